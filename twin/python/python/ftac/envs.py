"""Gymnasium environments: pick one object, a second one beside the first, or two.

``import ftac`` registers ``ftac/PickOne-v0``, ``ftac/PickSecond-v0`` and ``ftac/PickTwo-v0`` where ``gymnasium`` is installed.
"""

from __future__ import annotations

from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ftac import _native

Task = Literal["pick_one", "pick_second", "pick_two"]
Observation = dict[str, Any]
"""Arrays by name."""
Vector = NDArray[np.float32]

OBJECTS = {"pick_one": 1, "pick_second": 2, "pick_two": 2}
STEPS = {"pick_one": 300, "pick_second": 300, "pick_two": 600}
"""Steps of 1/20 s after which an episode is truncated."""


class Pick(gymnasium.Env[Observation, Vector]):
    """Objects of the benchmark are to be lifted and held for a second.

    **Actions** (12,) float32, each from -1 to 1: the palm's velocity (3) and angular velocity (3) in world axes, as shares of 0.25 m/s and 1 rad/s; the five
    cables' tensions (thumb, index, middle, ring, little) from 0 to 60 N; the thumb's opposition over its range. They hold for 1/20 s.

    **Observations**, all float32 but the images; nothing in them is the scene's truth:

    - ``servos`` (6, 3): angle (rad), speed (rad/s), current (A).
    - ``arm`` (7, 3): angle (rad), speed (rad/s), torque (N m).
    - ``palm`` (7,): ``world_from_palm`` by the arm's encoders.
    - ``command`` (6,): the last action's tensions and opposition, -1 to 1.
    - ``seen`` (objects, 7): ``world_from_object`` as vision reported it when the episode began, with its error (some 7 mm and 0.08 rad with ``reality``).
    - ``tactile`` (17, n, n, 3) uint8: an image a pad; only with ``images``.

    **Rewards**: ``sparse`` is 1 in the step in which the task is done and 0 before. ``shaped`` adds what the step has gained in progress, from 0 (far) by being
    near, touching and lifting to 1 (lifted). Rewards are judged by the true scene, and so is ``info["held"]``.

    **Ends**: terminated when the task is done or an object has left the table; truncated after `STEPS`.

    Parameters
    ----------
    task: ``pick_one`` (one object alone), ``pick_second`` (the first one is in the hand already) or ``pick_two``.
    images: side of the tactile images in pixels, 8 to 240; None for none.
    reward: ``sparse`` or ``shaped``.
    combination: number of a combination of the benchmark (see `ftac.combinations`); None draws one for every episode.
    reality: the benchmark's errors of arm and vision and effects of reality; without it nothing errs.
    """

    metadata: dict[str, Any] = {"render_modes": [], "render_fps": 20}

    SPEED, TURN_SPEED, TENSION = 0.25, 1.0, 60.0

    def __init__(
        self,
        task: Task = "pick_one",
        *,
        images: int | None = None,
        reward: Literal["sparse", "shaped"] = "sparse",
        combination: int | None = None,
        reality: bool = True,
        render_mode: None = None,
    ) -> None:
        if task not in OBJECTS:
            raise ValueError(f"task: found {task!r}, expected one of {', '.join(OBJECTS)}")
        if reward not in ("sparse", "shaped"):
            raise ValueError(f"reward: found {reward!r}, expected sparse or shaped")
        if render_mode is not None:
            raise ValueError(f"render_mode: found {render_mode!r}, expected None")
        if images is not None and not 8 <= images <= 240:
            raise ValueError(f"images: found {images}, expected 8 to 240 pixels")
        self.task, self.images, self.reward, self.combination, self.reality = task, images, reward, combination, reality
        self.render_mode = render_mode
        self._episode: _native.Episode | None = None
        self._opposition = np.zeros(2)
        self._command = np.zeros(6, dtype=np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (12,), np.float32)

        def real(*shape: int) -> spaces.Box:
            return spaces.Box(-np.inf, np.inf, shape, np.float32)

        self._measured = ["servos", "arm", "palm", "seen"]
        observed: dict[str, spaces.Space[Any]] = {
            "servos": real(6, 3),
            "arm": real(7, 3),
            "palm": real(7),
            "command": spaces.Box(-1.0, 1.0, (6,), np.float32),
            "seen": real(OBJECTS[task], 7),
        }
        if images is not None:
            observed["tactile"] = spaces.Box(0, 255, (17, images, images, 3), np.uint8)
        self.observation_space = spaces.Dict(observed)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins an episode. After ``reset(seed=...)`` everything that follows is the same to the bit.

        ``info`` names the ``objects`` and the ``combination``, and has each object's turn about the vertical from its rest pose as seen: ``yaws``, rad.
        """
        super().reset(seed=seed)
        drawn = int(self.np_random.integers(2**40))
        self._episode = _native.Episode(self.task, self.images, self.combination, drawn, self.reality)
        self._opposition = self._episode.limits()["opposition"]
        tensions, opposition = self._episode.grip()
        pulled = [2.0 * tension / self.TENSION - 1.0 for tension in tensions]
        self._command = np.clip([*pulled, self.thumb(opposition)], -1.0, 1.0).astype(np.float32)
        names, yaws = self._episode.objects(), self._episode.yaws()
        return self._observe(), {"objects": names, "yaws": yaws, "combination": self._episode.combination()}

    def step(self, action: Vector) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Carries out `action` for 1/20 s. ``ValueError`` for one that is not in the action space."""
        if self._episode is None:
            raise gymnasium.error.ResetNeeded("the episode is over or has not begun: call reset() first")
        found = np.asarray(action)
        if found.shape != (12,) or not np.all(np.abs(found) <= 1.0):
            raise ValueError(f"action: found {found}, expected 12 numbers from -1 to 1")
        shares = found.astype(np.float64)
        twist = np.concatenate([self.SPEED * shares[:3], self.TURN_SPEED * shares[3:6]])
        tensions = 0.5 * (shares[6:11] + 1.0) * self.TENSION
        lowest, highest = self._opposition
        opposition = float(lowest + 0.5 * (shares[11] + 1.0) * (highest - lowest))
        held, _, gained, success, lost = self._episode.step(twist, None, tensions, opposition, None)
        self._command = found[6:].astype(np.float32)
        reward = float(success) + (gained if self.reward == "shaped" else 0.0)
        observation = self._observe()
        if success or lost:
            self._episode = None
        return observation, reward, success or lost, False, {"held": held, "is_success": success}

    def grip_action(self) -> Vector:
        """The action that moves nothing and pulls as before: what `pick_second` holds the first object with."""
        return np.concatenate([np.zeros(6, dtype=np.float32), self._command])

    def thumb(self, opposition: float) -> float:
        """Share of the opposition joint's range, -1 to 1, at which it is at `opposition` (rad)."""
        lowest, highest = self._opposition
        return float(2.0 * (opposition - lowest) / (highest - lowest) - 1.0)

    def _observe(self) -> Observation:
        assert self._episode is not None
        measured = self._episode.observe()
        observation: Observation = {name: measured[name].astype(np.float32) for name in self._measured}
        observation["command"] = self._command.copy()
        if self.images is not None:
            observation["tactile"] = measured["tactile"]
        return observation


def register() -> None:
    """Makes the environments known to ``gymnasium.make``. Once is enough; ``import ftac`` does it."""
    for name, task in (("PickOne", "pick_one"), ("PickSecond", "pick_second"), ("PickTwo", "pick_two")):
        if f"ftac/{name}-v0" not in gymnasium.registry:
            gymnasium.register(
                f"ftac/{name}-v0", entry_point="ftac.envs:Pick", max_episode_steps=STEPS[task], kwargs={"task": task}
            )
