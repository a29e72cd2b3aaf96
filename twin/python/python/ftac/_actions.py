"""Actions of a step of 1/20 s as twelve shares from -1 to 1, and what they ask of the robot."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

SPEED = 0.25
"""Of the palm, along each axis, m/s."""
TURN_SPEED = 1.0
"""Of the palm, about each axis, rad/s."""
TENSION = 60.0
"""Of a cable, N."""

Array = NDArray[np.float64]


def row(action: ArrayLike, opposition: ArrayLike) -> Array:
    """What an action asks for: twist (6), tensions (5, N), opposition (rad), which has the limits `opposition`.

    ``ValueError`` for anything but twelve numbers from -1 to 1.
    """
    found = np.asarray(action)
    if found.shape != (12,) or found.dtype.kind not in "fiu" or not np.all(np.abs(found) <= 1.0):
        raise ValueError(f"action: found {found}, expected 12 numbers from -1 to 1")
    shares = found.astype(np.float64)
    lowest, highest = np.asarray(opposition, dtype=np.float64)
    angle = lowest + 0.5 * (shares[11] + 1.0) * (highest - lowest)
    tensions = 0.5 * (shares[6:11] + 1.0) * TENSION
    return np.concatenate([SPEED * shares[:3], TURN_SPEED * shares[3:6], tensions, [angle]])


def thumb(angle: float, opposition: ArrayLike) -> float:
    """Share of the opposition joint's range, -1 to 1, at which it is at `angle` (rad)."""
    lowest, highest = np.asarray(opposition, dtype=np.float64)
    return float(2.0 * (angle - lowest) / (highest - lowest) - 1.0)


def command(tensions: ArrayLike, angle: float, opposition: ArrayLike) -> NDArray[np.float32]:
    """Tensions (N) and the opposition's angle (rad) as the last six shares of an action."""
    pulled = 2.0 * np.asarray(tensions, dtype=np.float64) / TENSION - 1.0
    return np.clip([*pulled, thumb(angle, opposition)], -1.0, 1.0).astype(np.float32)


def observation(measured: dict[str, Any], last: NDArray[np.float32]) -> dict[str, Any]:
    """What a policy observes of what was measured and of the `last` action's command: float32, and the images as they are."""
    observed: dict[str, Any] = {
        name: np.asarray(measured[name], dtype=np.float32) for name in ("servos", "arm", "palm", "detected")
    }
    observed["command"] = last.copy()
    if "tactile" in measured:
        observed["tactile"] = measured["tactile"]
    return observed
