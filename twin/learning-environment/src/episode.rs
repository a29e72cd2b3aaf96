//! Tasks with objects of the benchmark: beginning of an episode, and its evaluation after every step.
//!
//! An episode is a trial of the benchmark under another seed, with the same combinations, variation of object poses,
//! errors of arm and detector, and effects. Its seed decides everything that is random in it, including its combination
//! if none is requested.

use std::sync::Arc;

use control::detection::DetectedObject;
use control::motion::tension::friction_compensated;
use grasp_verification::rollout::{PALM, digit_bits, in_hand};
use hand_model::pads::IMAGE_SIZE;
use hand_model::{DigitVector, Hand};
use nalgebra::Point3;
use rand::RngExt as _;
use scenarios::generator::trial_rng;
use sim::SimulatedRobot;
use sim::robot::GroundTruth;
use sim::tactile::TactileBoard;
use world::objects::ObjectModel;

use super::scene::{FirstImages, SceneError, StartedRobot, TactileScene, with_frame_size};
use bench::trial::setup::InitialConditions;
use bench::trial::{Bench, NoWatcher};
use control::pad_images::ImageSizeError;
use robot_backends::Backend;

/// Seed of the bench that episodes are drawn from. No benchmark trial has it.
pub const EPISODE_SEED: u64 = 0x6570_6973_6f64_6573;
/// Time for which the task's objects must be held without a break, s.
pub const HOLD_TIME: f64 = 1.0;
/// Height below which an object has left the table, m.
const FALLEN_HEIGHT: f64 = -0.05;
/// Centre of the palm in its frame, m: grasped objects lie a few centimetres in front of it.
const GRASP_CENTER: [f64; 3] = [0.0, 0.0, -0.03];
/// Distance over which the reward for proximity falls off, m.
const PROXIMITY_DISTANCE: f64 = 0.1;
/// Height that counts as fully lifted, m.
const FULL_LIFT_HEIGHT: f64 = 0.1;
/// Shares of proximity, touch and lift in an object's progress.
const PROGRESS_SHARES: [f64; 3] = [0.3, 0.2, 0.5];
/// Number of touching digits (and palm) that counts as a full touch.
const FULL_TOUCH_COUNT: f64 = 3.0;
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
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EpisodeOptions {
    pub task: EpisodeTask,
    /// Side of the tactile images, pixels; without it there are none.
    pub images: Option<usize>,
    /// Number of the combination; without it each episode draws one.
    pub combination: Option<usize>,
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
    /// Progress of the task, 0 to 1: near, touched, lifted, averaged over its objects.
    pub progress: f64,
    /// Progress gained in this step.
    pub gained: f64,
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
    progress: f64,
}

impl Episode {
    /// Begins the episode of a `seed`.
    pub fn begin(bench: &Bench, options: EpisodeOptions, seed: u64) -> Result<Self, EpisodeError> {
        let combination = draw_combination(bench, options.combination, seed)?;
        let (found, expected) = (bench.grasp_pairs.pairs[combination].objects().len(), options.task.objects());
        if found < expected {
            return Err(EpisodeError::Objects { found, expected });
        }
        let seed = seed as usize;
        let InitialState { begun, seen, images, opposition } = match options.task {
            EpisodeTask::PickSecond => begin_after_grasp(bench, combination, seed, options.images)?,
            task => begin_at_rest(bench, combination, seed, (task.objects(), options.images))?,
        };
        let objects = bench.world.models(&bench.grasp_pairs.pairs[combination].objects()[..options.task.objects()])?;
        let grip = (begun.tensions, opposition);
        let scene = TactileScene::begin(&bench.world.cell, begun, images)?;
        let mut episode = Self { scene, objects, detections: seen, combination, grip, held_since: None, progress: 0.0 };
        episode.progress = episode.judge().progress;
        Ok(episode)
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
        let before =
            std::mem::replace(&mut self.progress, progress(&self.scene.cell.robot.hand, &truth, &self.objects));
        let on_hand = |height: f64| height.is_finite() && height >= FALLEN_HEIGHT;
        let lost = !truth.objects.iter().all(|pose| on_hand(pose.translation.z));
        Judgement { held, progress: self.progress, gained: self.progress - before, success, lost }
    }
}

/// Returns the mean progress over the objects.
fn progress(hand: &Hand, truth: &GroundTruth, objects: &[Arc<ObjectModel>]) -> f64 {
    let [near, touch, lift] = PROGRESS_SHARES;
    let middle = truth.palm * Point3::from(GRASP_CENTER);
    let of = |(index, object): (usize, &Arc<ObjectModel>)| {
        let at = truth.objects[index].translation.vector;
        let touched = truth.touched_by[index];
        let digits = hand.digits().iter().map(|digit| digit_bits(hand, &[*digit])).chain([PALM]);
        let touching = digits.filter(|bits| touched & bits != 0).count() as f64;
        let raised =
            if touched == 0 { 0.0 } else { ((at.z - object.rest_height()) / FULL_LIFT_HEIGHT).clamp(0.0, 1.0) };
        near * (1.0 - ((at - middle.coords).norm() / PROXIMITY_DISTANCE).tanh())
            + touch * (touching / FULL_TOUCH_COUNT).min(1.0)
            + lift * raised
    };
    let sum: f64 = objects.iter().enumerate().map(of).sum();
    sum / objects.len() as f64
}

fn draw_combination(bench: &Bench, asked: Option<usize>, seed: u64) -> Result<usize, EpisodeError> {
    let count = bench.grasp_pairs.pairs.len();
    match asked {
        Some(found) if found >= count => Err(EpisodeError::Combination { found, most: count.saturating_sub(1) }),
        Some(combination) => Ok(combination),
        None => Ok(trial_rng(EPISODE_SEED, 0, seed as usize).random_range(0..count)),
    }
}

/// Initial conditions of an episode.
struct InitialState {
    begun: StartedRobot,
    seen: Vec<DetectedObject>,
    images: Option<FirstImages>,
    /// Angle of the opposition joint, rad.
    opposition: f64,
}

/// Begins with the combination's first `count` objects on the table and the arm ready.
fn begin_at_rest(
    bench: &Bench,
    combination: usize,
    trial: usize,
    (count, side): (usize, Option<usize>),
) -> Result<InitialState, EpisodeError> {
    let world = &bench.world;
    let (setup, _) = InitialConditions::noisy(bench, combination, trial)?;
    let noise = &setup.noise;
    let objects = setup.objects(bench)?;
    let real = objects.iter().zip(&noise.object_instances).take(count);
    let objects = real.map(|(object, one)| Ok(one.apply_to(object)?)).collect::<anyhow::Result<Vec<_>>>()?;
    let scene = world.scene(&objects, world.cell.ready_posture, noise);
    let board = side.map(|side| cameras_for_images(bench, &setup, side)).transpose()?;
    let images = side.zip(board.as_ref()).map(|(side, board)| FirstImages::untouched(side, board.background_frames()));
    let board = board.unwrap_or_else(TactileBoard::blank);
    let robot = SimulatedRobot::new(&world.cell.robot, &scene, board);
    let seen = world.detected_objects(&objects, noise);
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
