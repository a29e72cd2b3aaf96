"""Arm, hand and objects on a table, stepped at 20 Hz."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ftac import _native
from ftac._arrays import number, numbers, on_gpu, real, robot_of, scenario_of, seed_of, side_of, whole
from ftac._images import Images, enlarged, images as shown, png
from ftac._poses import pose_matrix

Place = tuple[str, float, float, float]
__all__ = ["Place", "Scene", "command", "pose_matrix"]


def command(
    twist: ArrayLike | None,
    joints: ArrayLike | None,
    tensions: ArrayLike | None,
    opposition: float | None,
    spools: ArrayLike | None,
    arm_joints: int,
) -> tuple[Any, ...]:
    """Arguments of a native step."""

    def one(what: str, values: ArrayLike | None, length: int) -> NDArray[np.float64] | None:
        return None if values is None else numbers(what, values, length)

    return (
        one("twist", twist, 6),
        one("joints", joints, arm_joints),
        one("tensions", tensions, 5),
        None if opposition is None else number("opposition", opposition, ", rad"),
        one("spools", spools, 6),
    )


def _place(n: int, place: Any) -> Place:
    if isinstance(place, str) or not isinstance(place, Sequence) or len(place) != 4:
        raise ValueError(f"objects[{n}]: found {place!r}, expected (name, x, y, turn)")
    x, y, turn = (number(f"objects[{n}]: {what}", value) for what, value in zip(("x", "y", "turn"), place[1:]))
    return str(place[0]), x, y, turn


class Scene:
    """A robot at a table with objects.

    Parameters
    ----------
    objects:
        Each is a name (see `ftac.objects`) and the place of its centre on the table: x and y in m (world; the arm reaches about 0.50 to 0.72 and
        -0.25 to 0.25), and the turn about the vertical in rad. ``ValueError`` for objects that are in each other.
    images:
        Side of the tactile images in pixels, 8 to 240; None for no images, which is much faster.
    seed:
        Of the cameras' noise. The same seed and the same actions give the same bits.
    reality:
        Whether covers give way, cables rub, pads feel the hand itself and images arrive late, as in the benchmark.
    robot_model:
        File of another robot (`hand-model/data/robots` has the hand on a UR5e and on a Panda); None for the F-TAC Hand on a Gen3.
    scenario:
        Scenario file with objects of your own and effects (see the guide); None for the benchmark's.
    renderer:
        What forms images of 240 pixels: ``cpu``, or ``gpu``, whose pixels differ by rounding. Without a GPU it raises ``RuntimeError``, with images of another
        size ``ValueError``.
    """

    def __init__(
        self,
        objects: Sequence[Place] = (),
        *,
        images: int | None = None,
        seed: int = 0,
        reality: bool = True,
        robot_model: str | os.PathLike[str] | None = None,
        scenario: str | os.PathLike[str] | None = None,
        renderer: Literal["cpu", "gpu"] = "cpu",
    ) -> None:
        places = [_place(n, place) for n, place in enumerate(objects)]
        setup = (bool(reality), robot_of(robot_model)[0], scenario_of(scenario), on_gpu(renderer, images))
        self._scene = _native.Scene(places, side_of(images), seed_of(seed), setup)
        self.objects = [place[0] for place in places]
        self.limits: dict[str, Any] = self._scene.limits()
        """Limits of what `step` takes: `speed` (m/s) and `turn_speed` (rad/s) of each axis, `joints` (an arm joint each, 2) rad, `tension` (N), `opposition` (2,) rad,
        `spools` (6, 2) rad; and `step`, the length of a step in s."""

    def step(
        self,
        *,
        twist: ArrayLike | None = None,
        joints: ArrayLike | None = None,
        tensions: ArrayLike | None = None,
        opposition: float | None = None,
        spools: ArrayLike | None = None,
    ) -> dict[str, Any]:
        """Lets 1/20 s pass and returns `observe()`.

        The arm moves the palm with ``twist`` (6,): m/s of its origin and rad/s, world axes; or goes to ``joints``, an angle (rad) for each joint, 7 of a Gen3. With neither it keeps still.
        The hand pulls its cables with ``tensions`` (5,), N at the spools (thumb, index, middle, ring, little), and turns the thumb to ``opposition``, rad;
        or its servos turn to the output angles ``spools`` (6,), rad. With neither all cables are slack.

        Raises ``ValueError`` where a value is not a number or beyond `limits`; the scene is then as it was.
        """
        if tensions is None and spools is None:
            tensions, opposition = np.zeros(5), 0.0 if opposition is None else opposition
        elif tensions is not None and opposition is None:
            opposition = 0.0
        self._scene.step(command(twist, joints, tensions, opposition, spools, len(self.limits["joints"])))
        return self.observe()

    def tick(self, arm: ArrayLike, servos: ArrayLike, capture: bool = False) -> dict[str, Any]:
        """Lets 1/120 s pass with a robot's own command, as a driver sends it, and returns `observe()` with ``frames``.

        Parameters
        ----------
        arm: set-point of each joint, rad.
        servos: (n, 2), a row for each servo: goal of the output angle (rad) and current limit (A).
        capture: requests an image of every camera; with ``images``.

        ``frames`` has the images that arrived: ``{name: (time, image)}``. A scene that was moved like this cannot be pickled.
        """
        goals = real("servos", servos)
        if goals.ndim != 2 or goals.shape[1] != 2:
            raise ValueError(f"servos: found shape {goals.shape}, expected a row of two numbers for each servo")
        command = numbers("arm", arm), numbers("servos", goals[:, 0]), numbers("servos", goals[:, 1])
        frames = self._scene.tick(command, bool(capture))
        cameras = self.names["cameras"] if frames else []
        return {**self.observe(), "frames": {cameras[camera]: (time, image) for camera, time, image in frames}}

    @property
    def names(self) -> dict[str, list[str]]:
        """Names of the arm's ``joints``, of the hand's ``servos`` and of its ``cameras``, in the order of measurements and commands."""
        return dict(zip(("joints", "servos", "cameras"), self._scene.names()))

    def observe(self) -> dict[str, Any]:
        """What the robot measures; nothing here is the scene's truth.

        - ``time``: s since the scene began.
        - ``servos`` (6, 3): output angle (rad), speed (rad/s), current (A) of five cable servos and the thumb's opposition.
        - ``arm`` (7, 3), a row for each of its joints: joint angle (rad), speed (rad/s), torque (N m).
        - ``palm`` (7,): ``world_from_palm`` by the arm's encoders and nominal dimensions.
        - ``tactile`` (17, n, n, 3) uint8: an image a pad (`ftac.hand.PADS`), row 0 at the fingertip's side; only with ``images``.
        - ``tactile_time`` (17,): when they were taken, s; NaN for those from before the scene.
        """
        measured = self._scene.observe()
        if "tactile" in measured:
            measured["tactile"] = shown(measured["tactile"])
        return measured

    def picture(self, side: int = 480) -> Images:
        """The scene as rendered for people: (side, side, 3) uint8 RGB, with `side` from 16 to 2048 pixels."""
        return shown(self._scene.picture(whole("side", side, 16, 2048)))

    def __repr__(self) -> str:
        measured = self._scene.observe()
        pads = f", tactile {measured['tactile'].shape} uint8" if "tactile" in measured else ", no images"
        return f"<Scene at {measured['time']:.2f} s: {', '.join(self.objects) or 'no objects'}{pads}>"

    def _repr_png_(self) -> bytes:
        return png(enlarged(self.picture()))

    def true_state(self) -> dict[str, Any]:
        """The scene as it really is, for judging and plotting. No real robot can know it: keep it from policies.

        ``objects`` (n, 7) ``world_from_object``, ``velocities`` (n, 3) m/s, ``palm`` (7,) ``world_from_palm``, ``joints`` (15,) rad, ``tensions`` (5,) N,
        ``pad_forces`` (17,) N, ``on_table`` n booleans, ``contacts`` (k, 8): object, link (-1 is the palm), point (m, world), force on the object (N, world).
        """
        return self._scene.true_state()

    def untouched(self) -> Images | None:
        """The pads before anything touched them, (17, n, n, 3) uint8 as ``tactile`` of `observe`; None without ``images``.

        With ``images=240`` the picture of a pad with one camera is that camera's image: `ftac.touch.surface` compares the two.
        """
        untouched = self._scene.untouched()
        return None if untouched is None else shown(untouched)

    def copy(self) -> Scene:
        """A scene that goes its own way from the same bits.

        A scene can be pickled too. The pickle has what the scene was made of and all actions since, not the simulator's state: unpickling steps anew, as
        long as that takes, and is refused by another version of the package.
        """
        twin = object.__new__(Scene)
        twin._scene, twin.objects, twin.limits = self._scene.copy(), list(self.objects), dict(self.limits)
        return twin
