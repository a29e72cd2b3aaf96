"""Demonstrations: clean trials of the built-in policy ``touch`` with two objects, as a data set with a card. What ``ftac demonstrations`` runs.

Trials run in the order of their numbers, each combination once before any of them has its next trial; the clean ones become episodes. The data set is therefore
the same with any number of threads, and after a continuation. Images are asked for in every step, 20 times a second; while the controller takes its own, an
image may stand still for a step.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ftac import _native
from ftac._arrays import seed_of, whole
from ftac.lerobot import card
from ftac.lerobot.layout import ACTION, Layout
from ftac.lerobot.ordered import in_order
from ftac.lerobot.progress import Progress
from ftac.lerobot.trials import SPEC, replay, trial
from ftac.lerobot.video import Quality, measured_loss
from ftac.lerobot.writer import Episode, Writer

TRIALS_IN_FILE = 20
"""Trials whose clean ones share the data set's files; an interrupted run continues after the last file."""
REPLAYED = 40
"""Episodes whose actions are repeated for the card."""
Ran = tuple[Episode | None, dict[str, Any]]


def demonstrations(
    episodes: int,
    out: str | os.PathLike[str],
    *,
    seed: int = 1,
    images: int = 64,
    combinations: int = 60,
    jobs: int | None = None,
    video: Quality = "lossless",
    minutes: float | None = None,
    replayed: int = REPLAYED,
    quiet: bool = False,
) -> dict[str, Any]:
    """Writes `episodes` clean trials as the data set `out`, a folder that must not exist.

    An interrupted call leaves the finished files in ``OUT.partial``, and the same call continues after them.

    Parameters
    ----------
    seed: of the trials (as ``ftac bench --seed``).
    images: side of the tactile images, pixels, an even number.
    combinations: trials are those of the benchmark's first so many combinations.
    jobs: threads; None for one a core.
    video: ``lossless``, or a constant rate factor (`ftac.lerobot.video`).
    minutes: time after which the data set is completed with the episodes so far, one at least; None for no limit.
    replayed: number of episodes, evenly distributed, whose actions are repeated blindly for the card.
    """
    episodes, seed = whole("episodes", episodes, 1, 1_000_000), seed_of(seed)
    images = whole("images", images, 16, 240)
    combinations = whole("combinations", combinations, 1, len(_native.combinations()))
    jobs = os.cpu_count() or 1 if jobs is None else whole("jobs", jobs, 1, 1024)
    replayed = whole("replayed", replayed, 0, 1_000_000)
    spec = replace(SPEC, images=images)
    made = {"trials": "touch", "seed": seed, "combinations": combinations}
    writer = Writer(Path(out), Layout(spec, 2), video=video, made=made, resume=True)
    began, benchmark = time.monotonic(), _native.Benchmark(seed)
    facts = writer.resumed_facts()
    done = _Counts(writer, facts, episodes, quiet)

    def over() -> bool:
        return minutes is not None and time.monotonic() - began > 60.0 * minutes

    try:
        while writer.episodes < episodes and not (over() and writer.episodes):
            first = TRIALS_IN_FILE * len(facts)
            numbers = range(first, first + TRIALS_IN_FILE)
            started, trials, clean = time.monotonic(), 0, 0
            loss = {"error": 0.0, "signal": 0.0}
            for episode, _ in _in_order(benchmark, numbers, combinations, spec, jobs):
                trials += 1
                if episode is not None:
                    clean += 1
                    writer.add(episode)
                    if clean == 1 and video != "lossless":
                        loss = measured_loss(episode.images, writer.video)
                done.show()
                if writer.episodes == episodes or (over() and writer.episodes):
                    break
            fact = {"trials": trials, "clean": clean, "seconds": time.monotonic() - started, **loss}
            writer.finish_file(**fact)
            facts.append(fact)
        total = {name: sum(fact[name] for fact in facts) for name in ("trials", "clean", "seconds")}
        again = _replay(benchmark, writer, spec, replayed)
        measured = [fact for fact in facts if fact["clean"]]
        lost = {name: sum(fact[name] for fact in measured) / max(len(measured), 1) for name in ("error", "signal")}
        told = card.write(writer, spec, {**made, **total, **lost, "jobs": jobs, **again, "video": video, "episodes_asked": episodes})
        return {**writer.finish(told), **total, **again}
    except BaseException:
        writer.abandon(keep_finished=True)
        raise
    finally:
        done.end()


def _in_order(benchmark: _native.Benchmark, numbers: range, combinations: int, spec: Any, jobs: int) -> Iterator[Ran]:
    """Runs trials on `jobs` threads and yields them in their order; no more wait than there are threads."""
    questions = ((benchmark, number % combinations, number // combinations, spec) for number in numbers)
    yield from in_order(ThreadPoolExecutor(jobs), trial, questions, jobs)


def _replay(benchmark: _native.Benchmark, writer: Writer, spec: Any, most: int) -> dict[str, Any]:
    """Repeats the actions of some episodes: how many were repeated, succeed, and succeed cleanly."""
    chosen = sorted(set(np.linspace(0, len(writer.rows) - 1, min(most, len(writer.rows))).astype(int).tolist()))
    records = [replay(benchmark, spec, writer.rows[n], writer.vector_of(n, ACTION)) for n in chosen]
    count = {name: sum(bool(record[name]) for record in records) for name in ("success", "clean_success")}
    return {"replayed": len(records), "replayed_success": count["success"], "replayed_clean_success": count["clean_success"]}


class _Counts:
    """Progress: episodes, trials, pace and remaining time."""

    def __init__(self, writer: Writer, facts: list[dict[str, Any]], asked: int, quiet: bool) -> None:
        self._writer, self._asked, self._progress = writer, asked, Progress(quiet)
        self._before, self._trials = sum(fact["trials"] for fact in facts), 0
        self._since = time.monotonic()
        self._begun = writer.episodes
        if facts and not quiet:
            print(f"continues after {writer.episodes} episodes of {self._before} trials", file=sys.stderr)

    def show(self) -> None:
        """Tells the progress after a trial."""
        self._trials += 1
        new = self._writer.episodes - self._begun
        pace = (time.monotonic() - self._since) / max(new, 1)
        left = pace * (self._asked - self._writer.episodes)
        line = f"{self._writer.episodes} of {self._asked} episodes, {self._before + self._trials} trials, {pace:.1f} s an episode, {left / 60.0:.0f} min left"
        self._progress.tell(line, self._writer.episodes == self._asked)

    def end(self) -> None:
        """Ends the line."""
        self._progress.end()
