//! The side door by which a scene is disturbed from outside: forces, slippery objects, servos without power, failed cameras.
//!
//! Like the truth it is on the concrete type alone: no controller that holds a [`hand_model::robot::Robot`] can reach it.

use std::sync::Arc;

use hand_model::robot::{Command, ServoGoal, TactileImage};
use hand_model::{ACTUATORS, Digit};
use nalgebra::Vector3;
use rapier3d_f64::prelude::RigidBodyHandle;
use scenarios::disturbance::Blindness;

use super::SimulatedRobot;
use crate::convert;

/// The servo of the thumb's opposition, which has no cable.
const OPPOSITION: usize = 5;

/// What acts on the scene from outside.
#[derive(Clone, Default)]
pub(super) struct Outside {
    /// For the next tick: object (`None` is the palm) and force, N.
    forces: Vec<(Option<usize>, Vector3<f64>)>,
    /// Servos without power.
    unpowered: [bool; ACTUATORS],
    /// Failed cameras.
    failed: Vec<(usize, Blindness)>,
}

impl SimulatedRobot {
    /// A force (N, world axes) during the next tick on object `on`, at its centre of mass, or on the palm's origin.
    pub fn pull(&mut self, on: Option<usize>, force: Vector3<f64>) {
        self.outside.forces.push((on, force));
    }

    /// Object `index` has `factor` times the friction of its model from now on.
    pub fn set_friction(&mut self, index: usize, factor: f64) {
        let (model, _, collider) = &self.objects[index];
        self.engine.colliders[*collider].set_friction(factor * model.friction);
    }

    /// The servos of these digits are without power from now on, the thumb's opposition with the thumb.
    pub fn cut_power(&mut self, digits: &[Digit]) {
        for digit in digits {
            self.outside.unpowered[digit.index()] = true;
            self.outside.unpowered[OPPOSITION] |= *digit == Digit::Thumb;
        }
    }

    /// The cameras of the pads of these names fail from now on.
    pub fn fail_cameras(&mut self, pads: &[String], how: Blindness) {
        let named = self.hand.pads.iter().filter(|pad| pads.contains(&pad.name));
        self.outside.failed.extend(named.flat_map(|pad| pad.cameras.iter().map(|camera| (*camera, how))));
    }

    fn acted_on(&self, on: Option<usize>) -> RigidBodyHandle {
        on.map_or_else(|| self.body.palm_link(), |index| self.objects[index].1)
    }

    pub(super) fn begin_forces(&mut self) {
        for (on, force) in self.outside.forces.clone() {
            let palm = self.palm(&self.body.link_poses(&self.engine)).translation.vector;
            let handle = self.acted_on(on);
            let body = &mut self.engine.bodies[handle];
            let point = if on.is_some() { body.center_of_mass() } else { convert::vector(&palm) };
            body.add_force_at_point(convert::vector(&force), point, true);
        }
    }

    pub(super) fn end_forces(&mut self) {
        for (on, _) in std::mem::take(&mut self.outside.forces) {
            let handle = self.acted_on(on);
            let body = &mut self.engine.bodies[handle];
            body.reset_forces(true);
            body.reset_torques(true);
        }
    }

    pub(super) fn without_power(&self, command: &mut Command) {
        for (goal, unpowered) in command.servos.iter_mut().zip(self.outside.unpowered) {
            if unpowered {
                *goal = ServoGoal::Current(0.0);
            }
        }
    }

    pub(super) fn drop_failed_frames(&mut self) {
        for (camera, how) in &self.outside.failed {
            match how {
                Blindness::Missing => self.frames.retain(|frame| frame.camera != *camera),
                Blindness::Black => {
                    for frame in self.frames.iter_mut().filter(|frame| frame.camera == *camera) {
                        frame.image = Arc::new(TactileImage { rgb: vec![0; frame.image.rgb.len()] });
                    }
                }
            }
        }
    }
}
