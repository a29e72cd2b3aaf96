//! Closing of a sampled posture: the hand opens clear of the object, pulls, and touches it.
//!
//! The palm stands still and the object floats. While the digits close, the object's motion is damped, as a table or a
//! slowly closing hand would damp it. Once they have closed, the damping is removed and the grasp has to come to rest
//! by itself.
//!
//! A sample does not state how hard each digit has to pull to keep the object between the digits. A closing takes less
//! time than a chain, so several [`ClosingParameters`] are tried: the plain one first, then others with different tensions,
//! helping actuators and a small offset.

use dexterous_grasping::synthesis::chain::GraspSample;
use dexterous_grasping::synthesis::frames::{HandState, LinkFrames};
use dexterous_grasping::synthesis::held::HeldContact;
use dexterous_grasping::synthesis::posture::{self, FreePosture};
use nalgebra::{Isometry3, Point3, Vector3};
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;
use sim::hand_scene::{HandScene, SceneContact, TensionCommand, pose_difference};

use super::grasping_hand::GraspingHand;
use super::subject::PreparedObject;
use super::urdf_hand::open_posture;

/// Tension of an actuator in a plain closing, N.
const CLOSE_TENSION: f64 = 30.0;
/// Probability that an actuator without a contact point helps.
const HELPER_PROBABILITY: f64 = 0.25;
/// Standard deviation of the hand's offset: m, rad.
const OFFSET_SIGMA: (f64, f64) = (3e-3, 0.06);
/// Rise time of the tension, s.
pub const RISE_TIME: f64 = 0.4;
/// Settling time of the damped object after the rise, s.
pub const DAMPED_SETTLING_TIME: f64 = 0.3;
/// Settling time of the free object after that, s.
pub const FREE_SETTLING_TIME: f64 = 0.3;
/// Damping of the object's motion while the digits close, 1/s.
pub const OBJECT_DAMPING: f64 = 100.0;

/// Thresholds on the object's motion while the digits close: m, rad. An object that moves farther was pushed away, not
/// grasped.
const MAX_CLOSING_MOTION: (f64, f64) = (0.03, 0.6);

/// Closed grasp that keeps pulling. It is cloned for every test.
pub trait PullingGrasp: Clone {
    /// Returns the time step, s.
    fn dt(&self) -> f64;
    /// Returns the pose of the object.
    fn object(&self) -> Isometry3<f64>;
    /// Returns the joint angles, rad.
    fn joints(&self) -> &[f64];
    /// Runs one step with a force (N) on the object's centre of mass.
    fn step(&mut self, force: &Vector3<f64>);
}

/// Closed grasp at rest.
#[derive(Clone)]
pub struct ClosedGrasp {
    /// Scene at rest. It is cloned for every test.
    pub scene: HandScene,
    pub pull: TensionCommand,
    /// Open posture from which it closed.
    pub open: FreePosture,
    /// `root_from_object` before closing.
    pub start: Isometry3<f64>,
    /// Motion of the object while the digits closed: m, rad.
    pub moved: (f64, f64),
    pub touches: Vec<SceneContact>,
}

impl ClosedGrasp {
    /// Returns the grasp with all tensions zero.
    pub fn slack(&self) -> Self {
        let mut slack = self.clone();
        slack.pull.tensions.fill(0.0);
        slack
    }
}

impl PullingGrasp for ClosedGrasp {
    fn dt(&self) -> f64 {
        self.scene.dt()
    }

    fn object(&self) -> Isometry3<f64> {
        self.scene.object()
    }

    fn joints(&self) -> &[f64] {
        self.scene.angles()
    }

    fn step(&mut self, force: &Vector3<f64>) {
        self.scene.step(&self.pull, force);
    }
}

/// Reason why a sample did not become a closed grasp.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClosingFailure {
    /// The palm or a digit cannot be cleared of the object.
    Blocked,
    /// The closing digits pushed the object away.
    PushedAway,
}

/// Tensions and offset of one closing of a sample.
#[derive(Debug, Clone, PartialEq)]
pub struct ClosingParameters {
    /// Tension of each actuator, N. Actuators with `None` hold their open posture.
    pub tensions: Vec<Option<f64>>,
    /// Offset of the hand from the sample: m, rad.
    pub offset: [f64; 6],
}

impl ClosingParameters {
    /// Creates the plain closing: every actuator that is `closing` pulls with the same tension, within the range `low`
    /// to `high` (N), and the hand stays at the sample.
    pub fn plain(closing: &[bool], (low, high): (f64, f64)) -> Self {
        let tension = CLOSE_TENSION.clamp(low, high);
        Self { tensions: closing.iter().map(|closing| closing.then_some(tension)).collect(), offset: [0.0; 6] }
    }

    /// Draws a closing with tensions from the range `low` to `high` (N), sometimes a helping actuator that `may_close`,
    /// and a small offset.
    pub fn varied(closing: &[bool], may_close: &[bool], (low, high): (f64, f64), rng: &mut impl Rng) -> Self {
        let tension = |(closing, may_close): (&bool, &bool)| {
            let pulls = *closing || rng.random::<f64>() < HELPER_PROBABILITY;
            let tension = low * (high / low).powf(rng.random());
            (pulls && *may_close).then_some(tension)
        };
        let tensions = closing.iter().zip(may_close).map(tension).collect();
        let offset = std::array::from_fn(
            |n| if n < 3 { OFFSET_SIGMA.0 } else { OFFSET_SIGMA.1 } * rng.sample::<f64, _>(StandardNormal),
        );
        Self { tensions, offset }
    }
}

/// Closes `sample` on the object with the tensions and offset of `aim`.
pub fn close(
    hand: &GraspingHand,
    subject: &PreparedObject,
    sample: &GraspSample,
    frames: &mut LinkFrames,
    aim: &ClosingParameters,
) -> Result<ClosedGrasp, ClosingFailure> {
    let mut by = vec![0.0; sample.state.freedom()];
    by[..6].copy_from_slice(&aim.offset);
    let (start, open) = open_clear(hand, subject, frames, &sample.state.moved(&by)).ok_or(ClosingFailure::Blocked)?;
    let after: Vec<f64> = aim.tensions.iter().zip(&open.tensions).map(|(aimed, held)| aimed.unwrap_or(*held)).collect();
    let after = hand.limited_to_efforts(&after);
    close_open_hand(hand, subject, start, open, after)
}

/// Closes an open hand: its tensions rise to `after` (N), with the object at `start` (`root_from_object`).
pub fn close_open_hand(
    hand: &GraspingHand,
    subject: &PreparedObject,
    start: Isometry3<f64>,
    open: FreePosture,
    after: Vec<f64>,
) -> Result<ClosedGrasp, ClosingFailure> {
    let mut scene = hand.scene(subject, &start, &open.joints);
    scene.set_object_damping(OBJECT_DAMPING);
    let steps = |time: f64| (time / scene.dt()).round() as usize;
    let (rise, damped, free) = (steps(RISE_TIME), steps(DAMPED_SETTLING_TIME), steps(FREE_SETTLING_TIME));
    let mut pull = TensionCommand { tensions: open.tensions.clone(), opposition: open.opposition };
    for step in 0..rise + damped + free {
        let part = (step as f64 / rise as f64).min(1.0);
        for (tension, (before, after)) in pull.tensions.iter_mut().zip(open.tensions.iter().zip(&after)) {
            *tension = before + part * (after - before);
        }
        if step == rise + damped {
            scene.set_object_damping(0.0);
        }
        scene.step(&pull, &Vector3::zeros());
        if step % 24 == 0 && pushed_away(pose_difference(&start, &scene.object())) {
            return Err(ClosingFailure::PushedAway);
        }
    }
    let moved = pose_difference(&start, &scene.object());
    if pushed_away(moved) {
        return Err(ClosingFailure::PushedAway);
    }
    let touches = scene.contacts();
    Ok(ClosedGrasp { scene, pull, open, start, moved, touches })
}

/// Returns a touch as files record it, at `point` (root frame, m).
pub fn held_contact(touch: &SceneContact, point: &Point3<f64>) -> HeldContact {
    HeldContact {
        link: touch.link,
        point: point.coords.into(),
        normal: touch.normal.into_inner().into(),
        force: touch.force,
    }
}

/// True if a motion of the object (m, rad) means that it was pushed away.
fn pushed_away(moved: (f64, f64)) -> bool {
    moved.0 > MAX_CLOSING_MOTION.0 || moved.1 > MAX_CLOSING_MOTION.1
}

/// Returns the nearest posture that the actuators hold clear of the object, and `root_from_object` there. `None` if the
/// hand cannot be cleared.
fn open_clear(
    hand: &GraspingHand,
    subject: &PreparedObject,
    frames: &mut LinkFrames,
    sample: &HandState,
) -> Option<(Isometry3<f64>, FreePosture)> {
    if let Some(named) = &hand.named_hand {
        let opened = posture::open_clear(named, &hand.sampled.surface, &subject.field, frames, sample)?;
        return Some((opened.state.object_from_palm.inverse(), opened.open));
    }
    let (state, amounts) = open_posture::open_clear(hand, &subject.field, frames, sample)?;
    let start = hand.palm_from_root.inverse() * state.object_from_palm.inverse();
    let amounts = amounts.iter().enumerate();
    let tensions = amounts.map(|(line, amount)| open_posture::holding_tension(hand, line, *amount)).collect();
    Some((start, FreePosture { tensions, opposition: 0.0, joints: state.joints }))
}
