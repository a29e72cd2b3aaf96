//! Faults of the plant, how they are drawn, and what must be named for each.

use anyhow::{Context, Result};
use bench::mirror::divergence::{Divergence, Kind};
use bench::mirror::residuals::Residuals;
use control::executive::{Executive, Phase};
use hand_model::{CAMERAS, Digit, Hand};
use nalgebra::{Isometry3, Vector3};
use proving::rehearsal::in_hand;
use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;
use scenarios::disturbance::Blindness;
use sim::SimulatedRobot;

/// Kinds of faults, in the order of the table.
pub const KINDS: [&str; 11] = [
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

/// Cables pulled with less show nothing of what is wrong with them, N; joints of digits that close more slowly than this (m/s) neither.
const PULLED: f64 = 1.5;
const CLOSING: f64 = 0.01;
/// Where a snatched object goes: beside the table's middle.
const AWAY: [f64; 3] = [0.3, 0.6, 0.1];

/// A fault that can strike.
#[derive(Debug, Clone)]
pub enum Fault {
    Break(usize),
    /// By m.
    Slip(usize, f64),
    /// To a share of the torque.
    Weak(usize, f64),
    Stick(usize),
    /// By kg.
    Heavy(f64),
    Snatch,
    /// N, for as long as it is looked at.
    Push(Vector3<f64>),
    Freeze(usize),
    Blind(usize, Blindness),
    Dim(usize, usize, f32),
}

impl Fault {
    /// A fault of each kind that can show at this moment.
    pub fn draw(
        rng: &mut ChaCha8Rng,
        hand: &Hand,
        (robot, executive): (&SimulatedRobot, &Executive),
        residuals: &Residuals,
    ) -> Vec<(usize, Self)> {
        let mut drawn = Vec::new();
        let mut some = |of: &[usize]| (!of.is_empty()).then(|| of[rng.random_range(0..of.len())]);
        let digits = |fits: &dyn Fn(usize) -> bool| (0..5).filter(|n| fits(*n)).collect::<Vec<_>>();
        let pulled = digits(&|n| residuals.cables[n].pulled > PULLED);
        let closing = digits(&|n| pulled.contains(&n) && residuals.cables[n].speed > CLOSING);
        let [broken, slipped, weak, stuck] = [&pulled, &pulled, &pulled, &closing].map(|of| some(of));
        let [frozen, missing, black, dim] = [(); 4].map(|()| rng.random_range(0..CAMERAS));
        let angle: f64 = rng.random_range(0.0..std::f64::consts::TAU);
        let push = rng.random_range(8.0..20.0) * Vector3::new(angle.cos(), angle.sin(), 0.0);
        let (slip, share, more) =
            (rng.random_range(0.0015..0.004), rng.random_range(0.5..0.75), rng.random_range(0.12..0.4));
        let (joint, channel, left) = (rng.random_range(0..3), rng.random_range(0..3), rng.random_range(0.3..0.7));
        drawn.extend(broken.map(|n| (0, Self::Break(n))));
        drawn.extend(slipped.map(|n| (1, Self::Slip(n, slip))));
        drawn.extend(weak.map(|n| (2, Self::Weak(n, share))));
        // The thumb's first joint is turned by a servo of its own.
        let joint_of = |n: usize| Digit::ALL[n].joints()[if n == 0 { joint.max(1) } else { joint }];
        drawn.extend(stuck.map(|n| (3, Self::Stick(joint_of(n)))));
        let phase = executive.phase();
        let lifted = phase > Phase::LiftFirst || phase == Phase::LiftFirst && executive.progress() > 0.4;
        if lifted && in_hand(&robot.truth(), 0) {
            drawn.extend([(4, Self::Heavy(more)), (5, Self::Snatch)]);
        }
        drawn.push((6, Self::Push(push)));
        drawn.push((7, Self::Freeze(frozen)));
        let pad = |camera: usize| hand.cameras[camera].pad;
        drawn.push((8, Self::Blind(pad(missing), Blindness::Missing)));
        drawn.push((9, Self::Blind(pad(black), Blindness::Black)));
        drawn.push((10, Self::Dim(dim, channel, left)));
        drawn
    }

    /// Strikes.
    pub fn strike(&self, robot: &mut SimulatedRobot, hand: &Hand) -> Result<()> {
        match *self {
            Self::Break(n) => robot.break_cable(n),
            Self::Slip(n, length) => robot.slip_cable(n, length),
            Self::Weak(n, share) => robot.weaken_servo(n, share),
            Self::Stick(joint) => robot.stick_joint(joint),
            Self::Heavy(more) => robot.add_mass(0, more),
            Self::Snatch => robot.put(0, &Isometry3::translation(AWAY[0], AWAY[1], AWAY[2])),
            Self::Push(_) => {}
            Self::Freeze(camera) => robot.freeze_camera(camera),
            Self::Blind(pad, how) => {
                let name = hand.pads.get(pad).context("a pad")?.name.clone();
                robot.fail_cameras(&[name], how);
            }
            Self::Dim(camera, channel, left) => robot.dim_lamp(camera, channel, left),
        }
        Ok(())
    }

    /// What lasts with every tick.
    pub fn press(&self, robot: &mut SimulatedRobot) {
        if let Self::Push(force) = self {
            robot.pull(None, *force);
        }
    }

    /// Whether `named` is its right name, part included.
    pub fn is(&self, named: &Divergence, hand: &Hand) -> bool {
        let digit = |n: usize| named.part == Digit::ALL[n].name();
        let camera = |n: usize| named.part == hand.cameras[n].name;
        match *self {
            Self::Break(n) => named.kind == Kind::CableBroken && digit(n),
            Self::Slip(n, _) => named.kind == Kind::CableSlipped && digit(n),
            Self::Weak(n, _) => named.kind == Kind::ServoWeak && digit(n),
            // No name: a joint that is stuck looks like one that touches something.
            Self::Stick(_) => false,
            Self::Heavy(_) => named.kind == Kind::OtherPayload,
            Self::Snatch => named.kind == Kind::ObjectLost,
            Self::Push(_) => named.kind == Kind::UnexpectedContact,
            Self::Freeze(n) => named.kind == Kind::CameraDead && camera(n),
            Self::Blind(pad, _) => named.kind == Kind::CameraDead && hand.pads[pad].cameras.iter().any(|n| camera(*n)),
            Self::Dim(n, ..) => named.kind == Kind::PadDrifted && camera(n),
        }
    }
}

/// Whether two names are the same finding.
pub fn same(one: &Divergence, other: &Divergence) -> bool {
    (one.kind, &one.part) == (other.kind, &other.part)
}
