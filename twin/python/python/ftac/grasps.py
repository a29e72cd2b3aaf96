"""The grasps that come with the program."""

from __future__ import annotations

import json
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ftac import _native

Array = NDArray[np.float64]


class PickUp(NamedTuple):
    """How an object of the benchmark is picked up: angles in rad, lengths in m, tensions in N.

    ``role`` is ``first`` (ring and little finger against the palm) or ``second`` (thumb, index and middle finger). ``yaw`` turns the hand about the vertical
    from the object's own, ``pitch`` is positive with the fingers down, ``roll`` negative with the ulnar edge down. ``center`` (3,) is where the object's
    centre is in the palm frame when the digits close; ``raise_`` is how far the hand rises meanwhile. ``score`` is the share of rehearsals that held.
    """

    object: str
    id: int
    role: str
    yaw: float
    pitch: float
    roll: float
    center: Array
    pre_tension: Array
    close_tension: Array
    opposition: float
    raise_: float
    thumb_delay: float
    score: float


class Held(NamedTuple):
    """A grasp as it was held in physics: ``palm_from_object`` (7,) m, ``joints`` (15,) rad, ``tensions`` (5,) N, ``opposition`` rad; ``contacts`` (k, 8): link (-1
    is the palm), point (m), normal into the object, force (N), palm frame; ``margin`` is the wrench that it resists in every direction, N."""

    object: str
    palm_from_object: Array
    joints: Array
    tensions: Array
    opposition: float
    contacts: Array
    margin: float


@cache
def repertoire() -> dict[str, list[PickUp]]:
    """The benchmark's pick-ups by object, best first."""
    return {name: [pick_up(grasp) for grasp in grasps] for name, grasps in json.loads(_native.repertoire()).items()}


@cache
def collection() -> list[Held]:
    """The synthesized grasps of all objects."""
    return [_held(grasp) for grasp in json.loads(_native.collection())]


def pick_up(grasp: dict[str, Any]) -> PickUp:
    """A pick-up from the fields of its file."""
    arrays: dict[str, Any] = {name: np.array(grasp[name]) for name in ("center", "pre_tension", "close_tension")}
    same = ("object", "id", "role", "yaw", "pitch", "roll", "opposition", "thumb_delay", "score")
    return PickUp(raise_=grasp["raise"], **arrays, **{name: grasp[name] for name in same})


def _held(grasp: dict[str, Any]) -> Held:
    arrays: dict[str, Any] = {name: np.array(grasp[name]) for name in ("palm_from_object", "joints", "tensions")}
    rows = [
        [-1 if link is None else link, *point, *normal, force] for link, point, normal, force in grasp["contacts"]
    ]
    contacts = np.array(rows, dtype=np.float64).reshape(-1, 8)
    same = ("object", "opposition", "margin")
    return Held(contacts=contacts, **arrays, **{name: grasp[name] for name in same})
