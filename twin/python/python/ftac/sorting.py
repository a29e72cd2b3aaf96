"""An environment in which objects are recognised by touch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ftac._arrays import known_names, whole
from ftac.envs import Pick
from ftac.features import STEP, Observation
from ftac.grasps import pick_one
from ftac.randomization import Randomization
from ftac.scripted import LIFT, STAGE_TIMEOUT, Script

Array = NDArray[np.float64]

BALLS_CYLINDERS_BOXES = (("ball_45", "ball_50"), ("cylinder_45", "can_50"), ("cube_45", "box_50"))
"""Three shapes of nearly one size."""
ANY_SIZE = {"effects.objects.size_sigma": 0.1, "effects.objects.mass_sigma": 0.3}
"""`Randomization` by which objects differ in size and weight (standard deviations), so that a few objects cannot be told apart by how far the digits close and how heavy they are."""
MOST_CLASSES = 4
MOST_TRIES = 64
"""Pick-ups that may fail in a row before an episode cannot begin."""


class Sort(Pick):
    """An object is picked up and held over the bin of its class. No observation says which class it is; the tactile images show its shape.

    Observations, actions and parameters are those of `Pick` with one object, but for these: ``shape`` is all 0, for unknown; the planned grasp of
    ``grasp`` is the same for all objects; ``identity``, ``combination`` and ``objects`` are no parameters. The bins are in a row beside the object, in the
    order of the classes (`bins`).

    Terminated when the object has been held still over a bin for `HOLD_TIME`, in the right one with ``is_success``, or has left the table. The rewards are
    those of `Pick`, with ``success`` for the right bin and ``lost`` for a wrong one. ``info`` of `reset` has the number of the object's ``class``.

    With ``in_hand`` an episode begins after the pick-up, which `ftac.scripted.Script` carries out; what it drops is not used.

    Parameters
    ----------
    classes: names of the objects of each class; two to four classes. Each class is drawn alike, and each object of it.
    grasp_of: name of the object whose planned grasp (`ftac.grasps.pick_one`) is used for all of them.
    in_hand: whether an episode begins with the object lifted.
    options: of `Pick`. With ``randomization=ANY_SIZE`` the objects of a class have all sizes.
    """

    _OWN_STATE = ("class_of_object", "_steps_over")
    HOLD_TIME = 1.0
    """Time over a bin that decides, s."""
    TOLERANCE = 0.05
    """Horizontal distance of the object from a bin's middle that counts as over it, m."""
    STILL = 0.05
    """Speed below which the object counts as held there, m/s: the way to one bin may lead over another."""
    ROW: Array = np.array([[0.60, 0.02], [0.60, -0.22]])
    """Middles of the first and the last bin: x, y, m, world."""

    def __init__(
        self,
        *,
        classes: Sequence[Sequence[str]] = BALLS_CYLINDERS_BOXES,
        grasp_of: str = "lemon",
        in_hand: bool = False,
        **options: Any,
    ) -> None:
        for name in ("task", "identity", "combination", "objects"):
            if options.get(name, False) is not False and options[name] is not None:
                raise ValueError(f"{name}: found {options[name]!r}, expected none for an environment in which the object is unknown")
        if isinstance(classes, str) or not 2 <= len(classes) <= MOST_CLASSES:
            raise ValueError(f"classes: found {classes!r}, expected the names of the objects of two to {MOST_CLASSES} classes")
        self.classes = [[str(name) for name in ([] if isinstance(one, str) else one)] for one in classes]
        names = [name for one in self.classes for name in one]
        if not all(self.classes) or len(set(names)) < len(names):
            raise ValueError(f"classes: found {classes!r}, expected one name at least in each, and each name once")
        if grasp_of not in pick_one():
            raise ValueError(f"grasp_of: found {grasp_of!r}, expected one of {', '.join(pick_one())}")
        super().__init__("pick_one", **options)
        known_names("classes", names, self._all_objects())
        self.grasp_of, self.in_hand = grasp_of, bool(in_hand)
        self.bins: Array = np.linspace(self.ROW[0], self.ROW[1], len(self.classes))
        """Middles of the bins, (classes, 2): x, y, m, world."""
        self.class_of_object = 0
        """Number of the present object's class. No policy may know it."""
        self._asked: int | None = None
        self._steps_over = np.zeros(len(self.classes), dtype=np.int64)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """As `Pick.reset`; ``options`` may have the number of the ``class``, and ``randomization``."""
        observation, info = super().reset(seed=seed, options=options)
        tries = 1
        while self.in_hand and not self._lift():
            if tries == MOST_TRIES:
                raise RuntimeError(f"in_hand: found {tries} pick-ups of class {self.class_of_object} that fail, expected one that holds")
            tries += 1
            observation, info = super().reset(options=options)
        if self.in_hand:
            observation = self._observe()
        return observation, {**info, "class": self.class_of_object}

    def _lift(self) -> bool:
        """Carries out the planned pick-up; whether the object is in the hand at its end."""
        assert self._episode is not None and self.features is not None
        driver = self.features.copy()
        driver.spec = replace(driver.spec, arm="twist", hand="tension_steps")
        script = Script(driver)
        held = [False]
        while script.stage < LIFT or script.clock < STAGE_TIMEOUT:
            action = script.act(driver.observe(self._episode.observe(False), False))
            held, terms, _, lost = self._episode.step(driver.act(action))
            if lost:
                return False
            self._progress = np.array(terms)
        self.features.begin(driver.tensions, driver.opposition)
        return bool(held[0])

    def _options(self, options: dict[str, Any] | None) -> tuple[int | None, list[str], Randomization]:
        given = dict(options or {})
        for name in given:
            if name not in ("class", "randomization"):
                raise ValueError(f"options: found {name!r}, expected some of 'class', 'randomization'")
        self._asked = whole("class", given.pop("class"), 0, len(self.classes) - 1) if "class" in given else None
        return super()._options(given)

    def _draw_objects(self, objects: list[str]) -> list[str]:
        drawn = int(self.np_random.integers(len(self.classes)))
        self.class_of_object = drawn if self._asked is None else self._asked
        self._steps_over[:] = 0
        names = self.classes[self.class_of_object]
        return [names[int(self.np_random.integers(len(names)))]]

    def _known(self, names: list[str], shape: ArrayLike) -> tuple[list[str], ArrayLike]:
        return [self.grasp_of] * len(names), np.zeros_like(shape)

    def _judge(
        self, judged: tuple[list[bool], list[float], bool, bool]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        held, terms, _, lost = judged
        assert self._episode is not None
        true = self._episode.true_state()
        still = held[0] and float(np.linalg.norm(true["velocities"][0])) < self.STILL
        over = (np.linalg.norm(self.bins - true["objects"][0, :2], axis=1) < self.TOLERANCE) & still
        self._steps_over = np.where(over, self._steps_over + 1, 0)
        decided = STEP * self._steps_over > self.HOLD_TIME - 0.5 * STEP
        right = bool(decided[self.class_of_object])
        return super()._judge((held, terms, right, lost or bool(decided.any() and not right)))
