"""A policy that carries out one pick-up as it is planned, for the environments of `ftac.envs`: an upper mark to learn from, and a lower one to beat."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ftac._poses import compose, pose_matrix, rotation_vector
from ftac.features import CENTER, REACH, STEP, Features, Observation, Row, limited_twist
from ftac.grasps import PickUp, palm_goal
from ftac.hand import friction_compensated

Array = NDArray[np.float64]

APPROACH_DISTANCE = 0.09
"""Distance of the pose before the grasp, m."""
POSE_TOLERANCE = 0.001, 0.005
"""Distance (m) and angle (rad) from a pose that count as reached."""
STAGE_TIMEOUT = 2.5
"""Time after which the next stage begins in any case, s: something is in the way."""
SPEED_SHARES = 1.0, 0.5, 1.0, 0.4, 0.6
"""Shares of the largest velocities in each stage."""
STARTING_TIME = 0.8
"""Time in which the palm reaches the velocity of a stage, s: a jerk would shake a heavy object out of the hand."""
TENSION_RATE = 80.0
"""Rate of change of the tensions, N/s."""
CLOSING_TIME = 1.1
"""Time in which the digits close, s."""
LIFT_HEIGHT = 0.18
"""Height by which an object is lifted, m."""
LIFT, CARRY = 3, 4
"""Numbers of the last stages."""


class Script:
    """Moves above the object, down to it, closes, lifts, and carries it if it is told where to, without looking at the result.

    Parameters
    ----------
    features: of the episode, which has the scales of the actions: ``env.unwrapped.features`` after ``reset``. Their actions are twists and tensions.
    grasp: the pick-up to carry out; None for the planned one of the object (`ftac.grasps.pick_one`).
    object: index of the object.
    yaw: its turn about the vertical from the rest pose, rad (``info["yaws"]``).
    pose: its ``world_from_object`` (7,), m; None for that which was detected. A teacher may know the true one.
    place: x and y over which the object is held after it has been lifted, m, world; None for where it was.
    stage: with which it begins: 0, or `CARRY` with the object lifted already.
    """

    def __init__(
        self,
        features: Features,
        grasp: PickUp | None = None,
        *,
        object: int = 0,
        yaw: float | None = None,
        pose: ArrayLike | None = None,
        place: ArrayLike | None = None,
        stage: int = 0,
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
        """Positions of the palm at the end of each stage, m, world: above the object, at it, closed, lifted, carried."""
        if place is not None:
            self.goals.append(self.goals[3] + [*(np.asarray(place, dtype=np.float64) - np.asarray(pose)[:2]), 0.0])
        self.stage, self.clock = stage, 0.0
        """Stage (from 0) and the time since it began, s."""
        self.tensions = (grasp.pre_tension if stage < 2 else grasp.close_tension).copy()

    def act(self, observation: Observation) -> Row:
        """The next action. But for the time in which the digits close, it depends on the observation alone."""
        palm = palm_of(observation)
        goal = compose(self.rotation, self._goal())
        distance = float(np.linalg.norm(goal[:3, 3] - palm[:3, 3]))
        angle = float(np.linalg.norm(rotation_vector(goal[:3, :3] @ palm[:3, :3].T)))
        reached = distance < POSE_TOLERANCE[0] and angle < POSE_TOLERANCE[1]
        over = self.clock >= CLOSING_TIME if self.stage == 2 else reached or self.clock >= STAGE_TIMEOUT
        if over and self.stage < len(self.goals) - 1:
            self.stage, self.clock = self.stage + 1, 0.0
            goal = compose(self.rotation, self._goal())
        starting = min(1.0, (self.clock + STEP) / STARTING_TIME)
        twist = limited_twist(palm, goal, starting * SPEED_SHARES[self.stage])
        if self.stage == 2:
            twist[2] += (self._risen(self.clock + STEP) - self._risen(self.clock)) / STEP
        self.clock += STEP
        change = self._wanted() - self.tensions
        self.tensions += np.clip(change, -TENSION_RATE * STEP, TENSION_RATE * STEP)
        pulled = friction_compensated(self.tensions, self.features.spools_of(observation))
        return self.features.action(twist, pulled, self.grasp.opposition)

    def _goal(self) -> Array:
        """Position of the palm to reach now, m."""
        if self.stage != 2:
            return self.goals[self.stage]
        risen: Array = self.goals[1] + np.array([0.0, 0.0, self._risen(self.clock)])
        return risen

    def _risen(self, time: float) -> float:
        """Height by which the palm has risen after this time of closing, m: with minimum jerk."""
        part = min(time / CLOSING_TIME, 1.0)
        return self.grasp.raise_ * part**3 * (10.0 - 15.0 * part + 6.0 * part**2)

    def _wanted(self) -> Array:
        """Tensions of the present stage, N: the thumb may close later or earlier than the fingers."""
        if self.stage < 2:
            return self.grasp.pre_tension
        delay = self.grasp.thumb_delay
        delays = np.where(np.arange(5) == 0, max(delay, 0.0), max(-delay, 0.0))
        waits = (self.stage == 2) & (self.clock < delays)
        return np.where(waits, self.grasp.pre_tension, self.grasp.close_tension)


def palm_of(observation: Observation) -> Array:
    """``world_from_palm`` (4, 4) of an observation, m."""
    scaled = observation["palm"].astype(np.float64)
    first, second = scaled[3:6], scaled[6:9]
    rotation = np.stack([first, second, np.cross(first, second)], axis=1)
    return compose(rotation, CENTER + REACH * scaled[:3])


def relative_pose(observation: Observation, detected: ArrayLike) -> Array:
    """``object_from_palm`` (4, 4) of an observation for an object detected at `detected` (7,), m."""
    return np.linalg.inv(pose_matrix(detected)) @ palm_of(observation)
