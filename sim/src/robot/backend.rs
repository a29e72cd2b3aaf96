//! The simulated robot as a backend in its own right, and as the plant behind emulated devices.

use hand_model::robot::{Observation, Plant, Readings, RobotBackend, RobotCommand, RobotError, Tick};

use super::SimulatedRobot;

impl RobotBackend for SimulatedRobot {
    fn observe(&mut self) -> Result<Readings, RobotError> {
        Ok(self.observe().into())
    }

    fn send(&mut self, command: &RobotCommand) -> Result<RobotCommand, RobotError> {
        Ok(self.send(command))
    }

    fn wait_for_tick(&mut self) -> Tick {
        self.wait_for_tick()
    }

    fn tick_length(&self) -> f64 {
        self.tick_length()
    }
}

impl Plant for SimulatedRobot {
    fn observe(&mut self) -> Observation {
        self.observe()
    }

    fn send(&mut self, command: &RobotCommand) -> RobotCommand {
        self.send(command)
    }

    fn wait_for_tick(&mut self) -> Tick {
        self.wait_for_tick()
    }

    fn tick_length(&self) -> f64 {
        self.tick_length()
    }
}
