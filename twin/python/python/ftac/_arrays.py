"""Numbers as the native module takes them."""

from __future__ import annotations

import operator
import os
import reprlib
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ftac import _native


def real(what: str, values: Any) -> NDArray[Any]:
    """`values` as an array of real numbers of any kind and shape. ``ValueError`` for anything else."""
    try:
        array = np.asarray(values)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{what}: expected numbers: {error}") from None
    if array.dtype.kind == "c":
        raise ValueError(f"{what}: found complex numbers, expected real ones")
    if array.dtype.kind == "O":
        try:
            return array.astype(np.float64)
        except (TypeError, ValueError):
            pass
    if array.dtype.kind not in "fiub":
        raise ValueError(f"{what}: found {shortened(values)}, expected numbers")
    return array


shortened = reprlib.repr
"""`repr` of at most a few elements."""


def numbers(what: str, values: ArrayLike, length: int | None = None) -> NDArray[np.float64]:
    """`values` as a contiguous float64 vector, of `length` if given. ``ValueError`` for anything else."""
    array = np.ascontiguousarray(real(what, values), dtype=np.float64)
    if array.ndim != 1 or (length is not None and array.shape != (length,)):
        expected = "one dimension" if length is None else f"shape ({length},)"
        raise ValueError(f"{what}: found shape {array.shape}, expected {expected}")
    return array


def mapping(what: str, value: Any, expected: str) -> Mapping[str, Any]:
    """`value` as a mapping from names. ``ValueError`` for anything else."""
    if not isinstance(value, Mapping) or not all(isinstance(name, str) for name in value):
        raise ValueError(f"{what}: found {shortened(value)}, expected {expected}")
    return value


def number(what: str, value: Any, unit: str = "") -> float:
    """`value` as a finite number. ``ValueError`` for anything else."""
    try:
        found = float(value)
    except (TypeError, ValueError):
        found = float("nan")
    if isinstance(value, str) or not np.isfinite(found):
        raise ValueError(f"{what}: found {value!r}, expected a finite number{unit}")
    return found


def known_names(what: str, names: Iterable[str], known: Sequence[str]) -> None:
    """``ValueError`` for a name that is not among the known ones."""
    for name in names:
        if name not in known:
            near = get_close_matches(name, known, 3)
            raise ValueError(f"{what}: found {name!r}, expected one of {', '.join(near or known)}")


def whole(what: str, value: Any, low: int, high: int) -> int:
    """`value` as an int from `low` to `high`. ``ValueError`` for anything else; what is not whole is not rounded in silence."""
    try:
        found = operator.index(value)
    except TypeError:
        raise ValueError(f"{what}: found {value!r}, expected a whole number from {low} to {high}") from None
    if not low <= found <= high:
        raise ValueError(f"{what}: found {found}, expected {low} to {high}")
    return found


def seed_of(value: Any) -> int:
    """`value` as a seed."""
    return whole("seed", value, 0, 2**64 - 1)


def side_of(images: Any) -> int | None:
    """`images` as the side of tactile images, pixels, or None."""
    return None if images is None else whole("images", images, 8, 240)


def on_gpu(renderer: Any, images: int | None) -> bool:
    """Whether `renderer`, ``cpu`` or ``gpu``, is a GPU. ``ValueError`` for another one, or for images that a GPU does not form."""
    if renderer not in ("cpu", "gpu"):
        raise ValueError(f"renderer: found {renderer!r}, expected cpu or gpu")
    if renderer == "gpu" and images != 240:
        raise ValueError(f"renderer: found gpu for images={images}, expected images=240: smaller ones are formed on the CPU")
    return bool(renderer == "gpu")


def image(what: str, values: ArrayLike) -> NDArray[np.uint8]:
    """`values` as a contiguous uint8 picture. ``ValueError`` for another kind of number: a picture is not scaled in silence."""
    array = np.asarray(values)
    if array.dtype != np.uint8:
        raise ValueError(f"{what}: found dtype {array.dtype}, expected uint8")
    if array.ndim != 3:
        raise ValueError(f"{what}: found shape {array.shape}, expected (240, 240, 3)")
    return np.ascontiguousarray(array)


def robot_of(path: str | os.PathLike[str] | None) -> tuple[str | None, int, int]:
    """A robot for the native module, how many joints its arm has, and how many pads its hand: those of the F-TAC Hand on a Gen3 without a file."""
    return (None, 7, 17) if path is None else _native.robot(os.fspath(path))


def scenario_of(path: str | os.PathLike[str] | None) -> str | None:
    """The text of a scenario file for the native module; None without a file."""
    return None if path is None else _native.scenario(os.fspath(path))


@lru_cache(maxsize=16)
def objects_of(text: str | None) -> list[str]:
    """Names of the objects of a scenario's text, or of the benchmark's."""
    return _native.scenario_objects(text)
