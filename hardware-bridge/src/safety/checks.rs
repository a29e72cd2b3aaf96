//! Checks of measurements against the limits.

use hand_model::ActuatorVector;
use hand_model::robot::{ArmState, Reading, Readings, RobotCommand, ServoGoal, ServoState, TactileFrame};

use super::limits::SafetyLimits;
use super::state::{ArmTrouble, StopCause};

/// Tolerance of a shaft angle outside its limits before it is an alarm, rad: cables stretch and encoders round.
const ANGLE_MARGIN: f64 = 0.15;
/// Tolerance of a current above its limit, as a factor and an offset (A): the servo's own control overshoots.
const CURRENT_MARGIN: (f64, f64) = (1.2, 0.05);
/// Tolerance of the shaft's speed, as a factor of the goal's speed limit, when winding and when unwinding. A winding
/// shaft catches up after a stall; an unwinding one is thrown open by springs that are suddenly released.
const SPEED_MARGIN: (f64, f64) = (1.5, 2.5);

/// Tolerance of an arm joint outside its range before it is an alarm, rad.
const ARM_ANGLE_MARGIN: f64 = 0.15;
/// Tolerance of an arm joint's speed above the limit of its set-points, as a factor and an offset (rad/s).
const ARM_SPEED_MARGIN: (f64, f64) = (1.5, 0.2);

/// The newest measurement of one servo.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ServoReading {
    /// Time of arrival, s.
    pub received_at: f64,
    /// State of the shaft.
    pub state: ServoState,
    /// Supply voltage, V; none if the servo does not measure it.
    pub voltage: Option<f64>,
    /// Alert bit of the servo's answer.
    pub alert: bool,
}

/// The newest measurement of the arm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmReading {
    /// Time of arrival, s.
    pub received_at: f64,
    /// State of the joints.
    pub state: ArmState,
    /// Trouble of the arm, if any.
    pub fault: Option<ArmTrouble>,
}

/// The newest measurements of all devices.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measurements {
    /// Newest reading of each servo, in actuator order; `None` before the first.
    pub servos: ActuatorVector<Option<ServoReading>>,
    pub arm: Option<ArmReading>,
    /// True if the camera board's port works.
    pub cameras: bool,
    /// True if the robot's driver works.
    pub driver: bool,
}

impl Measurements {
    /// Returns the measurements of a robot with this many servos before the first reading.
    pub fn none(servos: usize) -> Self {
        Self { servos: (0..servos).map(|_| None).collect(), arm: None, cameras: true, driver: true }
    }

    /// Converts the measurements to the readings that a controller gets at `time` (s) in tick `sequence`.
    pub fn readings(&self, time: f64, sequence: u64, tactile: Vec<TactileFrame>) -> Readings {
        let reading = |servo: ServoReading| Reading { value: servo.state, time: servo.received_at };
        let servos = self.servos.iter().map(|servo| servo.map(reading)).collect();
        let arm = self.arm.map(|arm| Reading { value: arm.state, time: arm.received_at });
        Readings { time, sequence, servos, arm, tactile }
    }
}

/// True if a command holds only finite numbers and no negative current limit.
pub fn is_valid(command: &RobotCommand) -> bool {
    let servo = |goal: &ServoGoal| match *goal {
        ServoGoal::Current(current) => current.is_finite(),
        ServoGoal::Position { angle, current_limit } => {
            angle.is_finite() && current_limit.is_finite() && current_limit >= 0.0
        }
    };
    command.arm.iter().all(|angle| angle.is_finite()) && command.servos.iter().all(servo)
}

/// Returns the most serious alarm raised by the measurements at `now` (s), if any.
pub fn alarm(measured: &Measurements, limits: &SafetyLimits, now: f64) -> Option<StopCause> {
    if !measured.driver {
        return Some(StopCause::DriverFailed);
    }
    if let Some(trouble) = measured.arm.and_then(|arm| arm.fault) {
        return Some(StopCause::ArmFault(trouble));
    }
    let alerts = measured.servos.iter().position(|servo| servo.is_some_and(|servo| servo.alert));
    if let Some(servo) = alerts {
        return Some(StopCause::ServoAlert(servo));
    }
    let age = |at: Option<f64>| at.map_or(f64::INFINITY, |at| now - at);
    for (n, servo) in measured.servos.iter().enumerate() {
        let silent = age(servo.map(|servo| servo.received_at));
        if silent > limits.staleness {
            return Some(StopCause::ServoSilent(n, silent));
        }
        if let Some(cause) = servo.and_then(|servo| servo_alarm(n, &servo, limits)) {
            return Some(cause);
        }
    }
    let silent = age(measured.arm.map(|arm| arm.received_at));
    if silent > limits.watchdogs.arm {
        return Some(StopCause::ArmSilent(silent));
    }
    if let Some(cause) = measured.arm.and_then(|arm| arm_alarm(&arm.state, limits)) {
        return Some(cause);
    }
    (!measured.cameras).then_some(StopCause::CamerasGone)
}

/// Returns the alarm raised by the arm's measurement, if any. NaN is outside every limit.
fn arm_alarm(state: &ArmState, limits: &SafetyLimits) -> Option<StopCause> {
    let (factor, offset) = ARM_SPEED_MARGIN;
    (0..state.position.len()).find_map(|joint| {
        let (angle, speed) = (state.position[joint], state.velocity[joint]);
        let (low, high) = limits.arm.angle[joint];
        let most = factor * limits.arm.speed[joint] + offset;
        if !(low - ARM_ANGLE_MARGIN..=high + ARM_ANGLE_MARGIN).contains(&angle) {
            Some(StopCause::ArmAngle(joint, angle, (low, high)))
        } else if !(0.0..=most).contains(&speed.abs()) {
            Some(StopCause::ArmSpeed(joint, speed, most))
        } else {
            None
        }
    })
}

/// Returns the alarm raised by one servo's measurement, if any. NaN is outside every limit.
fn servo_alarm(n: usize, reading: &ServoReading, limits: &SafetyLimits) -> Option<StopCause> {
    let own = &limits.servos[n];
    let ServoState { position, velocity, current, temperature } = reading.state;
    let angles = own.angle.0 - ANGLE_MARGIN..=own.angle.1 + ANGLE_MARGIN;
    let most = CURRENT_MARGIN.0 * own.current + CURRENT_MARGIN.1;
    if !angles.contains(&position) {
        Some(StopCause::Angle(n, position))
    } else if !(-SPEED_MARGIN.1 * own.speed..=SPEED_MARGIN.0 * own.speed).contains(&velocity) {
        Some(StopCause::Speed(n, velocity))
    } else if !(0.0..=most).contains(&current.abs()) {
        Some(StopCause::Current(n, current))
    } else if !(-20.0..=own.temperature).contains(&temperature) {
        Some(StopCause::Temperature(n, temperature))
    } else {
        let volts = reading.voltage.filter(|volts| !(limits.voltage.0..=limits.voltage.1).contains(volts))?;
        Some(StopCause::Voltage(n, volts))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::super::limits::tests::limits;
    use super::*;

    pub(crate) fn fine(now: f64) -> Measurements {
        let state = ServoState { position: 1.0, velocity: 0.0, current: 0.1, temperature: 30.0 };
        let servo = ServoReading { received_at: now, state, voltage: Some(11.1), alert: false };
        let arm = ArmReading { received_at: now, state: ArmState::at_rest([0.0; 7].into()), fault: None };
        Measurements { servos: [Some(servo); 6].into(), arm: Some(arm), ..Measurements::none(0) }
    }

    fn with(change: impl FnOnce(&mut ServoReading)) -> Option<StopCause> {
        let mut measured = fine(10.0);
        change(measured.servos[2].as_mut().expect("there"));
        alarm(&measured, &limits(), 10.01)
    }

    #[test]
    fn each_alarm() {
        assert_eq!(with(|_| ()), None);
        assert_eq!(with(|servo| servo.state.position = 4.7), Some(StopCause::Angle(2, 4.7)));
        assert_eq!(with(|servo| servo.state.position = 4.6), None);
        assert_eq!(with(|servo| servo.state.velocity = -20.0), Some(StopCause::Speed(2, -20.0)));
        assert_eq!(with(|servo| servo.state.velocity = -12.0), None);
        assert_eq!(with(|servo| servo.state.velocity = 12.0), Some(StopCause::Speed(2, 12.0)));
        assert_eq!(with(|servo| servo.state.current = 0.9), Some(StopCause::Current(2, 0.9)));
        assert_eq!(with(|servo| servo.state.temperature = 61.0), Some(StopCause::Temperature(2, 61.0)));
        assert_eq!(with(|servo| servo.voltage = Some(5.2)), Some(StopCause::Voltage(2, 5.2)));
        assert_eq!(with(|servo| servo.voltage = None), None);
        assert_eq!(with(|servo| servo.alert = true), Some(StopCause::ServoAlert(2)));
        assert!(matches!(with(|servo| servo.received_at = 9.9), Some(StopCause::ServoSilent(2, _))));
        assert!(matches!(with(|servo| servo.state.current = f64::NAN), Some(StopCause::Current(2, _))));
        let arm = |change: fn(&mut ArmState)| {
            let mut measured = fine(10.0);
            change(&mut measured.arm.as_mut().expect("there").state);
            alarm(&measured, &limits(), 10.01)
        };
        assert_eq!(arm(|state| state.position[1] = 2.1), None);
        assert_eq!(arm(|state| state.position[1] = -2.2), Some(StopCause::ArmAngle(1, -2.2, (-2.0, 2.0))));
        assert!(matches!(arm(|state| state.position[6] = f64::NAN), Some(StopCause::ArmAngle(6, ..))));
        assert_eq!(arm(|state| state.velocity[3] = -1.6), None);
        assert_eq!(arm(|state| state.velocity[3] = -1.8), Some(StopCause::ArmSpeed(3, -1.8, 1.7)));
        assert!(matches!(arm(|state| state.velocity[0] = f64::NAN), Some(StopCause::ArmSpeed(0, ..))));
        let mut measured = fine(10.0);
        measured.arm = None;
        assert!(matches!(alarm(&measured, &limits(), 10.0), Some(StopCause::ArmSilent(_))));
        measured = fine(10.0);
        measured.cameras = false;
        assert_eq!(alarm(&measured, &limits(), 10.0), Some(StopCause::CamerasGone));
        measured.driver = false;
        assert_eq!(alarm(&measured, &limits(), 10.0), Some(StopCause::DriverFailed));
    }
}
