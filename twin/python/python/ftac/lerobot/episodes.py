"""Episodes of the environments of `ftac.envs` as a data set."""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ftac._arrays import seed_of, whole
from ftac.features import Observation
from ftac.lerobot.layout import ACTION, Layout
from ftac.lerobot.ordered import in_order
from ftac.lerobot.progress import Progress
from ftac.lerobot.video import Quality
from ftac.lerobot.writer import Episode, Writer

Act = Callable[[Observation], Any]
Ran = tuple["Recorder", dict[str, Any], bool]
"""Steps of an episode, the info of its reset, and whether the task was done."""


class Taught(NamedTuple):
    """Two actions of one step of a recorded policy, as in DAgger: the data then do not repeat the motion."""

    moves: Any
    """The action that is carried out."""
    written: Any
    """The action that is recorded: what a teacher would do."""


class Recorder:
    """Collects the steps of one episode."""

    def __init__(self, layout: Layout) -> None:
        self.layout = layout
        self._vectors: dict[str, list[Any]] = {name: [] for name in layout.names()}
        self._images: dict[str, list[Any]] = {key: [] for key in layout.sides()}
        self._rewards: list[float] = []

    def add(self, observation: Mapping[str, Any], action: Any, reward: float | None = None) -> None:
        """Adds an observation, the action that follows it, and its reward."""
        vectors = {**self.layout.vectors(observation), ACTION: np.asarray(action, dtype=np.float32)}
        for name, rows in self._vectors.items():
            rows.append(vectors[name])
        for key, image in self.layout.images(observation).items():
            self._images[key].append(image)
        if reward is not None:
            self._rewards.append(reward)

    def episode(self, task: str, success: bool, about: dict[str, Any]) -> Episode:
        """The episode."""
        vectors = {name: np.array(rows, dtype=np.float32) for name, rows in self._vectors.items()}
        images = {key: np.array(rows, dtype=np.uint8) for key, rows in self._images.items()}
        return Episode(task, vectors, images, success, np.array(self._rewards) if self._rewards else None, about)


def record(
    env: Any,
    policy: Any,
    episodes: int,
    out: str | os.PathLike[str],
    *,
    seed: int = 1,
    only_successes: bool = True,
    attempts: int | None = None,
    video: Quality = "lossless",
    task: str | None = None,
    jobs: int = 1,
    quiet: bool = False,
) -> dict[str, Any]:
    """Runs episodes of an environment and writes them as the data set `out`. The same arguments give the same episodes.

    Parameters
    ----------
    env: an environment of `ftac.envs`, as ``gymnasium.make`` returns it (which limits its steps), with any observations and actions; or a function that makes
        one.
    policy: an object with ``act(observation)`` as of the benchmark (`ftac.bench`), whose ``reset(info)`` is called first if it has one; or a function that
        gets the environment after each reset and returns such an ``act``: ``lambda env: Script(env.unwrapped.features).act``. An action of
        None ends the episode; a `Taught` has the action to carry out and the one to record. For random actions the function makes a generator of its
        own for each episode: ``default_rng([env.unwrapped.np_random_seed, 1])``.
    episodes: number of episodes to write.
    out: folder, which must not exist. Nothing is left of it after an error.
    seed: of the first episode; the next ones have the following seeds.
    only_successes: whether only episodes in which the task is done are written.
    attempts: most episodes to run; None for ten times `episodes`. ``RuntimeError`` if there are too few successes among them.
    video: ``lossless``, or a constant rate factor (`ftac.lerobot.video`).
    task: the task in words; None for words with the objects' names.
    jobs: processes. With more than one, `env` and `policy` are functions that can be pickled, and a program that calls this does so under
        ``if __name__ == "__main__"``. The episodes do not depend on the number of processes.

    Returns ``dataset``, ``episodes``, ``frames``, ``bytes``, ``attempts`` and ``successes``.
    """
    episodes, seed = whole("episodes", episodes, 1, 1_000_000), seed_of(seed)
    attempts = 10 * episodes if attempts is None else whole("attempts", attempts, episodes, 10_000_000)
    jobs = whole("jobs", jobs, 1, 1024)
    if jobs > 1:
        _check_picklable("env", env, "a function that makes an environment")
        _check_picklable("policy", policy, "a function of the environment")
    here = env() if callable(env) else env
    layout = Layout.of(here)
    pick = here.unwrapped
    made = {"env": pick.task, "seed": seed, "only_successes": bool(only_successes)}
    writer = Writer(Path(out), layout, video=video, rewards=True, made=made)
    told = Progress(quiet)
    seeds, tried, successes = range(seed, seed + attempts), 0, 0
    runs = _runs(env, policy, seeds, layout, jobs) if jobs > 1 else (_run(here, policy, one, layout) for one in seeds)
    try:
        while writer.episodes < episodes:
            if tried == attempts:
                raise RuntimeError(f"attempts: found {successes} successes in {tried} episodes, expected {episodes}")
            steps, info, success = next(runs)
            about = {"seed": seed + tried, "combination": info["combination"], "objects": list(info["objects"])}
            tried, successes = tried + 1, successes + success
            if success or not only_successes:
                writer.add(steps.episode(task or words(layout.task or pick.task, info["objects"], layout.goal), success, about))
                if writer.is_full():
                    writer.finish_file()
            told.tell(f"{writer.episodes} of {episodes} episodes, {successes} of {tried} succeed", writer.episodes == episodes)
        return {**writer.finish(), "attempts": tried, "successes": successes}
    except BaseException:
        writer.abandon()
        raise
    finally:
        runs.close()
        told.end()


def _check_picklable(what: str, found: Any, expected: str) -> None:
    words = f"found {type(found).__name__} for several jobs, expected {expected} that can be pickled"
    # A policy with a state of its own would go on from another episode in each process.
    if not callable(found) or hasattr(found, "act"):
        raise ValueError(f"{what}: {words}")
    try:
        pickle.dumps(found)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise ValueError(f"{what}: {words} ({error})") from None


def _runs(env: Any, policy: Any, seeds: Iterable[int], layout: Layout, jobs: int) -> Generator[Ran, None, None]:
    """Episodes in processes of their own. They are spawned: a program that is forked while it has threads may wait for their locks forever."""
    pool = ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=_begin, initargs=(env, policy, layout))
    yield from in_order(pool, _run_there, ((seed,) for seed in seeds), jobs)


_there: list[Any] = []
"""Environment, policy and layout in a process of `_runs`."""


def _begin(env: Any, policy: Any, layout: Layout) -> None:
    _there[:] = env(), policy, layout


def _run_there(seed: int) -> Ran:
    env, policy, layout = _there
    return _run(env, policy, seed, layout)


def _run(env: Any, policy: Any, seed: int, layout: Layout) -> Ran:
    """An episode."""
    observation, begun = env.reset(seed=seed)
    act, steps, over, success = _act_of(policy, env, begun), Recorder(layout), False, False
    while not over:
        action = act(observation)
        if action is None:
            break
        moves, written = action if isinstance(action, Taught) else (action, action)
        if isinstance(action, Taught) and not env.action_space.contains(np.asarray(written, dtype=np.float32)):
            raise ValueError(f"written: found {written}, expected {env.action_space.shape[0]} numbers from -1 to 1")
        following, reward, terminated, truncated, info = env.step(np.asarray(moves, dtype=np.float32))
        steps.add(observation, written, float(reward))
        observation, over, success = following, terminated or truncated, bool(info["is_success"])
    return steps, begun, success


def _act_of(policy: Any, env: Any, info: dict[str, Any]) -> Act:
    if hasattr(policy, "act"):
        if hasattr(policy, "reset"):
            policy.reset(info)
        act: Act = policy.act
        return act
    if not callable(policy):
        raise ValueError(f"policy: found {type(policy).__name__}, expected an object with act(observation), or a function of the environment")
    act = policy(env)
    if not callable(act):
        raise ValueError(f"policy: found a function that returns {type(act).__name__}, expected one that returns act(observation)")
    return act


def words(task: str, objects: Sequence[str], goal: bool = False) -> str:
    """A task in words: that of `ftac.envs.Pick`, or ``sort``, in which nobody may know the object."""
    named = [name.replace("_", " ") for name in objects]
    if goal:
        return f"move the {named[0]} to the goal"
    if task == "sort":
        return "hold the object over the bin of its shape"
    if task == "pick_one":
        return f"pick up the {named[0]}"
    if task == "pick_second":
        return f"pick up the {named[1]} with the {named[0]} in the hand"
    return "pick up the " + ", then the ".join(named) + " beside it"
