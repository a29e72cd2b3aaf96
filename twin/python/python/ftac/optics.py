"""Tactile images of what presses into a pad.

Images are (240, 240, 3) uint8: row 0 is the pad's distal edge (largest y), column 0 has the smallest x. A ``camera`` is a name or an index of
`ftac.hand.CAMERAS`. A ``unit`` is the serial number of a hand whose cameras differ a little from the design; None is the design itself.
"""

from __future__ import annotations

import os
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ftac import _native, hand
from ftac._arrays import number, numbers, seed_of, whole
from ftac._images import Images, beside, coloured, images as shown, png
from ftac.program import call


class Press(NamedTuple):
    """A rendered press: ``image`` (240, 240, 3) uint8, ``depth`` of the gel's indentation (240, 240) float32, m, and the normal ``force``, N. A notebook
    shows the image beside the depth."""

    image: Images
    depth: NDArray[np.float32]
    force: float

    def __repr__(self) -> str:
        deepest = 1e3 * float(self.depth.max())
        return f"<Press: image {self.image.shape} uint8, depth {self.depth.shape} up to {deepest:.2f} mm, force {self.force:.2f} N>"

    def _repr_png_(self) -> bytes:
        return png(beside(np.asarray(self.image), coloured(self.depth, 0.0, float(self.depth.max()))))


def _press(rendered: tuple[NDArray[np.uint8], NDArray[np.float32], float]) -> Press:
    image, depth, force = rendered
    return Press(shown(image), depth, force)


def background(camera: int | str, *, unit: int | None = None) -> Images:
    """Image (240, 240, 3) uint8 of the untouched pad, without read-out noise."""
    return shown(_native.background(hand.camera(camera), _serial(unit)))


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

    `seed` is that of the read-out noise. ``ValueError`` where not exactly one of `depth` and `force` is given, and where the gel is not that thick or bears
    no such force. The force is 0 where the ball is not over the pad.

    Returns a `Press`: image (240, 240, 3) uint8, depth (240, 240) m, force N.
    """
    x, y = numbers("center", center, 2).tolist()
    at = (x, y)
    return _press(
        _native.press_sphere(
            hand.camera(camera),
            number("radius", radius, ", m"),
            None if depth is None else number("depth", depth, ", m"),
            None if force is None else number("force", force, ", N"),
            at,
            _serial(unit),
            seed_of(seed),
        )
    )


def press_heights(
    camera: int | str, surface: ArrayLike, force: float, *, unit: int | None = None, seed: int = 0
) -> Press:
    """Any surface pressed in with `force` (N) until the gel bears it. ``ValueError`` for more than it can bear; the force is 0 where nothing is over the pad.

    `surface` (240, 240) is the height of the object's lowest point over every pixel: m, pad frame, z out of the pad, from any zero; NaN where there is
    nothing. Returns a `Press`: image (240, 240, 3) uint8, depth (240, 240) m, force N.
    """
    heights = np.ascontiguousarray(surface, dtype=np.float64)
    if heights.ndim != 2:
        raise ValueError(f"surface: found shape {heights.shape}, expected (240, 240)")
    return _press(_native.press_heights(hand.camera(camera), heights, number("force", force, ", N"), _serial(unit), seed_of(seed)))


def _serial(unit: int | None) -> int | None:
    return None if unit is None else whole("unit", unit, 0, 2**32 - 1)


def press_mesh(
    camera: int | str,
    vertices: ArrayLike,
    triangles: ArrayLike,
    force: float,
    *,
    unit: int | None = None,
    seed: int = 0,
) -> Press:
    """A mesh pressed in with `force` (N) from above: `vertices` (n, 3), m, pad frame, z out of the pad, from any zero; `triangles` (k, 3), places among them.

    Returns a `Press`: image (240, 240, 3) uint8, depth (240, 240) m, force N.
    """
    points, faces = np.asarray(vertices, dtype=np.float64), np.asarray(triangles)
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise ValueError(f"vertices: found shape {points.shape}, expected (n, 3) finite numbers")
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
        raise ValueError(f"triangles: found shape {faces.shape} of {faces.dtype}, expected (k, 3) whole numbers")
    if faces.size and not (0 <= faces.min() and faces.max() < len(points)):
        raise ValueError(f"triangles: found {faces.min()} to {faces.max()}, expected 0 to {len(points) - 1}")
    return press_heights(camera, _lowest(hand.CAMERAS[hand.camera(camera)], points[faces]), force, unit=unit, seed=seed)


def _lowest(view: hand.Camera, corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Height of the lowest of the triangles (k, 3, 3) over every pixel, NaN where there is none."""
    side = 240
    heights = np.full((side, side), np.nan)
    # Columns and rows of the corners; a pixel's middle is a whole number.
    columns = (corners[..., 0] + 0.5 * view.width) / view.width * side - 0.5
    rows = (view.center_y + 0.5 * view.height - corners[..., 1]) / view.height * side - 0.5
    for x, y, z in zip(columns, rows, corners[..., 2]):
        left, right = max(0, int(np.ceil(x.min()))), min(side - 1, int(np.floor(x.max())))
        top, bottom = max(0, int(np.ceil(y.min()))), min(side - 1, int(np.floor(y.max())))
        area = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])
        if left > right or top > bottom or area == 0.0:
            continue
        u, v = np.meshgrid(np.arange(left, right + 1), np.arange(top, bottom + 1))
        first = ((x[1] - u) * (y[2] - v) - (x[2] - u) * (y[1] - v)) / area
        second = ((x[2] - u) * (y[0] - v) - (x[0] - u) * (y[2] - v)) / area
        shares = np.stack([first, second, 1.0 - first - second])
        height = np.where((shares >= -1e-9).all(axis=0), np.tensordot(z, shares, 1), np.nan)
        part = heights[top : bottom + 1, left : right + 1]
        part[:] = np.fmin(part, height)
    return heights


def calibrate(
    folder: str | os.PathLike[str], *, ball_diameter_mm: float, seed: int = 1, **options: str | float | bool
) -> dict[str, Any]:
    """Fits a real sensor's image formation to presses of a ball: ``ftac optics calibrate``, whose help says what the folder holds.

    Parameters
    ----------
    folder: with ``background.png``, images of presses and perhaps ``labels.csv``.
    ball_diameter_mm: of the ball, mm.
    seed: of everything random.
    options: the command's, with underscores: ``pixel_mm=0.02``, ``shallow=True``.

    Returns what the command prints with ``--json``.
    """
    asked: list[str] = []
    for name, value in options.items():
        if value is not False and value is not None:
            asked += [f"--{name.replace('_', '-')}"] + ([] if value is True else [str(value)])
    ball = ["--ball-diameter-mm", str(float(ball_diameter_mm)), "--seed", str(seed_of(seed))]
    return call("optics", "calibrate", os.fspath(folder), *ball, *asked)
