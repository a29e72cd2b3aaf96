//! Tasks with objects of the benchmark: beginning of an episode, and its evaluation after every step.
//!
//! An episode is a trial of the benchmark under another seed, with the same combinations, variation of object poses,
//! errors of arm and detector, and effects. Its seed decides everything that is random in it, including its combination
//! or its objects if several are allowed.

use std::sync::Arc;

use control::detection::DetectedObject;
use control::motion::tension::friction_compensated;
use grasp_verification::rollout::in_hand;
use hand_model::pads::IMAGE_SIZE;
use hand_model::{DigitVector, Hand};
use rand::RngExt as _;
use scenarios::generator::trial_rng;
use sim::SimulatedRobot;
use sim::tactile::TactileBoard;
use world::objects::ObjectModel;

use super::scene::{FirstImages, SceneError, StartedRobot, TactileScene, with_frame_size};
use bench::trial::setup::InitialConditions;
use bench::trial::{Bench, NoWatcher};
use control::pad_images::ImageSizeError;
use robot_backends::Backend;

pub use self::progress::Progress;

mod progress;

/// Seed of the bench that episodes are drawn from. No benchmark trial has it.
pub const EPISODE_SEED: u64 = 0x6570_6973_6f64_6573;
/// Seed of the draws of objects.
const OBJECT_SEED: u64 = 0x6f62_6a65_6374_7321;
/// Time for which the task's objects must be held without a break, s.
pub const HOLD_TIME: f64 = 1.0;
/// Height below which an object has left the table, m.
const FALLEN_HEIGHT: f64 = -0.05;
/// Maximum number of first grasps that are tried until one holds.
const MAX_GRASP_TRIES: u64 = 64;

/// Task of an episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EpisodeTask {
    /// Lift one object, alone on the table.
    PickOne,
    /// Lift the second object as well, with the first in the hand as grasped by the built-in controller.
    PickSecond,
    /// Lift two objects from the table together.
    PickTwo,
}

impl EpisodeTask {
    /// Returns the number of objects in the scene, all of which are to be held.
    pub fn objects(self) -> usize {
        if self == Self::PickOne { 1 } else { 2 }
    }
}

/// Options of episodes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EpisodeOptions {
    pub task: EpisodeTask,
    /// Side of the tactile images, pixels; without it there are none.
    pub images: Option<usize>,
    /// Number of the combination; without it each episode draws one.
    pub combination: Option<usize>,
    /// Names of objects from which an episode draws its own, without repetition. If there are none, the objects are
    /// those of the combination.
    pub objects: Vec<String>,
}

/// Reason for which an episode cannot begin.
#[derive(Debug, thiserror::Error)]
pub enum EpisodeError {
    /// There is no such combination.
    #[error("combination: found {found}, expected 0 to {most}")]
    Combination { found: usize, most: usize },
    /// The task needs more objects than a trial of the scenario has.
    #[error("task: found one of {expected} objects, expected one of {found} at most, as the scenario's trials have")]
    Objects { found: usize, expected: usize },
    /// The task begins with a grasp of a combination, and its objects cannot be chosen.
    #[error("objects: found {0} names, expected none for a task that begins with a planned grasp")]
    FixedObjects(usize),
    /// There are fewer objects to choose from than the task needs.
    #[error("objects: found {found}, expected {expected} at least")]
    TooFewObjects { found: usize, expected: usize },
    /// No first grasp of the combination holds under the errors drawn.
    #[error("combination {0}: {MAX_GRASP_TRIES} first grasps in a row do not hold their object")]
    NoFirstGrasp(usize),
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The trial cannot be set up.
    #[error("{0:#}")]
    Setup(#[from] anyhow::Error),
}

/// State of an episode after a step. It is judged by the ground truth, as a referee judges: a reward may train a
/// policy, and is not a measurement.
#[derive(Debug, Clone, PartialEq)]
pub struct Judgement {
    /// True for each object that is in the hand and lifted.
    pub held: Vec<bool>,
    /// Progress of the task, averaged over its objects.
    pub progress: Progress,
    /// True if all objects have been held for [`HOLD_TIME`].
    pub success: bool,
    /// True if an object has left the table, or if the simulation cannot continue.
    pub lost: bool,
}

/// Commanded grip at the beginning of an episode: tensions (N) at the spools, and the angle (rad) of the opposition
/// joint.
pub type GripCommand = (DigitVector, f64);

/// A task in progress.
#[derive(Clone)]
pub struct Episode {
    pub scene: TactileScene,
    objects: Vec<Arc<ObjectModel>>,
    detections: Vec<DetectedObject>,
    combination: usize,
    grip: GripCommand,
    held_since: Option<f64>,
}

impl Episode {
    /// Begins the episode of a `seed`.
    pub fn begin(bench: &Bench, options: EpisodeOptions, seed: u64) -> Result<Self, EpisodeError> {
        let combination = draw_combination(bench, options.combination, seed)?;
        let objects = draw_objects(bench, &options, combination, seed)?;
        let seed = seed as usize;
        let InitialState { begun, seen, images, opposition } = match options.task {
            EpisodeTask::PickSecond => begin_after_grasp(bench, combination, seed, options.images)?,
            _ => begin_at_rest(bench, combination, seed, (&objects, options.images))?,
        };
        let grip = (begun.tensions, opposition);
        let scene = TactileScene::begin(&bench.world.cell, begun, images)?;
        Ok(Self { scene, objects, detections: seen, combination, grip, held_since: None })
    }

    /// Returns the models of the objects as a controller knows them, in order.
    pub fn models(&self) -> &[Arc<ObjectModel>] {
        &self.objects
    }

    /// Returns the names of the objects, in the order of the combination.
    pub fn objects(&self) -> impl Iterator<Item = &str> {
        self.objects.iter().map(|object| object.name.as_str())
    }

    /// Returns each object as detected at the beginning, with its error.
    pub fn detections(&self) -> &[DetectedObject] {
        &self.detections
    }

    /// Returns the commanded grip at the beginning. It holds the first object, if one is held.
    pub fn grip(&self) -> GripCommand {
        self.grip
    }

    /// Returns the number of the combination.
    pub fn combination(&self) -> usize {
        self.combination
    }

    /// Judges the scene after a step.
    pub fn judge(&mut self) -> Judgement {
        let truth = self.scene.truth();
        let held: Vec<bool> = (0..self.objects.len()).map(|index| in_hand(&truth, index)).collect();
        let all = held.iter().all(|held| *held);
        self.held_since = if all { self.held_since.or(Some(truth.time)) } else { None };
        // Half a tick of tolerance: times are sums of ticks.
        let success = self.held_since.is_some_and(|since| truth.time - since > HOLD_TIME - 0.004);
        let held_share = self.held_since.map_or(0.0, |since| ((truth.time - since) / HOLD_TIME).min(1.0));
        let progress = Progress::measure(&self.scene.cell.robot.hand, &truth, &self.objects, held_share);
        let on_table = |height: f64| height.is_finite() && height >= FALLEN_HEIGHT;
        let lost = !truth.objects.iter().all(|pose| on_table(pose.translation.z));
        Judgement { held, progress, success, lost }
    }
}

fn draw_combination(bench: &Bench, asked: Option<usize>, seed: u64) -> Result<usize, EpisodeError> {
    let count = bench.grasp_pairs.pairs.len();
    match asked {
        Some(found) if found >= count => Err(EpisodeError::Combination { found, most: count.saturating_sub(1) }),
        Some(combination) => Ok(combination),
        None => Ok(trial_rng(EPISODE_SEED, 0, seed as usize).random_range(0..count)),
    }
}

/// Returns the objects of an episode: those of the combination, or a draw from the options' own.
fn draw_objects(
    bench: &Bench,
    options: &EpisodeOptions,
    combination: usize,
    seed: u64,
) -> Result<Vec<Arc<ObjectModel>>, EpisodeError> {
    let expected = options.task.objects();
    if options.objects.is_empty() {
        let names = bench.grasp_pairs.pairs[combination].objects();
        if names.len() < expected {
            return Err(EpisodeError::Objects { found: names.len(), expected });
        }
        return Ok(bench.world.models(&names[..expected])?);
    }
    let mut left: Vec<&str> = options.objects.iter().map(String::as_str).collect();
    if options.task == EpisodeTask::PickSecond {
        return Err(EpisodeError::FixedObjects(left.len()));
    }
    if left.len() < expected {
        return Err(EpisodeError::TooFewObjects { found: left.len(), expected });
    }
    // A stream of its own: the episode's other draws stay those of its combination.
    let mut rng = trial_rng(OBJECT_SEED, 0, seed as usize);
    let names: Vec<&str> = (0..expected).map(|_| left.swap_remove(rng.random_range(0..left.len()))).collect();
    let known = &bench.world.objects;
    let unknown = |name: &str| SceneError::Object { name: name.to_owned(), known: known.names().join(", ") };
    names.into_iter().map(|name| Ok(known.get(name).cloned().ok_or_else(|| unknown(name))?)).collect()
}

/// Initial conditions of an episode.
struct InitialState {
    begun: StartedRobot,
    seen: Vec<DetectedObject>,
    images: Option<FirstImages>,
    /// Angle of the opposition joint, rad.
    opposition: f64,
}

/// Begins with these objects on the table and the arm ready.
fn begin_at_rest(
    bench: &Bench,
    combination: usize,
    trial: usize,
    (objects, side): (&[Arc<ObjectModel>], Option<usize>),
) -> Result<InitialState, EpisodeError> {
    let world = &bench.world;
    let (setup, _) = InitialConditions::noisy(bench, combination, trial)?;
    let noise = &setup.noise;
    let real = objects.iter().zip(&noise.object_instances);
    let real = real.map(|(object, one)| Ok(one.apply_to(object)?)).collect::<anyhow::Result<Vec<_>>>()?;
    let scene = world.scene(&real, world.cell.ready_posture, noise);
    let board = side.map(|side| cameras_for_images(bench, &setup, side)).transpose()?;
    let images = side.zip(board.as_ref()).map(|(side, board)| FirstImages::untouched(side, board.background_frames()));
    let board = board.unwrap_or_else(TactileBoard::blank);
    let robot = SimulatedRobot::new(world.simulated_robot(), &scene, board);
    let seen = world.detected_objects(&real, noise);
    let begun = StartedRobot {
        robot,
        posture: world.cell.ready_posture,
        tensions: world.cell.robot.hand.slack_tensions(),
        frame_delay: scene.frame_delay,
    };
    Ok(InitialState { begun, seen, images, opposition: 0.0 })
}

/// Returns the cameras of a trial, with frames of the size of the requested images.
fn cameras_for_images(bench: &Bench, setup: &InitialConditions, side: usize) -> Result<TactileBoard, SceneError> {
    let mut board = bench.cameras.with_noise(setup.camera_noise);
    if let Some(drift) = &setup.drift {
        board = board.drifting(drift.clone());
    }
    Ok(with_frame_size(board, side)?)
}

/// Begins with the first object in the hand, by the first of the trials from `trial` on whose first grasp holds.
fn begin_after_grasp(
    bench: &Bench,
    combination: usize,
    trial: usize,
    side: Option<usize>,
) -> Result<InitialState, EpisodeError> {
    for attempt in 0..MAX_GRASP_TRIES {
        // Far from the numbers of other episodes.
        let trial = trial ^ (attempt << 48) as usize;
        let (setup, _) = InitialConditions::noisy(bench, combination, trial)?;
        let untouched = side.map(|side| cameras_for_images(bench, &setup, side)).transpose()?;
        let start = setup.run_first_grasp(bench, None, &mut NoWatcher)?;
        let snapshot = start.run.snapshot;
        let Backend::Simulated(mut robot) = snapshot.robot else { continue };
        if !in_hand(&robot.truth(), 0) {
            continue;
        }
        let executor = snapshot.executor;
        let hand: &Hand = &bench.world.cell.robot.hand;
        let friction = bench.world.protocol().friction;
        let tensions = friction_compensated(hand, &friction, executor.motion().servos(), &executor.required_tensions());
        let mut now = bench.cameras.backgrounds();
        for frame in executor.motion().newest_images() {
            now[frame.camera] = frame.image.clone();
        }
        let images =
            side.zip(untouched).map(|(side, board)| FirstImages { side, untouched: board.background_frames(), now });
        if let Some(side) = side.filter(|side| *side != IMAGE_SIZE) {
            robot.reduce_images(side).map_err(|_| SceneError::from(ImageSizeError(side)))?;
        }
        let seen = executor.targets().iter().map(|target| target.detected).collect();
        let frame_delay = bench.world.scenario.effects.time.map_or(0.0, |time| time.frame);
        let begun = StartedRobot { robot: *robot, posture: *executor.motion().posture(), tensions, frame_delay };
        return Ok(InitialState { begun, seen, images, opposition: executor.target(0).grasp.opposition });
    }
    Err(EpisodeError::NoFirstGrasp(combination))
}

#[cfg(test)]
mod tests;
