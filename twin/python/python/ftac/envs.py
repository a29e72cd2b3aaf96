"""Gymnasium environments: pick one object, a second one beside the first, or two.

``import ftac`` registers ``ftac/PickOne-v0``, ``ftac/PickSecond-v0`` and ``ftac/PickTwo-v0`` where ``gymnasium`` is installed.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from ftac import _actions, _native
from ftac._arrays import robot_of, side_of, whole

Task = Literal["pick_one", "pick_second", "pick_two"]
Observation = dict[str, Any]
"""Arrays by name."""
Vector = NDArray[np.float32]

OBJECTS = {"pick_one": 1, "pick_second": 2, "pick_two": 2}
STEPS = {"pick_one": 300, "pick_second": 300, "pick_two": 600}
"""Steps of 1/20 s after which an episode is truncated."""
SIDE = 480
"""Side of a rendered picture, pixels."""


class Pick(gymnasium.Env[Observation, Vector]):
    """Objects of the benchmark are to be lifted and held for a second.

    **Actions** (12,) float32, each from -1 to 1: the palm's velocity (3) and angular velocity (3) in world axes, as shares of 0.25 m/s and 1 rad/s; the five
    cables' tensions (thumb, index, middle, ring, little) from 0 to 60 N; the thumb's opposition over its range. They hold for 1/20 s.

    **Observations**, all float32 but the images; nothing in them is the scene's truth:

    - ``servos`` (6, 3): angle (rad), speed (rad/s), current (A).
    - ``arm`` (7, 3), a row for each of its joints: angle (rad), speed (rad/s), torque (N m).
    - ``palm`` (7,): ``world_from_palm`` by the arm's encoders.
    - ``command`` (6,): the last action's tensions and opposition, -1 to 1.
    - ``detected`` (objects, 7): ``world_from_object`` as vision reported it when the episode began, with its error (some 7 mm and 0.08 rad with ``reality``).
    - ``tactile`` (17, n, n, 3) uint8: an image a pad; only with ``images``. Those of the untouched pads are in the ``info`` of `reset`.

    **Rewards**: ``sparse`` is 1 in the step in which the task is done and 0 before. ``shaped`` adds what the step has gained in progress, from 0 (far) by being
    near, touching and lifting to 1 (lifted). Rewards are judged by the true scene, and so is ``info["held"]``.

    **Ends**: terminated when the task is done or an object has left the table; truncated after `STEPS`.

    Parameters
    ----------
    task: ``pick_one`` (one object alone), ``pick_second`` (the first one is in the hand already) or ``pick_two``.
    images: side of the tactile images in pixels, 8 to 240; None for none. Smaller ones are formed on 64 or more points a side, which is quick; the log says how
        far they are from the mean of full ones (a grey level, and more at sharp edges).
    reward: ``sparse`` or ``shaped``.
    combination: number of a combination of the benchmark (see `ftac.combinations`); None draws one for every episode.
    reality: the benchmark's errors of arm and vision and effects of reality; without it nothing errs.
    robot_model: file of another robot (`hand-model/data/robots` has the hand on a UR5e and on a Panda), for ``pick_one`` and ``pick_two``; None for the
        F-TAC Hand on a Gen3.
    render_mode: ``rgb_array``: `render` returns a picture (480, 480, 3) uint8 of the true scene, for people.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 20}

    SPEED, TURN_SPEED, TENSION = _actions.SPEED, _actions.TURN_SPEED, _actions.TENSION

    def __init__(
        self,
        task: Task = "pick_one",
        *,
        images: int | None = None,
        reward: Literal["sparse", "shaped"] = "sparse",
        combination: int | None = None,
        reality: bool = True,
        robot_model: str | os.PathLike[str] | None = None,
        render_mode: str | None = None,
    ) -> None:
        if task not in OBJECTS:
            raise ValueError(f"task: found {task!r}, expected one of {', '.join(OBJECTS)}")
        if reward not in ("sparse", "shaped"):
            raise ValueError(f"reward: found {reward!r}, expected sparse or shaped")
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode: found {render_mode!r}, expected rgb_array or None")
        images = side_of(images)
        if combination is not None:
            combination = whole("combination", combination, 0, len(_native.combinations()) - 1)
        self.task, self.images, self.reward, self.combination, self.reality = task, images, reward, combination, reality
        self.render_mode = render_mode
        self._robot, joints, pads = robot_of(robot_model)
        self._episode: _native.Episode | None = None
        self._shown: _native.Episode | None = None
        self._opposition = np.zeros(2)
        self._command = np.zeros(6, dtype=np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (12,), np.float32)

        def real(*shape: int) -> spaces.Box:
            return spaces.Box(-np.inf, np.inf, shape, np.float32)

        observed: dict[str, spaces.Space[Any]] = {
            "servos": real(6, 3),
            "arm": real(joints, 3),
            "palm": real(7),
            "command": spaces.Box(-1.0, 1.0, (6,), np.float32),
            "detected": real(OBJECTS[task], 7),
        }
        if images is not None:
            observed["tactile"] = spaces.Box(0, 255, (pads, images, images, 3), np.uint8)
        self.observation_space = spaces.Dict(observed)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins an episode. After ``reset(seed=...)`` everything that follows is the same to the bit. There are no ``options``.

        ``info`` names the ``objects`` and the ``combination``, and has each object's turn about the vertical from its rest pose as seen: ``yaws``, rad. With
        ``images`` it has ``untouched`` too: the pads before anything touched them, as the observation's ``tactile``.
        """
        _check_options(options)
        super().reset(seed=seed)
        drawn = int(self.np_random.integers(2**40))
        self._episode = _native.Episode(self.task, self.images, self.combination, drawn, self.reality, self._robot)
        self._shown = self._episode
        self._opposition = self._episode.limits()["opposition"]
        tensions, opposition = self._episode.grip()
        self._command = _actions.command(tensions, opposition, self._opposition)
        names, yaws = self._episode.objects(), self._episode.yaws()
        info: dict[str, Any] = {"objects": names, "yaws": yaws, "combination": self._episode.combination()}
        if self.images is not None:
            info["untouched"] = self._episode.untouched()
        return self._observe(), info

    def step(self, action: Vector) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Carries out `action` for 1/20 s. ``ValueError`` for one that is not in the action space."""
        row = self._row(action)
        assert self._episode is not None
        return self._judge(action, self._episode.step((row[:6], None, row[6:11], float(row[11]), None)))

    def _row(self, action: Vector) -> NDArray[np.float64]:
        """Twist, tensions, opposition of an action."""
        if self._episode is None:
            raise gymnasium.error.ResetNeeded("the episode is over or has not begun: call reset() first")
        return _actions.row(action, self._opposition)

    def _judge(
        self, action: Vector, judged: tuple[list[bool], float, float, bool, bool]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        held, _, gained, success, lost = judged
        self._command = np.asarray(action)[6:].astype(np.float32)
        reward = float(success) + (gained if self.reward == "shaped" else 0.0)
        observation = self._observe()
        if success or lost:
            self._episode = None
        return observation, reward, success or lost, False, {"held": held, "is_success": success}

    def render(self) -> NDArray[np.uint8] | None:
        """The scene as it is, (480, 480, 3) uint8; None without ``render_mode``."""
        if self.render_mode is None:
            return None
        if self._shown is None:
            raise gymnasium.error.ResetNeeded("nothing to show yet: call reset() first")
        return self._shown.picture(SIDE)

    def grip_action(self) -> Vector:
        """The action that moves nothing and pulls as before: what `pick_second` holds the first object with."""
        return np.concatenate([np.zeros(6, dtype=np.float32), self._command])

    def thumb(self, opposition: float) -> float:
        """Share of the opposition joint's range, -1 to 1, at which it is at `opposition` (rad)."""
        return _actions.thumb(opposition, self._opposition)

    def _observe(self) -> Observation:
        assert self._episode is not None
        return _actions.observation(self._episode.observe(), self._command)


class VectorPick(gymnasium.vector.VectorEnv[Observation, Vector, NDArray[Any]]):
    """Many `Pick` side by side: one call steps all of them, on as many threads as there are cores.

    An environment whose episode is over begins the next one in the step after, whatever its action (Gymnasium's ``NEXT_STEP``). Seeds of a reset are `seed`,
    `seed` + 1 and so on, one an environment. ``info["is_success"]`` and ``info["held"]`` are arrays.

    Parameters
    ----------
    num_envs: how many.
    max_episode_steps: after which an episode is truncated; None for those of its task.
    jobs: threads; None for one a core.
    options: of `Pick`.
    """

    metadata: dict[str, Any] = {**Pick.metadata, "autoreset_mode": gymnasium.vector.AutoresetMode.NEXT_STEP}

    def __init__(
        self, num_envs: int, *, max_episode_steps: int | None = None, jobs: int | None = None, **options: Any
    ) -> None:
        num_envs = whole("num_envs", num_envs, 1, 4096)
        self.envs = [Pick(**options) for _ in range(num_envs)]
        self.num_envs, self.jobs = num_envs, jobs or os.cpu_count() or 1
        self.render_mode = self.envs[0].render_mode
        self.single_observation_space = self.envs[0].observation_space
        self.single_action_space = self.envs[0].action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._most = STEPS[self.envs[0].task] if max_episode_steps is None else max_episode_steps
        self._steps = np.zeros(num_envs, dtype=np.int64)
        self._over = np.zeros(num_envs, dtype=np.bool_)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins an episode in every environment. There are no ``options``."""
        _check_options(options)
        seeds = seed if isinstance(seed, list) else [None if seed is None else seed + n for n in range(self.num_envs)]
        if len(seeds) != self.num_envs:
            raise ValueError(f"seed: found {len(seeds)} seeds, expected {self.num_envs}")
        with ThreadPoolExecutor(self.jobs) as threads:
            begun = list(threads.map(lambda pair: pair[0].reset(seed=pair[1]), zip(self.envs, seeds)))
        self._steps[:], self._over[:] = 0, False
        info = {name: np.array([info[name] for _, info in begun], dtype=object) for name in ("objects", "combination")}
        if self.envs[0].images is not None:
            info["untouched"] = np.stack([info["untouched"] for _, info in begun])
        return _stacked([observation for observation, _ in begun]), info

    def step(
        self, actions: Vector
    ) -> tuple[Observation, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """A step of 1/20 s of every environment. If an action is refused, with a ``ValueError``, no environment is stepped."""
        if np.shape(actions) != (self.num_envs, 12):
            raise ValueError(f"actions: found shape {np.shape(actions)}, expected ({self.num_envs}, 12)")
        going = [n for n in range(self.num_envs) if not self._over[n]]
        rows = [self.envs[n]._row(actions[n]) for n in going]
        episodes = [episode for n in going if (episode := self.envs[n]._episode) is not None]
        judged = _native.step_all(episodes, np.ascontiguousarray(rows).reshape(-1, 12), self.jobs)
        rewards = np.zeros(self.num_envs)
        terminated, truncated = np.zeros(self.num_envs, np.bool_), np.zeros(self.num_envs, np.bool_)
        held, success = np.empty(self.num_envs, dtype=object), np.zeros(self.num_envs, np.bool_)
        observations: list[Observation] = [{} for _ in self.envs]
        for n, judgement in zip(going, judged):
            observations[n], rewards[n], terminated[n], _, info = self.envs[n]._judge(actions[n], judgement)
            held[n], success[n] = info["held"], info["is_success"]
        self._steps[going] += 1
        truncated[going] = (self._steps[going] >= self._most) & ~terminated[going]
        again = [n for n in range(self.num_envs) if self._over[n]]
        with ThreadPoolExecutor(self.jobs) as threads:
            for n, (observation, _) in zip(again, threads.map(lambda n: self.envs[n].reset(), again)):
                observations[n], self._steps[n] = observation, 0
        self._over = terminated | truncated
        return _stacked(observations), rewards, terminated, truncated, {"held": held, "is_success": success}


def _stacked(observations: list[Observation]) -> Observation:
    return {name: np.stack([observation[name] for observation in observations]) for name in observations[0]}


def _check_options(options: dict[str, Any] | None) -> None:
    if options:
        raise ValueError(f"options: found {next(iter(options))!r}, expected none: what an episode has is said when its environment is made")


def register() -> None:
    """Makes the environments known to ``gymnasium.make``. Once is enough; ``import ftac`` does it."""
    for name, task in (("PickOne", "pick_one"), ("PickSecond", "pick_second"), ("PickTwo", "pick_two")):
        if f"ftac/{name}-v0" not in gymnasium.registry:
            gymnasium.register(
                f"ftac/{name}-v0",
                entry_point="ftac.envs:Pick",
                vector_entry_point="ftac.envs:VectorPick",
                max_episode_steps=STEPS[task],
                kwargs={"task": task},
            )
