//! The states of the robot and the causes of a stop.

use std::fmt;

use hand_model::Digit;

use super::collision_bodies::{CollisionBody, WorkspaceSide};

/// State of the robot, from disconnected to running.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SupervisorState {
    /// No devices are connected.
    Disconnected,
    /// Devices answer; their torque is unchanged.
    Connected,
    /// The devices are the right ones, set up correctly, cool and supplied.
    Checked,
    /// Torque has been enabled on request; nothing moves yet.
    Armed,
    /// The robot follows commands.
    Running,
    /// The last goals are kept, with the current capped. Torque stays on.
    Hold(StopCause),
    /// The current fades. At the end the torque is switched off and the state becomes [`SupervisorState::Connected`].
    Release {
        /// Start of the release, s.
        since: f64,
    },
    /// Like hold, but a device needs attention before the robot can run again.
    Fault(StopCause),
}

/// Trouble with the arm, distinguished by the action that it requires of the operator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ArmTrouble {
    EmergencyStop,
    /// A joint or the base reports a fault.
    Fault,
    /// The arm stopped by itself because no commands came.
    Watchdog,
    /// No data arrives from the arm.
    Network,
    /// Commands that were sent in time did not reach the arm in time.
    CommandsLost,
    /// Commands reached the arm too late, or its session expired, because this program was delayed.
    HostLate,
    /// The arm ended the connection.
    Closed,
    /// The arm has lost the session, although it was kept alive.
    SessionLost,
    /// Another client controls the arm.
    OtherClient,
    /// The arm or its client refuses something else.
    Refused,
}

impl fmt::Display for ArmTrouble {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::EmergencyStop => {
                "its emergency stop is pressed; once the cause is gone, release it and run `ftac bridge clear-faults`"
            }
            Self::Fault => "in fault; once the cause is gone, run `ftac bridge clear-faults`",
            Self::Watchdog => {
                "it stopped by itself, because no commands came; is this computer overloaded? Then run `ftac bridge clear-faults`"
            }
            Self::Network => "no data arrives from it; check the network cable and the arm's supply",
            Self::CommandsLost => {
                "commands that were sent in time did not reach it: the network loses or delays them; use a cable of its own, without a switch that others use. Then run `ftac bridge clear-faults`"
            }
            Self::HostLate => {
                "this program was delayed, and the arm received nothing for too long; is this computer overloaded, or was it suspended? Then run `ftac bridge clear-faults`"
            }
            Self::Closed => "it ended the connection; did it restart?",
            Self::SessionLost => "it has lost this session, which was kept alive in time; did it restart?",
            Self::OtherClient => {
                "another client has taken control of it (its web page, or another program); end that, then start again"
            }
            Self::Refused => "it refused",
        })
    }
}

/// Cause of a stop: the reason why the robot does not follow commands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StopCause {
    /// The operator stopped the robot.
    Operator,
    /// A command held a non-finite number or a negative current limit.
    BadCommand,
    /// Time without a command, s.
    HostSilent(f64),
    /// A servo's index, and the time without a measurement of it, s.
    ServoSilent(usize, f64),
    /// Time without a measurement of the arm, s.
    ArmSilent(f64),
    /// A joint of the arm, its angle, and the range that it is outside of (least, greatest), rad.
    ArmAngle(usize, f64, (f64, f64)),
    /// A joint of the arm, its speed, and the greatest that is tolerated, rad/s.
    ArmSpeed(usize, f64, f64),
    /// A joint of the arm, and its distance, rad, from where its set-points have been for a while.
    ArmOffCourse(usize, f64),
    /// A joint of the arm, and its torque, N m, which exceeded the limit for longer than `torque_time`.
    ArmTorque(usize, f64),
    /// A joint of the arm, and its residual, N m: torque beyond weight, motion and payload that exceeded the limit for
    /// longer than a jolt.
    ArmResidual(usize, f64),
    /// A part that the controller sends below the table, and the depth, m.
    Table(CollisionBody, f64),
    /// A part that the controller sends out of the workspace, the side, and the distance outside, m.
    Workspace(CollisionBody, WorkspaceSide, f64),
    /// Two parts that the controller sends too close to each other, and their distance, m; negative if they overlap.
    SelfCollision(CollisionBody, CollisionBody, f64),
    /// The arm reports a fault or is in other trouble.
    ArmFault(ArmTrouble),
    /// Time for which this program itself, or the whole computer, stood still, s.
    HostFrozen(f64),
    /// The port of the camera board is gone.
    CamerasGone,
    /// The robot's driver has failed; its own words are in the report of the cycles.
    DriverFailed,
    /// A servo and its angle, rad, outside its limits.
    Angle(usize, f64),
    /// A servo and its speed, rad/s, above its limit.
    Speed(usize, f64),
    /// A servo and its current, A, above its limit.
    Current(usize, f64),
    /// A servo and its temperature, degrees Celsius, outside its range.
    Temperature(usize, f64),
    /// A servo and its supply voltage, V, outside its range.
    Voltage(usize, f64),
    /// A servo that raised its alert bit: see its hardware error status.
    ServoAlert(usize),
    /// A servo that lost its torque without a request: it restarted.
    TorqueLost(usize),
    /// A servo that was stopped by its bus watchdog.
    WatchdogTripped(usize),
}

impl StopCause {
    /// True if a device needs attention before the robot can run again.
    pub fn is_fault(&self) -> bool {
        matches!(self, Self::ServoAlert(_) | Self::TorqueLost(_) | Self::ArmFault(_) | Self::DriverFailed)
    }
}

/// Display of an actuator's name, by its index.
struct ServoName(usize);

impl fmt::Display for ServoName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} servo", Digit::ALL.get(self.0).map_or("opposition", |digit| digit.name()))
    }
}

impl fmt::Display for StopCause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ms = |age: &f64| format!("{:.0} ms", 1e3 * age);
        match self {
            Self::Operator => write!(f, "the operator stopped it"),
            Self::BadCommand => write!(f, "the controller sent a command that is not a number; this is a bug in it"),
            Self::HostSilent(age) => write!(f, "no command for {}; is the controller running?", ms(age)),
            Self::ServoSilent(n, age) => {
                write!(
                    f,
                    "{}: no answer for {}; check its plug, the USB adapter and the supply",
                    ServoName(*n),
                    ms(age)
                )
            }
            Self::ArmSilent(age) => write!(f, "arm: no measurement for {}; check the network cable", ms(age)),
            Self::ArmAngle(joint, angle, (low, high)) => write!(
                f,
                "arm joint {}: at {angle:.3} rad, expected {low:.3} to {high:.3}; move it inside by the arm's own controls",
                joint + 1
            ),
            Self::ArmSpeed(joint, speed, most) => {
                write!(f, "arm joint {}: {speed:.2} rad/s, expected at most {most:.2}", joint + 1)
            }
            Self::ArmOffCourse(joint, distance) => write!(
                f,
                "arm joint {}: {distance:.2} rad from its set-points (limits.arm.following, lag); does it follow them, and what blocks or moves it?",
                joint + 1
            ),
            Self::ArmFault(trouble) => write!(f, "arm: {trouble}"),
            Self::ArmTorque(joint, torque) => write!(
                f,
                "arm joint {}: {torque:.1} N m, above its limit (limits.arm.torque); what does it press against, or carry?",
                joint + 1
            ),
            Self::ArmResidual(joint, torque) => write!(
                f,
                "arm joint {}: {torque:.1} N m more than weight, motion and payload explain (limits.arm.residual); what does it press against?",
                joint + 1
            ),
            Self::Table(body, below) => write!(
                f,
                "the controller sends {body} {:.0} mm below the table (limits.space.table, tolerance)",
                1e3 * below
            ),
            Self::Workspace(body, side, outside) => {
                write!(f, "the controller sends {body} {:.0} mm out of the workspace ({side})", 1e3 * outside)
            }
            Self::SelfCollision(one, other, distance) => write!(
                f,
                "the controller sends {one} to {:.0} mm from {other} (limits.space.clearance)",
                1e3 * distance
            ),
            Self::HostFrozen(gap) => write!(
                f,
                "this program stood still for {}; was it stopped, or the computer suspended or overloaded?",
                ms(gap)
            ),
            Self::CamerasGone => write!(f, "camera board: its port is gone; check the USB cable"),
            Self::DriverFailed => write!(f, "the robot's driver has failed"),
            Self::Angle(n, angle) => {
                write!(f, "{}: at {angle:.3} rad, out of its limits; look at its spool and cable", ServoName(*n))
            }
            Self::Speed(n, speed) => {
                write!(f, "{}: {speed:.2} rad/s, above its limit; did its cable break?", ServoName(*n))
            }
            Self::Current(n, current) => {
                write!(f, "{}: {:.0} mA, above its limit; what blocks it?", ServoName(*n), 1e3 * current)
            }
            Self::Temperature(n, celsius) => write!(f, "{}: {celsius:.0} C; let it cool", ServoName(*n)),
            Self::Voltage(n, volts) => write!(f, "{}: {volts:.1} V at its plug; check the supply", ServoName(*n)),
            Self::ServoAlert(n) => {
                write!(
                    f,
                    "{}: it reports a hardware error; support what is held, then run `ftac bridge reboot`",
                    ServoName(*n)
                )
            }
            Self::TorqueLost(n) => {
                write!(f, "{}: it restarted and has no torque; check the supply, support what is held", ServoName(*n))
            }
            Self::WatchdogTripped(n) => {
                write!(f, "{}: it received nothing for too long and stopped itself", ServoName(*n))
            }
        }
    }
}

impl fmt::Display for SupervisorState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Disconnected => write!(f, "disconnected"),
            Self::Connected => write!(f, "connected"),
            Self::Checked => write!(f, "checked"),
            Self::Armed => write!(f, "armed"),
            Self::Running => write!(f, "running"),
            Self::Hold(cause) => write!(f, "hold: {cause}"),
            Self::Release { .. } => write!(f, "releasing"),
            Self::Fault(cause) => write!(f, "fault: {cause}"),
        }
    }
}

/// A transition that the present state does not allow.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("cannot {transition} while {state}")]
pub struct TransitionRefused {
    /// Requested transition.
    pub transition: &'static str,
    /// State at the time of the request.
    pub state: String,
}
