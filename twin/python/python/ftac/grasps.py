"""The grasps that come with the program, and synthesis of others."""

from __future__ import annotations

import json
import os
import tempfile
from functools import cache, lru_cache
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ftac import _native, hand
from ftac._arrays import seed_of, whole
from ftac._poses import compose, pose_matrix, turn
from ftac.program import call

Array = NDArray[np.float64]
LEVEL: Array = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Rotation of the level palm, facing down, fingers along world x."""


class PickUp(NamedTuple):
    """How an object of the benchmark is picked up: angles in rad, lengths in m, tensions in N.

    ``digits`` are those that close, such as ring and little finger against the palm. ``yaw`` turns the hand about the vertical
    from the object's own, ``pitch`` is positive with the fingers down, ``roll`` negative with the ulnar edge down. ``center`` (3,) is where the object's
    centre is in the palm frame when the digits close; ``raise_`` is how far the hand rises meanwhile. ``score`` is the share of rollouts that held.
    """

    object: str
    id: int
    digits: tuple[str, ...]
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

    def __repr__(self) -> str:
        return f"<PickUp {self.id} of {self.object} by {', '.join(self.digits)}: score {self.score:.2f}>"

    def _repr_html_(self) -> str:
        degrees = {name: f"{np.degrees(getattr(self, name)):.0f} deg" for name in ("yaw", "pitch", "roll", "opposition")}
        center, tension = 1e3 * self.center, self.close_tension
        rows = {
            "object": f"{self.object}, pick-up {self.id}",
            "digits": ", ".join(self.digits),
            **degrees,
            "center": f"{np.array2string(center, precision=0)} mm in the palm frame",
            "close_tension": f"{np.array2string(tension, precision=1)} N",
            "raise_": f"{1e3 * self.raise_:.0f} mm",
            "score": f"{self.score:.2f}",
        }
        cells = (f"<tr><th>{name}</th><td>{escape(text)}</td></tr>" for name, text in rows.items())
        return f"<table>{''.join(cells)}</table>"


class Held(NamedTuple):
    """A grasp as it was held in physics: ``palm_from_object`` (7,) m, ``joints`` (15,) rad, ``tensions`` (5,) N, ``opposition`` rad; ``contacts`` (k, 8): link (-1
    is the palm), point (m), normal into the object, force (N), palm frame; ``margin`` is the wrench that it resists in every direction, N. A notebook shows
    the hand from the palm's and the thumb's side, without the object."""

    object: str
    palm_from_object: Array
    joints: Array
    tensions: Array
    opposition: float
    contacts: Array
    margin: float

    def __repr__(self) -> str:
        return f"<Held {self.object}: joints {self.joints.shape}, contacts {self.contacts.shape}, margin {self.margin:.2f} N>"

    def _repr_png_(self) -> bytes:
        # A joint on its stop is pressed a little beyond it.
        low, high = np.ceil(1e3 * np.degrees(hand.LIMITS[:, 0])), np.floor(1e3 * np.degrees(hand.LIMITS[:, 1]))
        return _hand_picture(tuple(float(angle) for angle in 1e-3 * np.clip(1e3 * np.degrees(self.joints), low, high)))


@cache
def repertoire() -> dict[str, list[PickUp]]:
    """The benchmark's pick-ups by object, best first."""
    return {name: [pick_up(grasp) for grasp in grasps] for name, grasps in json.loads(_native.repertoire()).items()}


@cache
def pick_one() -> dict[str, PickUp]:
    """For each object, the pick-up that `ftac.scripted.Script` carries out best in ``ftac/PickOne-v1``, as ``examples/choose_grasps.py`` has measured it. An
    object without pick-ups in the repertoire has one of a similar object."""
    text = (Path(__file__).parent / "data" / "pick_one.json").read_text()
    return {name: numbered(one["object"], one["id"]) for name, one in json.loads(text).items()}


def numbered(object: str, id: int) -> PickUp:
    """The best pick-up of an object with this number. Numbers are those of pick-ups by the same digits: one by other digits may have it too."""
    return next(grasp for grasp in repertoire()[object] if grasp.id == id)


@cache
def collection() -> list[Held]:
    """The synthesized grasps of all objects."""
    return [_held(grasp) for grasp in json.loads(_native.collection())]


def generate(
    object: str | None = None,
    *,
    mesh: str | os.PathLike[str] | None = None,
    chains: int = 64,
    contacts: str = "5",
    friction: float | None = None,
    mass: float | None = None,
    seed: int = 1,
) -> list[Held]:
    """Grasps for an object by sampling, each closed by its cables, verified, and held in physics: ``ftac grasps generate``.

    Parameters
    ----------
    object: name of an object of the set (`ftac.objects`); or
    mesh: an OBJ file, in metres.
    chains: samples, each of which may leave one grasp; a second or more each on one core.
    contacts: contact points of a sample: a number, or a range taken in turn, such as ``2-5``.
    friction: Coulomb friction between hand and object; None for the command's.
    mass: for which grasps are verified, kg; None for the object's own, or 0.1.
    seed: of everything random.
    """
    if (object is None) == (mesh is None):
        raise ValueError("expected either an object or a mesh")
    subject = ["--object", str(object)] if mesh is None else ["--mesh", os.fspath(mesh)]
    chains, seed = whole("chains", chains, 1, 1_000_000), seed_of(seed)
    given = {"--friction": friction, "--mass": mass}
    more = [part for name, value in given.items() if value is not None for part in (name, str(float(value)))]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "grasps.jsonl"
        asked = [*subject, "--n", str(chains), "--contacts", contacts, *more, "--seed", str(seed), "--out", str(file)]
        call("grasps", "generate", *asked)
        # The first line is about the file.
        lines = file.read_text().splitlines()[1:] if file.exists() else []
    return [_held(json.loads(line)) for line in lines]


def palm_goal(grasp: PickUp, detected: ArrayLike, yaw: float) -> Array:
    """``world_from_palm`` (4, 4) in which the digits of a pick-up close, m.

    Parameters
    ----------
    grasp: the pick-up.
    detected: the object's ``world_from_object`` as detected, (7,).
    yaw: its turn about the vertical from the rest pose, rad (``info["yaws"]``).
    """
    rotation = turn(2, grasp.yaw + yaw) @ turn(1, grasp.pitch) @ turn(0, grasp.roll) @ LEVEL
    return compose(rotation, pose_matrix(detected)[:3, 3] - rotation @ grasp.center)


def pick_up(grasp: dict[str, Any]) -> PickUp:
    """A pick-up from the fields of its file."""
    arrays: dict[str, Any] = {name: np.array(grasp[name]) for name in ("center", "pre_tension", "close_tension")}
    same = ("object", "id", "yaw", "pitch", "roll", "opposition", "thumb_delay", "score")
    return PickUp(digits=tuple(grasp["digits"]), raise_=grasp["raise"], **arrays, **{name: grasp[name] for name in same})


@lru_cache(maxsize=64)
def _hand_picture(angles: tuple[float, ...]) -> bytes:
    """PNG of the hand with these joint angles, deg: ``ftac hand picture``."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "hand.png"
        pose = ",".join(f"{angle:.3f}" for angle in angles)
        call("hand", "picture", "--pose", pose, "--view", "palm,thumb", "--size", 320, "--plain", "--out", file)
        return file.read_bytes()


def _held(grasp: dict[str, Any]) -> Held:
    arrays: dict[str, Any] = {name: np.array(grasp[name]) for name in ("palm_from_object", "joints", "tensions")}
    rows = [
        [-1 if link is None else link, *point, *normal, force] for link, point, normal, force in grasp["contacts"]
    ]
    contacts = np.array(rows, dtype=np.float64).reshape(-1, 8)
    same = ("object", "opposition", "margin")
    return Held(contacts=contacts, **arrays, **{name: grasp[name] for name in same})

