"""Tactile images of what presses into a pad.

Images are (240, 240, 3) uint8: row 0 is the pad's distal edge (largest y), column 0 has the smallest x. A ``camera`` is a name or an index of
`ftac.hand.CAMERAS`. A ``unit`` is the serial number of a hand whose cameras differ a little from the design; None is the design itself.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ftac import _native, hand
from ftac._arrays import seed_of, whole


class Press(NamedTuple):
    """A rendered press: ``image`` (240, 240, 3) uint8, ``depth`` of the gel's indentation (240, 240) float32, m, and the normal ``force``, N."""

    image: NDArray[np.uint8]
    depth: NDArray[np.float32]
    force: float


def background(camera: int | str, *, unit: int | None = None) -> NDArray[np.uint8]:
    """Image of the untouched pad, without read-out noise."""
    return _native.background(hand.camera(camera), _serial(unit))


def press_sphere(
    camera: int | str,
    radius: float,
    *,
    depth: float | None = None,
    force: float | None = None,
    center: tuple[float, float] = (0.0, 0.0),
    unit: int | None = None,
    seed: int = 0,
) -> Press:
    """A ball of `radius` (m) over `center` (x, y in m, pad frame), pressed `depth` (m) below the pad's plane or with `force` (N).

    `seed` is that of the read-out noise. ``ValueError`` where not exactly one of `depth` and `force` is given.
    """
    x, y = center
    return Press(
        *_native.press_sphere(
            hand.camera(camera), float(radius), depth, force, (float(x), float(y)), _serial(unit), seed_of(seed)
        )
    )


def press_heights(
    camera: int | str, surface: ArrayLike, force: float, *, unit: int | None = None, seed: int = 0
) -> Press:
    """Any surface pressed in with `force` (N) until the gel bears it.

    `surface` (240, 240) is the height of the object's lowest point over every pixel: m, pad frame, z out of the pad, from any zero; NaN where there is
    nothing.
    """
    heights = np.ascontiguousarray(surface, dtype=np.float64)
    if heights.ndim != 2:
        raise ValueError(f"surface: found shape {heights.shape}, expected (240, 240)")
    return Press(*_native.press_heights(hand.camera(camera), heights, float(force), _serial(unit), seed_of(seed)))


def _serial(unit: int | None) -> int | None:
    return None if unit is None else whole("unit", unit, 0, 2**32 - 1)
