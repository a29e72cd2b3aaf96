//! The states of the robot and the causes of a stop.

use std::fmt;

use hand_model::Digit;

use super::bodies::{Body, Side};

/// Where the robot is between being a box of parts and running.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum State {
    /// No devices.
    Disconnected,
    /// Devices answer; their torque is unchanged.
    Connected,
    /// Devices are the right ones, set up right, cool and supplied.
    Checked,
    /// Torque was enabled on request; nothing moves yet.
    Armed,
    /// Commands are followed.
    Running,
    /// Last goals kept, current capped. Torque stays on.
    Hold(Cause),
    /// The current fades; at its end the torque goes off and the state is [`State::Connected`].
    Release {
        /// When it began, s.
        since: f64,
    },
    /// As hold, but a device needs attention before the robot can run again.
    Fault(Cause),
}

/// What is wrong with the arm, as far as its operator does something else about it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ArmTrouble {
    EmergencyStop,
    /// A joint or the base reports a fault.
    Fault,
    /// The arm stopped by itself because no commands came.
    Watchdog,
    /// Nothing comes from it.
    Network,
    /// It got no commands in time, though they were sent in time.
    CommandsLost,
    /// It got no commands in time, or its session ran out, because this program was held up.
    HostLate,
    /// It ended the connection.
    Closed,
    /// It does not know our session, which was kept.
    SessionLost,
    /// Somebody else drives it.
    OtherClient,
    /// Anything else that it or its client refuses.
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
            Self::Network => "nothing comes from it; check the network cable and the arm's supply",
            Self::CommandsLost => {
                "commands that were sent in time did not reach it: the network loses or delays them; use a cable of its own, without a switch that others use. Then run `ftac bridge clear-faults`"
            }
            Self::HostLate => {
                "this program was held up, and it heard nothing for too long; is this computer overloaded, or was it suspended? Then run `ftac bridge clear-faults`"
            }
            Self::Closed => "it ended the connection; did it restart?",
            Self::SessionLost => "it does not know this session any more, which was kept in time; did it restart?",
            Self::OtherClient => {
                "another client has taken control of it (its web page, or another program); end that, then start again"
            }
            Self::Refused => "it refused",
        })
    }
}

/// Why the robot does not follow commands.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Cause {
    /// The operator said so.
    Operator,
    /// A command held something that is no number, or a negative current limit.
    BadCommand,
    /// No command for so long, s.
    HostSilent(f64),
    /// No measurement of this servo for so long, s.
    ServoSilent(usize, f64),
    /// Silence of the arm, s.
    ArmSilent(f64),
    /// This joint of the arm bears this torque, N m, for longer than `torque_time`.
    ArmTorque(usize, f64),
    /// This joint bears so much more than weight, motion and payload explain, N m, for longer than a jolt.
    ArmPress(usize, f64),
    /// The controller sends this part so far below the table, m.
    Table(Body, f64),
    /// The controller sends this part so far out of the workspace, m.
    Workspace(Body, Side, f64),
    /// The controller sends these parts so near to each other, m.
    SelfCollision(Body, Body, f64),
    /// The arm is in trouble.
    ArmFault(ArmTrouble),
    /// This program itself, or the whole computer, stood still for so long, s.
    Frozen(f64),
    /// The camera board is gone.
    CamerasGone,
    /// This servo's angle, rad, is out of its limits.
    Angle(usize, f64),
    /// This servo's speed, rad/s.
    Speed(usize, f64),
    /// This servo's current, A.
    Current(usize, f64),
    /// This servo's temperature, degrees Celsius.
    Temperature(usize, f64),
    /// The supply at this servo, V.
    Voltage(usize, f64),
    /// This servo raised its alert bit: see its hardware error status.
    ServoAlert(usize),
    /// This servo has lost its torque without being asked: it restarted.
    TorqueLost(usize),
    /// This servo's bus watchdog has stopped it.
    WatchdogTripped(usize),
}

impl Cause {
    /// Whether a device needs attention before the robot can run again.
    pub fn is_fault(&self) -> bool {
        matches!(self, Self::ServoAlert(_) | Self::TorqueLost(_) | Self::ArmFault(_))
    }
}

/// An actuator's name.
struct Servo(usize);

impl fmt::Display for Servo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} servo", Digit::ALL.get(self.0).map_or("opposition", |digit| digit.name()))
    }
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ms = |age: &f64| format!("{:.0} ms", 1e3 * age);
        match self {
            Self::Operator => write!(f, "the operator stopped it"),
            Self::BadCommand => write!(f, "the controller sent a command that is not a number; this is a bug in it"),
            Self::HostSilent(age) => write!(f, "no command for {}; is the controller running?", ms(age)),
            Self::ServoSilent(n, age) => {
                write!(f, "{}: no answer for {}; check its plug, the USB adapter and the supply", Servo(*n), ms(age))
            }
            Self::ArmSilent(age) => write!(f, "arm: no word for {}; check the network cable", ms(age)),
            Self::ArmFault(trouble) => write!(f, "arm: {trouble}"),
            Self::ArmTorque(joint, torque) => write!(
                f,
                "arm joint {}: {torque:.1} N m, above its limit (limits.arm.torque); what does it press against, or carry?",
                joint + 1
            ),
            Self::ArmPress(joint, torque) => write!(
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
            Self::Frozen(gap) => write!(
                f,
                "this program stood still for {}; was it stopped, or the computer suspended or overloaded?",
                ms(gap)
            ),
            Self::CamerasGone => write!(f, "camera board: its port is gone; check the USB cable"),
            Self::Angle(n, angle) => {
                write!(f, "{}: at {angle:.3} rad, out of its limits; look at its spool and cable", Servo(*n))
            }
            Self::Speed(n, speed) => {
                write!(f, "{}: {speed:.2} rad/s, above its limit; did its cable break?", Servo(*n))
            }
            Self::Current(n, current) => {
                write!(f, "{}: {:.0} mA, above its limit; what blocks it?", Servo(*n), 1e3 * current)
            }
            Self::Temperature(n, celsius) => write!(f, "{}: {celsius:.0} C; let it cool", Servo(*n)),
            Self::Voltage(n, volts) => write!(f, "{}: {volts:.1} V at its plug; check the supply", Servo(*n)),
            Self::ServoAlert(n) => {
                write!(
                    f,
                    "{}: it reports a hardware error; support what is held, then run `ftac bridge reboot`",
                    Servo(*n)
                )
            }
            Self::TorqueLost(n) => {
                write!(f, "{}: it restarted and has no torque; check the supply, support what is held", Servo(*n))
            }
            Self::WatchdogTripped(n) => {
                write!(f, "{}: it heard nothing for too long and stopped itself", Servo(*n))
            }
        }
    }
}

impl fmt::Display for State {
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

/// A step that the state does not allow.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("cannot {wish} while {state}")]
pub struct Refused {
    /// What was wished.
    pub wish: &'static str,
    /// The state it was wished in.
    pub state: String,
}
