"""Recorded sessions as a data set: what ``ftac export lerobot`` runs.

An episode has the observations that a policy of the benchmark gets in the session's trial, and the actions that lead to the commands of the session, as
`ftac.lerobot.trials` makes them. Images are updated as often as the trial's controller took them, and repeat in between. Before the first ones
the pads are shown as they are untouched.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ftac import _native
from ftac._arrays import whole
from ftac.lerobot.layout import Layout
from ftac.lerobot.trials import SPEC, episode_of
from ftac.lerobot.video import Quality
from ftac.lerobot.writer import Writer


def export(
    sessions: Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    images: int = 64,
    *,
    video: Quality = "lossless",
    quiet: bool = False,
) -> dict[str, Any]:
    """Writes `sessions` (MCAP) of one robot as the data set `out`, a folder that must not exist, with images of `images` x `images` pixels.

    Returns ``dataset``, ``episodes``, ``frames`` and ``bytes``. `ValueError` for anything that is no session of two objects on the F-TAC Hand; nothing is left
    of the data set then.
    """
    images = whole("images", images, 16, 240)
    if not sessions:
        raise ValueError("sessions: found none, expected at least one")
    spec = replace(SPEC, images=images)
    robot, writer = None, None
    unfinished = []
    try:
        for number, path in enumerate(sessions):
            steps = _native.session(Path(path), images)
            if robot is None:
                robot = steps["robot"]
                objects, joints = len(steps["detected"]), steps["arm"].shape[1]
                made = {"sessions": len(sessions), "robot": robot}
                writer = Writer(Path(out), Layout(spec, objects, joints), video=video, robot=f"ftac_gen3_{robot}", made=made)
            if steps["robot"] != robot:
                raise ValueError(f"{path}: robot: found {steps['robot']}, expected {robot} as in the first session")
            outcome = json.loads(steps["outcome"]) if steps["outcome"] else {}
            if not outcome:
                unfinished.append(Path(path).name)
            assert writer is not None
            episode = episode_of(steps, spec, bool(outcome.get("success", False)))
            episode.about |= {"clean_success": bool(outcome.get("clean_success", False)), "condition": str(outcome.get("condition", ""))}
            try:
                writer.add(episode)
            except ValueError as error:
                raise ValueError(f"{path}: {error}") from None
            if writer.is_full():
                writer.finish_file()
            if not quiet:
                print(f"\r{number + 1} of {len(sessions)} sessions", end="", file=sys.stderr, flush=True)
        if not quiet:
            print(file=sys.stderr)
        if unfinished:
            print(f"no outcome, because the trial did not end; exported as no success: {', '.join(unfinished)}", file=sys.stderr)
        assert writer is not None
        return writer.finish()
    except BaseException:
        if writer is not None:
            writer.abandon()
        raise
