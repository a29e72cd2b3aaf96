//! Kinds of device and host faults: how each is injected, and the outcome it must have.

use anyhow::Result;
use control::executor::Executor;
use fault_detection::divergence::Kind as Divergence;
use hand_model::robot::{Command, Readings, RobotBackend, ServoGoal};
use hardware_bridge::emulator::Plug;
use hardware_bridge::emulator::faults::{Chances, Event};
use hardware_bridge::emulator::lockstep::LockstepRobot;
use hardware_bridge::safety::state::State;
use kinova_kortex::emulator::Injection;
use kinova_kortex::safety_bank::FOLLOWING_ERROR;
use robot_session_log::Recorder;
use serde::{Deserialize, Serialize};

/// Servo that device faults strike: the index finger's.
const SERVO: u8 = 2;

/// A kind of fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Kind {
    Noise,
    Dropped,
    AllDropped,
    Delayed,
    Corrupt,
    Overload,
    Overheat,
    Dip,
    BrownOut,
    ServoUnplugged,
    AdapterUnplugged,
    CamerasUnplugged,
    CameraFrozen,
    JpegCut,
    UdpLossy,
    UdpSlow,
    ArmDeaf,
    ArmFault,
    EmergencyStop,
    NotANumber,
    ControllerSilent,
    OperatorStop,
    HostKilled,
}

/// All kinds of faults.
pub const ALL: [Kind; 23] = [
    Kind::Noise,
    Kind::Dropped,
    Kind::AllDropped,
    Kind::Delayed,
    Kind::Corrupt,
    Kind::Overload,
    Kind::Overheat,
    Kind::Dip,
    Kind::BrownOut,
    Kind::ServoUnplugged,
    Kind::AdapterUnplugged,
    Kind::CamerasUnplugged,
    Kind::CameraFrozen,
    Kind::JpegCut,
    Kind::UdpLossy,
    Kind::UdpSlow,
    Kind::ArmDeaf,
    Kind::ArmFault,
    Kind::EmergencyStop,
    Kind::NotANumber,
    Kind::ControllerSilent,
    Kind::OperatorStop,
    Kind::HostKilled,
];

/// Required outcome of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Expected {
    /// The robot goes on, or holds if too much is lost at once.
    GoesOn,
    Holds,
    /// The robot holds, and an operator must attend to a device.
    Faults,
    /// The devices stop by themselves.
    StopsItself,
}

/// The party that can detect a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Teller {
    /// Nobody: the links compensate, or the host is gone. A mirror must report nothing.
    Nobody,
    /// The supervisor, by holding the robot.
    Supervisor,
    /// A mirror, by this diagnosis.
    Mirror(Divergence),
}

impl Expected {
    /// True if the final supervisor `state`, and whether the robot is `safe`, satisfy this expectation.
    pub fn fits(self, state: &State, safe: bool) -> bool {
        match self {
            Self::GoesOn => safe || matches!(state, State::Running),
            Self::Holds => safe && matches!(state, State::Hold(_) | State::Fault(_)),
            Self::Faults => safe && matches!(state, State::Fault(_)),
            Self::StopsItself => safe,
        }
    }
}

impl Kind {
    /// Returns the description of the fault used in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Noise => "noise before 30 % of the answers",
            Self::Dropped => "5 % of the answers dropped",
            Self::AllDropped => "all servo answers dropped",
            Self::Delayed => "5 % of the answers late",
            Self::Corrupt => "5 % of the answers corrupt",
            Self::Overload => "servo shut down by overload",
            Self::Overheat => "servo overheated",
            Self::Dip => "supply dips to 8 V",
            Self::BrownOut => "supply gone",
            Self::ServoUnplugged => "servo unplugged",
            Self::AdapterUnplugged => "servo adapter unplugged",
            Self::CamerasUnplugged => "camera board unplugged",
            Self::CameraFrozen => "camera frozen",
            Self::JpegCut => "JPEGs cut in half",
            Self::UdpLossy => "30 % of UDP answers lost",
            Self::UdpSlow => "UDP answers up to 5 ms late",
            Self::ArmDeaf => "arm's network gone",
            Self::ArmFault => "arm fault",
            Self::EmergencyStop => "emergency stop",
            Self::NotANumber => "controller sends NaN",
            Self::ControllerSilent => "controller silent",
            Self::OperatorStop => "bridge stop",
            Self::HostKilled => "host killed or frozen",
        }
    }

    /// Returns the required outcome of the fault.
    pub fn expected(self) -> Expected {
        match self {
            Self::Noise | Self::Dropped | Self::Delayed | Self::Corrupt => Expected::GoesOn,
            Self::CameraFrozen | Self::JpegCut | Self::UdpLossy | Self::UdpSlow => Expected::GoesOn,
            Self::Overload | Self::ArmFault | Self::EmergencyStop => Expected::Faults,
            Self::HostKilled => Expected::StopsItself,
            _ => Expected::Holds,
        }
    }

    /// Returns the party that must detect the fault.
    pub fn teller(self) -> Teller {
        match self {
            Self::CameraFrozen | Self::JpegCut => Teller::Mirror(Divergence::CameraDead),
            kind if matches!(kind.expected(), Expected::GoesOn | Expected::StopsItself) => Teller::Nobody,
            _ => Teller::Supervisor,
        }
    }

    /// True if the fault removes a servo's torque, so that objects held by that servo may fall whatever the bridge
    /// does.
    pub fn takes_torque(self) -> bool {
        matches!(self, Self::Overload | Self::Overheat | Self::BrownOut | Self::ServoUnplugged)
    }

    /// True if the fault ends the host program.
    pub fn kills_the_host(self) -> bool {
        self == Self::HostKilled
    }

    /// Injects the fault.
    pub fn strike(self, robot: &mut LockstepRobot) {
        let chances = |chances: Chances| Some(chances);
        let chances = match self {
            Self::Noise => chances(Chances { noise: 0.3, ..Chances::default() }),
            Self::Dropped => chances(Chances { drop: 0.05, ..Chances::default() }),
            Self::AllDropped => chances(Chances { drop: 1.0, ..Chances::default() }),
            Self::Delayed => chances(Chances { delay: 0.05, ..Chances::default() }),
            Self::Corrupt => chances(Chances { corrupt: 0.05, ..Chances::default() }),
            _ => None,
        };
        if let Some(chances) = chances {
            robot.devices().set_chances(chances);
        }
        match self {
            Self::Overload => robot.devices().inject(Event::Overload(SERVO)),
            Self::Overheat => robot.devices().inject(Event::Overheat(SERVO)),
            Self::Dip => robot.devices().inject(Event::Voltage(8.0)),
            Self::BrownOut => robot.devices().inject(Event::Voltage(0.0)),
            Self::ServoUnplugged => robot.devices().inject(Event::Unplug(SERVO)),
            Self::AdapterUnplugged => robot.devices().unplug(Plug::Servos),
            Self::CamerasUnplugged => robot.devices().unplug(Plug::Cameras),
            Self::CameraFrozen => robot.devices().inject(Event::Freeze(3)),
            Self::JpegCut => robot.devices().set_jpeg_chance(1.0),
            Self::UdpLossy => arm(robot, Injection::LoseReplies(0.3)),
            Self::UdpSlow => arm(robot, Injection::DelayReplies(5)),
            Self::ArmDeaf => arm(robot, Injection::Deaf(true)),
            Self::ArmFault => arm(robot, Injection::JointFault { joint: 3, bits: FOLLOWING_ERROR }),
            Self::EmergencyStop => arm(robot, Injection::EmergencyStop(true)),
            Self::OperatorStop => robot.hold(),
            Self::HostKilled => robot.kill_host(),
            _ => {}
        }
    }

    /// Plays one tick after the fault. Returns the command that was sent, if the controller took part.
    pub fn drive(self, recorder: &mut Recorder<LockstepRobot>, executor: &mut Executor) -> Result<Option<Command>> {
        match self {
            // Bypasses the recorder, which died with the host.
            Self::HostKilled => {
                recorder.robot().wait_for_tick();
            }
            Self::ControllerSilent => {
                recorder.robot().idle_cycle();
                recorder.wait_for_tick();
            }
            Self::NotANumber => {
                if let Ok(observation) = recorder.observe().and_then(Readings::complete) {
                    let mut command = executor.tick(&observation)?;
                    command.servos[0] = ServoGoal::Current(f64::NAN);
                    // Refusal is the purpose of this fault.
                    let _ = recorder.send(&command);
                }
                recorder.wait_for_tick();
            }
            _ => return tick(recorder, executor),
        }
        Ok(None)
    }
}

/// Plays one tick of `robot` under `executor`, which holds if the robot fails. Returns the command that was sent.
pub(super) fn tick(robot: &mut impl RobotBackend, executor: &mut Executor) -> Result<Option<Command>> {
    let sent = match robot.observe().and_then(Readings::complete) {
        Ok(observation) => robot.send(&executor.tick(&observation)?).ok(),
        Err(_) => None,
    };
    robot.wait_for_tick();
    Ok(sent)
}

/// Injects a fault into the emulated arm.
fn arm(robot: &mut LockstepRobot, injection: Injection) {
    robot.arm().inject(injection);
}
