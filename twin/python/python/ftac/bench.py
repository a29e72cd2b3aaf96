"""Your own policy in the trials of the multi-object benchmark.

A policy chooses how the second object is taken once the first is in the hand, and what follows when that was tried; or it moves the robot itself. It
is told what the built-in policies know: measurements, tactile images, what vision reports and what touch makes of it. It is not told how the scene
really is. Simulated time stands while it thinks, unless something else is asked for.

`run` uses an object of this process. The command ``ftac bench --policy my_policy.py:MyPolicy`` uses a class, as a condition of the whole
benchmark, on any body and with as many threads as there are cores.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from ftac import _native
from ftac._arrays import seed_of, whole
from ftac._rows import Rows
from ftac._rows import rates as _rates
from ftac.grasps import PickUp

Array = NDArray[np.float64]
Aim = tuple[float, float, float]
CONDITIONS = ("ideal", "blind", "reflex", "touch")
"""Conditions of the benchmark: no errors and the plan carried out; errors and the plan; the built-in policy without images; with them."""
Answer = int | tuple[int, Aim] | None


@dataclass(frozen=True)
class Situation:
    """What a policy knows when it is asked. Poses are seven numbers (see `ftac`)."""

    phase: Literal["decide", "confirm"]
    """``decide``: the first object should be in the hand. ``confirm``: the second has been tried and lifted."""
    time: float
    """The robot's clock, s."""
    time_left: float
    """Until the trial has failed, s."""
    tries: int
    """Tries at the second object so far."""
    servos: Array
    """(6, 3): output angle (rad), speed (rad/s), current (A)."""
    arm: Array
    """(7, 3): joint angle (rad), speed (rad/s), torque (N m)."""
    palm: Array
    """``world_from_palm`` as commanded."""
    tactile: dict[str, NDArray[np.uint8]]
    """Images (240, 240, 3) of the last look by camera's name; a camera that has sent none is missing."""
    untouched: dict[str, NDArray[np.uint8]]
    """Images (240, 240, 3) of all cameras before anything touched their pads, by name: what `ftac.touch.surface` compares with."""
    objects: tuple[str, str]
    """Names of the first and the second object."""
    detected: Array
    """(2, 7): ``world_from_object`` of both where vision saw them last, with its error."""
    yaws: tuple[float, float]
    """Their turns about the vertical from the rest pose, as detected, rad."""
    second_is_visible: bool
    """True if the second object is in the newest detection."""
    in_hand: Array | None
    """``palm_from_object`` of the first object as felt after its lift."""
    in_hand_covariance: Array | None
    """Of that, (6, 6): position (m) and rotation vector (rad)."""
    holding: tuple[bool, bool]
    """For each object, True if the measurements say that it is in the hand."""
    first: PickUp
    """The grasp that took the first object."""
    candidates: tuple[PickUp, ...]
    """Grasps of the second object, the planned one first."""
    scores: Array
    """The plan's probability of success of each candidate."""

    def __getattr__(self, name: str) -> Any:
        if name not in _FORMER_FIELDS:
            raise AttributeError(f"Situation has no field {name!r}")
        warnings.warn(f"Situation.{name} is now called {_FORMER_FIELDS[name]}", DeprecationWarning, stacklevel=2)
        return getattr(self, _FORMER_FIELDS[name])


_FORMER_FIELDS = {
    "seen": "detected",
    "sees_second": "second_is_visible",
    "held": "in_hand",
    "held_covariance": "in_hand_covariance",
    "grip": "holding",
    "worth": "scores",
}


class Chooser(Protocol):
    """A policy that chooses how the second object is taken.

    A method ``reset(info)``, if there is one, is told before a trial is decided: ``combination``, ``trial``, ``objects`` (names), ``yaws`` (their turns as
    detected, rad) and a ``seed`` for what is random in the policy.
    """

    def choose(self, situation: Situation) -> Answer:
        """The place of one of ``situation.candidates``; or that and how far beside the place where the object is seen it aims: x and y (m, world; up to
        0.1) and the turn about the vertical (rad). None keeps what is in the hand: the second object is left alone if it has not been tried.

        An exception fails the trial; its traceback is the record's ``reason``.
        """
        ...


class Actor(Protocol):
    """A policy that moves the robot itself, from the beginning of a trial: ``reset`` is as in `Chooser`.

    An attribute ``features``, if there is one, is the choice of its observations and actions: a `ftac.features.Spec`, or a dictionary of its fields. They have
    the same keys, shapes and scales as those of the environments and of exported data. With images, ``reset`` is told the pictures of the untouched pads
    too: ``untouched``, (17, n, n, 3).
    """

    def act(self, observation: dict[str, Any]) -> NDArray[np.floating[Any]] | None:
        """The action of the next 1/20 s (see `ftac.features`), or None if the policy has finished.

        The observation is that of ``ftac/PickTwo-v1`` with the same features, and ``time_left`` (s). The trial succeeds once both objects have been held up
        for the benchmark's time: it is over then. An exception, or a value that is not a number, fails it.
        """
        ...


Policy = Chooser | Actor


def run(
    policy: Policy,
    *,
    combinations: Iterable[int] | None = None,
    trials: int = 1,
    seed: int = 1,
    beside: Sequence[str] = (),
    wall: bool = False,
) -> Rows:
    """Runs trials of the benchmark and returns a list with a row for each, which ``pandas.DataFrame`` takes and a notebook shows as a table.

    Parameters
    ----------
    policy: chooses how the second object is taken, or moves the robot.
    combinations: numbers of combinations (`ftac.combinations`); None for all 60.
    trials: of each combination.
    seed: of everything random. 1 is the benchmark's seed of development, 11 to 14 are those that nothing was developed on.
    beside: conditions that run on the same trials with the same errors: ``ideal``, ``blind``, ``reflex``, ``touch``.
    wall: as much simulated time passes while the policy thinks as on the wall. Results depend on the computer then.

    A row has the columns of the benchmark's ``trials.csv``, among them ``success``, ``contact``, ``clean_success``, ``cause``, ``reason`` and ``sim_seconds``; and
    ``policy``, the class's name or the condition.
    """
    # It needs what is defined here.
    from ftac.policy_host import Host

    host = Host(policy)
    trials, seed = whole("trials", trials, 1, 1_000_000), seed_of(seed)
    beside = [beside] if isinstance(beside, str) else list(beside)
    unknown = [name for name in beside if name not in CONDITIONS]
    if unknown:
        raise ValueError(f"beside: found {unknown[0]!r}, expected some of {', '.join(CONDITIONS)}")
    count = len(_native.combinations())
    if combinations is not None and (isinstance(combinations, str) or not isinstance(combinations, Iterable)):
        raise ValueError(f"combinations: found {combinations!r}, expected a list of numbers")
    numbers = range(count) if combinations is None else [whole("combination", n, 0, count - 1) for n in combinations]
    benchmark, introduction, rows = _benchmark(seed), json.dumps(host.introduction()), Rows()
    for combination in numbers:
        for trial in range(trials):
            rows.append(_row(benchmark.run(host, introduction, wall, combination, trial), type(policy).__name__))
            rows.extend(_row(benchmark.condition(name, combination, trial), name) for name in beside)
    return rows


def play(*arguments: Any, **named: Any) -> Rows:
    """Former name of `run`."""
    warnings.warn("ftac.bench.play is now called run", DeprecationWarning, stacklevel=2)
    return run(*arguments, **named)


@lru_cache(maxsize=1)
def _benchmark(seed: int) -> _native.Benchmark:
    # Objects are made ready to be felt, which takes seconds.
    return _native.Benchmark(seed)


def rates(rows: Iterable[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """By policy: number of ``trials``, and the shares (0 to 1) with an unwanted ``contact``, a ``success`` and a ``clean_success``."""
    return _rates(rows)


def _row(record: str, policy: str) -> dict[str, Any]:
    row: dict[str, Any] = json.loads(record)
    del row["condition"]
    return {"policy": policy, **row}
