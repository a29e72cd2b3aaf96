"""A robot of LeRobot as a driver; `ftac.robot` has the names for users."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from ftac.robot import Command, Description, Measurement, Robot


SPEED_WINDOW = 0.05
"""Time over which positions are differenced, s: over one cycle their resolution would look like speed."""


@dataclass(frozen=True)
class Axis:
    """A joint or a servo among the keys of a LeRobot robot: its angle (rad) is ``scale * value + offset``."""

    position: str
    """Key of its position in observations and actions, such as ``joint_1.pos``."""
    scale: float = math.pi / 180.0
    """rad per unit of the value; negative where the robot counts the other way."""
    offset: float = 0.0
    """rad."""
    velocity: str | None = None
    """Key of its speed, in units of the position per s; None to difference positions, over 0.05 s."""
    effort: str | None = None
    """Key of a joint's torque (N m) or of a servo's current (A)."""
    limit: str | None = None
    """Key of a servo's current limit (A) in actions."""
    stiffness: float | None = None
    """Of a servo without `limit`, A/rad: its current for each rad that it is behind its goal. Its goals then stay so near that it pulls no harder than the controller asks for;
    without `effort` its current is estimated from it too."""
    temperature: str | None = None
    """Key of a servo's temperature, degrees Celsius; None for 25."""


def from_lerobot(
    robot: Any,
    *,
    joints: Mapping[str, Axis],
    servos: Mapping[str, Axis],
    cameras: Mapping[str, str] | None = None,
    rate: float = 60.0,
    travel: Mapping[str, float] | None = None,
) -> Robot:
    """A LeRobot ``Robot`` (``get_observation``, ``send_action``) as a driver.

    Parameters
    ----------
    robot: connected here if it is not; it must have been calibrated (``lerobot-calibrate``).
    joints, servos: the axis of each joint and each servo by the robot model's name, in its order. A servo needs `Axis.limit` or `Axis.stiffness`.
    cameras: key of each camera's images by the robot model's name; the images must have 240 x 240 pixels.
    rate: see `Description`.
    travel: greatest angle of each servo, rad; None for that of the robot model.

    A file with a function is enough for ``--robot my_robot.py:my_robot``::

        def my_robot(port="/dev/ttyACM0"):
            robot = MyFollower(MyFollowerConfig(port=port, id="lab"))
            joints = {f"joint_{n}": Axis(f"joint_{n}.pos") for n in range(1, 8)}
            servos = {name: Axis(f"{name}.pos", stiffness=2.0) for name in ("thumb", "index", "middle", "ring", "little", "opposition")}
            return from_lerobot(robot, joints=joints, servos=servos)

    Keys of actions that no axis names are kept at the positions at which the robot was when it was connected.
    """
    return _LerobotDriver(robot, dict(joints), dict(servos), dict(cameras or {}), rate, travel)


class _LerobotDriver:
    def __init__(
        self,
        robot: Any,
        joints: dict[str, Axis],
        servos: dict[str, Axis],
        cameras: dict[str, str],
        rate: float,
        travel: Mapping[str, float] | None,
    ) -> None:
        self.robot, self.joints, self.servos, self.cameras = robot, joints, servos, cameras
        self.rate, self.travel = rate, travel
        self._check_keys()
        if not robot.is_connected:
            # Calibration asks people, whom this process cannot reach.
            robot.connect(calibrate=False)
        if not robot.is_calibrated:
            raise RuntimeError(f"{robot}: found a robot that is not calibrated, expected one after lerobot-calibrate")
        first = robot.get_observation()
        self._kept = {key: first[key] for key in self._unmapped()}
        self._past: deque[tuple[float, np.ndarray]] = deque()
        self._angles = self._positions(first)
        self._goals = self._angles.copy()
        self._capture = False

    def _axes(self) -> Iterator[tuple[str, Axis]]:
        yield from self.joints.items()
        yield from self.servos.items()

    def _unmapped(self) -> list[str]:
        """Keys of actions that no axis names."""
        mapped = {key for _, axis in self._axes() for key in (axis.position, axis.limit)}
        return [key for key in self.robot.action_features if key not in mapped]

    def _check_keys(self) -> None:
        observed, commanded = self.robot.observation_features, self.robot.action_features
        for name, axis in self._axes():
            for key in (axis.position, axis.velocity, axis.effort, axis.temperature):
                if key is not None and key not in observed:
                    raise ValueError(f"{name}: found no {key} among the observations, expected one of: {', '.join(observed)}")
            for key in (axis.position, axis.limit):
                if key is not None and key not in commanded:
                    raise ValueError(f"{name}: found no {key} among the actions, expected one of: {', '.join(commanded)}")
            if not (math.isfinite(axis.scale) and axis.scale != 0.0 and math.isfinite(axis.offset)):
                raise ValueError(f"{name}: found the scale {axis.scale} and the offset {axis.offset}, expected finite numbers, and a scale other than 0")
        for key in self._unmapped():
            if key not in observed:
                raise ValueError(f"{key}: found an action that no axis names and no observation has, expected an axis for it: where to keep it is not known")
        for name, axis in self.servos.items():
            if axis.stiffness is not None and not 0.0 < axis.stiffness < math.inf:
                raise ValueError(f"{name}: found the stiffness {axis.stiffness}, expected more than 0 A/rad")
            if axis.limit is None and axis.stiffness is None:
                raise ValueError(f"{name}: found neither limit nor stiffness, expected one of them: how hard it pulls must be limited")
            if axis.effort is None and axis.stiffness is None:
                raise ValueError(f"{name}: found neither effort nor stiffness, expected one of them: its current must be known")
        for name in self.servos:
            if self.travel is not None and name not in self.travel:
                raise ValueError(f"travel: found none of {name}, expected one of each servo: {', '.join(self.servos)}")
        for name, key in self.cameras.items():
            if key not in observed:
                raise ValueError(f"{name}: found no {key} among the observations, expected one of: {', '.join(observed)}")

    def describe(self) -> Description:
        from ftac.robot import Description

        sizes = {name: tuple(self.robot.observation_features[key][:2]) for name, key in self.cameras.items()}
        senses = all(axis.effort is not None for axis in self.joints.values())
        travel = None if self.travel is None else [self.travel[name] for name in self.servos]
        return Description(list(self.joints), list(self.servos), sizes, self.rate, senses, travel)

    def _positions(self, seen: Mapping[str, Any]) -> np.ndarray:
        return np.array([axis.scale * float(seen[axis.position]) + axis.offset for _, axis in self._axes()])

    def observe(self) -> Measurement:
        from ftac.robot import Measurement

        seen, now = self.robot.get_observation(), time.monotonic()
        angles = self._positions(seen)
        self._past.append((now, angles))
        while len(self._past) > 2 and self._past[1][0] <= now - SPEED_WINDOW:
            self._past.popleft()
        before, past = self._past[0]
        # A joint that turns freely may jump by a whole turn.
        differences = (np.mod(angles - past + np.pi, 2.0 * np.pi) - np.pi) / max(now - before, SPEED_WINDOW)
        self._angles = angles
        rows = []
        for (_, axis), angle, difference, goal in zip(self._axes(), angles, differences, self._goals):
            speed = difference if axis.velocity is None else axis.scale * float(seen[axis.velocity])
            if axis.effort is not None:
                effort = float(seen[axis.effort])
            else:
                effort = (axis.stiffness or 0.0) * (goal - angle)
            warmth = 25.0 if axis.temperature is None else float(seen[axis.temperature])
            rows.append((angle, speed, effort, warmth))
        count = len(self.joints)
        images = {name: seen[key] for name, key in self.cameras.items()} if self._capture else {}
        self._capture = False
        return Measurement(rows[count:], [measured[:3] for measured in rows[:count]], images, time=now)

    def send(self, command: Command) -> Command:
        from ftac.robot import Command

        self._capture |= command.capture
        goals, limits = np.concatenate([command.arm, command.servos[:, 0]]), command.servos[:, 1]
        action = dict(self._kept)
        for n, (_, axis) in enumerate(self._axes()):
            servo = n - len(self.joints)
            if servo >= 0 and axis.limit is not None:
                action[axis.limit] = float(limits[servo])
            elif servo >= 0 and axis.stiffness is not None:
                lead = limits[servo] / axis.stiffness
                goals[n] = np.clip(goals[n], self._angles[n] - lead, self._angles[n] + lead)
            action[axis.position] = float((goals[n] - axis.offset) / axis.scale)
        sent = {**action, **(self.robot.send_action(action) or {})}
        self._goals = self._positions(sent)
        count = len(self.joints)
        return Command(self._goals[:count].copy(), np.column_stack([self._goals[count:], limits]), command.capture)

    def close(self) -> None:
        if self.robot.is_connected:
            self.robot.disconnect()
