//! The one interface between a controller and a robot, simulated or real.
//!
//! A backend is driven by ticks and owns time: [`RobotBackend::observe`] gives the newest readings, [`RobotBackend::send`] takes a command
//! and answers with the one *actually sent* after limits, [`RobotBackend::wait_for_tick`] lets a tick pass. The first two can fail, and a
//! reading may be missing: a controller holds until it has an [`Observation`] again ([`Readings::complete`]). No backend offers ground
//! truth: object poses, noise draws and true contact forces reach only the referee, by a side door of the simulator.
//!
//! A [`Plant`] is the physics behind emulated devices. It cannot fail.

use std::sync::Arc;

use crate::{ActuatorVector, ArmVector};

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

/// The arm's measurements, a value for each joint.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ArmState {
    /// rad.
    pub position: ArmVector,
    /// rad/s.
    pub velocity: ArmVector,
    /// N m.
    pub torque: ArmVector,
}

impl ArmState {
    /// At rest at `position` (rad), without torques.
    pub fn still(position: ArmVector) -> Self {
        let none = position.iter().map(|_| 0.0).collect();
        Self { position, velocity: none, torque: none }
    }
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

/// A measured value with its time of validity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading<T> {
    pub value: T,
    /// s since the backend was started.
    pub time: f64,
}

/// The newest readings of a backend. What was never read is absent.
#[derive(Debug, Clone, Default)]
pub struct Readings {
    /// s since the backend was started.
    pub time: f64,
    /// Number of the tick.
    pub sequence: u64,
    /// Of each actuator.
    pub servos: ActuatorVector<Option<Reading<ServoState>>>,
    pub arm: Option<Reading<ArmState>>,
    /// Tactile images that arrived since the last readings.
    pub tactile: Vec<TactileFrame>,
}

impl Readings {
    /// All that a controller acts on.
    ///
    /// # Errors
    /// [`RobotError::Unread`] with the first device that was never read.
    pub fn complete(self) -> Result<Observation, RobotError> {
        let mut servos = ActuatorVector::new();
        for (n, reading) in self.servos.into_iter().enumerate() {
            servos.push(reading.ok_or(RobotError::Unread(Device::Servo(n)))?.value);
        }
        let arm = self.arm.ok_or(RobotError::Unread(Device::Arm))?.value;
        Ok(Observation { time: self.time, sequence: self.sequence, servos, arm, tactile: self.tactile })
    }
}

impl From<Observation> for Readings {
    /// Every reading is valid at the observation's time.
    fn from(observation: Observation) -> Self {
        let Observation { time, sequence, servos, arm, tactile } = observation;
        let servos = servos.into_iter().map(|value| Some(Reading { value, time })).collect();
        Self { time, sequence, servos, arm: Some(Reading { value: arm, time }), tactile }
    }
}

/// A part of the robot that is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Device {
    /// By index of its actuator.
    Servo(usize),
    Arm,
}

impl std::fmt::Display for Device {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Servo(index) => write!(f, "servo {}", index + 1),
            Self::Arm => f.write_str("arm"),
        }
    }
}

/// A backend could not observe or send.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RobotError {
    /// Nothing was ever read of a device.
    #[error("{0}: not read yet")]
    Unread(Device),
    /// The command did not go out in time.
    #[error("the command was not sent within {0:.3} s")]
    NotSent(f64),
    /// The cameras could not be asked for images.
    #[error("images could not be asked for: {0}")]
    Capture(String),
    /// Nobody answers any more.
    #[error("{0}")]
    Lost(String),
}

/// Everything measured up to now.
#[derive(Debug, Clone, Default)]
pub struct Observation {
    /// Time of the measurement, s since the body was started.
    pub time: f64,
    /// Number of the tick.
    pub sequence: u64,
    /// Of each actuator.
    pub servos: ActuatorVector<ServoState>,
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

impl Default for ServoGoal {
    /// Free to turn: no current.
    fn default() -> Self {
        Self::Current(0.0)
    }
}

/// One tick's command.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Command {
    /// Arm joint position set-points, rad.
    pub arm: ArmVector,
    /// Of each actuator.
    pub servos: ActuatorVector<ServoGoal>,
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

/// A robot that can be driven.
pub trait RobotBackend {
    /// The newest readings.
    ///
    /// # Errors
    /// Why nothing could be observed.
    fn observe(&mut self) -> Result<Readings, RobotError>;
    /// Takes a command; returns what was sent after limits. It does not wait for longer than a tick or two.
    ///
    /// # Errors
    /// Why nothing was sent.
    fn send(&mut self, command: &Command) -> Result<Command, RobotError>;
    /// Lets one control tick pass.
    fn wait_for_tick(&mut self) -> Tick;
    /// Length of a control tick, s.
    fn tick_length(&self) -> f64;
}

impl<R: RobotBackend + ?Sized> RobotBackend for Box<R> {
    fn observe(&mut self) -> Result<Readings, RobotError> {
        (**self).observe()
    }

    fn send(&mut self, command: &Command) -> Result<Command, RobotError> {
        (**self).send(command)
    }

    fn wait_for_tick(&mut self) -> Tick {
        (**self).wait_for_tick()
    }

    fn tick_length(&self) -> f64 {
        (**self).tick_length()
    }
}

/// Physics that emulated devices act on. Its methods are those of a [`RobotBackend`] that never fails.
pub trait Plant {
    fn observe(&mut self) -> Observation;
    /// Takes a command; returns what it follows.
    fn send(&mut self, command: &Command) -> Command;
    fn wait_for_tick(&mut self) -> Tick;
    /// Length of a control tick, s.
    fn tick_length(&self) -> f64;
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A servo that was never read is not at 0 rad.
    #[test]
    fn what_was_never_read_is_no_observation() {
        let servos = [ServoState::default(); 6].into();
        let whole = Readings::from(Observation { time: 0.5, sequence: 3, servos, ..Observation::default() });
        assert_eq!(whole.arm.map(|arm| arm.time), Some(0.5));
        let mut part = whole.clone();
        part.servos[2] = None;
        let error = part.complete().expect_err("incomplete");
        assert_eq!(error, RobotError::Unread(Device::Servo(2)));
        assert_eq!(error.to_string(), "servo 3: not read yet");
        let part = Readings { arm: None, ..whole.clone() };
        assert_eq!(part.complete().expect_err("incomplete"), RobotError::Unread(Device::Arm));
        assert_eq!(whole.complete().expect("complete").sequence, 3);
    }
}
