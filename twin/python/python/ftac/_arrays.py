"""Numbers as the native module takes them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def numbers(what: str, values: ArrayLike, length: int | None = None) -> NDArray[np.float64]:
    """`values` as a contiguous float64 vector, of `length` if given. ``ValueError`` for anything else."""
    try:
        array = np.ascontiguousarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{what}: expected numbers: {error}") from None
    if array.ndim != 1 or (length is not None and array.shape != (length,)):
        expected = "one dimension" if length is None else f"shape ({length},)"
        raise ValueError(f"{what}: found shape {np.shape(values)}, expected {expected}")
    return array


def image(what: str, values: ArrayLike) -> NDArray[np.uint8]:
    """`values` as a contiguous uint8 picture. ``ValueError`` for another kind of number: a picture is not scaled in silence."""
    array = np.asarray(values)
    if array.dtype != np.uint8:
        raise ValueError(f"{what}: found dtype {array.dtype}, expected uint8")
    if array.ndim != 3:
        raise ValueError(f"{what}: found shape {array.shape}, expected (240, 240, 3)")
    return np.ascontiguousarray(array)
