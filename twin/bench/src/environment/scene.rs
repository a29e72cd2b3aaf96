//! A scene in steps of a twentieth of a second: actions in, measurements out.

use std::sync::Arc;

use control::Twist;
use control::inverse_kinematics::{ArmKinematics, ArmServo, IkError, Joints};
use control::workcell::Workcell;
use hand_model::robot::{ArmState, Command, Observation, Robot, ServoGoal, ServoState, TactileImage};
use hand_model::{ACTUATORS, ARM_JOINTS};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use proving::world::World;
use scenarios::layout::Place;
use scenarios::noise::TrialNoise;
use scenarios::objects::ObjectModel;
use sim::robot::Truth;
use sim::tactile::TactileBoard;
use sim::{ObjectPlacement, SceneSetup, SimulatedRobot};

use super::action::{Action, ActionError, ActionLimits, ArmAction, HandAction};
use super::images::{ImageSizeError, PadImages, reduced};

/// Ticks of the robot in a step: six of 1/120 s.
pub const TICKS: usize = 6;
/// Most objects in a scene.
pub const MOST_OBJECTS: usize = 16;
/// Farthest place of an object from the arm's base along x and y, m.
const FARTHEST: f64 = 1.5;

/// Why there is no such scene.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// No object has this name.
    #[error("no object is called `{name}`; known are: {known}")]
    Object { name: String, known: String },
    /// An object's place is not a place on the table.
    #[error("object `{name}`, {axis}: found {found}, expected {expected}")]
    Place { name: String, axis: &'static str, found: f64, expected: String },
    /// Too many objects.
    #[error("objects: found {0}, expected {MOST_OBJECTS} at most")]
    Count(usize),
    #[error(transparent)]
    Images(#[from] ImageSizeError),
    #[error(transparent)]
    Arm(#[from] IkError),
}

/// An object and where it stands.
#[derive(Debug, Clone, PartialEq)]
pub struct Placed {
    /// Name of an object of the world.
    pub name: String,
    pub place: Place,
}

/// How a scene is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SceneOptions {
    /// Side of the tactile images, pixels; without it there are none.
    pub images: Option<usize>,
    /// Seed of the cameras' noise.
    pub seed: u64,
}

/// What the arm follows.
#[derive(Debug, Clone)]
enum Reference {
    /// The palm's twist.
    Palm(Box<ArmServo>),
    /// Joint set-points as they were sent, rad.
    Joints(Joints),
}

/// A robot at a table with objects. A clone goes its own way from the same bits.
#[derive(Clone)]
pub struct Scene {
    cell: Workcell,
    kinematics: ArmKinematics,
    limits: Arc<ActionLimits>,
    robot: SimulatedRobot,
    reference: Reference,
    tensions: [f64; 5],
    images: Option<PadImages>,
    /// Tick of a step in which images are asked for: the last from which they arrive within the step.
    capture_at: usize,
    observation: Observation,
}

/// A robot about to be stepped, and what it was last asked for.
pub(super) struct Begun {
    pub(super) robot: SimulatedRobot,
    /// Joint set-points, rad.
    pub(super) posture: Joints,
    /// N.
    pub(super) tensions: [f64; 5],
    /// From a camera's exposure to its frame, s.
    pub(super) frame_delay: f64,
}

impl Scene {
    /// Objects in their places, the arm in the posture in which trials begin, the hand open: a robot without errors, with the effects of
    /// the world's scenario on pads, gel, cables, floor and time.
    pub fn new(
        world: &World,
        board: &TactileBoard,
        objects: &[Placed],
        options: SceneOptions,
    ) -> Result<Self, SceneError> {
        if objects.len() > MOST_OBJECTS {
            return Err(SceneError::Count(objects.len()));
        }
        let objects = objects.iter().map(|placed| placement(world, placed)).collect::<Result<_, _>>()?;
        let setup = SceneSetup { objects, ..world.bare_scene(world.cell.ready, &TrialNoise::none()) };
        let frame_delay = setup.frame_delay;
        let board = options.images.map(|side| reduced(board.with_noise(options.seed), side)).transpose()?;
        let backgrounds = board.as_ref().map(TactileBoard::background_frames);
        let (hand, arm) = (world.cell.hand.clone(), world.cell.arm.clone());
        let robot = SimulatedRobot::new(hand, arm, &setup, board.unwrap_or_else(TactileBoard::blank));
        let begun = Begun { robot, posture: world.cell.ready, tensions: [0.0; 5], frame_delay };
        Self::begin(&world.cell, begun, options.images.zip(backgrounds))
    }

    /// Goes on with a robot as it is. `images`: side of the tactile images, and an image a camera to begin with.
    pub(super) fn begin(
        cell: &Workcell,
        begun: Begun,
        images: Option<(usize, Vec<Arc<TactileImage>>)>,
    ) -> Result<Self, SceneError> {
        let Begun { mut robot, posture, tensions, frame_delay } = begun;
        let images = images
            .map(|(side, backgrounds)| {
                let mut images = PadImages::new(&cell.hand, side)?;
                images.show_backgrounds(&cell.hand, backgrounds);
                Ok::<_, ImageSizeError>(images)
            })
            .transpose()?;
        // Times are sums of ticks: a thousandth of one is no tick.
        let under_way = (frame_delay / robot.tick_length() - 1e-3).ceil().max(0.0) as usize;
        let observation = robot.observe();
        Ok(Self {
            kinematics: cell.kinematics(),
            limits: Arc::new(ActionLimits::of(cell)),
            reference: Reference::Palm(Box::new(cell.arm_servo(posture)?)),
            cell: cell.clone(),
            robot,
            tensions,
            images,
            capture_at: TICKS.saturating_sub(under_way).max(1),
            observation,
        })
    }

    /// Carries out `action` for a step. An error leaves the scene as it was.
    pub fn step(&mut self, action: &Action) -> Result<(), ActionError> {
        self.limits.check(action)?;
        let tick = self.robot.tick_length();
        let mut reference = match (action.arm, &self.reference) {
            (ArmAction::Twist(_), Reference::Palm(servo)) => Reference::Palm(servo.clone()),
            (ArmAction::Twist(_), Reference::Joints(sent)) => Reference::Palm(Box::new(self.cell.arm_servo(*sent)?)),
            (ArmAction::Joints(joints), _) => Reference::Joints(joints),
        };
        // The whole step is planned before any of it is carried out.
        let mut wanted = [[0.0; ARM_JOINTS]; TICKS];
        for joints in &mut wanted {
            *joints = match (&mut reference, action.arm) {
                (Reference::Palm(servo), ArmAction::Twist(twist)) => {
                    let target = moved(&servo.palm_pose(), &twist, tick);
                    servo.step(&target, &twist, tick)?.q
                }
                (Reference::Palm(servo), ArmAction::Joints(_)) => *servo.q(),
                (Reference::Joints(joints), _) => *joints,
            };
        }
        let before = self.tensions;
        if let HandAction::Tensions { tensions, .. } = action.hand {
            self.tensions = tensions;
        }
        for (n, arm) in wanted.into_iter().enumerate() {
            let servos = self.servo_goals(&action.hand, &before, (n + 1) as f64 / TICKS as f64);
            let capture = self.images.is_some() && n + 1 == self.capture_at;
            let sent = self.robot.send(&Command { arm, servos, capture });
            self.robot.wait_for_tick();
            if let Reference::Joints(joints) = &mut reference {
                *joints = if n + 1 == TICKS { sent.arm } else { *joints };
            }
        }
        self.reference = reference;
        self.observe();
        Ok(())
    }

    /// Goals of a tick when `part` of the step is over and the tensions were `before` it, N.
    fn servo_goals(&self, action: &HandAction, before: &[f64; 5], part: f64) -> [ServoGoal; ACTUATORS] {
        match action {
            HandAction::Tensions { tensions, opposition } => {
                let now = std::array::from_fn(|n| before[n] + part * (tensions[n] - before[n]));
                ActionLimits::tension_goals(&self.cell, &now, *opposition)
            }
            HandAction::Spools(angles) => self.limits.spool_goals(angles),
        }
    }

    fn observe(&mut self) {
        let mut observation = self.robot.observe();
        if let Some(images) = &mut self.images {
            images.show(&self.cell.hand, std::mem::take(&mut observation.tactile));
        }
        self.observation = observation;
    }

    /// Limits of the actions.
    pub fn limits(&self) -> &ActionLimits {
        &self.limits
    }

    /// Length of a step, s.
    pub fn step_length(&self) -> f64 {
        TICKS as f64 * self.robot.tick_length()
    }

    /// Time since the robot was started, s.
    pub fn time(&self) -> f64 {
        self.observation.time
    }

    /// The six servos as they report.
    pub fn servos(&self) -> &[ServoState; ACTUATORS] {
        &self.observation.servos
    }

    /// The arm as it reports.
    pub fn arm(&self) -> &ArmState {
        &self.observation.arm
    }

    /// `world_from_palm` by the arm's encoders and its nominal dimensions.
    pub fn palm(&self) -> Isometry3<f64> {
        self.kinematics.palm_pose(&self.observation.arm.position)
    }

    /// The newest tactile images, if the scene has any.
    pub fn images(&self) -> Option<&PadImages> {
        self.images.as_ref()
    }

    /// The scene as it is: for whoever judges or records, and for no policy.
    pub fn truth(&self) -> Truth {
        self.robot.truth()
    }

    /// The objects as they really are, in order.
    pub(super) fn models(&self) -> impl Iterator<Item = &Arc<ObjectModel>> {
        self.robot.models()
    }

    pub fn cell(&self) -> &Workcell {
        &self.cell
    }
}

/// `pose` after `time` (s) with `twist`.
fn moved(pose: &Isometry3<f64>, twist: &Twist, time: f64) -> Isometry3<f64> {
    let (linear, angular): (Vector3<f64>, Vector3<f64>) =
        (twist.fixed_rows::<3>(0).into(), twist.fixed_rows::<3>(3).into());
    Isometry3::from_parts(
        Translation3::from(pose.translation.vector + linear * time),
        UnitQuaternion::from_scaled_axis(angular * time) * pose.rotation,
    )
}

fn placement(world: &World, placed: &Placed) -> Result<ObjectPlacement, SceneError> {
    let Placed { name, place } = placed;
    let model = world
        .objects
        .get(name)
        .cloned()
        .ok_or_else(|| SceneError::Object { name: name.clone(), known: world.objects.names().join(", ") })?;
    let error = |axis, found, expected: String| SceneError::Place { name: name.clone(), axis, found, expected };
    for (axis, found) in [("x", place.x), ("y", place.y)] {
        if found.is_nan() || found.abs() > FARTHEST {
            return Err(error(axis, found, format!("{} to {FARTHEST} m", -FARTHEST)));
        }
    }
    if !place.yaw.is_finite() {
        return Err(error("yaw", place.yaw, "a finite angle in rad".to_owned()));
    }
    Ok(ObjectPlacement { pose: place.pose(&model), model })
}
