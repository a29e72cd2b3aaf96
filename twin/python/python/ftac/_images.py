"""Images that show themselves in a notebook, and pictures of numbers. Needs numpy alone."""

from __future__ import annotations

import struct
import zlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Picture = NDArray[np.uint8]
SHOWN = 240
"""Height in pixels up to which a small image is enlarged."""
GAP = 4
"""Pixels between images that stand beside each other."""
COLOURS: NDArray[np.float64] = np.array(
    [(68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37)], dtype=np.float64
)
"""RGB of the scale of numbers, from the lowest to the highest."""


class Images(np.ndarray[Any, np.dtype[np.uint8]]):
    """A numpy array of one image (h, w, 3) or of several (n, h, w, 3), uint8 RGB, that a notebook shows as a picture.

    It computes like every array; a result that is no image is shown as numbers.
    """

    def _is_image(self) -> bool:
        return self.dtype == np.uint8 and self.ndim in (3, 4) and self.shape[-1] == 3 and self.size > 0

    def __repr__(self) -> str:
        if not self._is_image():
            return repr(np.asarray(self))
        return f"<image {self.shape} uint8>" if self.ndim == 3 else f"<{self.shape[0]} images {self.shape} uint8>"

    def _repr_png_(self) -> bytes | None:
        if not self._is_image():
            return None
        image = np.asarray(self)
        return png(enlarged(image) if image.ndim == 3 else mosaic(image))


def images(array: NDArray[np.uint8]) -> Images:
    """`array` itself as `Images`, without a copy."""
    return array.view(Images)


def png(picture: ArrayLike) -> bytes:
    """A picture (h, w, 3) uint8 RGB as the bytes of a PNG file."""
    array = np.ascontiguousarray(picture)
    if array.dtype != np.uint8 or array.ndim != 3 or array.shape[2] != 3 or array.size == 0:
        raise ValueError(f"picture: found shape {array.shape} of {array.dtype}, expected (h, w, 3) uint8")
    height, width, _ = array.shape
    # Each row begins with its filter: none.
    rows = np.zeros((height, 1 + 3 * width), dtype=np.uint8)
    rows[:, 1:] = array.reshape(height, 3 * width)

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    parts = chunk(b"IHDR", header), chunk(b"IDAT", zlib.compress(rows.tobytes(), 6)), chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def coloured(values: ArrayLike, low: float, high: float) -> Picture:
    """Numbers (h, w) as a picture (h, w, 3) uint8: `low` is dark blue, `high` yellow, and what is no number white."""
    numbers = np.asarray(values, dtype=np.float64)
    place = (numbers - low) / (high - low) if high > low else np.zeros_like(numbers)
    at = np.linspace(0.0, 1.0, len(COLOURS))
    shades = np.stack([np.interp(place, at, COLOURS[:, channel]) for channel in range(3)], axis=-1)
    return np.where(np.isfinite(numbers)[..., None], np.rint(shades), 255.0).astype(np.uint8)


def enlarged(picture: Picture) -> Picture:
    """A small picture with every pixel repeated, up to `SHOWN` rows."""
    factor = max(1, SHOWN // max(picture.shape[:2]))
    return picture.repeat(factor, axis=0).repeat(factor, axis=1)


def beside(*pictures: Picture) -> Picture:
    """Pictures of one height (h, w, 3) in a row, on white."""
    height = pictures[0].shape[0]
    gap = np.full((height, GAP, 3), 255, dtype=np.uint8)
    parts = [part for picture in pictures for part in (gap, picture)]
    return np.concatenate(parts[1:], axis=1)


def mosaic(stack: Picture) -> Picture:
    """Images (n, h, w, 3) in rows of equal length, on white."""
    columns = int(np.ceil(np.sqrt(len(stack))))
    rows = -(-len(stack) // columns)
    blank = np.full_like(stack[0], 255)
    factor = max(1, SHOWN // (2 * max(stack.shape[1:3])))
    shown = [image.repeat(factor, axis=0).repeat(factor, axis=1) for image in [*stack, *[blank] * (rows * columns - len(stack))]]
    lines = [beside(*shown[row * columns : (row + 1) * columns]) for row in range(rows)]
    gap = np.full((GAP, lines[0].shape[1], 3), 255, dtype=np.uint8)
    return np.concatenate([part for line in lines for part in (gap, line)][1:], axis=0)
