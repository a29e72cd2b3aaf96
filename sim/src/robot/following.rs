//! The side door by which a twin is kept beside the robot that it mirrors: from measurements alone.

use hand_model::robot::ServoState;
use hand_model::{ACTUATORS, ARM_JOINTS, HAND_JOINTS};
use nalgebra::Isometry3;

use super::SimulatedRobot;

impl SimulatedRobot {
    /// All servos are where `measured` says, and as fast; cables and joints follow in their own time.
    pub fn follow_servos(&mut self, measured: &[ServoState; ACTUATORS]) {
        self.drive.follow(measured);
    }

    /// Finger angles, rad.
    pub fn finger_angles(&self) -> &[f64; HAND_JOINTS] {
        &self.state.hand
    }

    /// Cable tensions at the spools, N.
    pub fn tensions(&self) -> &[f64; 5] {
        &self.drive.tensions
    }

    /// `world_from_link` of the arm's seven links, and `world_from_palm`.
    pub fn arm_poses(&self) -> (Vec<Isometry3<f64>>, Isometry3<f64>) {
        let mut links = self.body.link_poses(&self.engine);
        let palm = self.palm(&links);
        links.truncate(ARM_JOINTS);
        (links, palm)
    }
}
