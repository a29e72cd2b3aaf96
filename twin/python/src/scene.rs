//! Scenes and episodes (environments) that are stepped from Python.
//!
//! Steps run with Python's lock (GIL) released. A scene that one thread is stepping cannot be used by another: that
//! raises a `RuntimeError`.

use std::sync::{Mutex, MutexGuard, TryLockError};

use control::Twist;
use control::action::{Action, ActionError, ArmAction, HandAction};
use hand_model::RobotModel;
use hand_model::arm::MAX_ARM_JOINTS;
use hand_model::hand::{MAX_ACTUATORS, MAX_DIGITS};
use hand_model::robot::{RobotCommand, ServoGoal, TactileFrame};
use learning_environment::{
    EpisodeError, EpisodeOptions, EpisodeTask, Judgement, PadImages, Progress, SceneObject, SceneOptions,
};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3, PyArray4};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use world::layout::TablePlacement;

use crate::arrays::{
    Numbers, array_of_rows, bounded_length, failure, fixed_length, picture, pictures, pose_row, value_error,
};
use crate::pickling::{PickledState, SteppedScene, UnpickledState, check_state, decode_actions, pickle};
use crate::shared_benches::{Setup, shared_bench, varied_bench};
use crate::threads::detach;

/// Constructor arguments of a scene: objects and their places, images, seed, setup.
type SceneArguments = (Vec<(String, f64, f64, f64)>, Option<usize>, u64, Setup);
/// Arguments of a robot's own command: set-points of the joints (rad), goals (rad) and current limits (A) of the servos.
type CommandArguments<'py> = (Numbers<'py>, Numbers<'py>, Numbers<'py>);
/// Frame of a camera: camera, time (s), image.
type CameraFrame<'py> = (usize, f64, Bound<'py, PyArray3<u8>>);
/// Choices of an episode: images, combination, names of objects to draw from.
type EpisodeChoices = (Option<usize>, Option<usize>, Vec<String>);
/// Variation of an episode: fields of the scenario as JSON, and the number of the robot instance.
type Variation = (Option<String>, Option<u64>);
/// Constructor arguments of an episode: task, choices, seed, setup, variation.
type EpisodeArguments = (String, EpisodeChoices, u64, Setup, Variation);

/// A robot at a table with objects.
#[pyclass(frozen, module = "ftac._native")]
pub struct Scene(Mutex<SteppedScene<learning_environment::TactileScene, SceneArguments>>);

/// A task in progress.
#[pyclass(frozen, module = "ftac._native")]
pub struct Episode(pub Mutex<SteppedScene<learning_environment::Episode, EpisodeArguments>>);

/// Locks the scene, or returns an error if another thread is stepping it.
pub fn lock_stepped<T>(mutex: &Mutex<T>) -> PyResult<MutexGuard<'_, T>> {
    match mutex.try_lock() {
        Ok(guard) => Ok(guard),
        Err(TryLockError::WouldBlock) => {
            Err(PyRuntimeError::new_err("the scene is being stepped by another thread: give each thread its own"))
        }
        Err(TryLockError::Poisoned(_)) => {
            Err(PyRuntimeError::new_err("a step of the scene failed half-way: make a new one"))
        }
    }
}

/// Arguments of an action: `twist` or `joints`, and `tensions` with `opposition` or `spools`, in this order.
pub type ActionArguments<'py> =
    (Option<Numbers<'py>>, Option<Numbers<'py>>, Option<Numbers<'py>>, Option<f64>, Option<Numbers<'py>>);

/// Converts the arguments of an action. The action's limits check the exact number of values; here only the maximum of
/// any robot is checked.
pub fn action((twist, joints, tensions, opposition, spools): ActionArguments) -> PyResult<Action> {
    let arm = match (twist, joints) {
        (Some(twist), None) => ArmAction::Twist(Twist::from(fixed_length::<6>("twist", &twist)?)),
        (None, Some(joints)) => ArmAction::Joints(bounded_length("joints", &joints, MAX_ARM_JOINTS)?),
        (None, None) => ArmAction::Twist(Twist::zeros()),
        (Some(_), Some(_)) => return Err(value_error("found twist and joints, expected one of them at most")),
    };
    let hand = match (tensions, opposition, spools) {
        (Some(tensions), Some(opposition), None) => {
            HandAction::Tensions { tensions: bounded_length("tensions", &tensions, MAX_DIGITS)?, opposition }
        }
        (None, None, Some(spools)) => HandAction::Spools(bounded_length("spools", &spools, MAX_ACTUATORS)?),
        _ => return Err(value_error("expected either tensions and opposition, or spools")),
    };
    Ok(Action { arm, hand })
}

/// Returns as many finite numbers as expected.
fn sized(name: &str, values: &Numbers, expected: usize) -> PyResult<Vec<f64>> {
    let values = values.as_slice().map_err(value_error)?;
    if values.len() != expected || values.iter().any(|value| !value.is_finite()) {
        return Err(value_error(format!("{name}: found {values:?}, expected {expected} finite numbers")));
    }
    Ok(values.to_vec())
}

/// Returns the observation: the measurements of the robot, with the tactile images if there are any and `pictures` is
/// true.
fn observation<'py>(
    py: Python<'py>,
    scene: &learning_environment::TactileScene,
    pictures: bool,
) -> PyResult<Bound<'py, PyDict>> {
    let measured = PyDict::new(py);
    measured.set_item("time", scene.time())?;
    let servos = scene.servos().iter().map(|servo| [servo.position, servo.velocity, servo.current]);
    measured.set_item("servos", array_of_rows(py, servos))?;
    let arm = scene.arm();
    let joints = (0..arm.position.len()).map(|n| [arm.position[n], arm.velocity[n], arm.torque[n]]);
    measured.set_item("arm", array_of_rows(py, joints))?;
    measured.set_item("palm", PyArray1::from_slice(py, &pose_row(&scene.palm())))?;
    if let Some(images) = scene.images().filter(|_| pictures) {
        measured.set_item("tactile", pad_image_array(py, images)?)?;
        measured.set_item("tactile_time", times(images).into_pyarray(py))?;
    }
    Ok(measured)
}

fn pad_image_array<'py>(py: Python<'py>, images: &PadImages) -> PyResult<Bound<'py, PyArray4<u8>>> {
    pictures(py, images.times().len(), images.side(), images.rgb().to_vec())
}

fn times(images: &PadImages) -> Vec<f64> {
    images.times().iter().map(|time| time.unwrap_or(f64::NAN)).collect()
}

/// Returns the true state of the scene.
fn truth<'py>(py: Python<'py>, scene: &learning_environment::TactileScene) -> PyResult<Bound<'py, PyDict>> {
    let truth = scene.truth();
    let all = PyDict::new(py);
    all.set_item("time", truth.time)?;
    all.set_item("objects", array_of_rows(py, truth.objects.iter().map(pose_row)))?;
    all.set_item("velocities", array_of_rows(py, truth.velocities.iter().map(|v| [v.x, v.y, v.z])))?;
    all.set_item("palm", PyArray1::from_slice(py, &pose_row(&truth.palm)))?;
    all.set_item("joints", truth.hand.into_pyarray(py))?;
    all.set_item("tensions", PyArray1::from_slice(py, &truth.tensions))?;
    all.set_item("pad_forces", truth.pad_forces.into_pyarray(py))?;
    all.set_item("on_table", truth.on_table)?;
    let contacts = truth.contacts.iter().map(|contact| {
        let link = contact.link.map_or(-1.0, |link| link as f64);
        let (p, f) = (contact.point, contact.force);
        [contact.object as f64, link, p.x, p.y, p.z, f.x, f.y, f.z]
    });
    all.set_item("contacts", array_of_rows(py, contacts))?;
    Ok(all)
}

/// Returns the limits of the actions.
fn limits<'py>(py: Python<'py>, scene: &learning_environment::TactileScene) -> PyResult<Bound<'py, PyDict>> {
    let limits = scene.limits();
    let all = PyDict::new(py);
    all.set_item("speed", limits.speed)?;
    all.set_item("turn_speed", limits.turn_speed)?;
    all.set_item("joints", array_of_rows(py, limits.joints.into_iter()))?;
    all.set_item("tension", limits.tension)?;
    all.set_item("opposition", PyArray1::from_slice(py, &limits.opposition))?;
    all.set_item("spools", array_of_rows(py, limits.spools.into_iter()))?;
    all.set_item("step", scene.step_length())?;
    Ok(all)
}

#[pymethods]
impl Scene {
    #[new]
    fn new(
        py: Python<'_>,
        objects: Vec<(String, f64, f64, f64)>,
        images: Option<usize>,
        seed: u64,
        setup: Setup,
    ) -> PyResult<Self> {
        let bench = shared_bench(py, &setup)?;
        let placed =
            objects.iter().cloned().map(|(name, x, y, yaw)| SceneObject { name, place: TablePlacement { x, y, yaw } });
        let (placed, options) = (placed.collect::<Vec<_>>(), SceneOptions { images, seed });
        let scene =
            detach(py, || learning_environment::TactileScene::new(&bench.world, &bench.cameras, &placed, options))?;
        let (scene, arguments) = (scene.map_err(value_error)?, (objects, images, seed, setup));
        Ok(Self(Mutex::new(SteppedScene { scene, arguments, actions: Vec::new(), ticked: false })))
    }

    fn step(&self, py: Python<'_>, asked: ActionArguments) -> PyResult<()> {
        let action = action(asked)?;
        let mut stepped = lock_stepped(&self.0)?;
        let SteppedScene { scene, actions, .. } = &mut *stepped;
        detach(py, || scene.step(&action))?.map_err(value_error)?;
        actions.push(action);
        Ok(())
    }

    /// Lets one tick pass with a robot's own command. Returns the frames that arrived.
    fn tick<'py>(
        &self,
        py: Python<'py>,
        command: CommandArguments<'py>,
        capture: bool,
    ) -> PyResult<Vec<CameraFrame<'py>>> {
        let (arm, goals, limits) = command;
        let mut stepped = lock_stepped(&self.0)?;
        let robot = &stepped.scene.cell().robot;
        let arm = sized("arm", &arm, robot.arm.joints())?;
        let servos = robot.hand.servos.len();
        let (goals, limits) = (sized("goals", &goals, servos)?, sized("current limits", &limits, servos)?);
        if let Some(limit) = limits.iter().find(|limit| **limit < 0.0) {
            return Err(value_error(format!("current limits: found {limit} A, expected 0 or more")));
        }
        let goal = |(&angle, &current_limit): (&f64, &f64)| ServoGoal::Position { angle, current_limit };
        let servos = goals.iter().zip(&limits).map(goal).collect();
        let command = RobotCommand { arm: arm.into_iter().collect(), servos, capture };
        stepped.ticked = true;
        let scene = &mut stepped.scene;
        let frames = detach(py, || scene.tick(&command))?;
        let frame = |frame: TactileFrame| {
            let side = (frame.image.rgb.len() / 3).isqrt();
            Ok((frame.camera, frame.time, picture(py, side, frame.image.rgb.clone())?))
        };
        frames.into_iter().map(frame).collect()
    }

    /// Returns the names of the robot's joints, servos and cameras.
    fn names(&self) -> PyResult<(Vec<String>, Vec<String>, Vec<String>)> {
        let stepped = lock_stepped(&self.0)?;
        let RobotModel { arm, hand, .. } = &stepped.scene.cell().robot;
        let joints = arm.tree.joints.iter().take(arm.joints()).map(|joint| joint.name.clone()).collect();
        let servos = hand.parameters.actuator.iter().map(|actuator| actuator.name.clone()).collect();
        Ok((joints, servos, hand.cameras.iter().map(|camera| camera.name.clone()).collect()))
    }

    fn observe<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        observation(py, &lock_stepped(&self.0)?.scene, true)
    }

    /// Returns the images of the untouched pads, as `tactile` of an observation.
    fn untouched<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray4<u8>>>> {
        lock_stepped(&self.0)?.scene.untouched().map(|images| pad_image_array(py, images)).transpose()
    }

    fn true_state<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        truth(py, &lock_stepped(&self.0)?.scene)
    }

    fn limits<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        limits(py, &lock_stepped(&self.0)?.scene)
    }

    /// Renders the scene for people to look at, side x side x RGB.
    fn picture<'py>(&self, py: Python<'py>, side: u32) -> PyResult<Bound<'py, PyArray3<u8>>> {
        render_picture(py, &lock_stepped(&self.0)?.scene, side)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (SceneArguments, PickledState<'py>))> {
        let stepped = lock_stepped(&self.0)?;
        if stepped.ticked {
            let words = "pickle: found a scene that was moved by tick(), expected one that was moved by step() alone";
            return Err(PyRuntimeError::new_err(words));
        }
        let kept = pickle(py, &stepped.scene, &stepped.actions);
        Ok((native(py, "restored_scene")?, (stepped.arguments.clone(), kept)))
    }

    fn __deepcopy__(&self, _memo: &Bound<'_, PyAny>) -> PyResult<Self> {
        self.copy()
    }

    fn copy(&self) -> PyResult<Self> {
        Ok(Self(Mutex::new(lock_stepped(&self.0)?.clone())))
    }
}

/// Restores a pickled scene.
#[pyfunction]
pub fn restored_scene(py: Python<'_>, made: SceneArguments, kept: UnpickledState<'_>) -> PyResult<Scene> {
    let (objects, images, seed, setup) = made;
    let restored = Scene::new(py, objects, images, seed, setup)?;
    {
        let mut stepped = lock_stepped(&restored.0)?;
        let scene = &mut stepped.scene;
        let actions = decode_actions(scene, &kept)?;
        detach(py, || actions.iter().try_for_each(|action| scene.step(action)))?.map_err(value_error)?;
        check_state(&stepped.scene, &kept)?;
        stepped.actions = actions;
    }
    Ok(restored)
}

/// Returns a function of this module, for a pickle.
fn native<'py>(py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    py.import("ftac._native")?.getattr(name)
}

fn render_picture<'py>(
    py: Python<'py>,
    scene: &learning_environment::TactileScene,
    side: u32,
) -> PyResult<Bound<'py, PyArray3<u8>>> {
    let rgb = detach(py, || scene.picture(side))?.map_err(value_error)?;
    picture(py, side as usize, rgb)
}

/// Judgement of a scene: held, terms of progress (reach, near, touch, lift, hold), success, lost.
pub type JudgementTuple = (Vec<bool>, [f64; 5], bool, bool);

fn judgement_tuple(judgement: Judgement) -> JudgementTuple {
    let Judgement { held, progress: Progress { reach, near, touch, lift, hold }, success, lost } = judgement;
    (held, [reach, near, touch, lift, hold], success, lost)
}

#[pymethods]
impl Episode {
    #[new]
    fn new(
        py: Python<'_>,
        task: &str,
        choices: EpisodeChoices,
        seed: u64,
        setup: Setup,
        variation: Variation,
    ) -> PyResult<Self> {
        let kind = match task {
            "pick_one" => EpisodeTask::PickOne,
            "pick_second" => EpisodeTask::PickSecond,
            "pick_two" => EpisodeTask::PickTwo,
            found => {
                return Err(value_error(format!(
                    "task: found `{found}`, expected `pick_one`, `pick_second` or `pick_two`"
                )));
            }
        };
        let bench = varied_bench(shared_bench(py, &setup)?, variation.0.as_deref(), variation.1)?;
        if kind == EpisodeTask::PickSecond
            && !grasp_verification::builtin::fits_robot(&bench.world.cell.robot).map_err(|error| failure(&error))?
        {
            let name = &bench.world.cell.robot.name;
            let words = "task: found `pick_second`, which begins with a grasp of the built-in robot, expected `pick_one` or `pick_two` with";
            return Err(value_error(format!("{words} {name}")));
        }
        let (images, combination, objects) = choices.clone();
        let options = EpisodeOptions { task: kind, images, combination, objects };
        let arguments = (task.to_owned(), choices, seed, setup, variation);
        match detach(py, || learning_environment::Episode::begin(&bench, options, seed))? {
            Ok(scene) => Ok(Self(Mutex::new(SteppedScene { scene, arguments, actions: Vec::new(), ticked: false }))),
            Err(EpisodeError::Setup(error)) => Err(failure(&error)),
            Err(error) => Err(value_error(error)),
        }
    }

    fn step(&self, py: Python<'_>, asked: ActionArguments) -> PyResult<JudgementTuple> {
        let action = action(asked)?;
        let mut stepped = lock_stepped(&self.0)?;
        let stepped: &mut SteppedScene<_, _> = &mut stepped;
        detach(py, || step_and_judge(stepped, action))?.map_err(value_error)
    }

    /// Returns the observation, with the tactile images if `pictures` is true.
    fn observe<'py>(&self, py: Python<'py>, pictures: bool) -> PyResult<Bound<'py, PyDict>> {
        let stepped = lock_stepped(&self.0)?;
        let episode = &stepped.scene;
        let measured = observation(py, &episode.scene, pictures)?;
        measured.set_item(
            "detected",
            array_of_rows(py, episode.detections().iter().map(|object| pose_row(&object.pose()))),
        )?;
        Ok(measured)
    }

    /// Returns the images of the untouched pads, as `tactile` of an observation.
    fn untouched<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray4<u8>>>> {
        lock_stepped(&self.0)?.scene.scene.untouched().map(|images| pad_image_array(py, images)).transpose()
    }

    fn true_state<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        truth(py, &lock_stepped(&self.0)?.scene.scene)
    }

    fn limits<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        limits(py, &lock_stepped(&self.0)?.scene.scene)
    }

    /// Renders the scene for people to look at, side x side x RGB.
    fn picture<'py>(&self, py: Python<'py>, side: u32) -> PyResult<Bound<'py, PyArray3<u8>>> {
        render_picture(py, &lock_stepped(&self.0)?.scene.scene, side)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (EpisodeArguments, PickledState<'py>))> {
        let stepped = lock_stepped(&self.0)?;
        let kept = pickle(py, &stepped.scene.scene, &stepped.actions);
        Ok((native(py, "restored_episode")?, (stepped.arguments.clone(), kept)))
    }

    /// Returns the tensions (N) and the opposition (rad) with which the hand begins.
    fn grip(&self) -> PyResult<(Vec<f64>, f64)> {
        let (tensions, opposition) = lock_stepped(&self.0)?.scene.grip();
        Ok((tensions.to_vec(), opposition))
    }

    fn objects(&self) -> PyResult<Vec<String>> {
        Ok(lock_stepped(&self.0)?.scene.objects().map(str::to_owned).collect())
    }

    /// Returns the yaw (rad) of each object about the vertical from its rest pose, as seen by vision.
    fn yaws(&self) -> PyResult<Vec<f64>> {
        Ok(lock_stepped(&self.0)?.scene.detections().iter().map(|object| object.yaw).collect())
    }

    /// Returns the features of each object as known to a controller: half extents (m), mass (kg), friction, height at
    /// rest (m).
    fn object_features<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let stepped = lock_stepped(&self.0)?;
        Ok(array_of_rows(py, stepped.scene.models().iter().map(|object| object.features())))
    }

    /// Judges the scene as it is.
    fn judge(&self) -> PyResult<JudgementTuple> {
        Ok(judgement_tuple(lock_stepped(&self.0)?.scene.judge()))
    }

    fn combination(&self) -> PyResult<usize> {
        Ok(lock_stepped(&self.0)?.scene.combination())
    }

    fn __deepcopy__(&self, _memo: &Bound<'_, PyAny>) -> PyResult<Self> {
        self.copy()
    }

    fn copy(&self) -> PyResult<Self> {
        Ok(Self(Mutex::new(lock_stepped(&self.0)?.clone())))
    }
}

/// Steps an episode and returns its judgement.
pub fn step_and_judge(
    stepped: &mut SteppedScene<learning_environment::Episode, EpisodeArguments>,
    action: Action,
) -> Result<JudgementTuple, ActionError> {
    stepped.scene.scene.step(&action)?;
    stepped.actions.push(action);
    Ok(judgement_tuple(stepped.scene.judge()))
}

/// Restores a pickled episode.
#[pyfunction]
pub fn restored_episode(py: Python<'_>, made: EpisodeArguments, kept: UnpickledState<'_>) -> PyResult<Episode> {
    let (task, choices, seed, setup, variation) = made;
    let restored = Episode::new(py, &task, choices, seed, setup, variation)?;
    {
        let mut stepped = lock_stepped(&restored.0)?;
        let stepped: &mut SteppedScene<_, _> = &mut stepped;
        let actions = decode_actions(&stepped.scene.scene, &kept)?;
        detach(py, || actions.into_iter().try_for_each(|action| step_and_judge(stepped, action).map(drop)))?
            .map_err(value_error)?;
        check_state(&stepped.scene.scene, &kept)?;
    }
    Ok(restored)
}
