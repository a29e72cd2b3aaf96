//! The side door by which the robot itself breaks: cables, joints, servos, lamps and cameras.
//!
//! Like the truth it is on the concrete type alone: no controller that holds a [`hand_model::robot::RobotBackend`] can reach it.

use std::collections::BTreeMap;
use std::sync::Arc;

use hand_model::robot::{TactileFrame, TactileImage};
use rapier3d_f64::prelude::MassProperties;

use super::SimulatedRobot;
use crate::convert;
use crate::drive::JointEffort;

/// More cable than there is, m: none is left on the spool's side of the break.
const ALL_OF_IT: f64 = 10.0;
/// Stiffness of a joint that is stuck, N m/rad: it gives by some milliradians under the strongest pull.
const STUCK: f64 = 50.0;

/// What is broken.
#[derive(Clone, Default)]
pub(super) struct Broken {
    /// Stuck finger joints, and where, rad.
    stuck: BTreeMap<usize, f64>,
    /// Cameras that send their last image on and on.
    frozen: Vec<usize>,
    /// Camera, channel of the lamp's colour, and the share of its light that is left.
    dimmed: Vec<(usize, usize, f32)>,
    /// The last image of each camera.
    last: BTreeMap<usize, Arc<TactileImage>>,
}

impl Broken {
    /// What acts on finger joint `joint` at angle `q` (rad), with what holds it if it is stuck.
    pub(super) fn effort(&self, joint: usize, q: f64, effort: JointEffort) -> JointEffort {
        self.stuck.get(&joint).map_or(effort, |at| JointEffort {
            torque: effort.torque + STUCK * (at - q),
            stiffness: effort.stiffness + STUCK,
        })
    }

    /// The images as broken cameras send them.
    pub(super) fn spoil(&mut self, frames: &mut [TactileFrame]) {
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
    /// Cable `n` is broken from now on.
    pub fn break_cable(&mut self, n: usize) {
        self.drive.let_go(n, ALL_OF_IT);
    }

    /// Cable `n` slips on its spool by `length`, m.
    pub fn slip_cable(&mut self, n: usize, length: f64) {
        self.drive.let_go(n, length);
    }

    /// Servo `n` gives `factor` times the torque at the same current from now on.
    pub fn weaken_servo(&mut self, n: usize, factor: f64) {
        self.drive.weaken(n, factor);
    }

    /// Finger joint `joint` is stuck where it is from now on.
    pub fn stick_joint(&mut self, joint: usize) {
        self.broken.stuck.insert(joint, self.state.hand[joint]);
    }

    /// Object `index` weighs `more` from now on, kg, spread over it as before.
    pub fn add_mass(&mut self, index: usize, more: f64) {
        let (model, body, _) = &self.objects[index];
        // Before the first step after it was put in, the engine has not summed up its mass yet.
        self.engine.bodies[*body].recompute_mass_properties_from_colliders(&self.engine.colliders);
        let mass = self.engine.bodies[*body].mass() + more;
        let (com, inertia) = model.shape.inertia(mass);
        let properties = MassProperties::with_inertia_matrix(convert::point(&com), mass, convert::matrix(&inertia));
        self.engine.bodies[*body].set_additional_mass_properties(properties, true);
    }

    /// Camera `camera` sends its last image on and on from now on.
    pub fn freeze_camera(&mut self, camera: usize) {
        self.broken.frozen.push(camera);
    }

    /// The lamp of camera `camera` whose light is in colour `channel` (red, green, blue) has the share `left` of its light from now on.
    pub fn dim_lamp(&mut self, camera: usize, channel: usize, left: f32) {
        self.broken.dimmed.push((camera, channel, left));
    }
}
