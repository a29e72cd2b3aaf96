"""A policy that carries out one pick-up as it is planned, for the environments of `ftac.envs`: an upper mark to learn from, and a lower one to beat."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ftac._poses import compose, pose_matrix, rotation_of_vector, rotation_vector
from ftac.features import CENTER, REACH, STEP, Features, Observation, Row
from ftac.grasps import PickUp, palm_goal
from ftac.hand import friction_compensated

Array = NDArray[np.float64]

APPROACH_DISTANCE = 0.09
"""Distance of the pose before the grasp, m."""
PATH_SPEED, PATH_TURN_SPEED = 0.22, 0.9
"""Largest speed along a path (m/s) and about an axis (rad/s)."""
FINAL_SPEED_SHARE = 0.6
"""Share of these speeds on the last part of the approach and while lifting."""
TRACKING_GAIN = 2.0
"""Velocity that corrects a deviation from the path, over the deviation, 1/s."""
SETTLING_TIME = 0.1
"""Time for which the palm rests at the end of a path, s."""
TENSION_RATE = 80.0
"""Rate of change of the tensions, N/s."""
CLOSING_TIME = 1.1
"""Time in which the digits close, s."""
LIFT_HEIGHT = 0.18
"""Height by which an object is lifted, m."""


class Script:
    """Moves above the object, down to it, closes, and lifts, without looking at the result.

    Parameters
    ----------
    features: of the episode, which has the scales of the actions: ``env.unwrapped.features`` after ``reset``. Their actions are twists and tensions.
    grasp: the pick-up to carry out; None for the planned one of the object (`ftac.grasps.pick_one`).
    object: index of the object.
    yaw: its turn about the vertical from the rest pose, rad (``info["yaws"]``).
    pose: its ``world_from_object`` (7,), m; None for that which was detected. A teacher may know the true one.
    """

    def __init__(
        self,
        features: Features,
        grasp: PickUp | None = None,
        *,
        object: int = 0,
        yaw: float | None = None,
        pose: ArrayLike | None = None,
    ) -> None:
        grasp = features.grasps[object] if grasp is None else grasp
        if grasp is None:
            raise ValueError("grasp: found none planned for the object, expected a PickUp")
        pose = features.detected[object] if pose is None else pose
        goal = palm_goal(grasp, pose, features.yaws[object] if yaw is None else yaw)
        self.features, self.grasp, self.rotation = features, grasp, goal[:3, :3]
        at = goal[:3, 3]
        away = self.rotation[:, 2] + [0.0, 0.0, 0.5]
        raised = at + [0.0, 0.0, grasp.raise_]
        self.goals: list[Array] = [
            at + APPROACH_DISTANCE * away / np.linalg.norm(away),
            at,
            raised,
            raised + [0.0, 0.0, LIFT_HEIGHT],
        ]
        """Positions of the palm at the end of each stage, m, world: above the object, at it, closed, lifted."""
        self.stage, self.clock = 0, 0.0
        """Stage (0 to 3) and the time since it began, s."""
        self.tensions = grasp.pre_tension.copy()
        self._path: tuple[Array, Array, float] | None = None

    def act(self, observation: Observation) -> Row:
        """The next action."""
        palm = palm_of(observation)
        if self._path is not None and self.stage < 3 and self.clock >= self._path[2] + SETTLING_TIME * (self.stage != 2):
            self.stage, self.clock, self._path = self.stage + 1, 0.0, None
        if self._path is None:
            self._path = self._planned(palm)
        start, turned, duration = self._path
        here, there = (_minimum_jerk(time / duration) for time in (self.clock, self.clock + STEP))
        shift, goal = self.goals[self.stage] - start, compose(rotation_of_vector(here * turned) @ self._begun, start)
        goal[:3, 3] += here * shift
        deviation = np.concatenate([goal[:3, 3] - palm[:3, 3], rotation_vector(goal[:3, :3] @ palm[:3, :3].T)])
        twist = (there - here) / STEP * np.concatenate([shift, turned]) + TRACKING_GAIN * deviation
        self.clock += STEP
        change = self._wanted() - self.tensions
        self.tensions += np.clip(change, -TENSION_RATE * STEP, TENSION_RATE * STEP)
        pulled = friction_compensated(self.tensions, self.features.spools_of(observation))
        return self.features.action(twist, pulled, self.grasp.opposition)

    def _planned(self, palm: Array) -> tuple[Array, Array, float]:
        """Start (m), rotation vector (rad) and duration (s) of the stage's path: a straight line with minimum jerk."""
        self._begun = palm[:3, :3]
        turned = rotation_vector(self.rotation @ palm[:3, :3].T)
        length = float(np.linalg.norm(self.goals[self.stage] - palm[:3, 3]))
        share = 1.0 if self.stage == 0 else FINAL_SPEED_SHARE
        needed = 1.875 * max(length / PATH_SPEED, float(np.linalg.norm(turned)) / PATH_TURN_SPEED) / share
        return palm[:3, 3].copy(), turned, CLOSING_TIME if self.stage == 2 else max(needed, STEP)

    def _wanted(self) -> Array:
        """Tensions of the present stage, N: the thumb may close later or earlier than the fingers."""
        if self.stage < 2:
            return self.grasp.pre_tension
        delay = self.grasp.thumb_delay
        delays = np.where(np.arange(5) == 0, max(delay, 0.0), max(-delay, 0.0))
        waits = (self.stage == 2) & (self.clock < delays)
        return np.where(waits, self.grasp.pre_tension, self.grasp.close_tension)


def _minimum_jerk(part: float) -> float:
    """Share of a path that is covered after this share of its duration."""
    part = min(max(part, 0.0), 1.0)
    return part**3 * (10.0 - 15.0 * part + 6.0 * part**2)


def palm_of(observation: Observation) -> Array:
    """``world_from_palm`` (4, 4) of an observation, m."""
    scaled = observation["palm"].astype(np.float64)
    first, second = scaled[3:6], scaled[6:9]
    rotation = np.stack([first, second, np.cross(first, second)], axis=1)
    return compose(rotation, CENTER + REACH * scaled[:3])


def relative_pose(observation: Observation, detected: ArrayLike) -> Array:
    """``object_from_palm`` (4, 4) of an observation for an object detected at `detected` (7,), m."""
    return np.linalg.inv(pose_matrix(detected)) @ palm_of(observation)
