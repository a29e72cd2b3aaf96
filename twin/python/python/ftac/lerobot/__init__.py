"""Data sets in LeRobot's format v3.0: environment episodes, recorded sessions, and demonstrations.

All of them have the observations and actions of `ftac.features`, at 20 Hz, under LeRobot's keys (`ftac.lerobot.layout`): ``observation.state``,
``observation.environment_state`` (what is to be reached for), ``observation.images.<pad>``, ``action``. A policy trained on such data plays in the environments
and in the benchmark by `PolicyAdapter`.

- `record` runs episodes of an environment: `Writer` and `Recorder` write those of a loop of your own.
- `export` writes recorded sessions: ``ftac export lerobot``.
- `demonstrations` runs trials of the built-in policy ``touch`` and keeps the clean ones: ``ftac demonstrations``.

Each frame has an observation and the action that follows it. ``next.done`` and ``next.success`` are true in an episode's last frame, the latter if the task was done;
``next.reward`` is the reward of an environment. ``meta/ftac.json`` has the choice of observations and actions. Statistics
(`ftac.lerobot.statistics`) are exact and have quantiles. Video is lossless unless something else is asked for (`ftac.lerobot.video`).

It needs ``pyarrow`` and ``av``: ``pip install 'ftac[lerobot]'``.
"""

from __future__ import annotations

from ftac.lerobot.adapter import PolicyAdapter
from ftac.lerobot.demonstrations import demonstrations
from ftac.lerobot.episodes import Recorder, Taught, record
from ftac.lerobot.layout import Layout
from ftac.lerobot.sessions import export
from ftac.lerobot.writer import Episode, Writer

__all__ = ["Episode", "Layout", "PolicyAdapter", "Recorder", "Taught", "Writer", "demonstrations", "export", "record"]
