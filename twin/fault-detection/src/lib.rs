//! Fault detection: a reference model that runs beside the robot as an observer, fed with the same commands and
//! corrected by the robot's measurements, and the faults detected from the residuals.
//!
//! [`reference_model`] is the observer and [`measurements`] is all of its input. [`resampling`] resamples that input to
//! even ticks if a robot runs in real time. [`residuals`] are the differences between robot and reference model.
//! [`cables`], [`torque`], [`hand`] with [`steps`], and [`cameras`] detect faults in the residuals. They use the
//! expectations of a phase ([`expected`]), the load from [`external_wrench`], and the thresholds of [`limits`].
//! [`fault`] words the findings. [`held_pose`] is the pose estimate of the object in the hand.
//!
//! Fault detection only observes. It takes measurements, sent commands and the controller's estimates
//! ([`measurements::TickMeasurements`]). It has no access to the robot's ground truth and no influence on the
//! controller.

pub mod cables;
pub mod cameras;
pub mod expected;
pub mod external_wrench;
pub mod fault;
pub mod hand;
pub mod held_pose;
pub mod limits;
pub mod measurements;
pub mod reference_model;
pub mod resampling;
pub mod residuals;
pub mod steps;
pub mod torque;

use std::collections::BTreeMap;
use std::sync::Arc;

use control::executor::GraspTarget;
use control::inverse_kinematics::ArmKinematics;
use grasp_verification::simulated_world::SimulatedWorld;
use hand_model::robot::{ArmState, ServoState};
use hand_model::{ActuatorVector, Arm, ArmVector, Digit, Hand};
use nalgebra::Isometry3;

use self::cables::{CableWatch, Finding};
use self::cameras::CameraWatch;
use self::fault::{DetectedFault, FaultKind};
use self::hand::{HandTick, HandWatch};
use self::held_pose::{HeldPose, HeldPoseTracker};
use self::limits::{DetectionLimits, LimitsError};
use self::measurements::TickMeasurements;
use self::reference_model::ReferenceModel;
use self::resampling::{Observation, Resampled, Resampler};
use self::residuals::Residuals;

/// Reference model beside a robot, with all faults detected so far.
#[derive(Clone)]
pub struct FaultDetector {
    reference_model: ReferenceModel,
    resampler: Resampler,
    /// Number of gaps so long that the observations before them were discarded.
    gaps: u32,
    hand: Arc<Hand>,
    arm: Arc<Arm>,
    kinematics: ArmKinematics,
    limits: DetectionLimits,
    /// Masses of objects as known to the controller, kg.
    masses: Arc<BTreeMap<String, f64>>,
    servos_before: ActuatorVector<ServoState>,
    arm_before: ArmState,
    residuals: Residuals,
    cables: Vec<CableWatch>,
    hand_watch: HandWatch,
    cameras: CameraWatch,
    held_pose: HeldPoseTracker,
    faults: Vec<DetectedFault>,
}

impl FaultDetector {
    /// Creates the reference model from the controller's `world`, the arm at rest at the measured angles `arm` (rad).
    pub fn new(world: &SimulatedWorld, arm: &ArmVector) -> Result<Self, LimitsError> {
        let masses = world.objects.iter().map(|object| (object.name.clone(), object.mass)).collect();
        Ok(Self {
            reference_model: ReferenceModel::new(world, arm),
            resampler: Resampler::default(),
            gaps: 0,
            hand: world.cell.robot.hand.clone(),
            arm: world.cell.robot.arm.clone(),
            kinematics: world.cell.kinematics(),
            limits: DetectionLimits::standard()?,
            masses: Arc::new(masses),
            servos_before: world.cell.robot.hand.each_actuator(|_| ServoState::default()),
            arm_before: ArmState::default(),
            residuals: Residuals::default(),
            cables: vec![CableWatch::default(); world.cell.robot.hand.cables.len()],
            hand_watch: HandWatch::default(),
            cameras: CameraWatch::new(world.cell.robot.hand.cameras.len()),
            held_pose: HeldPoseTracker::default(),
            faults: Vec::new(),
        })
    }

    /// Processes an observation, made one tick after the last one or whenever the robot's host had the time. Returns
    /// the new faults.
    pub fn update(&mut self, seen: &TickMeasurements) -> &[DetectedFault] {
        let known = self.faults.len();
        let snapshot = Observation {
            time: seen.time,
            servos: seen.servos.iter().copied().collect(),
            arm: *seen.arm,
            sent: *seen.sent,
        };
        match self.resampler.resample(&snapshot, self.reference_model.tick_length()) {
            Resampled::Tick => self.tick(seen),
            Resampled::EvenTicks(ticks) => {
                for Observation { time, servos, arm, sent } in &ticks {
                    self.tick(&TickMeasurements { time: *time, servos, arm, sent, ..*seen });
                }
            }
            Resampled::Gap(ticks) => {
                self.gaps += 1;
                self.advance_unobserved(ticks, seen);
            }
        }
        let cameras = self.cameras.update(
            &self.limits.camera,
            (seen.time, seen.sent.capture, self.resampler.is_uneven()),
            seen.images,
        );
        for (camera, finding) in cameras {
            let part = camera.map_or_else(|| "all cameras".to_owned(), |camera| self.hand.cameras[camera].name.clone());
            self.report(seen.time, part, finding);
        }
        &self.faults[known..]
    }

    /// Lets the reference model follow its last command for `ticks` ticks without observations, and then resets the
    /// detectors of cables and hand. Those of cameras and the pose estimate are kept.
    fn advance_unobserved(&mut self, ticks: usize, seen: &TickMeasurements) {
        for _ in 0..ticks {
            self.reference_model.advance();
        }
        self.reference_model.correct(seen.servos, seen.arm, true);
        self.servos_before = seen.servos.iter().copied().collect();
        self.arm_before = *seen.arm;
        self.cables.fill(CableWatch::default());
        self.hand_watch.skip_tick();
        self.held_pose.update(seen.time, seen.phase, seen.felt);
        self.reference_model.advance_with(seen.sent);
    }

    /// Processes one tick.
    fn tick(&mut self, seen: &TickMeasurements) {
        let innovation = self.reference_model.correct(seen.servos, seen.arm, self.resampler.is_uneven());
        let (_, jacobian) = self.kinematics.jacobian(&seen.arm.position);
        let readings = [&self.servos_before, seen.servos];
        self.residuals =
            Residuals::new(&self.hand, readings, self.reference_model.tick_length(), &innovation, &jacobian);
        self.servos_before = seen.servos.iter().copied().collect();
        self.held_pose.update(seen.time, seen.phase, seen.felt);
        // An arm that repeats its state to the last bit is disconnected: the reference model moves on, and the
        // difference is no force.
        if std::mem::replace(&mut self.arm_before, *seen.arm) != *seen.arm {
            self.check_hand(seen);
        }
        self.check_cables(seen.time);
        self.reference_model.advance_with(seen.sent);
    }

    /// Returns the number of gaps so far that invalidated the observations before them.
    pub fn gaps(&self) -> u32 {
        self.gaps
    }

    /// True if a joint of the arm, at `angles` (rad), is so near its stop that the stop may bear some of the load on
    /// the hand.
    fn is_on_stop(&self, angles: &[f64]) -> bool {
        let near = self.limits.hand.stop;
        self.arm.tree.joints.iter().zip(angles).any(|(joint, at)| at - joint.lower < near || joint.upper - at < near)
    }

    fn check_hand(&mut self, seen: &TickMeasurements) {
        if self.is_on_stop(&seen.arm.position) {
            self.hand_watch.skip_tick();
            return;
        }
        let mass = |target: &GraspTarget| self.masses.get(&target.grasp.object).copied().unwrap_or(0.0);
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
        if let Some(finding) = self.hand_watch.update(&self.limits, &tick) {
            if finding.0 == FaultKind::ObjectLost {
                self.held_pose.clear();
            }
            self.report(seen.time, "hand".to_owned(), finding);
        }
    }

    fn check_cables(&mut self, time: f64) {
        let wrench = self.hand_watch.external_wrench(&self.limits.hand);
        for digit in self.hand.digits() {
            let n = digit.index();
            let finding = self.cables[n].update(&self.limits.cable, time, &self.residuals.cables[n], wrench);
            if let Some(finding) = finding {
                self.report(time, digit.name().to_owned(), finding);
            }
        }
    }

    fn report(&mut self, time: f64, part: String, (kind, found, expected): Finding) {
        self.faults.push(DetectedFault { time, kind, part, found, expected });
    }

    /// Returns all faults detected so far.
    pub fn faults(&self) -> &[DetectedFault] {
        &self.faults
    }

    /// Returns the residuals of the last tick.
    pub fn residuals(&self) -> &Residuals {
        &self.residuals
    }

    /// Returns the reference model.
    pub fn reference_model(&self) -> &ReferenceModel {
        &self.reference_model
    }

    /// Returns the pose estimate of the object in the hand, and the `world_from_object` derived from it.
    pub fn held_object(&self) -> Option<(&HeldPose, Isometry3<f64>)> {
        self.held_pose.object().map(|estimate| (estimate, self.reference_model.palm() * estimate.palm_from_object))
    }
}
