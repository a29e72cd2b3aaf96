"""Trials of the benchmark under the built-in policy ``touch`` as episodes, with the observations and actions of ``ftac/PickTwo-v1``.

The controller of the program moves the robot at 120 Hz. An action of a step leads to the set-points that the controller has at the end of the step, so that
actions at 20 Hz are a good approximation of its commands and not the same: `replay` measures whether they lead to the same outcome.
"""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ftac import _native, features
from ftac._poses import compose, pose_matrix, rotation_of_vector, rotation_vector
from ftac.features import STEP, Features, Observation, Row, Spec
from ftac.lerobot.episodes import Recorder, words
from ftac.lerobot.layout import Layout
from ftac.lerobot.writer import Episode

Array = NDArray[np.float64]
SPEC = Spec(images=64, hand="tensions", grasp=True)
"""Observations and actions of the demonstrations: velocities of the palm, tensions, and the planned grasp of each object alone."""


def trial(benchmark: _native.Benchmark, combination: int, number: int, spec: Spec = SPEC) -> tuple[Episode | None, dict[str, Any]]:
    """Runs a trial. Returns its episode, or None if it is no clean success, and its record.

    `spec` has images, and actions of the kinds ``twist``, ``palm_twist`` or ``joints`` with ``tensions``.
    """
    if spec.images is None or spec.arm not in ("twist", "palm_twist", "joints") or spec.hand != "tensions":
        raise ValueError(f"spec: found {spec}, expected images, an arm of twist, palm_twist or joints, and a hand of tensions")
    steps = benchmark.steps(combination, number, spec.images)
    record: dict[str, Any] = json.loads(steps["record"])
    return (episode_of(steps, spec, True) if record["clean_success"] else None), record


def episode_of(steps: dict[str, Any], spec: Spec, success: bool) -> Episode:
    """The episode of a trial's `steps`, as the native module returns them."""
    reset = json.loads(steps["reset"])
    info = reset["info"]
    learner = Features(
        spec,
        reset["limits"],
        detected=steps["detected"],
        objects=info["objects"],
        yaws=info["yaws"],
        shape=reset["object_features"],
        untouched=steps["untouched"],
    )
    recorder = Recorder(Layout(spec, len(info["objects"]), steps["arm"].shape[1]))
    actions = _Actions(learner, steps)
    for n in range(len(steps["time"])):
        observation = learner.observe({name: steps[name][n] for name in ("time", "servos", "arm", "palm", "tactile")})
        action = actions.at(n)
        recorder.add(observation, action)
        learner.act(action)
    about = {"combination": info["combination"], "trial": info["trial"], "objects": list(info["objects"])}
    return recorder.episode(words("pick_two", info["objects"]), success, about)


class _Actions:
    """Actions that lead to the set-points of a controller."""

    def __init__(self, learner: Features, steps: dict[str, Any]) -> None:
        self._learner, self._steps = learner, steps
        self._palm = pose_matrix(steps["palm_goals"][0, 0])

    def at(self, n: int) -> Row:
        """The action of step `n`; the steps come in their order."""
        steps, learner = self._steps, self._learner
        tensions, opposition = np.maximum(steps["tensions"][n, -1], 0.0), float(steps["oppositions"][n, -1])
        if learner.spec.arm != "joints":
            goal = pose_matrix(steps["palm_goals"][n, -1])
            shift = (goal[:3, 3] - self._palm[:3, 3]) / STEP
            turn = rotation_vector(goal[:3, :3] @ self._palm[:3, :3].T) / STEP
            asked = np.concatenate([shift, turn]) / np.repeat([features.SPEED, features.TURN_SPEED], 3)
            # What exceeds the largest velocity is made up for in the next steps.
            twist = asked / max(1.0, float(np.abs(asked).max())) * np.repeat([features.SPEED, features.TURN_SPEED], 3)
            action = learner.action(twist, tensions, opposition)
            self._palm = compose(rotation_of_vector(STEP * twist[3:]) @ self._palm[:3, :3], self._palm[:3, 3] + STEP * twist[:3])
            return action
        # A set-point stands still for a step: the mean keeps up with one that moves.
        joints = steps["arm_goals"][n].mean(axis=0)
        joints = np.remainder(joints + np.pi, 2.0 * np.pi) / np.pi - 1.0
        hand = learner.hand_action(tensions, opposition)
        clipped: Row = np.clip(np.concatenate([joints, hand]), -1.0, 1.0).astype(np.float32)
        return clipped


class Replay:
    """A policy of the benchmark that repeats actions, and ends with them."""

    def __init__(self, spec: Spec, actions: NDArray[Any]) -> None:
        self.features, self.actions, self.observations = spec, actions, list[Observation]()

    def act(self, observation: Observation) -> Row | None:
        """The next action."""
        n = len(self.observations)
        self.observations.append(observation)
        return self.actions[n] if n < len(self.actions) else None


def replay(benchmark: _native.Benchmark, spec: Spec, episode: dict[str, Any], actions: NDArray[Any]) -> dict[str, Any]:
    """Repeats the actions of an episode (its row of ``meta/episodes``) in its trial, blindly. Returns the record of this trial."""
    # A program of its own, `python -m ftac.policy_host`: the package does not load it.
    from ftac.policy_host import Host

    host = Host(Replay(replace(spec, images=None), actions))
    introduction = json.dumps(host.introduction())
    record: dict[str, Any] = json.loads(benchmark.run(host, introduction, False, episode["combination"], episode["trial"]))
    return record
