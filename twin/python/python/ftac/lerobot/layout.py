"""The keys of a data set and those of `ftac.features`: one mapping, used in both directions.

==================================  =====================================================================================
LeRobot                             `ftac.features`
==================================  =====================================================================================
``observation.state``               ``servos``, ``arm``, ``palm``, ``command``, ``time``, flattened in this order
``observation.environment_state``   what is to be reached for: ``objects``, ``shape``, and ``identity``, ``grasp`` and ``goal`` if
                                    the environment has them
``observation.images.<pad>``        ``tactile``, an image of each pad
``observation.images.scene``        ``scene_camera``
``action``                          the action
``privileged``, ``achieved_goal``   the same; no policy of LeRobot reads these keys, because they do not begin with ``observation``
==================================  =====================================================================================

Scales are those of `ftac.features`: every number is from -1 to 1. ``goal`` is ``desired_goal`` of an environment with goals.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftac import features, hand
from ftac.features import Observation, Row, Spec

STATE, ENVIRONMENT, ACTION = "observation.state", "observation.environment_state", "action"
IMAGES = "observation.images."
PER_OBJECT = ("objects", "shape", "identity", "grasp")
"""Keys of `ftac.features` with a row for each object."""
PARTS = {STATE: ("servos", "arm", "palm", "command", "time"), ENVIRONMENT: (*PER_OBJECT, "goal")}
"""Keys of `ftac.features` of which the keys of a data set consist."""
APART = ("privileged", "achieved_goal")
"""Keys that are the same in a data set and are not for policies."""
FILE = "meta/ftac.json"
"""File of a data set with its layout."""
Image = NDArray[np.uint8]


@dataclass(frozen=True)
class Layout:
    """Keys and shapes of a data set, by the observations that it comes from."""

    spec: Spec
    """The choice of observations and actions."""
    objects: int
    """Number of objects."""
    joints: int = 7
    """Joints of the arm."""
    pads: tuple[str, ...] = tuple(pad.name for pad in hand.PADS)
    """Names of the pads."""
    camera: int | None = None
    """Side of the images of a camera over the table; None for none."""
    privileged: int = 0
    """Numbers of ``privileged``; 0 for none."""
    goal: bool = False
    """Whether the observations are those of an environment with goals."""
    task: str | None = field(default=None, compare=False)
    """Task of the environment, as `ftac.lerobot.episodes.words` takes it; None where the data set does not say. Layouts of several tasks are equal."""

    @staticmethod
    def of(env: Any) -> Layout:
        """The layout of an environment's episodes. ``ValueError`` for anything but an environment of `ftac.envs`."""
        from ftac.envs import OBJECTS, LiftTo, Pick
        from ftac.sorting import Sort

        pick = getattr(env, "unwrapped", env)
        if not isinstance(pick, Pick):
            raise ValueError(f"env: found {type(pick).__name__}, expected an environment of ftac.envs")
        privileged = pick._named.get("privileged")
        return Layout(
            pick.spec_of_features,
            OBJECTS[pick.task],
            pick._joints,
            pad_names(pick._pads),
            pick.camera,
            0 if privileged is None else int(np.prod(privileged.shape or ())),
            isinstance(pick, LiftTo),
            "sort" if isinstance(pick, Sort) else pick.task,
        )

    @staticmethod
    def read(dataset: str | os.PathLike[str]) -> Layout:
        """The layout of a data set, given its folder or its file ``meta/ftac.json``."""
        path = Path(dataset)
        path = path / FILE if path.is_dir() else path
        try:
            fields = json.loads(path.read_text())["layout"]
            spec = Spec(**features.known_fields(f"{path}: layout.spec", fields.pop("spec")))
            return Layout(spec, pads=tuple(fields.pop("pads")), **fields)
        except (KeyError, TypeError, json.JSONDecodeError) as error:
            raise ValueError(f"{path}: found {error!r}, expected the layout of a data set of ftac.lerobot") from None

    def as_dict(self) -> dict[str, Any]:
        """The fields as a dictionary, as ``meta/ftac.json`` has them."""
        return asdict(self)

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Shapes of the observations by the keys of `ftac.features`, in their order; an environment with goals flattens all but ``goal``,
        ``achieved_goal`` and ``tactile``."""
        found = features.shapes(self.spec, self.objects, self.joints, len(self.pads))
        if self.camera is not None:
            found["scene_camera"] = (self.camera, self.camera, 3)
        if self.privileged:
            found["privileged"] = (self.privileged,)
        if self.goal:
            found |= {"goal": (3,), "achieved_goal": (3,)}
        return found

    def names(self) -> dict[str, list[str]]:
        """A name for every number of the data set's vectors."""
        per = features.names(self.spec, self.objects, self.joints)
        per["goal"] = [f"goal.{axis}" for axis in "xyz"]
        found = {key: [name for part in parts if part in self.shapes() for name in per[part]] for key, parts in PARTS.items()}
        found[ACTION] = per["action"]
        if self.privileged:
            found["privileged"] = [f"privileged.{n}" for n in range(self.privileged)]
        if self.goal:
            found["achieved_goal"] = [f"achieved.{axis}" for axis in "xyz"]
        return found

    def sides(self) -> dict[str, int]:
        """Side of the images by the data set's keys, pixels."""
        found = {} if self.spec.images is None else {IMAGES + pad: self.spec.images for pad in self.pads}
        return found if self.camera is None else {**found, IMAGES + "scene": self.camera}

    def vectors(self, observation: Mapping[str, Any]) -> dict[str, Row]:
        """The vectors of an observation by the data set's keys. ``ValueError`` if one is missing or has another shape."""
        parts = self._parts(observation)
        found = {
            key: np.concatenate([parts[name].ravel() for name in names if name in parts]).astype(np.float32)
            for key, names in PARTS.items()
        }
        return found | {name: parts[name].astype(np.float32) for name in APART if name in parts}

    def images(self, observation: Mapping[str, Any]) -> dict[str, Image]:
        """The images of an observation by the data set's keys."""
        found = {}
        if self.spec.images is not None:
            tactile = self._checked("tactile", observation)
            found = {IMAGES + pad: tactile[n] for n, pad in enumerate(self.pads)}
        if self.camera is not None:
            found[IMAGES + "scene"] = self._checked("scene_camera", observation)
        return found

    def observation(self, vectors: Mapping[str, Any], images: Mapping[str, Image]) -> Observation:
        """The observation of which a frame consists: the inverse of `vectors` and `images`."""
        shapes = self.shapes()
        found: dict[str, Any] = {}
        for key, parts in PARTS.items():
            found |= features.apart(np.asarray(vectors[key], dtype=np.float32), {part: shapes[part] for part in parts if part in shapes})
        found |= {name: np.asarray(vectors[name], dtype=np.float32) for name in APART if name in shapes}
        if self.spec.images is not None:
            found["tactile"] = np.stack([images[IMAGES + pad] for pad in self.pads])
        if self.goal:
            tactile = {name: found[name] for name in ("tactile",) if name in found}
            flat = np.concatenate([found[name].ravel() for name in self._flattened()])
            return {**tactile, "observation": flat, "achieved_goal": found["achieved_goal"], "desired_goal": found["goal"]}
        if self.camera is not None:
            found["scene_camera"] = images[IMAGES + "scene"]
        return {name: found[name] for name in shapes}

    def batch(self, observation: Mapping[str, Any], task: str | None = None) -> dict[str, Any]:
        """A batch of one, as LeRobot's policies get it: vectors (1, n) and images (1, 3, side, side) from 0 to 1, float32, and the task in words."""
        vectors = self.vectors(observation)
        found: dict[str, Any] = {key: vectors[key][None] for key in PARTS}
        for key, image in self.images(observation).items():
            found[key] = (image.astype(np.float32) / np.float32(255.0)).transpose(2, 0, 1)[None]
        return found if task is None else {**found, "task": [task]}

    def _parts(self, observation: Mapping[str, Any]) -> dict[str, Any]:
        """The observations by the keys of `ftac.features`, without images."""
        shapes = {name: shape for name, shape in self.shapes().items() if name not in ("tactile", "scene_camera")}
        if not self.goal:
            return {name: self._checked(name, observation) for name in shapes}
        found = features.apart(observation["observation"], {name: shapes[name] for name in self._flattened()})
        return {**found, "goal": np.asarray(observation["desired_goal"]), "achieved_goal": np.asarray(observation["achieved_goal"])}

    def _flattened(self) -> list[str]:
        """Keys that an environment with goals flattens, in their order."""
        return [name for name in self.shapes() if name not in ("goal", "achieved_goal", "tactile")]

    def _checked(self, name: str, observation: Mapping[str, Any]) -> Any:
        shape = self.shapes()[name]
        found = np.asarray(observation[name]) if name in observation else None
        if found is None or found.shape != shape:
            raise ValueError(f"observation.{name}: found {'none' if found is None else found.shape}, expected shape {shape}")
        return found


def pad_names(pads: int) -> tuple[str, ...]:
    """Names of the pads of a hand with so many: those of the F-TAC Hand, or numbers."""
    own = tuple(pad.name for pad in hand.PADS)
    return own if len(own) == pads else tuple(f"pad_{n}" for n in range(1, pads + 1))
