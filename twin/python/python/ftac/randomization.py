"""Domain randomisation: fields of the scenario and robot instances that every episode draws anew.

A field is named as in a scenario file, with dots: ``effects.cables.friction``, ``noise.perception.xy_sigma``, ``layout.spread_xy``. All fields below
``noise``, ``effects`` and ``layout`` can be drawn (`fields` lists them); the distribution is

- a pair of numbers ``(low, high)``: uniform between them;
- a list: one of its values, all alike; or
- a single value, which stays.

>>> Randomization({"effects.cables.friction": (0.5, 2.0), "effects.gel.shear": [0.3, 0.5]})  # doctest: +SKIP
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from ftac import _native
from ftac._arrays import whole


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
        for name, given in distributions.items():
            if isinstance(given, tuple):
                if len(given) != 2 or not all(isinstance(end, (int, float)) for end in given) or not given[0] <= given[1]:
                    raise ValueError(f"randomization.{name}: found {given!r}, expected (low, high), a list, or a value")
            elif isinstance(given, list) and not given:
                raise ValueError(f"randomization.{name}: found an empty list, expected values to choose from")
        self.distributions = dict(distributions)
        self.instances: tuple[int, int] | None = None
        if instances is not None:
            if len(instances) != 2:
                raise ValueError(f"robot_instances: found {instances!r}, expected the first and the last number")
            first = whole("robot_instances", instances[0], 0, 2**53)
            self.instances = (first, whole("robot_instances", instances[1], first, 2**53))

    def draw(self, random: np.random.Generator) -> tuple[str | None, int | None, dict[str, Any]]:
        """The fields as JSON, the robot instance, and both by name for people. Nothing is drawn where there is nothing to draw."""
        drawn = {name: _one(given, random) for name, given in self.distributions.items()}
        instance = None
        if self.instances is not None:
            instance = int(random.integers(self.instances[0], self.instances[1] + 1))
        told = drawn if instance is None else {**drawn, "robot_instance": instance}
        return (json.dumps(_tables(drawn)) if drawn else None), instance, told


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
        inner[field] = value
    return tables
