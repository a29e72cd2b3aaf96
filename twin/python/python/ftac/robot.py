"""A robot of your own as a backend of the trials: ``ftac trial 1 --robot my_robot.py:MyRobot``.

A driver is a class with three methods, `Robot`. The program makes an object of it in a process of its own, behind its safety supervisor, and asks it
for measurements and sends commands at the rate that the class states. The trial, its session and its replay are those of every other backend::

    from ftac.robot import Description, Measurement

    class MyRobot:
        def __init__(self, port="/dev/ttyUSB0"):          # --robot-arg port=/dev/ttyUSB1
            self.bus = MyBus(port)

        def describe(self):
            return Description(joints=[f"joint_{n}" for n in range(1, 8)], servos=["thumb", "index", "middle", "ring", "little", "opposition"], rate=100.0)

        def observe(self):
            return Measurement(servos=self.bus.servos(), arm=self.bus.arm())

        def send(self, command):
            self.bus.move(command.arm, command.servos)

The robot is a model of the program (``--robot-model FILE``, by default the F-TAC Hand on a Gen3): joints, servos and cameras are those of its files, by
name and in their order. Everything is in SI units and radians; the angle of a servo is 0 where the cable of the open digit is slack, and positive where
it winds the cable. A robot of LeRobot is wrapped by `from_lerobot`.

The supervisor limits commands (range, speed, acceleration, current, workspace) and checks measurements, and whether the arm follows; ``--config FILE`` changes its limits.
A class that raises, ends, answers late or returns what is no measurement stops the trial, with the reason. The program cannot stop a robot whose driver has failed: the
robot must then stand by itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ftac._lerobot_robot import Axis, from_lerobot

__all__ = ["Axis", "Command", "Description", "LockstepRobot", "Measurement", "PlacedObject", "Robot", "SceneRobot", "Verdict", "from_lerobot"]

Array = NDArray[np.float64]
Image = NDArray[np.uint8]


@dataclass(frozen=True)
class Description:
    """A robot. The program compares it with the robot model, and refuses one that differs."""

    joints: Sequence[str]
    """Names of the arm's joints, from the base outwards."""
    servos: Sequence[str]
    """Names of the hand's actuators: one for each digit, and the thumb's opposition if it has a servo of its own."""
    cameras: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    """Height and width of the images (pixels) by camera's name: none, or all of the hand's with 240 x 240."""
    rate: float = 120.0
    """How often the robot is measured and commanded, 20 to 500 Hz; 120 of a robot in lock-step. The controller's own ticks are 1/120 s: with a slower robot it waits."""
    senses_torque: bool = False
    """Whether the torques of `Measurement.arm` are measured. The supervisor then stops an arm that presses."""
    travel: Sequence[float] | None = None
    """Greatest angle of each servo, rad; None for that of the robot model."""


@dataclass(frozen=True)
class Measurement:
    """The newest measurements of a robot."""

    servos: ArrayLike
    """(n, 4), a row for each servo: angle (rad), speed (rad/s), current (A), temperature (degrees Celsius; a constant such as 25 of a servo that does not measure it)."""
    arm: ArrayLike
    """(m, 3), a row for each joint: angle (rad), speed (rad/s), torque (N m; 0 without a sensor)."""
    images: Mapping[str, Image] = field(default_factory=dict)
    """Images that were taken since the last measurement, (240, 240, 3) uint8 by camera's name. At least when `Command.capture` asked for them."""
    time: float | None = None
    """Time to which the times below refer, s; None for ``time.monotonic()`` when the measurement is returned."""
    servo_times: ArrayLike | None = None
    """(n,) When each servo was read, s; None for `time`. A reading that did not arrive is the old one with its old time: the supervisor stops the robot if it gets too old."""
    arm_time: float | None = None
    """When the arm was read, s; None for `time`."""
    image_times: Mapping[str, float] = field(default_factory=dict)
    """When images were taken, s; `time` for those that are not named."""


@dataclass(frozen=True)
class Command:
    """A command, within the supervisor's limits."""

    arm: Array
    """(m,) Set-point of each joint, rad."""
    servos: Array
    """(n, 2), a row for each servo: goal of its angle (rad), and the limit of its current (A), under which it may not reach the goal."""
    capture: bool = False
    """Whether an image of every camera is asked for."""


class Robot(Protocol):
    """A driver. Methods that it may have besides:

    - ``start()``: switches the torque on, at the present position; before the first command, with the operator's consent.
    - ``stop()``: no more commands follow. The arm stands, and the hand keeps its last goals.
    - ``close()``: the process ends.
    """

    def describe(self) -> Description | Mapping[str, Any]:
        """The robot; a mapping has the fields of `Description`."""
        ...

    def observe(self) -> Measurement:
        """The newest measurements. Together with `send` it has the time of a cycle, 1 / rate."""
        ...

    def send(self, command: Command) -> Command | None:
        """Sends a command. Returns the one that was really sent if the robot has limits of its own, and None if it is the same."""
        ...


class LockstepRobot(Robot, Protocol):
    """A driver whose time does not pass by itself: a simulation. It needs no wall clock, and the same trial gives the same bits."""

    def step(self) -> None:
        """Lets a control tick of 1/120 s pass, under the last command."""
        ...


@dataclass(frozen=True)
class PlacedObject:
    """An object of a trial in its place."""

    name: str
    pose: Array
    """``world_from_object``: x, y, z (m) and the quaternion x, y, z, w."""
    yaw: float
    """Turn about the vertical from its rest pose, rad."""

    @property
    def place(self) -> tuple[str, float, float, float]:
        """The same as `ftac.Scene` takes it: name, x, y (m), yaw (rad)."""
        return self.name, float(self.pose[0]), float(self.pose[1]), self.yaw


@dataclass(frozen=True)
class Verdict:
    """How a trial ended."""

    contact: bool
    """Whether a held object, a digit that holds it, or the palm touched the next object before its grasp had closed."""
    success: bool
    """Whether all objects were in the hand to the end."""
    cause: str | None = None
    """Of a failure: ``first_not_picked``, ``first_dropped``, ``second_not_picked``, ``second_dropped``, ``both_dropped``, ``slipped`` or ``unreachable``."""


class SceneRobot(LockstepRobot, Protocol):
    """A driver in lock-step that needs no operator: it lays out the objects, detects and judges them itself."""

    def lay_out(self, objects: Sequence[PlacedObject], trial: Mapping[str, int]) -> None:
        """Lays out the objects of a trial; before everything else. `trial` has ``combination``, ``trial`` and a ``seed`` for what is random."""
        ...

    def detect(self, name: str) -> ArrayLike | None:
        """``world_from_object`` (7,) of the object of this name now; None if it is hidden."""
        ...

    def judge(self) -> Verdict:
        """The verdict, after the trial."""
        ...
