"""The card of a data set of demonstrations: its README.md, in the form of Hugging Face's dataset cards."""

from __future__ import annotations

from collections import Counter
from typing import Any

import ftac
from ftac import features
from ftac.features import Spec
from ftac.lerobot.layout import ENVIRONMENT, IMAGES, STATE
from ftac.lerobot.video import FPS
from ftac.lerobot.writer import Writer


def command(facts: dict[str, Any], images: int) -> str:
    """The command that makes the same data set."""
    parts = {"--episodes": facts["episodes_asked"], "--seed": facts["seed"], "--images": images, "--combos": facts["combinations"]}
    options = " ".join(f"{name} {value}" for name, value in parts.items())
    return f"ftac demonstrations {options} --video {facts['video']}"


def write(writer: Writer, spec: Spec, facts: dict[str, Any]) -> str:
    """The card of the data set of `writer`, whose episodes are all there; `facts` are those of `ftac.lerobot.demonstrations`."""
    rows, frames, size = writer.rows, writer.frames, writer.bytes()
    count = len(rows)
    lengths = sorted(row["length"] / FPS for row in rows)
    per = Counter(tuple(row["objects"]) for row in rows)
    if facts["video"] == "lossless":
        stated = "lossless (libx264rgb, constant rate factor 0): every value of every image is that of the camera"
    else:
        stated = (
            f"H.264, yuv444p, constant rate factor {facts['video']}: a mean error of {facts['error']:.2f} grey levels where a contact changes the image, "
            f"which is {100.0 * facts['error'] / max(facts['signal'], 1e-9):.0f} % of that change ({facts['signal']:.1f} levels)"
        )
    names = writer.layout.names()
    keys = "\n".join(f"| `{key}` | {len(names[key])} | {', '.join(names[key])} |" for key in (STATE, ENVIRONMENT, "action"))
    objects = "\n".join(f"| {first} | {second} | {number} |" for (first, second), number in sorted(per.items()))
    replayed = facts["replayed"]
    repeated = (
        f"Actions at {FPS} Hz approximate the commands of the controller, which moves the robot at 120 Hz. Of {replayed} episodes whose actions were repeated "
        f"blindly in the same trial, {facts['replayed_success']} ended with both objects in the hand, {facts['replayed_clean_success']} of them cleanly."
        if replayed
        else f"Actions at {FPS} Hz approximate the commands of the controller, which moves the robot at 120 Hz. No episode was repeated."
    )
    return f"""---
license:
- mit
- apache-2.0
task_categories:
- robotics
tags:
- LeRobot
- tactile
- dexterous manipulation
- simulation
configs:
- config_name: default
  data_files: data/*/*.parquet
---

# Two objects in one tactile hand: {count} simulated demonstrations

The F-TAC Hand (15 joints, five cables, 17 camera-based tactile sensors) on a Kinova Gen3 arm picks up one object, then a second one beside it, and holds both. The
policy `touch` of the F-TAC twin, which decides by the tactile images, moves the robot. Every episode is a clean success: both objects are in the hand at
the end, and nothing has touched the second object before its grasp. All of it is simulated, with the errors and effects of the project's benchmark.

## How it was made

```sh
{command(facts, spec.images or 0)}
```

- Program: ftac {ftac.__version__}. Trials have seed {facts['seed']}, the first {facts['combinations']} combinations of the benchmark in turn. The same command makes the same episodes.
- {facts['trials']} trials were run, {count} clean successes are kept ({count / max(facts['trials'], 1):.3f}). It took {facts['seconds'] / 60.0:.0f} minutes with {facts['jobs']} threads.
- {repeated}

## Contents

LeRobot data set v3.0: {count} episodes, {frames} frames at {FPS} Hz ({frames / FPS / 3600.0:.2f} h), {size / 1e6:.0f} MB ({size / 1e6 / count:.2f} MB an episode). An episode takes
{lengths[0]:.0f} to {lengths[-1]:.0f} s, {lengths[len(lengths) // 2]:.0f} s in the median. Statistics are exact, with the quantiles q01, q10, q50, q90 and q99.

Observations and actions are those of the environment `ftac/PickTwo-v1` with `images={spec.images}, arm="{spec.arm}", hand="{spec.hand}", grasp=True`, from -1 to 1.
`meta/ftac.json` has this choice, so that `ftac.lerobot.PolicyAdapter` runs a trained policy in the environment, in the benchmark and on a robot.

| key | numbers | meaning |
|---|---|---|
{keys}

`{IMAGES}<pad>`: {len(writer.layout.pads)} tactile images of {spec.images} x {spec.images} pixels. They are asked for in every step, and are the newest that have arrived when
the step begins; while the controller takes its own, an image may stand still for a step. Before the first one an image shows the untouched pad. Video: {stated}.

`{ENVIRONMENT}` has what is to be reached for: the objects where the detector reported them at the start, with its error, their shapes, and for each the planned
grasp of this object alone (`ftac.grasps.pick_one`). The demonstrations use grasps for two objects, which may be others.

Scales: angles of the arm / pi, speeds / {features.ARM_SPEED} rad/s, torques / {features.ARM_TORQUE} N m; servos over their ranges, speeds / {features.SERVO_SPEED} rad/s, currents
/ {features.SERVO_CURRENT} A; positions / {features.REACH} m (near: {features.NEAR} m); time / {features.TIME} s. Actions: velocities x {features.SPEED} m/s and {features.TURN_SPEED} rad/s, tensions over 0 to {features.TENSION} N.

## Episodes of each combination

| first | second | episodes |
|---|---|---|
{objects}

## Limits

Nothing was recorded on a real robot. Only successes are included, so that the share of a combination is its ease. The policy knows the shapes of the objects.

## Licence

MIT or Apache-2.0, at your choice, as the program.
"""
