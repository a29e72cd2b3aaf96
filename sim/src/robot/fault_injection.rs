//! Fault injection into the robot itself: cables, joints, servos, lamps and cameras.
//!
//! Like the ground truth, it is available on the concrete type alone: no controller that holds a
//! [`hand_model::robot::RobotBackend`] can reach it.

use std::collections::BTreeMap;
use std::sync::Arc;

use hand_model::robot::{TactileFrame, TactileImage};
use rapier3d_f64::prelude::MassProperties;

use super::SimulatedRobot;
use crate::convert;
use crate::drive::JointEffort;

/// Length greater than any cable, m: none is left on the spool's side of the break.
const BROKEN_CABLE_LENGTH: f64 = 10.0;
/// Stiffness of a stuck joint, N m/rad: it yields by a few milliradians under the strongest pull.
const STUCK_JOINT_STIFFNESS: f64 = 50.0;

/// Faults that are present.
#[derive(Clone, Default)]
pub(super) struct RobotFaults {
    /// Stuck finger joints with their angles, rad.
    stuck: BTreeMap<usize, f64>,
    /// Cameras that repeat their last image.
    frozen: Vec<usize>,
    /// Camera, colour channel of the lamp, and the remaining fraction of its light.
    dimmed: Vec<(usize, usize, f32)>,
    /// The last image of each camera.
    last: BTreeMap<usize, Arc<TactileImage>>,
}

impl RobotFaults {
    /// Adds the holding effort of a stuck joint to the load on finger joint `joint` at angle `q` (rad).
    pub(super) fn effort_with_faults(&self, joint: usize, q: f64, effort: JointEffort) -> JointEffort {
        self.stuck.get(&joint).map_or(effort, |at| JointEffort {
            torque: effort.torque + STUCK_JOINT_STIFFNESS * (at - q),
            stiffness: effort.stiffness + STUCK_JOINT_STIFFNESS,
        })
    }

    /// Changes images to those that the broken cameras send.
    pub(super) fn corrupt_images(&mut self, frames: &mut [TactileFrame]) {
        for frame in frames {
            if let Some(last) = self.last.get(&frame.camera).filter(|_| self.frozen.contains(&frame.camera)) {
                frame.image = last.clone();
                continue;
            }
            for (_, channel, left) in self.dimmed.iter().filter(|(camera, ..)| *camera == frame.camera) {
                let mut rgb = frame.image.rgb.clone();
                rgb.iter_mut().skip(*channel).step_by(3).for_each(|value| *value = (f32::from(*value) * left) as u8);
                frame.image = Arc::new(TactileImage { rgb });
            }
            self.last.insert(frame.camera, frame.image.clone());
        }
    }
}

impl SimulatedRobot {
    /// Breaks cable `n` from now on.
    pub fn break_cable(&mut self, n: usize) {
        self.drive.release_cable(n, BROKEN_CABLE_LENGTH);
    }

    /// Lets cable `n` slip on its spool by `length`, m.
    pub fn slip_cable(&mut self, n: usize, length: f64) {
        self.drive.release_cable(n, length);
    }

    /// Scales the torque of servo `n` at the same current by `factor` from now on.
    pub fn weaken_servo(&mut self, n: usize, factor: f64) {
        self.drive.weaken(n, factor);
    }

    /// Makes finger joint `joint` stick at its present angle from now on.
    pub fn stick_joint(&mut self, joint: usize) {
        self.faults.stuck.insert(joint, self.state.hand[joint]);
    }

    /// Adds `more` (kg) to the mass of object `index` from now on, distributed as before.
    pub fn add_mass(&mut self, index: usize, more: f64) {
        let (model, body, _) = &self.objects[index];
        // Before the first step after the object's insertion, the engine has not yet computed its mass.
        self.engine.bodies[*body].recompute_mass_properties_from_colliders(&self.engine.colliders);
        let mass = self.engine.bodies[*body].mass() + more;
        let (com, inertia) = model.shape.inertia(mass);
        let properties = MassProperties::with_inertia_matrix(convert::point(&com), mass, convert::matrix(&inertia));
        self.engine.bodies[*body].set_additional_mass_properties(properties, true);
    }

    /// Makes camera `camera` repeat its last image from now on.
    pub fn freeze_camera(&mut self, camera: usize) {
        self.faults.frozen.push(camera);
    }

    /// Dims the lamp of camera `camera` with colour `channel` (red, green, blue) to the fraction `left` of its light
    /// from now on.
    pub fn dim_lamp(&mut self, camera: usize, channel: usize, left: f32) {
        self.faults.dimmed.push((camera, channel, left));
    }
}
