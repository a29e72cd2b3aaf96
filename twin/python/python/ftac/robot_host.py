"""Answers for a driver: ``python -m ftac.robot_host FILE.py:CLASS ARGUMENTS``, started by ``ftac trial --robot FILE.py:CLASS``.

A question is JSON, an answer is JSON with the images.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ftac._hosting import Bytes, Images, main
from ftac.robot import Array, Command, Description, Measurement, PlacedObject, Verdict

SCENE = ("lay_out", "detect", "judge")


class Host:
    """Answers for `robot` (see `ftac.robot.Robot`)."""

    def __init__(self, robot: Any) -> None:
        if isinstance(robot, type):
            raise ValueError(f"robot: found the class {robot.__name__}, expected an object of it: {robot.__name__}()")
        missing = [name for name in ("describe", "observe", "send") if not _has(robot, name)]
        if missing:
            raise ValueError(
                f"robot: found {type(robot).__name__} without {' and '.join(missing)}, "
                "expected an object with the methods describe(), observe() and send(command)"
            )
        self.robot, self.lockstep = robot, _has(robot, "step")
        scene = [name for name in SCENE if _has(robot, name)] if self.lockstep else []
        if scene and len(scene) < len(SCENE):
            raise ValueError(f"robot: found {type(robot).__name__} with {' and '.join(scene)}, expected all or none of {', '.join(SCENE)}")
        self.owns_scene = bool(scene)
        described = robot.describe()
        self.description = Description(**described) if isinstance(described, Mapping) else described
        if not isinstance(self.description, Description):
            raise TypeError(f"describe: found {type(described).__name__}, expected a Description, or a mapping with its fields")
        self.joints, self.servos = list(self.description.joints), list(self.description.servos)
        self.cameras = list(self.description.cameras)

    def introduction(self) -> dict[str, Any]:
        """The description, and what the class can do."""
        travel = self.description.travel
        return {
            "name": type(self.robot).__name__,
            "joints": [str(name) for name in self.joints],
            "servos": [str(name) for name in self.servos],
            "cameras": [(str(name), [int(side) for side in size]) for name, size in self.description.cameras.items()],
            "rate": float(self.description.rate),
            "senses_torque": bool(self.description.senses_torque),
            "travel": None if travel is None else [float(angle) for angle in travel],
            "lockstep": self.lockstep,
            "owns_scene": self.owns_scene,
        }

    def answer(self, question: dict[str, Any], arrays: Bytes) -> dict[str, Any] | tuple[dict[str, Any], Images]:
        """The answer to a question; ``{"error": traceback}`` if the driver raises an exception."""
        try:
            asked = question["ask"]
            if asked == "observe":
                return self._observe()
            if asked == "send":
                return self._send(question)
            if asked in SCENE:
                return self._scene(asked, question)
            # What a driver need not have.
            if _has(self.robot, asked):
                getattr(self.robot, asked)()
            return {}
        except Exception:
            return {"error": traceback.format_exc().strip()}

    def _observe(self) -> tuple[dict[str, Any], Images]:
        seen = self.robot.observe()
        if not isinstance(seen, Measurement):
            raise TypeError(f"observe: found {type(seen).__name__}, expected a Measurement")
        now = seen.time if seen.time is not None or self.lockstep else time.monotonic()
        servos = table("observe: servos", seen.servos, self.servos, ("angle", "speed", "current", "temperature"))
        arm = table("observe: arm", seen.arm, self.joints, ("angle", "speed", "torque"))
        times = [None] * len(self.servos) if seen.servo_times is None else row("observe: servo_times", seen.servo_times, self.servos).tolist()
        unknown = [name for name in (*seen.images, *seen.image_times) if name not in self.cameras]
        if unknown:
            raise ValueError(f"observe: images: found {unknown[0]!r}, expected one of: {', '.join(self.cameras) or 'none'}")
        images = [image(name, pixels, self.description.cameras[name]) for name, pixels in seen.images.items()]
        told = {
            "servos": servos.tolist(),
            "servo_ages": [_age(f"servo_times[{name}]", at, now) for name, at in zip(self.servos, times)],
            "arm": arm.tolist(),
            "arm_age": _age("arm_time", seen.arm_time, now),
            "images": [
                (self.cameras.index(name), _age(f"image_times[{name}]", seen.image_times.get(name), now)) for name in seen.images
            ],
        }
        return told, images

    def _send(self, question: dict[str, Any]) -> dict[str, Any]:
        sent = self.robot.send(Command(np.array(question["arm"]), np.array(question["servos"]), question["capture"]))
        if sent is None:
            return {}
        if not isinstance(sent, Command):
            raise TypeError(f"send: found {type(sent).__name__}, expected a Command or None")
        arm = row("send: arm", sent.arm, self.joints)
        return {"arm": arm.tolist(), "servos": table("send: servos", sent.servos, self.servos, ("goal", "current limit")).tolist()}

    def _scene(self, asked: str, question: dict[str, Any]) -> dict[str, Any]:
        if asked == "lay_out":
            objects = [PlacedObject(told["name"], np.array(told["pose"]), told["yaw"]) for told in question["objects"]]
            self.robot.lay_out(objects, question["trial"])
            return {}
        if asked == "detect":
            pose = self.robot.detect(question["object"])
            return {"pose": None if pose is None else row("detect", pose, ("x", "y", "z", "qx", "qy", "qz", "qw")).tolist()}
        verdict = self.robot.judge()
        if not isinstance(verdict, Verdict):
            raise TypeError(f"judge: found {type(verdict).__name__}, expected a Verdict")
        return {**asdict(verdict), "contact": bool(verdict.contact), "success": bool(verdict.success)}


def _has(robot: Any, name: str) -> bool:
    return callable(getattr(robot, name, None))


def _age(what: str, at: float | None, now: float | None) -> float:
    """Of a reading made at `at` when it was returned at `now`, s."""
    if at is None:
        return 0.0
    if now is None:
        raise ValueError(f"observe: {what}: found {at} s, but no time of the measurement, expected both")
    age = float(now) - float(at)
    if not age >= 0.0:
        raise ValueError(f"observe: {what}: found {at} s, expected no later than the measurement's time, {now} s")
    return age


def row(what: str, values: ArrayLike, names: list[str] | tuple[str, ...]) -> Array:
    """`values` as a finite number for each name. ``ValueError`` for anything else."""
    found = np.asarray(values, dtype=np.float64)
    if found.shape != (len(names),):
        raise ValueError(f"{what}: found shape {found.shape}, expected ({len(names)},)")
    if not np.isfinite(found).all():
        n = int(np.argmin(np.isfinite(found)))
        raise ValueError(f"{what}[{names[n]}]: found {found[n]}, expected a finite number")
    return found


def table(what: str, values: ArrayLike, names: list[str], columns: tuple[str, ...]) -> Array:
    """`values` as a row of finite numbers for each name. ``ValueError`` for anything else."""
    found = np.asarray(values, dtype=np.float64)
    if found.shape != (len(names), len(columns)):
        raise ValueError(f"{what}: found shape {found.shape}, expected ({len(names)}, {len(columns)}): {', '.join(columns)} of each")
    if not np.isfinite(found).all():
        n, column = np.argwhere(~np.isfinite(found))[0]
        raise ValueError(f"{what}[{names[n]}]: {columns[column]}: found {found[n, column]}, expected a finite number")
    return found


def image(name: str, pixels: Any, size: tuple[int, int]) -> Any:
    """`pixels` as an image of a camera. ``ValueError`` for anything else."""
    found, expected = np.asarray(pixels), (*size, 3)
    if found.dtype != np.uint8 or found.shape != expected:
        raise ValueError(f"observe: images[{name}]: found {found.dtype} of shape {found.shape}, expected uint8 of shape {expected}")
    return found


if __name__ == "__main__":
    main("robot", Host)
