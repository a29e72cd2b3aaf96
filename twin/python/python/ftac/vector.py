"""Many environments side by side, stepped by one call."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from ftac import _native
from ftac._arrays import real, seed_of, whole
from ftac.envs import PROGRESS, STEPS, Pick, State
from ftac.features import Observation
from ftac.sorting import Sort

Vector = NDArray[np.float32]
UNJUDGED: dict[str, Any] = {"held": [], "is_success": False, "progress": np.zeros(len(PROGRESS))}
"""What a step tells of an environment that was not stepped."""


class VectorPick(gymnasium.vector.VectorEnv[Observation, Vector, NDArray[Any]]):
    """Many `ftac.envs.Pick` side by side: one call steps all of them, on as many threads as there are cores.

    An environment whose episode is over begins the next one in the step after, whatever its action (Gymnasium's ``NEXT_STEP``). Seeds of a reset are `seed`,
    `seed` + 1 and so on, one an environment. Arrays of ``info``: ``is_success``, ``held``, and ``progress`` (num_envs, 5), of environments that were stepped; ``objects``,
    ``combination``, ``yaws``, ``detected``, ``drawn``, and with images ``untouched``, of those that began an episode, in `reset` or in a step. For each there is the array of
    the environments that have it, with ``_`` before its name, as Gymnasium's own vector environments do.

    Parameters
    ----------
    num_envs: number of environments. Those in ``envs`` have no images of their own: they are copied together.
    max_episode_steps: after which an episode is truncated; None for those of its task, -1 for no limit.
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
        self.num_envs = num_envs
        self.jobs = (os.cpu_count() or 1) if jobs is None else whole("jobs", jobs, 1, 4096)
        self.render_mode = self.envs[0].render_mode
        self.single_observation_space = self.envs[0].observation_space
        self.single_action_space = self.envs[0].action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        if max_episode_steps is None:
            max_episode_steps = STEPS[self.envs[0].task]
        self._most = np.iinfo(np.int64).max if max_episode_steps == -1 else whole("max_episode_steps", max_episode_steps, 1, 2**53)
        self._steps = np.zeros(num_envs, dtype=np.int64)
        self._over = np.zeros(num_envs, dtype=np.bool_)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins an episode in every environment. ``options`` are those of `ftac.envs.Pick.reset`."""
        if seed is None or isinstance(seed, (list, tuple)):
            seeds: list[int | None] = [None] * self.num_envs if seed is None else list(seed)
        else:
            seeds = [seed_of(seed) + n for n in range(self.num_envs)]
        if len(seeds) != self.num_envs:
            raise ValueError(f"seed: found {len(seeds)} seeds, expected {self.num_envs}")
        begun = self._each(lambda pair: pair[0].reset(seed=pair[1], options=options), zip(self.envs, seeds))
        self._steps[:], self._over[:] = 0, False
        return self._together([observation for observation, _ in begun]), self._told(range(self.num_envs), [info for _, info in begun])

    def step(
        self, actions: Vector
    ) -> tuple[Observation, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """A step of 1/20 s of every environment. If the shape of `actions` is refused, with a ``ValueError``, no environment is stepped."""
        size = int(np.prod(self.single_action_space.shape or ()))
        actions = real("actions", actions)
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
        observations: list[Observation] = [{} for _ in self.envs]
        infos = []
        for n, judgement in zip(going, judged):
            observations[n], rewards[n], terminated[n], _, info = self.envs[n]._judge(judgement)
            infos.append({**info, "progress": np.array(list(info["progress"].values()))})
        self._steps[going] += 1
        truncated[going] = (self._steps[going] >= self._most) & ~terminated[going]
        again = [n for n in range(self.num_envs) if self._over[n]]
        begun = self._each(lambda n: self.envs[n].reset(), again)
        for n, (observation, _) in zip(again, begun):
            observations[n], self._steps[n] = observation, 0
        self._over = terminated | truncated
        told = {**self._told(again, [info for _, info in begun]), **self._told(going, infos or [UNJUDGED])}
        return self._together(observations), rewards, terminated, truncated, told

    def save(self) -> list[State]:
        """The present states of all environments, see `ftac.envs.Pick.save`, and how far their episodes are."""
        progress = zip(self.envs, self._steps.tolist(), self._over.tolist())
        states = ((env.save(), {"steps": steps, "ended": over}) for env, steps, over in progress)
        return [State(state.episode, {**state.python, **counted}) for state, counted in states]

    def restore(self, states: list[State]) -> Observation:
        """Returns to states of `save`, with the observations in them. States of `ftac.envs.Pick.save` are taken as those of episodes that have just begun."""
        if len(states) != self.num_envs:
            raise ValueError(f"states: found {len(states)}, expected {self.num_envs}")
        observations = [env.restore(state) for env, state in zip(self.envs, states)]
        self._steps[:] = [state.python.get("steps", 0) for state in states]
        self._over[:] = [state.python.get("ended", state.python["over"]) for state in states]
        return self._together(observations)

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

    def _told(self, numbers: Sequence[int], infos: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
        """Arrays of the infos of the environments of these numbers, and who they are. The first info says what there is."""
        told: dict[str, Any] = {}
        for name in infos[0] if infos else ():
            first = infos[0][name]
            # Arrays and numbers have one size in all environments; lists need not.
            stacked = isinstance(first, (np.ndarray, bool, int))
            shape, kind = (np.shape(first), np.asarray(first).dtype) if stacked else ((), np.dtype(object))
            values = np.zeros((self.num_envs, *shape), kind) if stacked else np.full(self.num_envs, None, kind)
            among = np.zeros(self.num_envs, np.bool_)
            for n, info in zip(numbers, infos):
                values[n], among[n] = info[name], True
            told[name], told[f"_{name}"] = values, among
        return told

    def _each(self, work: Callable[[Any], Any], items: Any) -> list[Any]:
        with ThreadPoolExecutor(self.jobs) as threads:
            return list(threads.map(work, items))


class VectorSort(VectorPick):
    """Many `ftac.sorting.Sort` side by side, as `VectorPick`. ``info`` of `reset` has the numbers of the ``class``."""

    _ENV = Sort
