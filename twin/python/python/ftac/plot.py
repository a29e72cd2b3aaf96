"""Plots in one call. Needs ``matplotlib``: ``pip install 'ftac[plot]'``.

- `tactile`: images of pads.
- `press`: the image of a press beside the depth of the gel's indentation.
- `heights`: a reconstructed surface, or any map of depths.
- `trials`: success and contact of each policy, with intervals.

Each function draws into a new figure of ``matplotlib.pyplot`` and returns its axes: ``axes.figure.savefig("picture.png")`` keeps it. Notebooks show it
by themselves, programs after ``matplotlib.pyplot.show()``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

try:
    import matplotlib.pyplot as plt
    from matplotlib.axes import Axes
except ImportError as error:
    raise ImportError(f"ftac.plot needs matplotlib ({error}): pip install 'ftac[plot]'") from None

from ftac import hand
from ftac._rows import OUTCOMES
from ftac.optics import Press
from ftac.touch import Surface

__all__ = ["heights", "press", "tactile", "trials"]

QUANTILE = 1.959964
"""Of the standard normal distribution, for intervals of 95 %."""


def tactile(images: ArrayLike | Mapping[str, ArrayLike], *, names: Sequence[str] | None = None) -> NDArray[Any]:
    """Draws tactile images, one an axes, and returns the axes: an array (n,) of ``matplotlib.axes.Axes``.

    Parameters
    ----------
    images: uint8 RGB: one (h, w, 3), several (n, h, w, 3) such as ``tactile`` of `ftac.Scene.observe`, or a mapping from names to images such as
        ``Situation.tactile``.
    names: a title for each image; by default the names of a mapping, of the 17 pads, or of the 18 cameras.
    """
    if isinstance(images, Mapping):
        names = list(images) if names is None else names
        stack = [np.asarray(image) for image in images.values()]
    else:
        array = np.asarray(images)
        stack = [array] if array.ndim == 3 else list(array)
    for image in stack:
        if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
            raise ValueError(f"images: found shape {image.shape} of {image.dtype}, expected (h, w, 3) uint8 each")
    if not stack:
        raise ValueError("images: found none, expected at least one")
    if names is None:
        known = {len(hand.PADS): [pad.name for pad in hand.PADS], len(hand.CAMERAS): [view.name for view in hand.CAMERAS]}
        names = known.get(len(stack), [""] * len(stack))
    if len(names) != len(stack):
        raise ValueError(f"names: found {len(names)}, expected {len(stack)}, one for each image")
    columns = int(np.ceil(np.sqrt(len(stack))))
    rows = -(-len(stack) // columns)
    _, grid = plt.subplots(rows, columns, figsize=(2.0 * columns, 2.2 * rows), squeeze=False, layout="constrained")
    for axes in grid.flat[len(stack) :]:
        axes.remove()
    drawn: NDArray[Any] = grid.flatten()[: len(stack)]
    for axes, image, name in zip(drawn, stack, names):
        axes.imshow(image)
        axes.set_title(name, fontsize="small")
        axes.set_axis_off()
    return drawn


def press(press: Press, *, camera: int | str | None = None) -> tuple[Axes, Axes]:
    """Draws the image of a press beside the depth of the gel's indentation, in mm, and returns both axes.

    Parameters
    ----------
    press: of `ftac.optics`: image (240, 240, 3) uint8, depth (240, 240) m, force N.
    camera: index or name of its camera: the axes are then in mm of the pad frame instead of pixels.
    """
    _, (left, right) = plt.subplots(1, 2, figsize=(8.0, 4.0), layout="constrained")
    left.imshow(np.asarray(press.image), extent=_extent(camera, press.image.shape))
    left.set_title(f"image, {press.force:.2f} N")
    _label(left, camera)
    heights(press.depth, camera=camera, axes=right)
    right.set_title("depth")
    return left, right


def heights(
    surface: Surface | Press | ArrayLike, *, camera: int | str | None = None, axes: Axes | None = None
) -> Axes:
    """Draws the indentation of a pad's gel as a map in mm, positive into the gel, and returns the axes.

    Parameters
    ----------
    surface: of `ftac.touch.surface`, a press, or depths (h, w), m.
    camera: index or name of the camera: the axes are then in mm of the pad frame instead of pixels.
    axes: to draw into; None for a new figure.
    """
    depth = surface.indentation if isinstance(surface, Surface) else surface.depth if isinstance(surface, Press) else surface
    depth = np.asarray(depth, dtype=np.float64)
    if depth.ndim != 2:
        raise ValueError(f"surface: found shape {depth.shape}, expected (h, w)")
    if axes is None:
        _, axes = plt.subplots(layout="constrained")
    drawn = axes.imshow(1e3 * depth, extent=_extent(camera, depth.shape))
    axes.figure.colorbar(drawn, ax=axes, label="indentation, mm")
    _label(axes, camera)
    return axes


def trials(rows: Iterable[Mapping[str, Any]], *, axes: Axes | None = None) -> Axes:
    """Draws the shares (0 to 1) of trials with contact, success and clean success by policy, and returns the axes.

    A point is a share, with Wilson's 95 % interval of independent trials. ``ftac bench`` has intervals for trials that share their combinations.

    Parameters
    ----------
    rows: of `ftac.bench.run`, or of ``trials.csv``: mappings with ``contact``, ``success``, ``clean_success``, and ``policy`` or ``condition``.
    axes: to draw into; None for a new figure.
    """
    by_policy: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        by_policy.setdefault(str(row["policy"] if "policy" in row else row["condition"]), []).append(row)
    if not by_policy:
        raise ValueError("rows: found none, expected at least one")
    if axes is None:
        _, axes = plt.subplots(figsize=(6.0, 1.0 + 0.6 * len(by_policy)), layout="constrained")
    places = np.arange(len(by_policy), dtype=np.float64)
    for n, outcome in enumerate(OUTCOMES):
        found = np.array([_wilson([_truth(outcome, row[outcome]) for row in own]) for own in by_policy.values()])
        share, low, high = found.T
        offset = 0.2 * (n - 0.5 * (len(OUTCOMES) - 1))
        ends = np.array([share - low, high - share])
        axes.errorbar(share, places + offset, xerr=ends, fmt="o", capsize=3, label=outcome.replace("_", " "))
    axes.set_yticks(places, [f"{policy} ({len(own)})" for policy, own in by_policy.items()])
    axes.set_ylim(len(by_policy) - 0.5, -0.5)
    axes.set_xlim(-0.02, 1.02)
    axes.set_xlabel("share of trials, 95 % interval")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return axes


def _truth(name: str, value: Any) -> bool:
    """A value of a row as a bool: of `ftac.bench.run`, pandas, or the text of a table."""
    if isinstance(value, (bool, np.bool_)) or value in ("true", "false"):
        return value == "true" if isinstance(value, str) else bool(value)
    raise ValueError(f"{name}: found {value!r}, expected true or false")


def _wilson(outcomes: Sequence[bool]) -> tuple[float, float, float]:
    """Share, and Wilson's 95 % interval."""
    n, share = len(outcomes), sum(outcomes) / len(outcomes)
    scale, square = 1.0 / (1.0 + QUANTILE**2 / n), QUANTILE**2 / n
    middle = scale * (share + square / 2.0)
    half = scale * QUANTILE * np.sqrt(share * (1.0 - share) / n + square / (4.0 * n))
    # The interval of a share of 0 or 1 ends there but for rounding.
    return share, float(min(share, middle - half)), float(max(share, middle + half))


def _extent(camera: int | str | None, shape: tuple[int, ...]) -> tuple[float, float, float, float]:
    """Left, right, bottom and top of an image: mm in the pad frame of a camera, or pixels."""
    if camera is None:
        return -0.5, shape[1] - 0.5, shape[0] - 0.5, -0.5
    view = hand.CAMERAS[hand.camera(camera)]
    middle, width, height = 1e3 * view.center_y, 1e3 * view.width, 1e3 * view.height
    return -0.5 * width, 0.5 * width, middle - 0.5 * height, middle + 0.5 * height


def _label(axes: Axes, camera: int | str | None) -> None:
    unit = "pixels" if camera is None else "mm"
    axes.set_xlabel(f"x, {unit}")
    axes.set_ylabel("row, pixels" if camera is None else "y along the digit, mm")
