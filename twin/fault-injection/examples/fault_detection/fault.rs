//! Plant faults: their random draw, and the correct diagnosis of each.

use control::executor::Executor;
use fault_detection::fault::{DetectedFault, FaultKind};
use fault_detection::residuals::Residuals;
use fault_injection::plant::PlantFault;
use grasp_verification::rollout::in_hand;
use hand_model::{Digit, Hand};
use nalgebra::Vector3;
use plant::CameraFailure;
use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;
use sim::SimulatedRobot;

/// Kinds of faults, in the order of the table.
pub const FAULT_KINDS: [&str; 11] = [
    "cable broken",
    "cable slipped",
    "servo weak",
    "joint stuck",
    "payload heavier",
    "object snatched",
    "push on the palm",
    "camera frozen",
    "camera missing",
    "camera black",
    "lamp dim",
];

/// Minimum pull on a cable, N: below it no fault of the cable is observable.
const MIN_CABLE_PULL: f64 = 1.5;
/// Minimum closing speed, m/s: a joint of a digit that closes more slowly shows no fault.
const MIN_CLOSING_SPEED: f64 = 0.01;
/// A plant fault that can be injected.
#[derive(Debug, Clone)]
pub struct ExampleFault(PlantFault);

impl ExampleFault {
    /// Draws one fault of each kind that is observable at this moment.
    pub fn draw(
        rng: &mut ChaCha8Rng,
        hand: &Hand,
        (robot, executor): (&SimulatedRobot, &Executor),
        residuals: &Residuals,
    ) -> Vec<(usize, Self)> {
        let mut drawn = Vec::new();
        let mut some = |of: &[usize]| (!of.is_empty()).then(|| of[rng.random_range(0..of.len())]);
        let digits = |fits: &dyn Fn(usize) -> bool| (0..5).filter(|n| fits(*n)).collect::<Vec<_>>();
        let pulled = digits(&|n| residuals.cables[n].servo_tension > MIN_CABLE_PULL);
        let closing = digits(&|n| pulled.contains(&n) && residuals.cables[n].speed > MIN_CLOSING_SPEED);
        let [broken, slipped, weak, stuck] = [&pulled, &pulled, &pulled, &closing].map(|of| some(of));
        let [frozen, missing, black, dim] = [(); 4].map(|()| rng.random_range(0..hand.cameras.len()));
        let angle: f64 = rng.random_range(0.0..std::f64::consts::TAU);
        let push = rng.random_range(8.0..20.0) * Vector3::new(angle.cos(), angle.sin(), 0.0);
        let (slip, share, more) =
            (rng.random_range(0.0015..0.004), rng.random_range(0.5..0.75), rng.random_range(0.12..0.4));
        let (joint, channel, left) = (rng.random_range(0..3), rng.random_range(0..3), rng.random_range(0.3..0.7));
        drawn.extend(broken.map(|n| (0, PlantFault::Break(n))));
        drawn.extend(slipped.map(|n| (1, PlantFault::Slip(n, slip))));
        drawn.extend(weak.map(|n| (2, PlantFault::Weak(n, share))));
        // The thumb's first joint is turned by its own servo.
        let joint_of = |n: usize| Digit::ALL[n].ftac_joints()[if n == 0 { joint.max(1) } else { joint }];
        drawn.extend(stuck.map(|n| (3, PlantFault::Stick(joint_of(n)))));
        let phase = executor.phase();
        let lifted = phase.has_lifted(0) || phase.has_begun_lift(0) && executor.motion().progress() > 0.4;
        if lifted && in_hand(&robot.truth(), 0) {
            drawn.extend([(4, PlantFault::Heavy(0, more)), (5, PlantFault::Snatch(0))]);
        }
        drawn.push((6, PlantFault::Push(push)));
        drawn.push((7, PlantFault::Freeze(frozen)));
        let pad = |camera: usize| hand.cameras[camera].pad;
        drawn.push((8, PlantFault::Blind(pad(missing), CameraFailure::Missing)));
        drawn.push((9, PlantFault::Blind(pad(black), CameraFailure::Black)));
        drawn.push((10, PlantFault::Dim(dim, channel, left)));
        drawn.into_iter().map(|(kind, fault)| (kind, Self(fault))).collect()
    }

    /// Injects the fault.
    pub fn inject(&self, robot: &mut SimulatedRobot, hand: &Hand) {
        self.0.inject(robot, hand);
    }

    /// Applies the part of a fault that acts in every tick, such as a push.
    pub fn apply_push(&self, robot: &mut SimulatedRobot) {
        self.0.apply_push(robot);
    }

    /// True if `named` is the correct diagnosis of this fault, part included.
    pub fn matches(&self, named: &DetectedFault, hand: &Hand) -> bool {
        let digit = |n: usize| named.part == Digit::ALL[n].name();
        let camera = |n: usize| named.part == hand.cameras[n].name;
        match self.0 {
            PlantFault::Break(n) => named.kind == FaultKind::CableBroken && digit(n),
            PlantFault::Slip(n, _) => named.kind == FaultKind::CableSlipped && digit(n),
            PlantFault::Weak(n, _) => named.kind == FaultKind::ServoWeak && digit(n),
            // No diagnosis is correct: a stuck joint looks like one that touches something.
            PlantFault::Stick(_) => false,
            PlantFault::Heavy(..) => named.kind == FaultKind::OtherPayload,
            PlantFault::Snatch(_) => named.kind == FaultKind::ObjectLost,
            PlantFault::Push(_) => named.kind == FaultKind::UnexpectedContact,
            PlantFault::Freeze(n) => named.kind == FaultKind::CameraDead && camera(n),
            PlantFault::Blind(pad, _) => {
                named.kind == FaultKind::CameraDead && hand.pads[pad].cameras.iter().any(|n| camera(*n))
            }
            PlantFault::Dim(n, ..) => named.kind == FaultKind::PadDrifted && camera(n),
        }
    }
}

/// True if two reports are the same finding.
pub fn is_same_finding(one: &DetectedFault, other: &DetectedFault) -> bool {
    (one.kind, &one.part) == (other.kind, &other.part)
}
