//! The one interface between a controller and a robot, simulated or real.
//!
//! A backend is driven by ticks and owns the clock. [`RobotBackend::observe`] returns the newest readings,
//! [`RobotBackend::send`] takes a command and returns the one *actually sent* after limits, and
//! [`RobotBackend::wait_for_tick`] lets a tick pass. The first two can fail, and a reading may be missing: a controller
//! holds until it has an [`Observation`] again ([`Readings::into_observation`]). No backend offers ground truth: object
//! poses, noise samples and true contact forces reach only the referee, through a separate interface of the simulator.
//!
//! A [`Plant`] is the physics behind emulated devices. It cannot fail.
//!
//! # Your own robot
//! Implement [`RobotBackend`] for your robot or simulator. Servo values are listed in the order of the model's
//! actuators ([`crate::Hand::servos`]), joint values in that of the arm's joints. A robot without an arm or without
//! cameras reports nothing for them; see the example `backend` of this package.

use std::sync::Arc;

use crate::{ActuatorVector, ArmVector};

/// State that one servo reports.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ServoState {
    /// Output angle, rad, multi-turn, quantised by the encoder; 0 corresponds to the slack cable of an open digit.
    pub position: f64,
    /// Velocity, rad/s.
    pub velocity: f64,
    /// Input current, A.
    pub current: f64,
    /// Temperature, degrees Celsius.
    pub temperature: f64,
}

/// Measurements of the arm, one value per joint.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ArmState {
    /// Joint angles, rad.
    pub position: ArmVector,
    /// Joint velocities, rad/s.
    pub velocity: ArmVector,
    /// Joint torques, N m.
    pub torque: ArmVector,
}

impl ArmState {
    /// Returns the state at rest at `position` (rad), without torques.
    pub fn at_rest(position: ArmVector) -> Self {
        let none = position.iter().map(|_| 0.0).collect();
        Self { position, velocity: none, torque: none }
    }
}

/// A 240 x 240 RGB image of the inside of a pad.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TactileImage {
    /// Row-major RGB, `IMAGE_SIZE * IMAGE_SIZE * 3` bytes.
    pub rgb: Vec<u8>,
}

/// A tactile image with its arrival data.
#[derive(Debug, Clone)]
pub struct TactileFrame {
    /// Index of the camera.
    pub camera: usize,
    /// Capture time, s.
    pub time: f64,
    /// Sequence number of the frame for this camera.
    pub sequence: u64,
    /// Pixels; shared, because an idle pad sends the same image again and again.
    pub image: Arc<TactileImage>,
}

/// A measured value with its time of validity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading<T> {
    /// The measured value.
    pub value: T,
    /// Time of validity, s since the backend was started.
    pub time: f64,
}

/// The newest readings of a backend. A device that was never read is absent.
#[derive(Debug, Clone, Default)]
pub struct Readings {
    /// Time, s since the backend was started.
    pub time: f64,
    /// Number of the tick.
    pub sequence: u64,
    /// Reading of each actuator.
    pub servos: ActuatorVector<Option<Reading<ServoState>>>,
    /// Reading of the arm.
    pub arm: Option<Reading<ArmState>>,
    /// Tactile images that arrived since the last readings.
    pub tactile: Vec<TactileFrame>,
}

impl Readings {
    /// Converts to an observation that is complete enough to act on.
    ///
    /// # Errors
    /// [`RobotError::Unread`] with the first device that was never read.
    pub fn into_observation(self) -> Result<Observation, RobotError> {
        let mut servos = ActuatorVector::new();
        for (n, reading) in self.servos.into_iter().enumerate() {
            servos.push(reading.ok_or(RobotError::Unread(RobotDevice::Servo(n)))?.value);
        }
        let arm = self.arm.ok_or(RobotError::Unread(RobotDevice::Arm))?.value;
        Ok(Observation { time: self.time, sequence: self.sequence, servos, arm, tactile: self.tactile })
    }
}

impl From<Observation> for Readings {
    /// Marks every reading as valid at the observation's time.
    fn from(observation: Observation) -> Self {
        let Observation { time, sequence, servos, arm, tactile } = observation;
        let servos = servos.into_iter().map(|value| Some(Reading { value, time })).collect();
        Self { time, sequence, servos, arm: Some(Reading { value: arm, time }), tactile }
    }
}

/// A part of the robot that can be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RobotDevice {
    /// A servo, by the index of its actuator.
    Servo(usize),
    /// The arm.
    Arm,
}

impl std::fmt::Display for RobotDevice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Servo(index) => write!(f, "servo {}", index + 1),
            Self::Arm => f.write_str("arm"),
        }
    }
}

/// A failure of a backend to observe or to send.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RobotError {
    /// A device has not been read yet.
    #[error("{0}: not read yet")]
    Unread(RobotDevice),
    /// The command did not go out in time.
    #[error("the command was not sent within {0:.3} s")]
    NotSent(f64),
    /// The request to the cameras for images failed.
    #[error("images could not be asked for: {0}")]
    CaptureFailed(String),
    /// The connection is lost.
    #[error("{0}")]
    ConnectionLost(String),
}

/// A complete set of the newest measurements.
#[derive(Debug, Clone, Default)]
pub struct Observation {
    /// Time of the measurement, s since the backend was started.
    pub time: f64,
    /// Number of the tick.
    pub sequence: u64,
    /// State of each actuator.
    pub servos: ActuatorVector<ServoState>,
    /// State of the arm.
    pub arm: ArmState,
    /// Tactile images that arrived since the last observation.
    pub tactile: Vec<TactileFrame>,
}

/// Goal of a servo.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ServoGoal {
    /// Current control: current in A; positive winds the cable.
    Current(f64),
    /// Current-based position control: output angle under a current limit.
    Position {
        /// Output angle, rad.
        angle: f64,
        /// Current limit, A.
        current_limit: f64,
    },
}

impl Default for ServoGoal {
    /// Returns zero current: free to turn.
    fn default() -> Self {
        Self::Current(0.0)
    }
}

/// One tick's command.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RobotCommand {
    /// Arm joint position set-points, rad.
    pub arm: ArmVector,
    /// Goal of each actuator.
    pub servos: ActuatorVector<ServoGoal>,
    /// Requests one image of every camera from the camera board.
    pub capture: bool,
}

/// Timing of a control tick.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tick {
    /// Time, s since the backend was started.
    pub time: f64,
    /// Lateness of the tick, s; 0 in simulation.
    pub lateness: f64,
}

/// A robot that can be driven: simulated, real, emulated or replayed.
///
/// ```
/// use hand_model::robot::{ArmState, Observation, Readings, RobotBackend, RobotCommand, RobotError, ServoGoal, ServoState, Tick};
///
/// /// A gripper with one servo and no arm, whose servo follows its goal at once.
/// #[derive(Default)]
/// struct Gripper {
///     time: f64,
///     servo: ServoState,
/// }
///
/// impl RobotBackend for Gripper {
///     fn observe(&mut self) -> Result<Readings, RobotError> {
///         let servos = [self.servo].into_iter().collect();
///         Ok(Observation { time: self.time, servos, arm: ArmState::default(), ..Observation::default() }.into())
///     }
///
///     fn send(&mut self, command: &RobotCommand) -> Result<RobotCommand, RobotError> {
///         // Limits of the robot are applied here, and reported to the caller.
///         let mut sent = *command;
///         if let ServoGoal::Position { angle, .. } = &mut sent.servos[0] {
///             *angle = angle.clamp(0.0, 1.0);
///             self.servo.position = *angle;
///         }
///         Ok(sent)
///     }
///
///     fn wait_for_tick(&mut self) -> Tick {
///         self.time += self.tick_length();
///         Tick { time: self.time, lateness: 0.0 }
///     }
///
///     fn tick_length(&self) -> f64 {
///         0.01
///     }
/// }
///
/// let mut gripper = Gripper::default();
/// let goal = ServoGoal::Position { angle: 2.0, current_limit: 0.5 };
/// let command = RobotCommand { servos: [goal].into_iter().collect(), ..RobotCommand::default() };
/// let sent = gripper.send(&command)?;
/// assert_eq!(sent.servos[0], ServoGoal::Position { angle: 1.0, current_limit: 0.5 });
/// gripper.wait_for_tick();
/// assert_eq!(gripper.observe()?.into_observation()?.servos[0].position, 1.0);
/// # Ok::<(), RobotError>(())
/// ```
pub trait RobotBackend {
    /// Returns the newest readings.
    ///
    /// # Errors
    /// The reason why nothing could be observed.
    fn observe(&mut self) -> Result<Readings, RobotError>;
    /// Sends a command and returns what was sent after limits. It blocks for no longer than a tick or two.
    ///
    /// # Errors
    /// The reason why nothing was sent.
    fn send(&mut self, command: &RobotCommand) -> Result<RobotCommand, RobotError>;
    /// Waits until one control tick has passed.
    fn wait_for_tick(&mut self) -> Tick;
    /// Returns the length of a control tick, s.
    fn tick_length(&self) -> f64;
}

impl<R: RobotBackend + ?Sized> RobotBackend for Box<R> {
    fn observe(&mut self) -> Result<Readings, RobotError> {
        (**self).observe()
    }

    fn send(&mut self, command: &RobotCommand) -> Result<RobotCommand, RobotError> {
        (**self).send(command)
    }

    fn wait_for_tick(&mut self) -> Tick {
        (**self).wait_for_tick()
    }

    fn tick_length(&self) -> f64 {
        (**self).tick_length()
    }
}

/// Physics on which emulated devices act. Its methods are those of a [`RobotBackend`] that never fails.
pub trait Plant {
    /// Returns the newest measurements.
    fn observe(&mut self) -> Observation;
    /// Takes a command and returns the one that it follows.
    fn send(&mut self, command: &RobotCommand) -> RobotCommand;
    /// Simulates one control tick.
    fn wait_for_tick(&mut self) -> Tick;
    /// Returns the length of a control tick, s.
    fn tick_length(&self) -> f64;
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A servo that was never read must not appear to be at 0 rad.
    #[test]
    fn what_was_never_read_is_no_observation() {
        let servos = [ServoState::default(); 6].into();
        let whole = Readings::from(Observation { time: 0.5, sequence: 3, servos, ..Observation::default() });
        assert_eq!(whole.arm.map(|arm| arm.time), Some(0.5));
        let mut part = whole.clone();
        part.servos[2] = None;
        let error = part.into_observation().expect_err("incomplete");
        assert_eq!(error, RobotError::Unread(RobotDevice::Servo(2)));
        assert_eq!(error.to_string(), "servo 3: not read yet");
        let part = Readings { arm: None, ..whole.clone() };
        assert_eq!(part.into_observation().expect_err("incomplete"), RobotError::Unread(RobotDevice::Arm));
        assert_eq!(whole.into_observation().expect("complete").sequence, 3);
    }
}
