//! External disturbances of a scene: forces, slippery objects, servos without power, failed cameras.
//!
//! Like the ground truth, they are available on the concrete type alone: no controller that holds a
//! [`hand_model::robot::RobotBackend`] can reach them.

use std::sync::Arc;

use hand_model::Digit;
use hand_model::hand::MAX_ACTUATORS;
use hand_model::robot::{RobotCommand, ServoGoal, TactileFrame, TactileImage};
use nalgebra::Vector3;
use plant::CameraFailure;
use rapier3d_f64::prelude::RigidBodyHandle;

use crate::convert;
use crate::engine::Engine;

/// Index of the servo of the thumb's opposition, which has no cable.
const OPPOSITION_SERVO: usize = 5;

/// External disturbances that are present.
#[derive(Clone, Default)]
pub(super) struct ExternalDisturbances {
    /// Forces of the next tick: object (`None` for the palm) and force, N.
    forces: Vec<(Option<usize>, Vector3<f64>)>,
    /// Servos without power.
    unpowered: [bool; MAX_ACTUATORS],
    /// Failed cameras.
    failed: Vec<(usize, CameraFailure)>,
}

/// A force on a body during one tick.
pub(super) struct AppliedForce {
    pub(super) body: RigidBodyHandle,
    /// Point of application, world, m; `None` for the body's centre of mass.
    pub(super) point: Option<Vector3<f64>>,
    /// Force, world axes, N.
    pub(super) force: Vector3<f64>,
}

impl ExternalDisturbances {
    pub(super) fn add_force(&mut self, on: Option<usize>, force: Vector3<f64>) {
        self.forces.push((on, force));
    }

    pub(super) fn cut_power(&mut self, digits: &[Digit]) {
        for digit in digits {
            self.unpowered[digit.index()] = true;
            self.unpowered[OPPOSITION_SERVO] |= *digit == Digit::Thumb;
        }
    }

    pub(super) fn fail_cameras(&mut self, cameras: impl Iterator<Item = usize>, how: CameraFailure) {
        self.failed.extend(cameras.map(|camera| (camera, how)));
    }

    /// Takes the forces of the next tick and clears them.
    pub(super) fn take_forces(&mut self) -> Vec<(Option<usize>, Vector3<f64>)> {
        std::mem::take(&mut self.forces)
    }

    pub(super) fn apply_forces(targets: &[AppliedForce], engine: &mut Engine) {
        for target in targets {
            let body = &mut engine.bodies[target.body];
            let point = target.point.map_or_else(|| body.center_of_mass(), |point| convert::vector(&point));
            body.add_force_at_point(convert::vector(&target.force), point, true);
        }
    }

    pub(super) fn clear_forces(targets: &[AppliedForce], engine: &mut Engine) {
        for target in targets {
            let body = &mut engine.bodies[target.body];
            body.reset_forces(true);
            body.reset_torques(true);
        }
    }

    pub(super) fn cut_current(&self, command: &mut RobotCommand) {
        for (goal, unpowered) in command.servos.iter_mut().zip(self.unpowered) {
            if unpowered {
                *goal = ServoGoal::Current(0.0);
            }
        }
    }

    pub(super) fn drop_failed_frames(&self, frames: &mut Vec<TactileFrame>) {
        for (camera, how) in &self.failed {
            match how {
                CameraFailure::Missing => frames.retain(|frame| frame.camera != *camera),
                CameraFailure::Black => {
                    for frame in frames.iter_mut().filter(|frame| frame.camera == *camera) {
                        frame.image = Arc::new(TactileImage { rgb: vec![0; frame.image.rgb.len()] });
                    }
                }
            }
        }
    }
}
