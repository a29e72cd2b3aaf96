"""The hand on paper: kinematics, Jacobians, pads, and what its cables do.

Joint angles ``q`` are (15,), rad, in the order of `JOINTS`: thumb, index, middle, ring, little, each from the palm outwards; a positive angle flexes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ftac import _native
from ftac._arrays import numbers, whole

Array = NDArray[np.float64]


class Pad(NamedTuple):
    """A tactile pad. ``link`` is an index into `JOINTS`, None for the palm; sizes in m across and along the digit."""

    name: str
    link: int | None
    configuration: str
    width: float
    height: float
    cameras: tuple[str, ...]


class Camera(NamedTuple):
    """A camera, its pad's index, and the rectangle of the pad that it sees: centre along y, and size, m."""

    name: str
    pad: int
    center_y: float
    width: float
    height: float


_hand = _native.hand()
JOINTS: tuple[str, ...] = tuple(_hand["joints"])
"""Names of the 15 joints, which are those of the links that they move."""
LIMITS: Array = _hand["limits"]
"""Lowest and highest angle of each joint, (15, 2), rad."""
SPRINGS: Array = _hand["springs"]
"""Stiffness of the spring that opens each joint, (15,), N m/rad."""
PADS: tuple[Pad, ...] = tuple(
    Pad(name, link, configuration, width, height, tuple(cameras))
    for name, link, configuration, width, height, cameras in _hand["pads"]
)
"""The 17 pads, in the order of tactile images."""
CAMERAS: tuple[Camera, ...] = tuple(Camera(*camera) for camera in _hand["cameras"])
"""The 18 cameras: one a pad, two on the palm's ulnar one."""
SPOOL_RADIUS: float = _hand["spool_radius"]
"""m of cable per rad of a servo."""
TORQUE_CONSTANT: float = _hand["torque_constant"]
"""N m per A of a servo."""
MOST_TENSION: float = _hand["tension"]
"""What a servo pulls at most, N."""


def forward(q: ArrayLike) -> Array:
    """``palm_from_link`` of the 15 links at `q`: (15, 4, 4), m."""
    return _native.forward(numbers("q", q, 15))


def pad_poses(q: ArrayLike) -> Array:
    """``palm_from_pad`` of the 17 pads at `q`: (17, 4, 4), m."""
    return _native.pad_poses(numbers("q", q, 15))


def jacobian(q: ArrayLike, link: int | str, point: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """Geometric Jacobian of a `point` (m, frame of `link`) at `q`: (6, 15), rows linear then angular velocity, palm frame."""
    if isinstance(link, str):
        if link not in JOINTS:
            raise ValueError(f"link: found {link!r}, expected one of {', '.join(JOINTS)}")
        link = JOINTS.index(link)
    index = whole("link", link, 0, len(JOINTS) - 1)
    return _native.jacobian(numbers("q", q, 15), index, numbers("point", point, 3))


def excursions(q: ArrayLike) -> Array:
    """Cable that the joints of each digit take up between 0 and `q`: (5,), m."""
    return _native.excursions(numbers("q", q, 15))


def moment_arms(q: ArrayLike) -> Array:
    """Moment arm of each cable at each joint at `q`: (5, 15), m; 0 where a cable does not cross a joint."""
    return _native.moment_arms(numbers("q", q, 15))


def torques(q: ArrayLike, tensions: ArrayLike) -> Array:
    """Torque of cables under `tensions` (5,), N, and of springs at every joint: (15,), N m. Without friction and the opposition servo."""
    return _native.torques(numbers("q", q, 15), numbers("tensions", tensions, 5))


def resting_posture(tensions: ArrayLike, opposition: float = 0.0) -> Array:
    """Joint angles (15,), rad, at which the hand rests under `tensions` (5,), N, without contact, friction and weight."""
    return _native.resting_posture(numbers("tensions", tensions, 5), float(opposition))


def friction_compensated(tensions: ArrayLike, spools: ArrayLike) -> Array:
    """Tensions at the spools (5,), N, for which closing digits feel `tensions` (5,), N, at their middle joints in spite of the friction in the cables' guides; the
    servos' output angles are `spools` (6,), rad."""
    return _native.friction_compensated(numbers("tensions", tensions, 5), numbers("spools", spools, 6))


def camera(name: int | str) -> int:
    """Index of a camera given by its index or name. ``ValueError`` if there is none."""
    names = [camera.name for camera in CAMERAS]
    if isinstance(name, str):
        if name not in names:
            raise ValueError(f"camera: found {name!r}, expected one of {', '.join(names)}")
        return names.index(name)
    return whole("camera", name, 0, len(names) - 1)
