//! Comparison of identified parameters with the truth, for simulated robot instances with known parameters.

use hand_model::robot::{RobotCommand, ServoGoal};
use hand_model::transmission::friction::CableLosses;
use hand_model::{ArmVector, Digit, Hand, HandVector, RobotModel};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion};
use plant::GelViscoelasticity;
use plant::RobotInstance;
use plant::draws::gaussian_vector;
use plant::identified::IdentifiedRobot;
use plant::prior::Quantity;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use schemars::JsonSchema;
use serde::Serialize;
use sim::tactile::TactileBoard;
use sim::{ObjectPlacement, SceneSetup, SimulatedRobot};
use statistics::percentile;
use std::sync::Arc;
use world::geometry::{GeometryError, ObjectShape};
use world::objects::{ObjectModel, Symmetry};

use crate::ball::CalibrationBall;
use crate::fit::rms;
use crate::free_digit::{fingertip, simulate_motion};
use crate::free_motion::FreeMotion;
use crate::payload::Payload;

/// Density of the ball, kg/m3; below, its friction coefficient on a pad if no slide specifies it.
const STEEL_DENSITY: f64 = 7850.0;
const BALL_FRICTION: f64 = 0.8;
/// Random stream for the ball's position.
const BALL_STREAM: u64 = (1 << 20) + 1;
/// Random stream for the mass and position of the payload.
const PAYLOAD_STREAM: u64 = (1 << 20) + 2;
/// Number of arm postures in which fingertip positions are compared.
const REACH_POSTURE_COUNT: usize = 40;
/// Half width of a 95 % interval, in standard deviations.
const HALF_INTERVAL: f64 = 1.959_964;

/// Coverage: the number of parameters within their 95 % intervals.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, JsonSchema)]
pub struct Coverage {
    /// Number of parameters whose true value is in the 95 % interval.
    pub inside: usize,
    /// Number of all parameters.
    pub of: usize,
}

impl Coverage {
    fn count(&mut self, inside: bool) {
        self.of += 1;
        self.inside += usize::from(inside);
    }

    /// Adds two coverages.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self { inside: self.inside + other.inside, of: self.of + other.of }
    }

    /// Returns the fraction inside.
    pub fn share(self) -> f64 {
        self.inside as f64 / self.of.max(1) as f64
    }
}

/// Returns the coverage of the parameters that the sessions identified, and that of the rest.
pub fn coverage(found: &IdentifiedRobot, truth: &RobotInstance) -> [Coverage; 2] {
    let mut counts = [Coverage::default(); 2];
    for (estimate, truth) in found.estimates.iter().zip(truth.deviations()) {
        let inside = (estimate.deviation - truth).abs() <= HALF_INTERVAL * estimate.sigma;
        counts[usize::from(!estimate.identified)].count(inside);
    }
    counts
}

/// Differences in free motion between the true robot and a model.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MotionDifferences {
    /// Differences of every moving joint at every sample, rad.
    pub joints: Vec<f64>,
    /// Distances of every moving fingertip in the palm frame, m.
    pub tips: Vec<f64>,
    /// Differences of the servo angles, rad.
    pub servos: Vec<f64>,
}

impl MotionDifferences {
    /// Returns the median difference of the joints (rad) and of the fingertips (m), and the root mean square difference
    /// of the servos (rad).
    pub fn summary(&self) -> [f64; 3] {
        [median(&self.joints), median(&self.tips), rms(&self.servos)]
    }
}

/// Returns the median; NaN for no values.
pub fn median(values: &[f64]) -> f64 {
    percentile(values, 50.0).unwrap_or(f64::NAN)
}

/// Returns the simulated robot of an instance with its hand open and nothing in reach. The arm's encoders show the
/// posture `start`.
pub fn simulated_robot(
    instance: &RobotInstance,
    nominal: &RobotModel,
    losses: CableLosses,
    start: ArmVector,
) -> SimulatedRobot {
    let setup = SceneSetup { cables: losses, ..SceneSetup::ideal(Isometry3::identity(), start) };
    SimulatedRobot::new(&instance.apply_to_robot(nominal), &setup, TactileBoard::blank())
}

/// Environment of an instance during its excitation. Only the emulator may use it.
#[derive(Clone)]
pub struct Surroundings {
    /// The instance's own tactile cameras.
    pub cameras: TactileBoard,
    /// Viscoelasticity of its covers.
    pub gel: Option<GelViscoelasticity>,
    pub ball: Option<TrueBall>,
    pub payload: Option<TruePayload>,
}

/// True ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrueBall {
    /// Centre in the frame of the arm's base, m.
    pub center: Point3<f64>,
    /// Radius, m.
    pub radius: f64,
    /// Friction coefficient on a nominal pad.
    pub friction: f64,
}

impl TrueBall {
    /// Draws the ball of instance `number` around the measured values.
    pub fn draw(ball: &CalibrationBall, number: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(number);
        rng.set_stream(BALL_STREAM);
        let middle = ball.center() + gaussian_vector(&mut rng, ball.uncertain);
        let friction = ball
            .slide
            .as_ref()
            .map_or(BALL_FRICTION, |slide| slide.friction * gaussian_vector(&mut rng, slide.uncertain).x.exp());
        Self { center: middle, radius: ball.radius, friction }
    }
}

/// True payload and its true pose.
#[derive(Debug, Clone)]
pub struct TruePayload {
    /// Object model with the true mass; its friction is that on a nominal pad.
    pub model: ObjectModel,
    /// Pose in the frame of the arm's base.
    pub pose: Isometry3<f64>,
}

impl TruePayload {
    /// Draws the payload of instance `number` around the measured mass and place. None for an unknown object.
    pub fn draw(weight: &Payload, number: u64) -> Option<Self> {
        let mut rng = ChaCha8Rng::seed_from_u64(number);
        rng.set_stream(PAYLOAD_STREAM);
        let mass = weight.mass + gaussian_vector(&mut rng, weight.mass_uncertain).x;
        let model = ObjectModel { mass, ..weight.model()? };
        let off = gaussian_vector(&mut rng, weight.place_uncertain);
        let [x, y] = weight.place;
        let pose = Isometry3::from_parts(Translation3::new(x + off.x, y + off.y, model.rest_height()), model.rest);
        Some(Self { model, pose })
    }
}

/// Returns the simulated robot of an instance in its environment during the excitation.
pub fn excited_robot(
    instance: &RobotInstance,
    nominal: &RobotModel,
    losses: CableLosses,
    start: ArmVector,
    surroundings: &Surroundings,
) -> Result<SimulatedRobot, GeometryError> {
    let mut objects = Vec::new();
    if let Some(TrueBall { center: middle, radius, friction }) = surroundings.ball {
        let pose = Isometry3::from(Translation3::from(middle));
        let model = Arc::new(ObjectModel {
            name: "ball".to_owned(),
            shape: ObjectShape::Sphere { radius },
            mass: STEEL_DENSITY * 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3),
            friction: friction * instance.pad_friction(),
            color: [200; 3],
            rest: UnitQuaternion::identity(),
            symmetry: Symmetry::Full,
        });
        objects.push(ObjectPlacement { model, pose });
    }
    let fixed = !objects.is_empty();
    if let Some(TruePayload { model, pose }) = &surroundings.payload {
        let friction = model.friction * instance.pad_friction();
        objects.push(ObjectPlacement { model: Arc::new(ObjectModel { friction, ..model.clone() }), pose: *pose });
    }
    let base = SceneSetup::ideal(Isometry3::identity(), start);
    let setup = SceneSetup { cables: losses, gel: surroundings.gel, objects, ..base };
    let mut robot = SimulatedRobot::new(&instance.apply_to_robot(nominal), &setup, surroundings.cameras.clone());
    if fixed {
        robot.fix_object(0);
    }
    Ok(robot)
}

/// Returns the distances between true and modelled fingertips in the frame of the arm's base, m: all fingertips of the
/// hand with its joints at `bend` (rad), in `REACH_POSTURE_COUNT` postures of the arm about `start`. The encoder of
/// joint 1 is taken as known: it rotates the whole robot about its base, so it belongs to the pose of the base and not
/// to the robot.
pub fn fingertip_distances(
    truth: &RobotInstance,
    believed: &RobotInstance,
    nominal: &RobotModel,
    start: &[f64],
    bend: f64,
) -> Vec<f64> {
    let mut registered = believed.clone();
    if let Some(place) = truth.parameter_index(Quantity::ArmEncoder, 0) {
        registered.set(place, truth.deviations()[place]);
    }
    let bodies = [truth, &registered].map(|own| own.apply_to_robot(nominal));
    let joints = nominal.hand.each_joint(|_| bend);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut errors = Vec::new();
    for _ in 0..REACH_POSTURE_COUNT {
        let shown: ArmVector = start.iter().map(|angle| angle + rng.random_range(-0.5..0.5)).collect();
        let tips = bodies.each_ref().map(|RobotModel { hand, arm, .. }| {
            let palm = arm.tool_pose(&shown) * hand.palm_from_flange.inverse();
            let links = hand.tree.forward(&joints);
            Digit::ALL.map(|digit| {
                let [.., last] = digit.ftac_joints();
                palm * links[last] * fingertip(hand, last)
            })
        });
        errors.extend(tips[0].iter().zip(&tips[1]).map(|(real, believed)| (real - believed).norm()));
    }
    errors
}

/// Currents of the stairs (A), 0.4 s each, one actuator after another: motions not used for identification.
const STAIR_CURRENTS: [f64; 10] = [0.02, 0.055, 0.03, 0.06, 0.065, 0.015, 0.045, 0.05, 0.025, 0.0];
/// Duration of a stair, s.
const STAIR_DURATION: f64 = 0.4;
/// Lead-in in which the hand opens, s.
const LEAD_IN_DURATION: f64 = 1.0;
/// Angles added to the last two joints of the arm's posture for the stairs, rad: not a posture of the script.
const STAIR_POSTURE_OFFSETS: [f64; 2] = [0.4, 0.8];

/// Runs the stairs on the true robot and on models of the hands `believed`, and compares them. `start` is the arm's
/// ready posture.
pub fn compare(
    truth: &RobotInstance,
    nominal: &RobotModel,
    losses: CableLosses,
    start: &[f64],
    believed: &[&RobotInstance],
) -> Vec<MotionDifferences> {
    let mut start: ArmVector = start.iter().copied().collect();
    start.iter_mut().rev().zip(STAIR_POSTURE_OFFSETS.iter().rev()).for_each(|(angle, turn)| *angle += turn);
    let hand = &nominal.hand;
    let real = truth.apply_to_hand(hand);
    let hands: Vec<Hand> = believed.iter().map(|own| own.apply_to_hand(hand)).collect();
    let mut differences = vec![MotionDifferences::default(); hands.len()];
    for actuator in 0..hand.servos.len() {
        let mut robot = simulated_robot(truth, nominal, losses, start);
        let (motion, angles) = run_stairs(&mut robot, actuator, nominal);
        for (own, differences) in hands.iter().zip(&mut differences) {
            add_differences(own, &real, &motion, &angles, losses, differences);
        }
    }
    differences
}

type Angles = Vec<HandVector>;

/// Runs the stairs with one actuator. Returns the measured motion, and the true joint angles before each tick after the
/// lead-in.
fn run_stairs(robot: &mut SimulatedRobot, actuator: usize, nominal: &RobotModel) -> (FreeMotion, Angles) {
    let tick = robot.tick_length();
    let mut motion = FreeMotion {
        actuator,
        tick,
        lead_in: 0,
        goals: Vec::new(),
        angles: Vec::new(),
        opposition: Vec::new(),
        arm: Vec::new(),
        gravity: Vec::new(),
    };
    let mut angles = Vec::new();
    let hold = robot.observe().arm.position;
    let mut servos = nominal.hand.each_actuator(|_| ServoGoal::Position { angle: 0.0, current_limit: 0.15 });
    let opening = [(servos[actuator], LEAD_IN_DURATION)];
    let stairs = STAIR_CURRENTS.map(|current| (ServoGoal::Current(current), STAIR_DURATION));
    for (goal, length) in opening.into_iter().chain(stairs) {
        for _ in 0..(length / tick) as usize {
            let observation = robot.observe();
            motion.push(&observation, goal, nominal);
            angles.push(robot.truth().hand.into_iter().collect());
            servos[actuator] = goal;
            robot.send(&RobotCommand { arm: hold, servos, capture: false });
            robot.wait_for_tick();
        }
    }
    motion.lead_in = (LEAD_IN_DURATION / tick) as usize;
    let angles = angles.split_off(motion.lead_in);
    (motion, angles)
}

/// Adds the differences between the model of `own` and the `real` hand, whose joints were at `angles` in `motion`.
fn add_differences(
    own: &Hand,
    real: &Hand,
    motion: &FreeMotion,
    angles: &Angles,
    losses: CableLosses,
    differences: &mut MotionDifferences,
) {
    let joints: Vec<usize> = match own.transmission.cables.get(motion.actuator) {
        Some(path) => path.joints.iter().map(|crossing| crossing.joint).collect(),
        None => own.transmission.opposition.into_iter().collect(),
    };
    let digit = Digit::ALL.get(motion.actuator).copied().unwrap_or(Digit::Thumb);
    let [.., last] = digit.ftac_joints();
    for (shown, (angle, truth)) in
        simulate_motion(own, losses, motion).iter().zip(motion.measured().iter().zip(angles)).step_by(6)
    {
        differences.servos.push(shown.servo - angle);
        let mut believed = *truth;
        for (joint, angle) in joints.iter().zip(shown.joints) {
            differences.joints.push((angle - truth[*joint]).abs());
            believed[*joint] = angle;
        }
        let tip = |hand: &Hand, q: &[f64]| hand.tree.forward(q)[last] * fingertip(hand, last);
        differences.tips.push((tip(own, &believed) - tip(real, truth)).norm());
    }
}
