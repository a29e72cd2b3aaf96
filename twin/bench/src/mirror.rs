//! The mirror: a twin that runs beside the robot, fed with the same commands and corrected by its measurements, and what it names.
//!
//! [`twin`] is the observer, [`seen`] all that it is told, [`residuals`] what is left between robot and twin. [`cables`], [`torque`], [`hand`] with [`steps`], and
//! [`cameras`] find what is amiss in that, by what a phase lets expect ([`expected`]), what acts from [`outside`], and the limits of [`limits`]; [`divergence`] has the words for it. [`belief`] is where the object in the hand was felt.
//! [`watch`] lets a mirror look on while trials are played. A mirror only looks: it takes measurements, sent commands and what
//! the controller believes ([`seen::Seen`]), cannot reach the robot's truth, and gives nothing back to whoever commands.

pub mod belief;
pub mod cables;
pub mod cameras;
pub mod divergence;
pub mod expected;
pub mod hand;
pub mod limits;
pub mod outside;
pub mod residuals;
pub mod seen;
pub mod steps;
pub mod torque;
pub mod twin;
pub mod watch;

use std::collections::BTreeMap;
use std::sync::Arc;

use control::inverse_kinematics::ArmKinematics;
use hand_model::robot::{ArmState, ServoState};
use hand_model::{ACTUATORS, ARM_JOINTS, Arm, Digit, Hand};
use nalgebra::Isometry3;
use proving::world::World;

use self::belief::{Belief, Believes};
use self::cables::{CableWatch, Finding};
use self::cameras::CameraWatch;
use self::divergence::{Divergence, Kind};
use self::hand::{HandTick, HandWatch};
use self::limits::{Limits, LimitsError};
use self::residuals::Residuals;
use self::seen::Seen;
use self::twin::Twin;

/// A twin beside a robot, and all that was named so far.
#[derive(Clone)]
pub struct Mirror {
    twin: Twin,
    hand: Arc<Hand>,
    arm: Arc<Arm>,
    kinematics: ArmKinematics,
    limits: Limits,
    /// Masses of objects as the controller knows them, kg.
    masses: Arc<BTreeMap<String, f64>>,
    before: [ServoState; ACTUATORS],
    arm_before: ArmState,
    residuals: Residuals,
    cables: [CableWatch; 5],
    handle: HandWatch,
    cameras: CameraWatch,
    believes: Believes,
    named: Vec<Divergence>,
}

impl Mirror {
    /// Of the robot that the controller of `world` knows, its arm at rest where it was measured (rad).
    pub fn new(world: &World, arm: &[f64; ARM_JOINTS]) -> Result<Self, LimitsError> {
        let masses = world.objects.iter().map(|object| (object.name.clone(), object.mass)).collect();
        Ok(Self {
            twin: Twin::new(world, arm),
            hand: world.cell.hand.clone(),
            arm: world.cell.arm.clone(),
            kinematics: world.cell.kinematics(),
            limits: Limits::standard()?,
            masses: Arc::new(masses),
            before: [ServoState::default(); ACTUATORS],
            arm_before: ArmState::default(),
            residuals: Residuals::default(),
            cables: Default::default(),
            handle: HandWatch::default(),
            cameras: CameraWatch::default(),
            believes: Believes::default(),
            named: Vec::new(),
        })
    }

    /// A fresh mirror of a robot that went on unseen, its arm now at rest where it was measured (rad); what was named stays.
    pub fn restarted(self, world: &World, arm: &[f64; ARM_JOINTS]) -> Result<Self, LimitsError> {
        Ok(Self { named: self.named, ..Self::new(world, arm)? })
    }

    /// One tick; what was named in it.
    pub fn see(&mut self, seen: &Seen) -> &[Divergence] {
        let known = self.named.len();
        let innovation = self.twin.correct(seen.servos, seen.arm);
        let (_, jacobian) = self.kinematics.jacobian(&seen.arm.position);
        let readings = [&self.before, seen.servos];
        self.residuals = Residuals::new(&self.hand, readings, self.twin.tick_length(), &innovation, &jacobian);
        self.before = *seen.servos;
        self.believes.see(seen.time, seen.phase, seen.felt);
        // An arm that says the same to the last bit is not heard any more: the twin moves on, and what they differ by is no force.
        if std::mem::replace(&mut self.arm_before, *seen.arm) != *seen.arm {
            self.look_at_hand(seen);
        }
        self.look_at_cables(seen.time);
        let cameras = self.cameras.see(&self.limits.camera, (seen.time, seen.sent.capture), seen.images);
        for (camera, finding) in cameras {
            let part = camera.map_or_else(|| "all cameras".to_owned(), |camera| self.hand.cameras[camera].name.clone());
            self.name(seen.time, part, finding);
        }
        self.twin.follow(seen.sent);
        &self.named[known..]
    }

    /// Whether a joint of the arm, at `angles` (rad), is so near its stop that this may bear some of what loads the hand.
    fn is_on_stop(&self, angles: &[f64; ARM_JOINTS]) -> bool {
        let near = self.limits.hand.stop;
        self.arm.tree.joints.iter().zip(angles).any(|(joint, at)| at - joint.lower < near || joint.upper - at < near)
    }

    fn look_at_hand(&mut self, seen: &Seen) {
        if self.is_on_stop(&seen.arm.position) {
            self.handle.see_nothing();
            return;
        }
        let mass = |name: &str| self.masses.get(name).copied().unwrap_or(0.0);
        let tick = HandTick {
            time: seen.time,
            phase: seen.phase,
            progress: seen.progress,
            residuals: &self.residuals,
            masses: seen.objects.map(mass),
        };
        if let Some(finding) = self.handle.see(&self.limits, &tick) {
            if finding.0 == Kind::ObjectLost {
                self.believes.lose();
            }
            self.name(seen.time, "hand".to_owned(), finding);
        }
    }

    fn look_at_cables(&mut self, time: f64) {
        let outside = self.handle.outside(&self.limits.hand);
        for digit in Digit::ALL {
            let n = digit.index();
            let finding = self.cables[n].see(&self.limits.cable, time, &self.residuals.cables[n], outside);
            if let Some(finding) = finding {
                self.name(time, digit.name().to_owned(), finding);
            }
        }
    }

    fn name(&mut self, time: f64, part: String, (kind, found, expected): Finding) {
        self.named.push(Divergence { time, kind, part, found, expected });
    }

    /// All that was named.
    pub fn named(&self) -> &[Divergence] {
        &self.named
    }

    /// Residuals of the last tick.
    pub fn residuals(&self) -> &Residuals {
        &self.residuals
    }

    /// The twin.
    pub fn twin(&self) -> &Twin {
        &self.twin
    }

    /// The object that is believed to be in the hand, and `world_from_object` there.
    pub fn object(&self) -> Option<(&Belief, Isometry3<f64>)> {
        self.believes.object().map(|belief| (belief, self.twin.palm() * belief.palm_from_object))
    }
}
