//! The one interface between a controller and a body, simulated or real.
//!
//! A body is driven by ticks and owns time: [`Robot::observe`] gives the newest measurements, [`Robot::send`] takes a command
//! and answers with the one *actually sent* after limits, [`Robot::wait_for_tick`] lets a tick pass. No body offers ground
//! truth: object poses, noise draws and true contact forces reach only the referee, by a side door of the simulator.

use std::sync::Arc;

use crate::{ACTUATORS, ARM_JOINTS};

/// What one servo reports.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ServoState {
    /// Output angle, rad, multi-turn, quantised by the encoder; 0 is the slack cable of an open digit.
    pub position: f64,
    /// rad/s.
    pub velocity: f64,
    /// Input current, A.
    pub current: f64,
    /// Degrees Celsius.
    pub temperature: f64,
}

/// What the arm reports.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ArmState {
    /// rad.
    pub position: [f64; ARM_JOINTS],
    /// rad/s.
    pub velocity: [f64; ARM_JOINTS],
    /// N m.
    pub torque: [f64; ARM_JOINTS],
}

/// A 240 x 240 RGB picture of the inside of a pad.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TactileImage {
    /// Row-major RGB, `IMAGE_SIZE * IMAGE_SIZE * 3` bytes.
    pub rgb: Vec<u8>,
}

/// An image as it arrived.
#[derive(Debug, Clone)]
pub struct TactileFrame {
    /// Index of the camera.
    pub camera: usize,
    /// Capture time, s.
    pub time: f64,
    /// Sequence number of this camera.
    pub sequence: u64,
    /// Pixels; shared, because an idle pad sends the same image again and again.
    pub image: Arc<TactileImage>,
}

/// Everything measured up to now.
#[derive(Debug, Clone, Default)]
pub struct Observation {
    /// Time of the measurement, s since the body was started.
    pub time: f64,
    /// Number of the tick.
    pub sequence: u64,
    /// The six servos, in actuator order.
    pub servos: [ServoState; ACTUATORS],
    pub arm: ArmState,
    /// Tactile images that arrived since the last observation.
    pub tactile: Vec<TactileFrame>,
}

/// What a servo is asked to do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ServoGoal {
    /// Current control: A, positive winds the cable.
    Current(f64),
    /// Current-based position control: output angle in rad under a current limit in A.
    Position {
        /// rad.
        angle: f64,
        /// A.
        current_limit: f64,
    },
}

/// One tick's command.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Command {
    /// Arm joint position set-points, rad.
    pub arm: [f64; ARM_JOINTS],
    /// The six servos, in actuator order.
    pub servos: [ServoGoal; ACTUATORS],
    /// Ask the camera board for one image of every camera.
    pub capture: bool,
}

/// What passed with a tick.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tick {
    /// s since the body was started.
    pub time: f64,
    /// How late the tick was, s; 0 in simulation.
    pub lateness: f64,
}

/// A body that can be driven.
pub trait Robot {
    /// The newest measurements.
    fn observe(&mut self) -> Observation;
    /// Takes a command; returns what was sent after limits.
    fn send(&mut self, command: &Command) -> Command;
    /// Lets one control tick pass.
    fn wait_for_tick(&mut self) -> Tick;
    /// Length of a control tick, s.
    fn tick_length(&self) -> f64;
}

impl<R: Robot + ?Sized> Robot for Box<R> {
    fn observe(&mut self) -> Observation {
        (**self).observe()
    }

    fn send(&mut self, command: &Command) -> Command {
        (**self).send(command)
    }

    fn wait_for_tick(&mut self) -> Tick {
        (**self).wait_for_tick()
    }

    fn tick_length(&self) -> f64 {
        (**self).tick_length()
    }
}
