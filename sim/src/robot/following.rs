//! The side door by which a twin is kept beside the robot that it mirrors: from measurements alone.

use hand_model::robot::ServoState;

use super::SimulatedRobot;

impl SimulatedRobot {
    /// All servos are where `measured` says, and as fast; cables and joints follow in their own time.
    pub fn follow_servos(&mut self, measured: &[ServoState]) {
        self.drive.follow(measured);
    }

    /// Cable tensions at the spools, N.
    pub fn tensions(&self) -> &[f64] {
        &self.drive.tensions
    }
}
