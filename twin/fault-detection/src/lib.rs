//! The mirror: a twin that runs beside the robot as an observer, fed with the same commands and corrected by the
//! robot's measurements, and the divergences that it reports.
//!
//! [`twin`] is the observer and [`seen`] is all of its input. [`pace`] resamples that input to even ticks if a robot
//! runs in real time. [`residuals`] are the differences between robot and twin. [`cables`], [`torque`], [`hand`] with
//! [`steps`], and [`cameras`] detect faults in the residuals. They use the expectations of a phase ([`expected`]), the
//! load from [`outside`], and the thresholds of [`limits`]. [`divergence`] words the findings. [`belief`] is the pose
//! estimate of the object in the hand.
//!
//! A mirror only observes. It takes measurements, sent commands and the controller's estimates ([`seen::Seen`]). It has
//! no access to the robot's ground truth and gives nothing back to the controller.

pub mod belief;
pub mod cables;
pub mod cameras;
pub mod divergence;
pub mod expected;
pub mod hand;
pub mod limits;
pub mod outside;
pub mod pace;
pub mod residuals;
pub mod seen;
pub mod steps;
pub mod torque;
pub mod twin;

use std::collections::BTreeMap;
use std::sync::Arc;

use control::executor::Target;
use control::inverse_kinematics::ArmKinematics;
use grasp_verification::simulated_world::World;
use hand_model::robot::{ArmState, ServoState};
use hand_model::{ActuatorVector, Arm, ArmVector, Digit, Hand};
use nalgebra::Isometry3;

use self::belief::{Belief, Believes};
use self::cables::{CableWatch, Finding};
use self::cameras::CameraWatch;
use self::divergence::{Divergence, Kind};
use self::hand::{HandTick, HandWatch};
use self::limits::{Limits, LimitsError};
use self::pace::{Look, Pace, Passed};
use self::residuals::Residuals;
use self::seen::Seen;
use self::twin::Twin;

/// A twin beside a robot, with all divergences reported so far.
#[derive(Clone)]
pub struct Mirror {
    twin: Twin,
    pace: Pace,
    /// Number of gaps so long that the observations before them were discarded.
    gaps: u32,
    hand: Arc<Hand>,
    arm: Arc<Arm>,
    kinematics: ArmKinematics,
    limits: Limits,
    /// Masses of objects as the controller knows them, kg.
    masses: Arc<BTreeMap<String, f64>>,
    before: ActuatorVector<ServoState>,
    arm_before: ArmState,
    residuals: Residuals,
    cables: Vec<CableWatch>,
    handle: HandWatch,
    cameras: CameraWatch,
    believes: Believes,
    named: Vec<Divergence>,
}

impl Mirror {
    /// Creates the twin of the robot as the controller of `world` knows it, its arm at rest at the measured angles
    /// `arm` (rad).
    pub fn new(world: &World, arm: &ArmVector) -> Result<Self, LimitsError> {
        let masses = world.objects.iter().map(|object| (object.name.clone(), object.mass)).collect();
        Ok(Self {
            twin: Twin::new(world, arm),
            pace: Pace::default(),
            gaps: 0,
            hand: world.cell.robot.hand.clone(),
            arm: world.cell.robot.arm.clone(),
            kinematics: world.cell.kinematics(),
            limits: Limits::standard()?,
            masses: Arc::new(masses),
            before: world.cell.robot.hand.each_actuator(|_| ServoState::default()),
            arm_before: ArmState::default(),
            residuals: Residuals::default(),
            cables: vec![CableWatch::default(); world.cell.robot.hand.cables.len()],
            handle: HandWatch::default(),
            cameras: CameraWatch::new(world.cell.robot.hand.cameras.len()),
            believes: Believes::default(),
            named: Vec::new(),
        })
    }

    /// Processes an observation, made one tick after the last one or whenever the robot's host had the time. Returns
    /// the new divergences.
    pub fn see(&mut self, seen: &Seen) -> &[Divergence] {
        let known = self.named.len();
        let look =
            Look { time: seen.time, servos: seen.servos.iter().copied().collect(), arm: *seen.arm, sent: *seen.sent };
        match self.pace.take(&look, self.twin.tick_length()) {
            Passed::Tick => self.tick(seen),
            Passed::Even(ticks) => {
                for Look { time, servos, arm, sent } in &ticks {
                    self.tick(&Seen { time: *time, servos, arm, sent, ..*seen });
                }
            }
            Passed::Gap(ticks) => {
                self.gaps += 1;
                self.go_on_unseen(ticks, seen);
            }
        }
        let cameras =
            self.cameras.see(&self.limits.camera, (seen.time, seen.sent.capture, self.pace.is_uneven()), seen.images);
        for (camera, finding) in cameras {
            let part = camera.map_or_else(|| "all cameras".to_owned(), |camera| self.hand.cameras[camera].name.clone());
            self.name(seen.time, part, finding);
        }
        &self.named[known..]
    }

    /// Lets the twin follow its last command for `ticks` ticks without observations. The detectors of cables and hand
    /// are then reset. Those of cameras and the pose estimate are kept.
    fn go_on_unseen(&mut self, ticks: usize, seen: &Seen) {
        for _ in 0..ticks {
            self.twin.go_on();
        }
        self.twin.correct(seen.servos, seen.arm, true);
        self.before = seen.servos.iter().copied().collect();
        self.arm_before = *seen.arm;
        self.cables.fill(CableWatch::default());
        self.handle.see_nothing();
        self.believes.see(seen.time, seen.phase, seen.felt);
        self.twin.follow(seen.sent);
    }

    /// Processes one tick.
    fn tick(&mut self, seen: &Seen) {
        let innovation = self.twin.correct(seen.servos, seen.arm, self.pace.is_uneven());
        let (_, jacobian) = self.kinematics.jacobian(&seen.arm.position);
        let readings = [&self.before, seen.servos];
        self.residuals = Residuals::new(&self.hand, readings, self.twin.tick_length(), &innovation, &jacobian);
        self.before = seen.servos.iter().copied().collect();
        self.believes.see(seen.time, seen.phase, seen.felt);
        // An arm that repeats its state to the last bit is no longer heard: the twin moves on, and the difference is no
        // force.
        if std::mem::replace(&mut self.arm_before, *seen.arm) != *seen.arm {
            self.look_at_hand(seen);
        }
        self.look_at_cables(seen.time);
        self.twin.follow(seen.sent);
    }

    /// Returns the number of gaps so far that made the observations before them worthless.
    pub fn gaps(&self) -> u32 {
        self.gaps
    }

    /// True if a joint of the arm, at `angles` (rad), is so near its stop that the stop may bear some of the load on
    /// the hand.
    fn is_on_stop(&self, angles: &[f64]) -> bool {
        let near = self.limits.hand.stop;
        self.arm.tree.joints.iter().zip(angles).any(|(joint, at)| at - joint.lower < near || joint.upper - at < near)
    }

    fn look_at_hand(&mut self, seen: &Seen) {
        if self.is_on_stop(&seen.arm.position) {
            self.handle.see_nothing();
            return;
        }
        let mass = |target: &Target| self.masses.get(&target.grasp.object).copied().unwrap_or(0.0);
        let masses: Vec<f64> = seen.targets.iter().map(mass).collect();
        let digits: Vec<&[Digit]> = seen.targets.iter().map(|target| &target.grasp.digits[..]).collect();
        let tick = HandTick {
            time: seen.time,
            phase: seen.phase,
            progress: seen.progress,
            residuals: &self.residuals,
            masses: &masses,
            digits: &digits,
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
        for digit in self.hand.digits() {
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

    /// Returns all divergences reported so far.
    pub fn named(&self) -> &[Divergence] {
        &self.named
    }

    /// Returns the residuals of the last tick.
    pub fn residuals(&self) -> &Residuals {
        &self.residuals
    }

    /// Returns the twin.
    pub fn twin(&self) -> &Twin {
        &self.twin
    }

    /// Returns the pose estimate of the object in the hand, and `world_from_object` that follows from it.
    pub fn object(&self) -> Option<(&Belief, Isometry3<f64>)> {
        self.believes.object().map(|belief| (belief, self.twin.palm() * belief.palm_from_object))
    }
}
