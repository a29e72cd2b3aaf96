//! A scene in steps of a twentieth of a second: actions in, measurements out.

use std::sync::Arc;

use control::action::{Action, ActionError, ActionLimits, Stepper, TICKS_PER_STEP};
use control::inverse_kinematics::{ArmKinematics, IkError, Joints};
use control::workcell::Workcell;
use grasp_verification::simulated_world::SimulatedWorld;
use hand_model::DigitVector;
use hand_model::pads::IMAGE_SIZE;
use hand_model::robot::{ArmState, Observation, RobotCommand, ServoState, TactileFrame, TactileImage};
use nalgebra::Isometry3;
use scenarios::noise::TrialNoise;
use sim::robot::GroundTruth;
use sim::tactile::TactileBoard;
use sim::{ObjectPlacement, SceneSetup, SimulatedRobot};
use world::layout::TablePlacement;
use world::objects::ObjectModel;

use control::pad_images::{ImageSizeError, PadImages, capture_tick};

/// Largest number of objects in a scene.
pub const MAX_OBJECTS: usize = 16;
/// Largest distance of an object from the arm's base along x and y, m.
const MAX_COORDINATE: f64 = 1.5;
/// Depth up to which objects may be in each other, m: they touch.
const MAX_OVERLAP: f64 = 1e-4;

/// Reason for which a scene cannot be created.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// There is no object of this name.
    #[error("object: found `{name}`, expected one of {known}")]
    Object { name: String, known: String },
    /// An object's place is not on the table.
    #[error("object `{name}`, {axis}: found {found}, expected {expected}")]
    Place { name: String, axis: &'static str, found: f64, expected: String },
    /// Two objects are in each other.
    #[error("objects: found `{one}` {depth:.1} mm inside `{other}`, expected objects that stand clear of each other")]
    Overlap { one: String, other: String, depth: f64 },
    /// Too many objects.
    #[error("objects: found {0}, expected {MAX_OBJECTS} at most")]
    Count(usize),
    #[error(transparent)]
    Images(#[from] ImageSizeError),
    #[error(transparent)]
    Arm(#[from] IkError),
}

/// An object with its place.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneObject {
    /// Name of an object of the world.
    pub name: String,
    pub place: TablePlacement,
}

/// Options of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SceneOptions {
    /// Side of the tactile images, pixels; without it there are none.
    pub images: Option<usize>,
    /// Seed of the cameras' noise.
    pub seed: u64,
}

/// A robot at a table with objects. A clone continues independently from the same state.
#[derive(Clone)]
pub struct TactileScene {
    pub(super) cell: Workcell,
    kinematics: ArmKinematics,
    stepper: Stepper,
    robot: SimulatedRobot,
    images: Option<PadImages>,
    /// Tactile images of the untouched pads.
    untouched: Option<PadImages>,
    /// Tick of a step in which images are requested: the last from which they arrive within the step.
    capture_tick: usize,
    observation: Observation,
}

/// A robot about to be stepped, with its last commands.
pub(super) struct StartedRobot {
    pub(super) robot: SimulatedRobot,
    /// Joint set-points, rad.
    pub(super) posture: Joints,
    /// Cable tensions, N.
    pub(super) tensions: DigitVector,
    /// Delay from a camera's exposure to its frame, s.
    pub(super) frame_delay: f64,
}

/// Initial tactile images.
pub(super) struct FirstImages {
    /// Side of a pad's image, pixels.
    pub(super) side: usize,
    /// Images of the untouched pads, one per camera.
    pub(super) untouched: Vec<Arc<TactileImage>>,
    /// Present images of the pads, one per camera.
    pub(super) now: Vec<Arc<TactileImage>>,
}

impl FirstImages {
    /// Images of pads that nothing touches.
    pub(super) fn untouched(side: usize, images: Vec<Arc<TactileImage>>) -> Self {
        Self { side, untouched: images.clone(), now: images }
    }
}

impl TactileScene {
    /// Creates a scene with the objects in their places, the arm in the posture in which trials begin, and the hand
    /// open. The robot is free of errors but has the effects of the world's scenario on pads, gel, cables, floor and
    /// time.
    pub fn new(
        world: &SimulatedWorld,
        board: &TactileBoard,
        objects: &[SceneObject],
        options: SceneOptions,
    ) -> Result<Self, SceneError> {
        if objects.len() > MAX_OBJECTS {
            return Err(SceneError::Count(objects.len()));
        }
        let objects = objects.iter().map(|placed| placement(world, placed)).collect::<Result<Vec<_>, _>>()?;
        check_clearance(&objects)?;
        let setup = SceneSetup { objects, ..world.bare_scene(world.cell.ready_posture, &TrialNoise::none()) };
        let frame_delay = setup.frame_delay;
        let board = options.images.map(|side| with_frame_size(board.with_noise(options.seed), side)).transpose()?;
        let backgrounds = board.as_ref().map(TactileBoard::background_frames);
        let robot = SimulatedRobot::new(&world.cell.robot, &setup, board.unwrap_or_else(TactileBoard::blank));
        let begun = StartedRobot {
            robot,
            posture: world.cell.ready_posture,
            tensions: world.cell.robot.hand.slack_tensions(),
            frame_delay,
        };
        let images = options.images.zip(backgrounds).map(|(side, images)| FirstImages::untouched(side, images));
        Self::begin(&world.cell, begun, images)
    }

    /// Continues with a robot in its present state.
    pub(super) fn begin(cell: &Workcell, begun: StartedRobot, images: Option<FirstImages>) -> Result<Self, SceneError> {
        let StartedRobot { mut robot, posture, tensions, frame_delay } = begun;
        let (untouched, images) = images
            .map(|FirstImages { side, untouched, now }| {
                let shown = |of: Vec<Arc<TactileImage>>| {
                    let mut images = PadImages::new(&cell.robot.hand, side)?;
                    images.show_backgrounds(&cell.robot.hand, of);
                    Ok::<_, ImageSizeError>(images)
                };
                Ok::<_, ImageSizeError>((shown(untouched)?, shown(now)?))
            })
            .transpose()?
            .unzip();
        let capture_at = capture_tick(frame_delay, robot.tick_length());
        let observation = robot.observe();
        Ok(Self {
            kinematics: cell.kinematics(),
            stepper: Stepper::new(cell, posture, tensions)?,
            cell: cell.clone(),
            robot,
            images,
            untouched,
            capture_tick: capture_at,
            observation,
        })
    }

    /// Carries out `action` for one step. An error leaves the scene as it was.
    pub fn step(&mut self, action: &Action) -> Result<(), ActionError> {
        for (n, (arm, servos)) in self.stepper.step(action, self.robot.tick_length())?.into_iter().enumerate() {
            let capture = self.images.is_some() && n + 1 == self.capture_tick;
            let sent = self.robot.send(&RobotCommand { arm, servos, capture });
            self.robot.wait_for_tick();
            self.stepper.adopt_sent(sent.arm);
        }
        self.observe();
        Ok(())
    }

    /// Lets one tick of the robot pass with a command of its own, which has an angle for each joint and a goal for each
    /// servo. Returns the frames of the cameras that arrived.
    pub fn tick(&mut self, command: &RobotCommand) -> Vec<TactileFrame> {
        let sent = self.robot.send(command);
        self.robot.wait_for_tick();
        self.stepper.adopt_sent(sent.arm);
        self.observe()
    }

    /// Takes the newest measurements. Returns the frames that arrived.
    fn observe(&mut self) -> Vec<TactileFrame> {
        self.observation = self.robot.observe();
        let frames = std::mem::take(&mut self.observation.tactile);
        if let Some(images) = &mut self.images {
            images.show(&self.cell.robot.hand, frames.clone());
        }
        frames
    }

    /// Returns the limits of the actions.
    pub fn limits(&self) -> &ActionLimits {
        self.stepper.limits()
    }

    /// Returns the length of a step, s.
    pub fn step_length(&self) -> f64 {
        TICKS_PER_STEP as f64 * self.robot.tick_length()
    }

    /// Returns the time since the robot was started, s.
    pub fn time(&self) -> f64 {
        self.observation.time
    }

    /// Returns the servos' measurements.
    pub fn servos(&self) -> &[ServoState] {
        &self.observation.servos
    }

    /// Returns the arm's measurements.
    pub fn arm(&self) -> &ArmState {
        &self.observation.arm
    }

    /// Returns `world_from_palm` by the arm's encoders and its nominal dimensions.
    pub fn palm(&self) -> Isometry3<f64> {
        self.kinematics.palm_pose(&self.observation.arm.position)
    }

    /// Returns the newest tactile images, if the scene has any.
    pub fn images(&self) -> Option<&PadImages> {
        self.images.as_ref()
    }

    /// Returns the reference images of the untouched pads, if the scene has any.
    pub fn untouched(&self) -> Option<&PadImages> {
        self.untouched.as_ref()
    }

    /// Returns the ground truth, for judging and recording, not for policies.
    pub fn truth(&self) -> GroundTruth {
        self.robot.truth()
    }

    /// Returns the models of the real objects, in order.
    pub(super) fn models(&self) -> impl Iterator<Item = &Arc<ObjectModel>> {
        self.robot.models()
    }

    pub fn cell(&self) -> &Workcell {
        &self.cell
    }
}

fn placement(world: &SimulatedWorld, placed: &SceneObject) -> Result<ObjectPlacement, SceneError> {
    let SceneObject { name, place } = placed;
    let model = world
        .objects
        .get(name)
        .cloned()
        .ok_or_else(|| SceneError::Object { name: name.clone(), known: world.objects.names().join(", ") })?;
    let error = |axis, found, expected: String| SceneError::Place { name: name.clone(), axis, found, expected };
    for (axis, found) in [("x", place.x), ("y", place.y)] {
        if found.is_nan() || found.abs() > MAX_COORDINATE {
            return Err(error(axis, found, format!("{} to {MAX_COORDINATE} m", -MAX_COORDINATE)));
        }
    }
    if !place.yaw.is_finite() {
        return Err(error("yaw", place.yaw, "a finite angle in rad".to_owned()));
    }
    Ok(ObjectPlacement { pose: place.pose(&model), model })
}

/// Checks that no object is inside another.
fn check_clearance(objects: &[ObjectPlacement]) -> Result<(), SceneError> {
    for (n, one) in objects.iter().enumerate() {
        for other in &objects[..n] {
            let depth = one.overlap(other);
            if depth > MAX_OVERLAP {
                let name = |placed: &ObjectPlacement| placed.model.name.clone();
                return Err(SceneError::Overlap { one: name(one), other: name(other), depth: 1e3 * depth });
            }
        }
    }
    Ok(())
}

/// Returns a board whose frames have the size of the requested images. For images smaller than those of the cameras,
/// rendering all pixels to average them would take nearly all of a step.
pub(crate) fn with_frame_size(board: TactileBoard, side: usize) -> Result<TactileBoard, ImageSizeError> {
    if side == IMAGE_SIZE { Ok(board) } else { board.reduced(side).map_err(|_| ImageSizeError(side)) }
}
