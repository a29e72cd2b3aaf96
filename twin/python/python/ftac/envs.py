"""Gymnasium environments: pick one object, a second one beside the first, or two.

``import ftac`` registers ``ftac/PickOne-v1``, ``ftac/PickSecond-v1``, ``ftac/PickTwo-v1``, ``ftac/LiftTo-v1`` with goals, and ``ftac/Sort-v1``
(`ftac.sorting`), where ``gymnasium`` is installed. Observations and actions are those of `ftac.features`.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any, Literal, NamedTuple

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from ftac import _native, features
from ftac._arrays import known_names, mapping, number, objects_of, on_gpu, robot_of, scenario_of, shortened, whole
from ftac._poses import inverse, pose_matrix
from ftac.features import Features, Observation, Spec
from ftac.randomization import Randomization

Task = Literal["pick_one", "pick_second", "pick_two"]
Vector = NDArray[np.float32]

OBJECTS = {"pick_one": 1, "pick_second": 2, "pick_two": 2}
STEPS = {"pick_one": 300, "pick_second": 300, "pick_two": 600}
"""Steps of 1/20 s after which an episode of ``gymnasium.make`` is truncated; ``max_episode_steps`` sets another number."""
SIDE = 480
"""Side of a rendered picture, pixels."""
PAD_FORCE = 20.0
"""Scale of the force on a pad in ``privileged``, N."""

PROGRESS = ("reach", "near", "touch", "lift", "hold")
"""Terms of progress, each from 0 to 1: near on a scale of 0.6 m, near on a scale of 5 cm, share of three parts of the hand that touch, height over
the table / 0.1 m while it is touched, share of the second for which it has to be held. They are means over the objects."""
REWARDS: dict[str, dict[str, float]] = {
    "sparse": {"success": 1.0},
    "shaped": {"reach": 0.3, "near": 0.2, "touch": 0.3, "lift": 0.8, "hold": 0.4, "success": 1.0, "lost": -1.0},
}
"""Weights of the terms of a reward. A step's reward is, for each term of `PROGRESS`, its weight times the gain since the step before; the weight of
``success`` in the step in which the task is done; of ``lost`` in that in which an object leaves the table; and of ``step`` in every step."""


class State(NamedTuple):
    """What `Pick.save` keeps."""

    episode: _native.Episode
    python: dict[str, Any]


class Pick(gymnasium.Env[Observation, Vector]):
    """Objects of the benchmark are to be lifted and held for a second.

    **Observations and actions** are those of `ftac.features`, at 20 Hz, all from -1 to 1 but the images; zeros keep the robot still. Nothing in the
    observations is the scene's truth but ``privileged``. Added by parameters:

    - ``scene_camera`` (n, n, 3) uint8: a camera over the table, with ``camera=n``.
    - ``privileged`` (k,), with ``privileged=True``, for a critic that may know more than the policy: of each object the true ``palm_from_object`` (12, as
      ``objects``) and velocity (3, m/s); then the force on each pad / `PAD_FORCE` (17), the joint angles of the hand / (pi / 2) (15), and the cables'
      tensions / `ftac.features.TENSION` (5).

    **Ends**: terminated when the task is done or an object has left the table; truncated after `STEPS` by ``gymnasium.make``.

    ``info`` of a step has ``is_success``, ``held`` (for each object) and ``progress`` (the terms of `PROGRESS` by name). Rewards and ``info`` are judged
    by the true scene.

    Parameters
    ----------
    task: ``pick_one`` (one object alone), ``pick_second`` (the first one is in the hand already) or ``pick_two``.
    images, tactile, arm, hand, identity, grasp: choice of observations and actions, see `ftac.features.Spec`. Smaller images are formed on 64 or more
        points a side, which is quick; the log says how far they are from the mean of full ones (a grey level, and more at sharp edges).
    renderer: what forms tactile images of 240 pixels: ``cpu``, or ``gpu``, whose pixels differ by rounding. Without a GPU `reset` raises ``RuntimeError``; if a GPU
        fails later, a message on stderr says so, and the CPU forms the images.
    reward: ``sparse``, ``shaped`` (both in `REWARDS`), or weights of the terms by name.
    combination: number of a combination of the benchmark (see `ftac.combinations`); None draws one for every episode.
    objects: names of objects from which an episode draws its own, not for ``pick_second``; None for those of the combination.
    reality: the benchmark's errors of arm and detector and effects of reality; without it nothing errs.
    randomization: fields of the scenario that every episode draws anew, see `ftac.randomization`.
    robot_instances: the first and the last number of the robot instances (deviating lengths, springs, friction, sensors) of which every episode draws one.
    robot_model: file of another robot (`hand-model/data/robots` has the hand on a UR5e and on a Panda), for ``pick_one`` and ``pick_two``; None for the
        F-TAC Hand on a Gen3.
    scenario: scenario file, which can have objects of your own (meshes); None for the benchmark.
    camera: side of the images of a camera over the table, 32 to 2048 pixels; None for none.
    privileged: adds ``privileged`` to the observations.
    render_mode: ``rgb_array``: `render` returns a picture (480, 480, 3) uint8 of the true scene, for people.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 20}
    _OWN_STATE: tuple[str, ...] = ()
    """Attributes of a subclass that belong to the state of an episode."""

    def __init__(
        self,
        task: Task = "pick_one",
        *,
        images: int | None = None,
        tactile: Literal["image", "change"] = "image",
        arm: features.ArmAction = "twist",
        hand: features.HandAction = "tension_steps",
        renderer: Literal["cpu", "gpu"] = "cpu",
        identity: bool = False,
        grasp: bool = False,
        reward: str | Mapping[str, float] = "sparse",
        combination: int | None = None,
        objects: Sequence[str] | None = None,
        reality: bool = True,
        randomization: Mapping[str, Any] | None = None,
        robot_instances: tuple[int, int] | None = None,
        robot_model: str | os.PathLike[str] | None = None,
        scenario: str | os.PathLike[str] | None = None,
        camera: int | None = None,
        privileged: bool = False,
        render_mode: str | None = None,
    ) -> None:
        if task not in OBJECTS:
            raise ValueError(f"task: found {task!r}, expected one of {', '.join(OBJECTS)}")
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render_mode: found {render_mode!r}, expected rgb_array or None")
        self.spec_of_features = Spec(images=images, tactile=tactile, arm=arm, hand=hand, identity=identity, grasp=grasp)
        self.task, self.images, self.reality = task, self.spec_of_features.images, bool(reality)
        self.weights = _weights(reward)
        self.combination, self.objects = _combination(combination), _objects(objects)
        self.randomization = Randomization({} if randomization is None else randomization, robot_instances)
        self.camera = None if camera is None else whole("camera", camera, 32, 2048)
        self.privileged, self.render_mode = bool(privileged), render_mode
        self._robot, self._joints, self._pads = robot_of(robot_model)
        self._setup = (self.reality, self._robot, scenario_of(scenario), on_gpu(renderer, self.images))
        self.randomization.check(self._setup)
        known_names("objects", self.objects, self._all_objects())
        self._pictures = True
        self._episode: _native.Episode | None = None
        self._shown: _native.Episode | None = None
        self._over = True
        self.features: Features | None = None
        """Observations and actions of the present episode."""
        size = features.action_size(self.spec_of_features, self._joints)
        self.action_space = spaces.Box(-1.0, 1.0, (size,), np.float32)
        self._named = self._spaces()
        self.observation_space = spaces.Dict(self._named)

    def _spaces(self) -> dict[str, spaces.Space[Any]]:
        shapes = features.shapes(self.spec_of_features, OBJECTS[self.task], self._joints, self._pads)
        found: dict[str, spaces.Space[Any]] = {
            name: spaces.Box(0, 255, shape, np.uint8)
            if name == "tactile"
            else spaces.Box(-1.0, 1.0, shape, np.float32)
            for name, shape in shapes.items()
        }
        if self.camera is not None:
            found["scene_camera"] = spaces.Box(0, 255, (self.camera, self.camera, 3), np.uint8)
        if self.privileged:
            found["privileged"] = spaces.Box(-1.0, 1.0, (15 * OBJECTS[self.task] + self._pads + 20,), np.float32)
        return found

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins an episode. After ``reset(seed=...)`` everything that follows is the same to the bit.

        ``options`` may have, for this episode alone, ``combination``, ``objects`` and ``randomization``, in place of the environment's parameters.

        ``info`` has the names of the ``objects``, the ``combination``, each object's turn about the vertical from its rest pose as detected (``yaws``,
        rad), their poses as detected (``detected``, (objects, 7), m), and the fields drawn for this episode (``drawn``). With images it has ``untouched``
        too: the pads before anything touched them, as cameras take them.
        """
        combination, objects, randomization = self._options(options)
        super().reset(seed=seed)
        objects = self._draw_objects(objects)
        drawn = int(self.np_random.integers(2**40))
        overrides, instance, told = randomization.draw(self.np_random)
        choices = (self.images, combination, objects)
        self._episode = _native.Episode(self.task, choices, drawn, self._setup, (overrides, instance))
        self._shown, self._over = self._episode, False
        names, yaws, detected = self._episode.objects(), self._episode.yaws(), self._episode.observe(False)["detected"]
        untouched = None if self.images is None else self._episode.untouched()
        known, shape = self._known(names, self._episode.object_features())
        self.features = Features(
            self.spec_of_features,
            self._episode.limits(),
            detected=detected,
            objects=known,
            yaws=yaws,
            shape=shape,
            untouched=untouched,
        )
        self.features.begin(*self._episode.grip())
        self._progress = np.array(self._episode.judge()[1])
        info: dict[str, Any] = {
            "objects": names,
            "yaws": yaws,
            "combination": self._episode.combination(),
            "detected": detected,
            "drawn": told,
        }
        if untouched is not None:
            info["untouched"] = untouched
        return self._observe(), info

    def step(self, action: Vector) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Carries out `action` for 1/20 s. ``ValueError`` for one that is not in the action space."""
        command = self._command(action)
        assert self._episode is not None
        return self._judge(self._episode.step(command))

    def save(self) -> State:
        """The present state, for `restore` in this environment or another one of the same parameters, any number of times."""
        if self._episode is None or self.features is None:
            raise gymnasium.error.ResetNeeded("nothing to save yet: call reset() first")
        kept = {"features": self.features.copy(), "progress": self._progress.copy(), "over": self._over, "made": self._made()}
        own = {name: deepcopy(getattr(self, name)) for name in self._OWN_STATE}
        return State(self._episode.copy(), {**kept, **own, "random": self.np_random.bit_generator.state})

    def restore(self, state: State) -> Observation:
        """Returns to a state of `save`, and the observation in it. What follows is the same to the bit. The limit of steps is ``gymnasium.make``'s: it counts on."""
        if not isinstance(state, State):
            raise ValueError(f"state: found {type(state).__name__}, expected what save() returned")
        if state.python["made"] != self._made():
            found, expected = (f"{task}, {spec}" for task, spec, *_ in (state.python["made"], self._made()))
            raise ValueError(f"state: found one of {found}; expected one of {expected}, with the same robot, scenario and options")
        self._episode = state.episode.copy()
        self._shown, self._over = self._episode, state.python["over"]
        self.features, self._progress = state.python["features"].copy(), state.python["progress"].copy()
        self.np_random.bit_generator.state = state.python["random"]
        for name in self._OWN_STATE:
            setattr(self, name, deepcopy(state.python[name]))
        return self._observe()

    def render(self) -> NDArray[np.uint8] | None:
        """The scene as it is, (480, 480, 3) uint8; None without ``render_mode``."""
        if self.render_mode is None:
            return None
        if self._shown is None:
            raise gymnasium.error.ResetNeeded("nothing to show yet: call reset() first")
        return self._shown.picture(SIDE)

    def _made(self) -> tuple[Any, ...]:
        """What a state must have been made with."""
        return self.task, self.spec_of_features, self.camera, self.privileged, self._OWN_STATE, self._setup

    def _all_objects(self) -> list[str]:
        """Names of the scenario's objects."""
        return objects_of(self._setup[2])

    def _draw_objects(self, objects: list[str]) -> list[str]:
        """Names from which the simulation draws the objects of an episode; none for those of the combination."""
        return objects

    def _known(self, names: list[str], shape: ArrayLike) -> tuple[list[str], ArrayLike]:
        """The names and the features of the objects by which a policy goes."""
        return names, shape

    def _command(self, action: Vector) -> tuple[Any, ...]:
        """Arguments of a native step."""
        if self._over or self.features is None:
            raise gymnasium.error.ResetNeeded("the episode is over or has not begun: call reset() first")
        return self.features.act(action)

    def _judge(
        self, judged: tuple[list[bool], list[float], bool, bool]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        held, terms, success, lost = judged
        progress = np.array(terms)
        reward = float(self.weights[:5] @ (progress - self._progress))
        reward += self.weights[5] * success + self.weights[6] * lost + self.weights[7]
        self._progress = progress
        observation = self._observe()
        self._over = success or lost
        info = {"held": held, "is_success": success, "progress": dict(zip(PROGRESS, terms))}
        return observation, float(reward), self._over, False, info

    def _observe(self) -> Observation:
        assert self._episode is not None and self.features is not None
        observed = self.features.observe(self._episode.observe(self._pictures), self._pictures)
        if self.camera is not None:
            observed["scene_camera"] = self._episode.picture(self.camera)
        if self.privileged:
            observed["privileged"] = self._privileged()
        return observed

    def _privileged(self) -> Vector:
        assert self._episode is not None
        true = self._episode.true_state()
        from_world = inverse(pose_matrix(true["palm"]))
        poses = np.array([from_world @ pose_matrix(pose) for pose in true["objects"]])
        objects = np.concatenate([features.relative_rows(poses), true["velocities"]], axis=1)
        hand = [true["pad_forces"] / PAD_FORCE, true["joints"] / (0.5 * np.pi), true["tensions"] / features.TENSION]
        privileged: Vector = np.clip(np.concatenate([objects.ravel(), *hand]), -1.0, 1.0).astype(np.float32)
        return privileged

    def _options(self, options: dict[str, Any] | None) -> tuple[int | None, list[str], Randomization]:
        known = ("combination", "objects", "randomization")
        given = options or {}
        for name in given:
            if name not in known:
                raise ValueError(f"options: found {name!r}, expected some of {', '.join(known)}")
        combination = _combination(given["combination"]) if "combination" in given else self.combination
        objects = _objects(given["objects"]) if "objects" in given else self.objects
        randomization = self.randomization
        if "randomization" in given:
            randomization = Randomization(given["randomization"], randomization.instances)
        return combination, objects, randomization


class LiftTo(Pick):
    """`Pick` of one object with goals, for hindsight relabelling (HER): the object is to be moved to a point and held there.

    Observations have three keys, all float32: ``observation``, the flattened observations of `Pick` in their order (`parts` takes them apart);
    ``achieved_goal`` (3,), the object's true position; ``desired_goal`` (3,), the point, which is drawn over the table. Both are relative to
    `ftac.features.CENTER` / `ftac.features.REACH`. With ``images`` there is ``tactile`` too. On a robot nobody knows ``achieved_goal``: a policy that is to
    run there leaves it to the learner, and has to find out where in the hand the object is.
    The reward is that of `compute_reward`: 0 within ``tolerance`` (m) of the goal while the object is in the hand, -1 otherwise; ``reward`` is no parameter. It needs ``held``
    of the step's ``info``, which Stable-Baselines3's ``HerReplayBuffer`` keeps with ``copy_info_dict=True``.
    """

    _OWN_STATE = ("_goal",)
    TOLERANCE = 0.03
    """Distance from the goal that counts as reached unless ``tolerance`` is given, m."""
    GOALS: NDArray[np.float64] = np.array([[0.55, 0.68], [-0.15, 0.15], [0.12, 0.25]])
    """Lowest and highest x, y, z of a goal, m, world."""

    def __init__(self, *, tolerance: float = TOLERANCE, **options: Any) -> None:
        for name in ("task", "reward", "camera"):
            if options.get(name) is not None:
                raise ValueError(f"{name}: found {options[name]!r}, expected none for an environment with goals")
        if not number("tolerance", tolerance, ", m") > 0.0:
            raise ValueError(f"tolerance: found {tolerance}, expected a positive number, m")
        super().__init__("pick_one", **options)
        self.tolerance = float(tolerance)
        self._shapes = {name: space.shape or () for name, space in self._named.items() if name != "tactile"}
        length = sum(int(np.prod(shape)) for shape in self._shapes.values())
        self._goal = np.zeros(3)
        self._held = False
        named: dict[str, spaces.Space[Any]] = {
            "observation": spaces.Box(-1.0, 1.0, (length,), np.float32),
            "achieved_goal": spaces.Box(-1.0, 1.0, (3,), np.float32),
            "desired_goal": spaces.Box(-1.0, 1.0, (3,), np.float32),
        }
        if "tactile" in self._named:
            named["tactile"] = self._named["tactile"]
        self.observation_space = spaces.Dict(named)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """As `Pick.reset`."""
        self._goal, self._held = np.zeros(3), False
        observation, info = super().reset(seed=seed, options=options)
        low, high = self.GOALS.T
        self._goal = (self.np_random.uniform(low, high) - features.CENTER) / features.REACH
        return {**observation, "desired_goal": self._goal.astype(np.float32)}, info

    def parts(self, observation: Vector) -> Observation:
        """The observations of `Pick` by name, of the key ``observation``."""
        return features.apart(observation, self._shapes)

    def compute_reward(self, achieved_goal: Vector, desired_goal: Vector, info: Any) -> Any:
        """Rewards of achieved for desired goals, each (3,) or (n, 3); ``info``, or an array of n, has ``held``."""
        distance = features.REACH * np.linalg.norm(np.asarray(achieved_goal) - np.asarray(desired_goal), axis=-1)
        try:
            held = np.array([one["held"][0] for one in info], dtype=bool) if np.ndim(distance) else bool(info["held"][0])
        except (KeyError, TypeError):
            words = "a step's info with 'held' for each goal; Stable-Baselines3 keeps it with copy_info_dict=True"
            raise ValueError(f"info: found {shortened(info)}, expected {words}") from None
        if np.shape(held) != np.shape(distance):
            raise ValueError(f"info: found {len(info)}, expected one for each of {np.shape(distance)} goals")
        reached = (distance < self.tolerance) & held
        return reached.astype(np.float32) - 1.0 if np.ndim(distance) else float(reached) - 1.0

    def _judge(
        self, judged: tuple[list[bool], list[float], bool, bool]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        held, terms, _, lost = judged
        observation, _, _, _, info = super()._judge((held, terms, False, lost))
        reward = self.compute_reward(observation["achieved_goal"], observation["desired_goal"], info)
        info["is_success"] = reward == 0.0
        return observation, float(reward), self._over, False, info

    def _observe(self) -> Observation:
        observed = super()._observe()
        assert self._episode is not None
        position = self._episode.true_state()["objects"][0, :3]
        images = {"tactile": observed["tactile"]} if "tactile" in observed else {}
        return {
            **images,
            "observation": np.concatenate([observed[name].ravel() for name in self._shapes]),
            "achieved_goal": np.clip((position - features.CENTER) / features.REACH, -1.0, 1.0).astype(np.float32),
            "desired_goal": self._goal.astype(np.float32),
        }


def _weights(reward: str | Mapping[str, float]) -> NDArray[np.float64]:
    """Weights of the terms of progress, of success, loss and a step."""
    if isinstance(reward, str) and reward not in REWARDS:
        raise ValueError(f"reward: found {reward!r}, expected one of {', '.join(REWARDS)}, or weights by name")
    terms = (*PROGRESS, "success", "lost", "step")
    given = REWARDS[reward] if isinstance(reward, str) else mapping("reward", reward, "sparse, shaped, or weights by the names of terms")
    for name in given:
        if name not in terms:
            raise ValueError(f"reward: found the term {name!r}, expected some of {', '.join(terms)}")
    return np.array([number(f"reward.{name}", given.get(name, 0.0)) for name in terms])


def _combination(combination: Any) -> int | None:
    return None if combination is None else whole("combination", combination, 0, len(_native.combinations()) - 1)


def _objects(objects: Sequence[str] | None) -> list[str]:
    if objects is None:
        return []
    if isinstance(objects, str) or not objects:
        raise ValueError(f"objects: found {objects!r}, expected a list of names")
    return [str(name) for name in objects]


def register() -> None:
    """Makes the environments known to ``gymnasium.make``. Once is enough; ``import ftac`` does it."""
    picks = {"PickOne": "pick_one", "PickSecond": "pick_second", "PickTwo": "pick_two"}
    known: dict[str, tuple[str, str | None, dict[str, Any], int]] = {
        name: ("ftac.envs:Pick", "ftac.vector:VectorPick", {"task": task}, STEPS[task]) for name, task in picks.items()
    }
    known["LiftTo"] = ("ftac.envs:LiftTo", None, {}, STEPS["pick_one"])
    known["Sort"] = ("ftac.sorting:Sort", "ftac.vector:VectorSort", {}, STEPS["pick_one"])
    for name, (one, many, options, steps) in known.items():
        if f"ftac/{name}-v1" not in gymnasium.registry:
            gymnasium.register(
                f"ftac/{name}-v1", entry_point=one, vector_entry_point=many, max_episode_steps=steps, kwargs=options
            )
