"""Poses as 4 x 4 matrices, and rotations."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ftac._arrays import numbers

Array = NDArray[np.float64]


def pose_matrix(pose: ArrayLike) -> Array:
    """A pose of seven numbers as a 4 x 4 matrix."""
    x, y, z, i, j, k, w = numbers("pose", pose, 7)
    rotation = [
        [1 - 2 * (j * j + k * k), 2 * (i * j - k * w), 2 * (i * k + j * w)],
        [2 * (i * j + k * w), 1 - 2 * (i * i + k * k), 2 * (j * k - i * w)],
        [2 * (i * k - j * w), 2 * (j * k + i * w), 1 - 2 * (i * i + j * j)],
    ]
    return compose(np.array(rotation), np.array([x, y, z]))


def compose(rotation: Array, position: Array) -> Array:
    """The pose with this rotation matrix and position."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, position
    return matrix


def inverse(pose: Array) -> Array:
    """The inverse of a pose."""
    rotation = pose[:3, :3].T
    return compose(rotation, -rotation @ pose[:3, 3])


def turn(axis: int, angle: float) -> Array:
    """Rotation about x, y or z (0, 1, 2) by an angle, rad."""
    cos, sin = np.cos(angle), np.sin(angle)
    matrix = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix[[i, i, j, j], [i, j, i, j]] = [cos, -sin, sin, cos]
    return matrix


def rotation_vector(rotation: Array) -> Array:
    """Axis times angle (rad) of a rotation matrix; of half a turn it may be zero."""
    twist = 0.5 * np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    sin, cos = float(np.linalg.norm(twist)), 0.5 * (float(np.trace(rotation)) - 1.0)
    return twist * (np.arctan2(sin, cos) / sin) if sin > 1e-9 else twist


def rotation_of_vector(vector: Array) -> Array:
    """Rotation matrix of axis times angle (rad)."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation: Array = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)
    return rotation
