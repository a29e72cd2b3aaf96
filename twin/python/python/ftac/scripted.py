"""A policy that carries out one pick-up as it is planned, for the environments of `ftac.envs`: an upper mark to learn from, and a lower one to beat."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ftac._poses import compose, pose_matrix, rotation_vector
from ftac.features import CENTER, REACH, STEP, Features, Observation, Row, limited_twist
from ftac.grasps import PickUp, palm_goal

Array = NDArray[np.float64]

APPROACH_DISTANCE = 0.12
"""Distance of the pose before the grasp, m."""
POSE_TOLERANCE = 0.002, 0.01
"""Distance (m) and angle (rad) from a pose that count as reached."""
STAGE_TIMEOUT = 4.0
"""Time after which the next stage begins in any case, s: something is in the way."""
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
    grasp: the pick-up to carry out; None for the repertoire's best one of the object.
    object: index of the object.
    yaw: its turn about the vertical from the rest pose, rad (``info["yaws"]``); only needed with a `grasp`.
    """

    def __init__(self, features: Features, grasp: PickUp | None = None, *, object: int = 0, yaw: float = 0.0) -> None:
        goal = features.goals[object] if grasp is None else palm_goal(grasp, features.detected[object], yaw)
        grasp = features.grasps[object] if grasp is None else grasp
        if grasp is None or goal is None:
            raise ValueError("grasp: found none in the repertoire for the object, expected a PickUp")
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
        self.tensions = grasp.pre_tension.copy()

    def act(self, observation: Observation) -> Row:
        """The next action."""
        palm = palm_of(observation)
        goal = compose(self.rotation, self._goal())
        self.clock += STEP
        distance = float(np.linalg.norm(goal[:3, 3] - palm[:3, 3]))
        angle = float(np.linalg.norm(rotation_vector(goal[:3, :3] @ palm[:3, :3].T)))
        reached = distance < POSE_TOLERANCE[0] and angle < POSE_TOLERANCE[1]
        over = self.clock >= CLOSING_TIME if self.stage == 2 else reached or self.clock >= STAGE_TIMEOUT
        if over and self.stage < 3:
            self.stage, self.clock = self.stage + 1, 0.0
        change = self._wanted() - self.tensions
        self.tensions += np.clip(change, -TENSION_RATE * STEP, TENSION_RATE * STEP)
        return self.features.action(limited_twist(palm, goal), self.tensions, self.grasp.opposition)

    def _goal(self) -> Array:
        """Position of the palm to reach now, m: it rises evenly while the digits close."""
        if self.stage != 2:
            return self.goals[self.stage]
        part = min(1.0, (self.clock + STEP) / CLOSING_TIME)
        return (1.0 - part) * self.goals[1] + part * self.goals[2]

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
