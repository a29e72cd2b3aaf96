"""Domain randomisation: fields of the scenario and robot instances that every episode draws anew.

A field is named as in a scenario file, with dots: ``effects.cables.friction``, ``noise.perception.xy_sigma``, ``layout.spread_xy``. All fields below
``noise``, ``effects`` and ``layout`` can be drawn (`fields` lists them); the distribution is

- a pair of numbers ``(low, high)``: uniform between them;
- a list: one of its values, all alike; a field that has several numbers itself is given in a list, ``{"layout.reach_x": [[0.5, 0.7]]}``; or
- a single value, which stays.

An effect that is off, as all are with ``reality=False``, has no value to begin with: all fields of its table have to be given.

>>> Randomization({"effects.cables.friction": (0.5, 2.0), "effects.gel.shear": [0.3, 0.5]})  # doctest: +SKIP
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from copy import deepcopy
from itertools import product
from typing import Any

import numpy as np

from ftac import _native
from ftac._arrays import mapping, whole


MOST_COMBINATIONS = 64
"""Combinations of the ends of ranges that are checked before an episode begins."""


def fields() -> dict[str, Any]:
    """The fields that can be drawn, with the benchmark's values."""
    found: dict[str, Any] = {}

    def add(path: str, value: Any) -> None:
        if isinstance(value, dict):
            for name, inner in value.items():
                add(f"{path}.{name}", inner)
        else:
            found[path] = value

    whole_scenario = json.loads(_native.benchmark_scenario())
    for name in ("noise", "effects", "layout"):
        add(name, whole_scenario[name])
    return found


class Randomization:
    """Distributions of the fields by name, and the range of robot instances. ``ValueError`` for what is no distribution."""

    def __init__(self, distributions: Mapping[str, Any], instances: tuple[int, int] | None = None) -> None:
        given = mapping("randomization", distributions, "distributions by the names of fields")
        self.distributions = {name: _distribution(name, values) for name, values in given.items()}
        self.instances: tuple[int, int] | None = None
        if instances is not None:
            if not isinstance(instances, Sequence) or isinstance(instances, str) or len(instances) != 2:
                raise ValueError(f"robot_instances: found {instances!r}, expected the first and the last number")
            first = whole("robot_instances", instances[0], 0, 2**53)
            self.instances = (first, whole("robot_instances", instances[1], first, 2**53))

    def check(self, setup: _native.Setup) -> None:
        """Compares both ends of each range, and each value of each list, with what the scenario of a setup allows: in all combinations where those are at most
        `MOST_COMBINATIONS`, else one field after another. ``ValueError`` for what it does not allow."""
        extremes = {name: list(given) if isinstance(given, (tuple, list)) else [given] for name, given in self.distributions.items()}
        first = {name: values[0] for name, values in extremes.items()}
        if np.prod([float(len(values)) for values in extremes.values()]) <= MOST_COMBINATIONS:
            every = [dict(zip(extremes, values)) for values in product(*extremes.values())]
        else:
            every = [first, *({**first, name: value} for name, values in extremes.items() for value in values[1:])]
        if extremes:
            _native.check_overrides(setup, [json.dumps(_tables(fields)) for fields in every])

    def draw(self, random: np.random.Generator) -> tuple[str | None, int | None, dict[str, Any]]:
        """The fields as JSON, the robot instance, and both by name for people. Nothing is drawn where there is nothing to draw."""
        drawn = {name: _one(given, random) for name, given in self.distributions.items()}
        instance = None
        if self.instances is not None:
            instance = int(random.integers(self.instances[0], self.instances[1] + 1))
        told = drawn if instance is None else {**drawn, "robot_instance": instance}
        return (json.dumps(_tables(drawn)) if drawn else None), instance, told


def _distribution(name: str, given: Any) -> Any:
    """`given` as plain numbers, lists and a pair. ``ValueError`` for what is no distribution."""
    if isinstance(given, tuple):
        ends = [_value(name, end) for end in given]
        if len(ends) != 2 or not all(isinstance(end, (int, float)) for end in ends) or not ends[0] <= ends[1]:
            raise ValueError(f"randomization.{name}: found {given!r}, expected (low, high), a list, or a value")
        return tuple(ends)
    if isinstance(given, list) or (isinstance(given, np.ndarray) and given.ndim > 0):
        if len(given) == 0:
            raise ValueError(f"randomization.{name}: found an empty list, expected values to choose from")
        return [_value(name, value) for value in given]
    return _value(name, given)


def _value(name: str, given: Any) -> Any:
    """A value of a field with the types of JSON."""
    if isinstance(given, (np.generic, np.ndarray)):
        given = given.tolist()
    if isinstance(given, Mapping):
        return {str(key): _value(f"{name}.{key}", value) for key, value in given.items()}
    if isinstance(given, (list, tuple)):
        return [_value(name, value) for value in given]
    if not isinstance(given, (bool, int, float, str)):
        raise ValueError(f"randomization.{name}: found {given!r}, expected a number")
    if isinstance(given, float) and not np.isfinite(given):
        raise ValueError(f"randomization.{name}: found {given}, expected a finite number")
    return given


def _one(given: Any, random: np.random.Generator) -> Any:
    if isinstance(given, tuple):
        return float(random.uniform(*given))
    return given[int(random.integers(len(given)))] if isinstance(given, list) else given


def _tables(drawn: Mapping[str, Any]) -> dict[str, Any]:
    """Nested tables of dotted names."""
    tables: dict[str, Any] = {}
    for name, value in drawn.items():
        *path, field = name.split(".")
        inner = tables
        for part in path:
            inner = inner.setdefault(part, {})
        inner[field] = deepcopy(value)
    return tables
