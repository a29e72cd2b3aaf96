//! Interface by which a reference model tracks a robot from measurements alone.

use hand_model::robot::ServoState;

use super::SimulatedRobot;

impl SimulatedRobot {
    /// Sets all servos to the measured angles and speeds; cables and joints follow by their dynamics.
    pub fn follow_servos(&mut self, measured: &[ServoState]) {
        self.drive.set_measured(measured);
    }

    /// Returns the cable tensions at the spools, N.
    pub fn tensions(&self) -> &[f64] {
        &self.drive.tensions
    }
}
