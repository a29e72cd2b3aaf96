"""A robot of one's own behind a driver: the simulation, as if it were a robot that the program does not know.

    ftac trial 1 --robot my_robot.py:SimulatedHand
    ftac trial 1 --robot my_robot.py:SimulatedHand --robot-arg images=false --policy reflex
    ftac bench --robot my_robot.py:SimulatedHand --combos 2 --trials 2

`SimulatedHand` has a method ``step``, so it runs in lock-step, and it lays out, detects and judges the objects itself. `RealTimeHand` is the same hand on
the wall clock: an operator is asked, as with a real robot. For a driver of real devices, replace the scene by their library; see ``help(ftac.robot)``.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

import ftac
from ftac.robot import Command, Description, Measurement, PlacedObject, Verdict

LIFTED = 0.05
"""Height above its place on the table at which an object counts as lifted, m."""


class SimulatedHand:
    """Arm, hand and objects in a scene.

    Parameters
    ----------
    images: whether the hand has cameras.
    reality: whether covers give way and cables rub, as in the benchmark.
    robot_model: file of another robot (``--robot-model``).
    """

    def __init__(self, images: bool = True, reality: bool = True, robot_model: str | None = None) -> None:
        self.options: dict[str, Any] = {"images": 240 if images else None, "reality": reality, "robot_model": robot_model}
        self._begin([], 0)

    def _begin(self, places: Sequence[ftac.scene.Place], seed: int) -> None:
        self.scene = ftac.Scene(places, seed=seed, **self.options)
        self.measured = self.scene.observe()
        self.command: Command | None = None
        self.images: dict[str, tuple[float, Any]] = {}
        self.rest = self.scene.true_state()["objects"][:, 2]
        self.lifted = np.zeros(len(places), dtype=bool)
        self.contact = False

    def describe(self) -> Description:
        names = self.scene.names
        cameras = {name: (240, 240) for name in names["cameras"]} if self.options["images"] else {}
        return Description(names["joints"], names["servos"], cameras, senses_torque=True)

    def observe(self) -> Measurement:
        # The scene's servos do not measure their temperature.
        servos = np.column_stack([self.measured["servos"], np.full(len(self.measured["servos"]), 30.0)])
        images, self.images = self.images, {}
        return Measurement(
            servos,
            self.measured["arm"],
            images={name: image for name, (_, image) in images.items()},
            image_times={name: taken for name, (taken, _) in images.items()},
            time=self.measured["time"],
        )

    def send(self, command: Command) -> None:
        self.command = command

    def step(self) -> None:
        if self.command is None:
            arm, servos, capture = self.measured["arm"][:, 0], np.zeros((len(self.measured["servos"]), 2)), False
        else:
            arm, servos, capture = self.command.arm, self.command.servos, self.command.capture
        self.measured = self.scene.tick(arm, servos, capture)
        # An image is asked for once.
        self.command = Command(arm, servos)
        self.images |= self.measured.pop("frames")
        self._note_contact()

    def lay_out(self, objects: Sequence[PlacedObject], trial: Mapping[str, int]) -> None:
        self.names = [placed.name for placed in objects]
        self._begin([placed.place for placed in objects], trial["seed"])

    def detect(self, name: str) -> Any:
        return self.scene.true_state()["objects"][self.names.index(name)]

    def judge(self) -> Verdict:
        """Whether all objects are in the air and in the hand. Contacts are those of palm and links; objects that touch each other are not noticed."""
        touching = self._touching()
        held = [bool(touching[n]) and self._height(n) > LIFTED for n in range(len(self.rest))]
        if all(held):
            return Verdict(self.contact, True)
        lost = held.index(False)
        return Verdict(self.contact, False, f"{('first', 'second')[lost]}_{'dropped' if self.lifted[lost] else 'not_picked'}")

    def _height(self, n: int) -> float:
        return float(self.scene.true_state()["objects"][n, 2] - self.rest[n])

    def _touching(self) -> list[set[int]]:
        """Links that touch each object; -1 is the palm."""
        contacts = self.scene.true_state()["contacts"]
        return [set(contacts[contacts[:, 0] == n, 1].astype(int)) for n in range(len(self.rest))]

    def _note_contact(self) -> None:
        """Notes that the palm, or a link that holds the first object, touches the second one before two others grasp it."""
        heights = self.scene.true_state()["objects"][:, 2] - self.rest
        self.lifted |= heights > LIFTED
        if len(self.rest) == 2 and self.lifted[0] and not self.lifted[1]:
            first, second = self._touching()
            holding = first | {-1}
            self.contact |= bool(second & holding) and len(second - holding) < 2


class RealTimeHand(SimulatedHand):
    """The same hand on the wall clock, with `objects` in their places: name, x, y (m), and turn about the vertical (rad).

    ftac trial 1 --robot my_robot.py:RealTimeHand --robot-arg objects='[["tennis_ball", 0.62, 0.14, 0], ["cylinder_45", 0.62, -0.14, 0]]' --policy blind
    """

    step = None

    def __init__(self, objects: Sequence[ftac.scene.Place] = (), images: bool = False) -> None:
        super().__init__(images)
        self._begin(objects, 0)
        self.begun: float | None = None

    def describe(self) -> Description:
        # The scene catches up with the clock in jumps, which the supervisor would take for pushes.
        return replace(super().describe(), senses_torque=False)

    def observe(self) -> Measurement:
        now = time.monotonic()
        self.begun = now if self.begun is None else self.begun
        while self.measured["time"] < now - self.begun:
            super().step()
        return super().observe()
