"""Many environments side by side, stepped by one call."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from ftac import _native
from ftac._arrays import whole
from ftac.envs import PROGRESS, STEPS, Pick, State
from ftac.features import Observation
from ftac.sorting import Sort

Vector = NDArray[np.float32]


class VectorPick(gymnasium.vector.VectorEnv[Observation, Vector, NDArray[Any]]):
    """Many `ftac.envs.Pick` side by side: one call steps all of them, on as many threads as there are cores.

    An environment whose episode is over begins the next one in the step after, whatever its action (Gymnasium's ``NEXT_STEP``). Seeds of a reset are `seed`,
    `seed` + 1 and so on, one an environment. Arrays of ``info``: ``is_success``, ``held``, and ``progress`` (num_envs, 5); of that of `reset`: ``objects``,
    ``combination``, ``yaws``, ``detected``, ``drawn``, and with images ``untouched``.

    Parameters
    ----------
    num_envs: number of environments. Those in ``envs`` have no images of their own: they are copied together.
    max_episode_steps: after which an episode is truncated; None for those of its task.
    jobs: threads; None for one a core.
    options: of `ftac.envs.Pick`.
    """

    _ENV: type[Pick] = Pick
    metadata: dict[str, Any] = {**Pick.metadata, "autoreset_mode": gymnasium.vector.AutoresetMode.NEXT_STEP}

    def __init__(
        self, num_envs: int, *, max_episode_steps: int | None = None, jobs: int | None = None, **options: Any
    ) -> None:
        num_envs = whole("num_envs", num_envs, 1, 4096)
        self.envs = [self._ENV(**options) for _ in range(num_envs)]
        for env in self.envs:
            env._pictures = False
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
        """Begins an episode in every environment. ``options`` are those of `ftac.envs.Pick.reset`."""
        if isinstance(seed, list):
            seeds = seed
        else:
            seeds = [None if seed is None else seed + n for n in range(self.num_envs)]
        if len(seeds) != self.num_envs:
            raise ValueError(f"seed: found {len(seeds)} seeds, expected {self.num_envs}")
        begun = self._each(lambda pair: pair[0].reset(seed=pair[1], options=options), zip(self.envs, seeds))
        self._steps[:], self._over[:] = 0, False
        names = ("objects", "combination", "yaws", "drawn")
        info: dict[str, Any] = {name: _objects([one[name] for _, one in begun]) for name in names}
        for name in ("class", "detected", "untouched"):
            if name in begun[0][1]:
                info[name] = np.stack([one[name] for _, one in begun])
        return self._together([observation for observation, _ in begun]), info

    def step(
        self, actions: Vector
    ) -> tuple[Observation, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """A step of 1/20 s of every environment. If the shape of `actions` is refused, with a ``ValueError``, no environment is stepped."""
        size = int(np.prod(self.single_action_space.shape or ()))
        if np.shape(actions) != (self.num_envs, size):
            raise ValueError(f"actions: found shape {np.shape(actions)}, expected ({self.num_envs}, {size})")
        going = [n for n in range(self.num_envs) if not self._over[n]]
        if not np.all(np.abs(actions[going]) <= 1.0):
            raise ValueError(f"actions: found {actions}, expected numbers from -1 to 1")
        commands = [self.envs[n]._command(actions[n]) for n in going]
        episodes = [episode for n in going if (episode := self.envs[n]._episode) is not None]
        judged = _native.step_all(episodes, commands, self.jobs)
        rewards = np.zeros(self.num_envs)
        terminated, truncated = np.zeros(self.num_envs, np.bool_), np.zeros(self.num_envs, np.bool_)
        held, success = np.empty(self.num_envs, dtype=object), np.zeros(self.num_envs, np.bool_)
        progress = np.zeros((self.num_envs, len(PROGRESS)))
        observations: list[Observation] = [{} for _ in self.envs]
        for n, judgement in zip(going, judged):
            observations[n], rewards[n], terminated[n], _, info = self.envs[n]._judge(judgement)
            held[n], success[n], progress[n] = info["held"], info["is_success"], list(info["progress"].values())
        self._steps[going] += 1
        truncated[going] = (self._steps[going] >= self._most) & ~terminated[going]
        again = [n for n in range(self.num_envs) if self._over[n]]
        for n, (observation, _) in zip(again, self._each(lambda n: self.envs[n].reset(), again)):
            observations[n], self._steps[n] = observation, 0
        self._over = terminated | truncated
        info = {"held": held, "is_success": success, "progress": progress}
        return self._together(observations), rewards, terminated, truncated, info

    def save(self) -> list[State]:
        """The present states of all environments, see `ftac.envs.Pick.save`."""
        return [env.save() for env in self.envs]

    def restore(self, states: list[State]) -> Observation:
        """Returns to states of `save`, with the observations in them."""
        if len(states) != self.num_envs:
            raise ValueError(f"states: found {len(states)}, expected {self.num_envs}")
        self._over[:] = False
        return self._together([env.restore(state) for env, state in zip(self.envs, states)])

    def render(self) -> Any:
        """A picture of every environment, see `ftac.envs.Pick.render`."""
        return tuple(env.render() for env in self.envs)

    def _together(self, observations: list[Observation]) -> Observation:
        """Arrays of the observations of all environments, with their images."""
        found = {name: np.stack([observation[name] for observation in observations]) for name in observations[0]}
        if self.envs[0].images is not None:
            episodes = [env._episode for env in self.envs if env._episode is not None]
            change = self.envs[0].spec_of_features.tactile == "change"
            found["tactile"] = _native.tactile_of_all(episodes, change, self.jobs)
        return found

    def _each(self, work: Callable[[Any], Any], items: Any) -> list[Any]:
        with ThreadPoolExecutor(self.jobs) as threads:
            return list(threads.map(work, items))


class VectorSort(VectorPick):
    """Many `ftac.sorting.Sort` side by side, as `VectorPick`. ``info`` of `reset` has the numbers of the ``class``."""

    _ENV = Sort


def _objects(values: list[Any]) -> NDArray[Any]:
    """An array with one Python object for each environment."""
    array = np.empty(len(values), dtype=object)
    array[:] = values
    return array
