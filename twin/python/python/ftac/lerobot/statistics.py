"""Statistics of a data set, as LeRobot reads them: ``min``, ``max``, ``mean``, ``std``, ``count`` and the quantiles of `QUANTILES`.

All of them are exact, within an episode and over all episodes: vectors are read again as a whole, and of images the number of pixels of each of the 256
levels is kept. A quantile is numpy's (linear between neighbours). LeRobot itself estimates quantiles by histograms of samples, and merges
those of episodes by their weighted mean.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}
"""Quantiles by the name that LeRobot gives them."""
Statistics = dict[str, Any]
"""Lists by name."""


def of_vectors(values: NDArray[Any]) -> Statistics:
    """Statistics of rows (n, k), column by column."""
    numbers = values.astype(np.float64)
    found = {name: getattr(numbers, name)(axis=0).tolist() for name in ("min", "max", "mean", "std")}
    quantiles = np.quantile(numbers, list(QUANTILES.values()), axis=0)
    return {**found, "count": [len(numbers)], **{name: row.tolist() for name, row in zip(QUANTILES, quantiles)}}


def levels(images: NDArray[np.uint8]) -> NDArray[np.int64]:
    """The number of pixels of each level in images (..., 3), by colour: (3, 256)."""
    pixels = images.reshape(-1, 3)
    return np.stack([np.bincount(pixels[:, colour], minlength=256) for colour in range(3)])


def of_levels(counts: NDArray[np.int64], frames: int) -> Statistics:
    """Statistics of the images with these `levels`, by colour from 0 to 1, each (3, 1, 1)."""
    scale = np.arange(256) / 255.0
    weights = counts / counts.sum(axis=1, keepdims=True)
    mean = weights @ scale
    std = np.sqrt((weights * (scale - mean[:, None]) ** 2).sum(axis=1))
    present = counts > 0
    found = {
        "min": scale[present.argmax(axis=1)],
        "max": scale[255 - present[:, ::-1].argmax(axis=1)],
        "mean": mean,
        "std": std,
        **{name: np.array([_quantile(row, share) for row in counts]) for name, share in QUANTILES.items()},
    }
    return {**{name: value.reshape(3, 1, 1).tolist() for name, value in found.items()}, "count": [frames]}


def _quantile(counts: NDArray[np.int64], share: float) -> float:
    """A quantile of the pixels with these numbers of each level."""
    upto = np.cumsum(counts)
    position = share * (int(upto[-1]) - 1)
    low, high = (int(np.searchsorted(upto, order, side="right")) for order in (int(np.floor(position)), int(np.ceil(position))))
    return float(low + (high - low) * (position - np.floor(position))) / 255.0
