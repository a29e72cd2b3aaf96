"""A policy that carries out one pick-up as it is planned, for the environments of `ftac.envs`: an upper mark to learn from, and a lower one to beat."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ftac.grasps import PickUp
from ftac.scene import pose_matrix

if TYPE_CHECKING:
    from ftac.envs import Observation, Pick, Vector

Array = NDArray[np.float64]

APPROACH_DISTANCE = 0.12
"""Distance of the pose before the grasp, m."""
POSITION_GAIN = 4.0
"""Of the palm's velocity on its distance, 1/s."""
POSE_TOLERANCE = 0.002, 0.01
"""Distance (m) and angle (rad) from a pose that count as there."""
STAGE_TIMEOUT = 4.0
"""Time after which the next stage begins all the same, s: something is in the way."""
TENSION_RATE = 80.0
"""How fast tensions change, N/s."""
STEP_LENGTH = 0.05
"""Length of a step, s."""
CLOSING_TIME = 1.1
"""Time that the digits get to close, s."""
LIFT_HEIGHT = 0.18
"""How far an object is lifted, m."""


class Script:
    """Goes above the object, down to it, closes, and lifts. It never looks whether that helped.

    Parameters
    ----------
    env: the environment, whose scales of action it takes.
    grasp: what to carry out (`ftac.grasps.repertoire`).
    detected: the object's ``world_from_object`` as detected, (7,).
    yaw: its turn about the vertical, rad (``info["yaws"]``).
    """

    def __init__(self, env: Pick, grasp: PickUp, detected: NDArray[np.floating], yaw: float) -> None:
        rotation = _turn(2, grasp.yaw + yaw) @ _turn(1, grasp.pitch) @ _turn(0, grasp.roll) @ _LEVEL
        at = pose_matrix(np.asarray(detected, dtype=np.float64))[:3, 3] - rotation @ grasp.center
        away = rotation[:, 2] + [0.0, 0.0, 0.5]
        self.env, self.grasp, self.rotation = env, grasp, rotation
        raised = at + [0.0, 0.0, grasp.raise_]
        self.goals = [at + APPROACH_DISTANCE * away / np.linalg.norm(away), at, raised, raised + [0.0, 0.0, LIFT_HEIGHT]]
        self.stage, self.clock = 0, 0.0
        self.tensions = grasp.pre_tension.copy()

    def act(self, observation: Observation) -> Vector:
        """The next action (12,)."""
        palm = pose_matrix(observation["palm"].astype(np.float64))
        shift = self._goal() - palm[:3, 3]
        turn = _rotation_vector(self.rotation @ palm[:3, :3].T)
        self.clock += STEP_LENGTH
        there = np.linalg.norm(shift) < POSE_TOLERANCE[0] and np.linalg.norm(turn) < POSE_TOLERANCE[1]
        over = self.clock >= CLOSING_TIME if self.stage == 2 else there or self.clock >= STAGE_TIMEOUT
        if over and self.stage < 3:
            self.stage, self.clock = self.stage + 1, 0.0
        action = np.zeros(12)
        action[:3] = POSITION_GAIN * shift / self.env.SPEED
        action[3:6] = POSITION_GAIN * turn / self.env.TURN_SPEED
        # A velocity that is too high is slowed down, not bent.
        action[:6] /= max(1.0, np.abs(action[:6]).max())
        self.tensions += np.clip(self._wanted() - self.tensions, -TENSION_RATE * STEP_LENGTH, TENSION_RATE * STEP_LENGTH)
        action[6:11] = 2.0 * self.tensions / self.env.TENSION - 1.0
        action[11] = self.env.thumb(self.grasp.opposition)
        return np.clip(action, -1.0, 1.0).astype(np.float32)

    def _goal(self) -> Array:
        """Where the palm is to be now, m: it rises evenly while the digits close."""
        if self.stage != 2:
            return self.goals[self.stage]
        part = min(1.0, (self.clock + STEP_LENGTH) / CLOSING_TIME)
        return (1.0 - part) * self.goals[1] + part * self.goals[2]

    def _wanted(self) -> Array:
        """Tensions of the present stage, N: the thumb may close later or earlier than the fingers."""
        if self.stage < 2:
            return self.grasp.pre_tension
        delay = self.grasp.thumb_delay
        delays = np.where(np.arange(5) == 0, max(delay, 0.0), max(-delay, 0.0))
        waits = (self.stage == 2) & (self.clock < delays)
        return np.where(waits, self.grasp.pre_tension, self.grasp.close_tension)


_LEVEL: Array = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Palm level and facing down, fingers along world x."""


def _turn(axis: int, angle: float) -> Array:
    cos, sin = np.cos(angle), np.sin(angle)
    matrix = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix[[i, i, j, j], [i, j, i, j]] = [cos, -sin, sin, cos]
    return matrix


def _rotation_vector(rotation: Array) -> Array:
    """Axis times angle (rad) of a rotation matrix; of half a turn it may be zero."""
    twist = 0.5 * np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    sin, cos = float(np.linalg.norm(twist)), 0.5 * (float(np.trace(rotation)) - 1.0)
    return twist * (np.arctan2(sin, cos) / sin) if sin > 1e-9 else twist
