"""Observations and actions as learners use them: the same keys, shapes and scales everywhere.

The environments (`ftac.envs`), the policies of the benchmark that move the robot themselves (`ftac.bench.Actor`), and the exported data
(`ftac.lerobot`) all use `Features`. A policy trained on exported data therefore runs in an environment, in the benchmark, and on a real robot.

Every number is scaled to -1 to 1 and clipped there; the scales are constants of this module. **Observations**, float32:

- ``servos`` (6, 3): output angle over its range, speed / `SERVO_SPEED`, current / `SERVO_CURRENT`.
- ``arm`` (joints, 3): angle / pi (a joint that turns without end is taken into -pi to pi), speed / `ARM_SPEED`, torque / `ARM_TORQUE`.
- ``palm`` (9,): position relative to `CENTER` / `REACH`, and the first two columns of the rotation matrix of ``world_from_palm``, by the arm's encoders.
- ``command`` (6,): the set-points of the hand after the last action: tensions over 0 to the maximum, and the thumb's opposition over its range; or
  spools over their ranges, if the actions are spools.
- ``time`` (1,): time since the beginning / `TIME`.
- ``objects`` (objects, 12): ``palm_from_object`` of each object where the detector reported it, with its error: position / `REACH`, position / `NEAR`
  (fine, for the last centimetres), and the first two columns of the rotation matrix.
- ``shape`` (objects, 6): half extents in the resting pose / `EXTENT` (3), mass / `MASS`, friction coefficient, height of the centre at rest / `EXTENT`.
- ``identity`` (objects, 33), if asked for: 1 at the object's place in `ftac.objects()`; all 0 for an object of one's own.
- ``grasp`` (objects, 26), if asked for: the planned pick-up (`ftac.grasps.pick_one`): 1 if there is one, ``palm_from_goal`` of the palm's pose in which the digits close
  (12, as ``objects``), tensions before and while they close (5 each, over 0 to the maximum), opposition over its range, rise meanwhile / `NEAR`, delay of
  the thumb / `DELAY`.
- ``tactile`` (17, n, n, 3) uint8, with images: an image of each pad. With ``tactile="change"`` it is half of its difference from the
  image of the untouched pad, and 128 where nothing has changed; a difference of one grey level is lost.

**Actions**, each from -1 to 1, for 1/20 s: those of the arm, then those of the hand. Zeros keep the robot still with the default kinds.

========================  =======  =====================================================================================================
arm                       numbers  meaning
========================  =======  =====================================================================================================
``twist`` (default)       6        the palm's velocity (x `SPEED`) and angular velocity (x `TURN_SPEED`), world axes
``palm_twist``            6        the same along the palm's axes
``palm_pose``             6        pose that the palm moves to: position relative to `CENTER` (x `REACH`), rotation vector from `LEVEL` (x pi)
``joints``                7        joint angles that the arm moves to, x pi; a joint that turns without end goes the short way
``joint_steps``           7        change of the joint set-points, x `JOINT_STEP`
========================  =======  =====================================================================================================

========================  =======  =====================================================================================================
hand                      numbers  meaning
========================  =======  =====================================================================================================
``tension_steps`` (def.)  6        change of the five tensions (x `TENSION_STEP`) and of the opposition (x `OPPOSITION_STEP`)
``tensions``              6        tensions over 0 to the maximum, opposition over its range; -1 is slack
``spools``                6        output angles of the servos over their ranges; -1 is unwound
``spool_steps``           6        change of the spool set-points, x `SPOOL_STEP`
========================  =======  =====================================================================================================
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ftac import _native
from ftac._arrays import side_of
from ftac._poses import compose, inverse, pose_matrix, rotation_vector, rotation_of_vector
from ftac.grasps import LEVEL, PickUp, palm_goal, pick_one

Array = NDArray[np.float64]
Row = NDArray[np.float32]
Observation = dict[str, Any]
"""Arrays by name."""
ArmAction = Literal["twist", "palm_twist", "palm_pose", "joints", "joint_steps"]
HandAction = Literal["tension_steps", "tensions", "spools", "spool_steps"]

STEP = 0.05
"""Length of a step, s."""
CENTER: Array = np.array([0.6, 0.0, 0.25])
"""Middle of the palm's workspace, world, m."""
REACH = 0.5
"""Scale of positions, m."""
NEAR = 0.05
"""Scale of positions near an object, m."""
SERVO_SPEED, SERVO_CURRENT = 10.0, 1.0
"""Scales of the servos' speed (rad/s) and current (A)."""
ARM_SPEED, ARM_TORQUE = 1.5, 40.0
"""Scales of the arm's joint speed (rad/s) and torque (N m)."""
TIME = 30.0
"""Scale of times, s."""
EXTENT, MASS, DELAY = 0.1, 0.5, 0.5
"""Scales of an object's size (m) and mass (kg), and of the thumb's delay (s)."""
SPEED, TURN_SPEED = 0.25, 1.0
"""Largest velocity of the palm along each axis (m/s) and about it (rad/s)."""
TENSION = 60.0
"""Largest tension of a cable, N."""
JOINT_STEP, TENSION_STEP, OPPOSITION_STEP, SPOOL_STEP = 0.05, 4.0, 0.1, 0.15
"""Largest change in a step of a joint (rad), a tension (N), the opposition (rad), a spool (rad)."""
POSE_GAIN = 4.0
"""Velocity with which the palm moves to a pose, over the distance from it, 1/s."""
LEAD = 0.15
"""Largest distance of a joint set-point from the measured angle, rad."""
GRASP_LENGTH = 26


@dataclass(frozen=True)
class Spec:
    """The choice of observations and actions. An environment takes its fields as parameters; a policy of the benchmark has it as attribute ``features``."""

    images: int | None = None
    """Side of the tactile images in pixels, 8 to 240; None for none."""
    tactile: Literal["image", "change"] = "image"
    """Whether images are as the cameras take them, or changes from the untouched pads."""
    arm: ArmAction = "twist"
    hand: HandAction = "tension_steps"
    identity: bool = False
    """Adds ``identity`` to the observations."""
    grasp: bool = False
    """Adds ``grasp`` to the observations."""

    def __post_init__(self) -> None:
        for name, known in (("arm", ArmAction), ("hand", HandAction), ("tactile", Literal["image", "change"])):
            if getattr(self, name) not in get_args(known):
                raise ValueError(f"{name}: found {getattr(self, name)!r}, expected one of {', '.join(get_args(known))}")
        object.__setattr__(self, "images", side_of(self.images))

    @staticmethod
    def of(policy: Any) -> Spec:
        """The features of a policy: its attribute ``features``, a `Spec` or a mapping of its fields; and its attribute ``images``, if it has one."""
        found = getattr(policy, "features", None)
        if found is None:
            spec = Spec()
        elif isinstance(found, Spec):
            spec = found
        elif isinstance(found, Mapping):
            spec = Spec(**known_fields("features", found))
        else:
            raise ValueError(f"features: found {type(found).__name__}, expected a Spec or a mapping of its fields")
        images = getattr(policy, "images", None)
        return spec if images is None else replace(spec, images=images)

    def as_dict(self) -> dict[str, Any]:
        """The fields as a dictionary, as a data set and a run store them."""
        return asdict(self)


def known_fields(what: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """`given` if it has fields of `Spec` only. ``ValueError`` otherwise."""
    known = list(Spec.__dataclass_fields__)
    for name in given:
        if name not in known:
            raise ValueError(f"{what}: found {name!r}, expected some of {', '.join(known)}")
    return dict(given)


def shapes(spec: Spec, objects: int, joints: int = 7, pads: int = 17) -> dict[str, tuple[int, ...]]:
    """Shapes of the observations by name, in their order: for an arm of `joints` joints, a hand of `pads` pads and so many `objects`."""
    found: dict[str, tuple[int, ...]] = {
        "servos": (6, 3),
        "arm": (joints, 3),
        "palm": (9,),
        "command": (6,),
        "time": (1,),
        "objects": (objects, 12),
        "shape": (objects, 6),
    }
    if spec.identity:
        found["identity"] = (objects, len(_native.objects()))
    if spec.grasp:
        found["grasp"] = (objects, GRASP_LENGTH)
    if spec.images is not None:
        found["tactile"] = (pads, spec.images, spec.images, 3)
    return found


def action_size(spec: Spec, joints: int = 7) -> int:
    """Numbers of an action."""
    return (joints if spec.arm in ("joints", "joint_steps") else 6) + 6


def names(spec: Spec, objects: int, joints: int = 7) -> dict[str, list[str]]:
    """A name for every number of the flattened observations (without images) and, under ``action``, of the action."""
    digits = ["thumb", "index", "middle", "ring", "little"]
    servos = [*digits, "opposition"]
    arm = [f"joint_{n}" for n in range(1, joints + 1)]
    pose = [*"xyz", *(f"r{row}{column}" for column in (1, 2) for row in (1, 2, 3))]
    fine = [*"xyz", *(f"near_{axis}" for axis in "xyz"), *pose[3:]]
    each = [f"object_{n}" for n in range(1, objects + 1)]
    per: dict[str, list[str]] = {
        "servos": [f"servo_{name}.{what}" for name in servos for what in ("angle", "speed", "current")],
        "arm": [f"{name}.{what}" for name in arm for what in ("angle", "speed", "torque")],
        "palm": [f"palm.{name}" for name in pose],
        "command": [f"command.{name}" for name in servos],
        "time": ["time"],
        "objects": [f"{one}.{name}" for one in each for name in fine],
        "shape": [f"{one}.{name}" for one in each for name in ("half_x", "half_y", "half_z", "mass", "friction", "height")],
    }
    if spec.identity:
        per["identity"] = [f"{one}.is_{name}" for one in each for name in _native.objects()]
    if spec.grasp:
        grasp = [f"goal_{name}" for name in fine]
        tensions = [f"{when}_{name}" for when in ("before", "closing") for name in digits]
        parts = ["known", *grasp, *tensions, "opposition", "rise", "delay"]
        per["grasp"] = [f"{one}.grasp_{name}" for one in each for name in parts]
    axes = {"joints": arm, "joint_steps": arm}.get(spec.arm, ["x", "y", "z", "turn_x", "turn_y", "turn_z"])
    return {**per, "action": [f"{spec.arm}.{name}" for name in axes] + [f"{spec.hand}.{name}" for name in servos]}


class Features:
    """Observations and actions of one episode or trial.

    Parameters
    ----------
    spec: what is observed and how one acts.
    limits: of the robot's actions: ``opposition`` (2,), ``spools`` (6, 2), ``joints`` (n, 2), rad, and ``tension``, N, as `ftac.Scene.limits`.
    detected: ``world_from_object`` of each object as detected, (objects, 7).
    objects: their names.
    yaws: their turns about the vertical from the rest pose, as detected, rad.
    shape: features of the objects, (objects, 6): half extents (m), mass (kg), friction, height at rest (m).
    untouched: images of the untouched pads, if there are images.
    """

    def __init__(
        self,
        spec: Spec,
        limits: Mapping[str, Any],
        *,
        detected: ArrayLike,
        objects: Sequence[str],
        yaws: Sequence[float],
        shape: ArrayLike,
        untouched: NDArray[np.uint8] | None = None,
    ) -> None:
        self.spec = spec
        self._opposition, self._spools = (np.asarray(limits[name], dtype=np.float64) for name in ("opposition", "spools"))
        self._tension = min(TENSION, float(limits["tension"]))
        self._joint_limits = np.asarray(limits["joints"], dtype=np.float64)
        self._endless = self._joint_limits[:, 1] - self._joint_limits[:, 0] > 4.0 * np.pi
        self.detected = np.asarray(detected, dtype=np.float64).reshape(-1, 7)
        self._objects = np.array([pose_matrix(pose) for pose in self.detected])
        self._fixed = {"shape": self._shape(shape)}
        self.grasps: list[PickUp | None] = [pick_one().get(name) for name in objects]
        """The planned pick-up of each object (`ftac.grasps.pick_one`); None for an object of one's own."""
        self.yaws = tuple(float(yaw) for yaw in yaws)
        """Turns of the objects about the vertical from their rest poses, as detected, rad."""
        self.goals = [
            None if grasp is None else palm_goal(grasp, pose, yaw)
            for grasp, pose, yaw in zip(self.grasps, self.detected, yaws)
        ]
        """``world_from_palm`` (4, 4) in which the digits of that pick-up close."""
        if spec.identity:
            known = _native.objects()
            rows = [[float(name == one) for one in known] for name in objects]
            self._fixed["identity"] = np.array(rows, dtype=np.float32).reshape(len(objects), len(known))
        self._untouched = None if untouched is None else untouched.astype(np.int16)
        self.begin(np.zeros(5), 0.0)

    def begin(self, tensions: ArrayLike, opposition: float, joints: ArrayLike | None = None) -> None:
        """Sets the set-points at the beginning: tensions (N), opposition (rad); joints of the arm (rad), or None for those first measured."""
        self.tensions = np.asarray(tensions, dtype=np.float64).copy()
        self.opposition = float(np.clip(opposition, *self._opposition))
        self._spool_goals: Array = np.zeros(len(self._spools))
        self._joints: Array = np.zeros(0) if joints is None else np.asarray(joints, dtype=np.float64).copy()
        self._begun = False

    def observe(self, measured: Mapping[str, Any], pictures: bool = True) -> Observation:
        """Observations from what the robot measures: ``time`` (s), ``servos`` (6, 3), ``arm`` (n, 3), ``palm`` (7,), and ``tactile`` with images,
        which are left out without `pictures`."""
        servos, arm = np.array(measured["servos"], dtype=np.float64), np.array(measured["arm"], dtype=np.float64)
        if not self._begun:
            self._begun, self._spool_goals = True, np.clip(servos[:, 0], self._spools[:, 0], self._spools[:, 1])
            self._joints = self._joints if len(self._joints) else arm[:, 0].copy()
        servos[:, 0] = _share(servos[:, 0], self._spools)
        servos[:, 1:] /= (SERVO_SPEED, SERVO_CURRENT)
        arm[:, 0] = np.remainder(arm[:, 0] + np.pi, 2.0 * np.pi) / np.pi - 1.0
        arm[:, 1:] /= (ARM_SPEED, ARM_TORQUE)
        palm = pose_matrix(measured["palm"])
        from_world = inverse(palm)
        observed = {
            "servos": _clipped(servos),
            "arm": _clipped(arm),
            "palm": _clipped(np.concatenate([(palm[:3, 3] - CENTER) / REACH, palm[:3, :2].T.ravel()])),
            "command": _clipped(self._command()),
            "time": _clipped(np.array([measured["time"] / TIME])),
            "objects": relative_rows(from_world @ self._objects),
            **{name: value.copy() for name, value in self._fixed.items()},
        }
        if self.spec.grasp:
            observed["grasp"] = np.array(
                [self._grasp(grasp, goal, from_world) for grasp, goal in zip(self.grasps, self.goals)], dtype=np.float32
            ).reshape(-1, GRASP_LENGTH)
        if self.spec.images is not None and pictures:
            images = measured["tactile"]
            if self.spec.tactile == "change" and self._untouched is not None:
                images = (128 + (images.astype(np.int16) - self._untouched) // 2).astype(np.uint8)
            observed["tactile"] = images
        self._palm = palm
        self._measured_joints = np.asarray(measured["arm"])[:, 0]
        return observed

    def act(self, action: ArrayLike) -> tuple[Any, ...]:
        """Arguments of a step that carries out `action`, and moves the set-points: twist, joints, tensions, opposition, spools; None where it sets
        nothing. ``ValueError`` for anything but as many numbers from -1 to 1 as there are; nothing is changed then."""
        size = action_size(self.spec, len(self._joint_limits))
        found = np.asarray(action)
        if found.shape != (size,) or found.dtype.kind not in "fiu" or not np.all(np.abs(found) <= 1.0):
            raise ValueError(f"action: found {found}, expected {size} numbers from -1 to 1")
        shares = found.astype(np.float64)
        twist, joints = self._arm(shares[:-6])
        hand = shares[-6:]
        kind = self.spec.hand
        if kind in ("spools", "spool_steps"):
            goals = _within(hand, self._spools) if kind == "spools" else self._spool_goals + SPOOL_STEP * hand
            self._spool_goals = np.clip(goals, self._spools[:, 0], self._spools[:, 1])
            return twist, joints, None, None, self._spool_goals
        if kind == "tensions":
            self.tensions = 0.5 * (hand[:5] + 1.0) * self._tension
            self.opposition = float(_within(hand[5], self._opposition))
        else:
            self.tensions = np.clip(self.tensions + TENSION_STEP * hand[:5], 0.0, self._tension)
            self.opposition = float(np.clip(self.opposition + OPPOSITION_STEP * hand[5], *self._opposition))
        return twist, joints, self.tensions, self.opposition, None

    def action(self, twist: ArrayLike, tensions: ArrayLike, opposition: float) -> Row:
        """The action closest to a twist (6,) of the palm (m/s, rad/s, world axes), tensions (5,) N and an opposition (rad). A velocity that is too high is scaled
        down in its direction. ``ValueError`` for actions of the kinds ``palm_pose``, ``joints`` and ``spools``, which have no such numbers."""
        if self.spec.arm not in ("twist", "palm_twist") or self.spec.hand not in ("tension_steps", "tensions"):
            raise ValueError(f"action: found the kinds {self.spec.arm} and {self.spec.hand}, expected twist and tensions of either kind")
        asked = np.array(twist, dtype=np.float64)
        if self.spec.arm == "palm_twist":
            asked = np.concatenate([self._palm[:3, :3].T @ asked[:3], self._palm[:3, :3].T @ asked[3:]])
        asked /= np.repeat([SPEED, TURN_SPEED], 3)
        asked /= max(1.0, float(np.abs(asked).max()))
        action: Row = np.clip([*asked, *self.hand_action(tensions, opposition)], -1.0, 1.0).astype(np.float32)
        return action

    def hand_action(self, tensions: ArrayLike, opposition: float) -> Array:
        """The hand's part (6,) of the action that leads to tensions (5,) N and an opposition (rad), not clipped. The hand's actions are tensions of either kind."""
        tensions = np.asarray(tensions, dtype=np.float64)
        if self.spec.hand == "tensions":
            return np.append(2.0 * tensions / self._tension - 1.0, _share(np.array(opposition), self._opposition))
        return np.append((tensions - self.tensions) / TENSION_STEP, (opposition - self.opposition) / OPPOSITION_STEP)

    def spools_of(self, observation: Observation) -> Array:
        """Output angles of the servos (6,), rad, in an observation."""
        return _within(observation["servos"][:, 0].astype(np.float64), self._spools)

    def copy(self) -> Features:
        """A copy that goes on independently."""
        twin = object.__new__(Features)
        twin.__dict__.update(self.__dict__)
        for name in ("tensions", "_spool_goals", "_joints"):
            setattr(twin, name, getattr(self, name).copy())
        return twin

    def _arm(self, shares: Array) -> tuple[Array | None, Array | None]:
        kind = self.spec.arm
        if kind == "twist":
            return np.concatenate([SPEED * shares[:3], TURN_SPEED * shares[3:]]), None
        if kind == "palm_twist":
            rotation = self._palm[:3, :3]
            return np.concatenate([SPEED * (rotation @ shares[:3]), TURN_SPEED * (rotation @ shares[3:])]), None
        if kind == "palm_pose":
            goal = compose(rotation_of_vector(np.pi * shares[3:]) @ LEVEL, CENTER + REACH * shares[:3])
            return limited_twist(self._palm, goal), None
        if kind == "joints":
            joints = np.pi * shares
            # A joint without end goes the short way.
            turns = np.remainder(joints - self._measured_joints + np.pi, 2.0 * np.pi) - np.pi
            joints = np.where(self._endless, self._measured_joints + turns, joints)
        else:
            ahead = self._joints + JOINT_STEP * shares
            joints = np.clip(ahead, self._measured_joints - LEAD, self._measured_joints + LEAD)
        self._joints = np.clip(joints, self._joint_limits[:, 0], self._joint_limits[:, 1])
        return None, self._joints

    def _command(self) -> Array:
        if self.spec.hand in ("spools", "spool_steps"):
            return _share(self._spool_goals, self._spools)
        return np.append(2.0 * self.tensions / self._tension - 1.0, _share(np.array(self.opposition), self._opposition))

    def _shape(self, shape: ArrayLike) -> Row:
        return _clipped(np.asarray(shape, dtype=np.float64).reshape(-1, 6) / (EXTENT, EXTENT, EXTENT, MASS, 1.0, EXTENT))

    def _grasp(self, grasp: PickUp | None, goal: Array | None, from_world: Array) -> Row:
        if grasp is None or goal is None:
            return np.zeros(GRASP_LENGTH, dtype=np.float32)
        tensions = 2.0 * np.concatenate([grasp.pre_tension, grasp.close_tension]) / self._tension - 1.0
        opposition = float(_share(np.array(grasp.opposition), self._opposition))
        ends = np.array([opposition, grasp.raise_ / NEAR, grasp.thumb_delay / DELAY])
        rows = [np.ones(1), relative_rows((from_world @ goal)[None])[0], _clipped(np.concatenate([tensions, ends]))]
        return np.concatenate(rows).astype(np.float32)


def limited_twist(palm: Array, goal: Array, share: float = 1.0) -> Array:
    """Twist (6,) that moves the palm from one ``world_from_palm`` (4, 4) towards another, at most at a `share` of `SPEED` and `TURN_SPEED` along each axis."""
    shift = POSE_GAIN * (goal[:3, 3] - palm[:3, 3])
    turn = POSE_GAIN * rotation_vector(goal[:3, :3] @ palm[:3, :3].T)
    twist = np.concatenate([shift, turn])
    return twist / max(1.0, float(np.abs(twist / np.repeat([SPEED, TURN_SPEED], 3)).max()) / share)


def _share(values: Array, limits: Array) -> Array:
    """`values` over their range, -1 to 1."""
    low, high = limits[..., 0], limits[..., 1]
    return 2.0 * (values - low) / np.where(high > low, high - low, 1.0) - 1.0


def _within(shares: Array, limits: Array) -> Array:
    low, high = limits[..., 0], limits[..., 1]
    return low + 0.5 * (shares + 1.0) * (high - low)


def _clipped(values: Array) -> Row:
    clipped: Row = np.clip(values, -1.0, 1.0).astype(np.float32)
    return clipped


def apart(flat: ArrayLike, shapes: Mapping[str, tuple[int, ...]]) -> Observation:
    """Arrays of these shapes by name, from all their numbers one after another."""
    ends = np.cumsum([int(np.prod(shape)) for shape in shapes.values()])
    pieces = np.split(np.asarray(flat), ends[:-1])
    return {name: piece.reshape(shape) for (name, shape), piece in zip(shapes.items(), pieces)}


def relative_rows(poses: Array) -> Row:
    """Rows of twelve numbers of poses (n, 4, 4)."""
    position = poses[:, :3, 3]
    turned = poses[:, :3, :2].transpose(0, 2, 1).reshape(-1, 6)
    return _clipped(np.concatenate([position / REACH, position / NEAR, turned], axis=1))
