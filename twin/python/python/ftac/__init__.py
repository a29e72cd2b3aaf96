"""The F-TAC Hand on a Kinova Gen3 arm, simulated: scenes, tactile images, grasps, and Gymnasium environments.

SI units and radians throughout. Frames are right-handed: ``world`` has the table's top at z = 0, z up and the arm's base in its origin; ``palm`` has y
towards the fingertips, x towards the thumb's side and -z out of the palm; ``pad`` has its origin in the middle of the pad's surface, y along the digit
and z out of the surface. ``a_from_b`` maps coordinates in b to a. A pose is seven numbers: x, y, z and the quaternion x, y, z, w, with w >= 0.

- `Scene`: arm, hand and objects, stepped at 20 Hz.
- `hand`: kinematics, Jacobians, pads, transmission.
- `optics`: tactile images of what presses into a pad.
- `touch`: heights and normals from tactile images.
- `grasps`: the grasps that come with the program.
- `bench`: your own policy in the benchmark's trials.
- `robot`: your own robot as a backend of the trials.
- `features`: observations and actions as learners use them, the same in environments, policies and exported data.
- `envs`, `sorting`, `vector`: Gymnasium environments; they are registered where ``gymnasium`` is installed.
- `randomization`: fields of the scenario that every episode draws anew.
- `scripted`: a policy for them that carries out one planned pick-up.
- `plot`: plots in one call, with ``matplotlib``.
- `lerobot`: LeRobot data sets of environment episodes, recorded sessions and demonstrations, and policies trained on them.

In a notebook, scenes, presses, surfaces, grasps, images and rows of trials show themselves as pictures or tables. Bad input raises `ValueError` with what
was found and what was expected.
"""

from __future__ import annotations

import importlib
import importlib.metadata
import importlib.util
import warnings
from typing import Any

from ftac import bench, features, grasps, hand, lerobot, optics, randomization, robot, scripted, touch
from ftac._native import combinations, objects
from ftac.scene import Scene

__version__ = importlib.metadata.version("ftac")
__all__ = [
    "Scene",
    "bench",
    "combinations",
    "features",
    "grasps",
    "hand",
    "lerobot",
    "objects",
    "optics",
    "randomization",
    "robot",
    "scripted",
    "touch",
]

_GYM_MISSING = "pip install 'ftac[gym]'"
if importlib.util.find_spec("gymnasium") is not None:
    try:
        import gymnasium as _  # noqa: F401
    except Exception as error:
        # Built for another numpy, for example. Everything else of the package works without it.
        _GYM_MISSING = f"the installed one cannot be imported: {type(error).__name__}: {error}"
        warnings.warn(f"ftac: no environments, because of gymnasium: {_GYM_MISSING}", stacklevel=2)
    else:
        from ftac import envs, sorting, vector

        envs.register()
        __all__ += ["envs", "sorting", "vector"]


def __getattr__(name: str) -> Any:
    if name == "plot":
        # Loaded when it is used, because matplotlib is optional and takes time to load.
        return importlib.import_module("ftac.plot")
    if name in ("envs", "sorting", "vector"):
        raise ImportError(f"ftac.{name} needs gymnasium: {_GYM_MISSING}")
    raise AttributeError(f"module 'ftac' has no attribute {name!r}")
