//! Kinds of device and host faults: the injection and the required outcome of each.

use anyhow::Result;
use control::executor::Executor;
use fault_detection::fault::FaultKind as Divergence;
use hand_model::robot::{Readings, RobotBackend, RobotCommand, ServoGoal};
use hardware_bridge::emulator::Plug;
use hardware_bridge::emulator::faults::{FaultEvent, FaultProbabilities};
use hardware_bridge::emulator::lockstep::LockstepRobot;
use hardware_bridge::safety::state::SupervisorState;
use kinova_kortex::emulator::Injection;
use kinova_kortex::safety_bank::FOLLOWING_ERROR;
use robot_session_log::SessionRecorder;
use serde::{Deserialize, Serialize};

/// Servo that device faults affect: the index finger's.
const FAULTY_SERVO: u8 = 2;

/// A kind of fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum InjectedFault {
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
pub const ALL: [InjectedFault; 23] = [
    InjectedFault::Noise,
    InjectedFault::Dropped,
    InjectedFault::AllDropped,
    InjectedFault::Delayed,
    InjectedFault::Corrupt,
    InjectedFault::Overload,
    InjectedFault::Overheat,
    InjectedFault::Dip,
    InjectedFault::BrownOut,
    InjectedFault::ServoUnplugged,
    InjectedFault::AdapterUnplugged,
    InjectedFault::CamerasUnplugged,
    InjectedFault::CameraFrozen,
    InjectedFault::JpegCut,
    InjectedFault::UdpLossy,
    InjectedFault::UdpSlow,
    InjectedFault::ArmDeaf,
    InjectedFault::ArmFault,
    InjectedFault::EmergencyStop,
    InjectedFault::NotANumber,
    InjectedFault::ControllerSilent,
    InjectedFault::OperatorStop,
    InjectedFault::HostKilled,
];

/// Required outcome of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExpectedOutcome {
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
pub enum DetectingParty {
    /// Nobody: the links compensate, or the host has failed. Fault detection must report nothing.
    Nobody,
    /// The supervisor, by holding the robot.
    Supervisor,
    /// Fault detection, by this kind of fault.
    FaultDetector(Divergence),
}

impl ExpectedOutcome {
    /// True if the final supervisor `state`, and whether the robot is `safe`, satisfy this expectation.
    pub fn is_met_by(self, state: &SupervisorState, safe: bool) -> bool {
        match self {
            Self::GoesOn => safe || matches!(state, SupervisorState::Running),
            Self::Holds => safe && matches!(state, SupervisorState::Hold(_) | SupervisorState::Fault(_)),
            Self::Faults => safe && matches!(state, SupervisorState::Fault(_)),
            Self::StopsItself => safe,
        }
    }
}

impl InjectedFault {
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
    pub fn expected(self) -> ExpectedOutcome {
        match self {
            Self::Noise | Self::Dropped | Self::Delayed | Self::Corrupt => ExpectedOutcome::GoesOn,
            Self::CameraFrozen | Self::JpegCut | Self::UdpLossy | Self::UdpSlow => ExpectedOutcome::GoesOn,
            Self::Overload | Self::ArmFault | Self::EmergencyStop => ExpectedOutcome::Faults,
            Self::HostKilled => ExpectedOutcome::StopsItself,
            _ => ExpectedOutcome::Holds,
        }
    }

    /// Returns the party that must detect the fault.
    pub fn detecting_party(self) -> DetectingParty {
        match self {
            Self::CameraFrozen | Self::JpegCut => DetectingParty::FaultDetector(Divergence::CameraDead),
            kind if matches!(kind.expected(), ExpectedOutcome::GoesOn | ExpectedOutcome::StopsItself) => {
                DetectingParty::Nobody
            }
            _ => DetectingParty::Supervisor,
        }
    }

    /// True if the fault removes a servo's torque, so that objects held by that servo may fall whatever the bridge
    /// does.
    pub fn takes_torque(self) -> bool {
        matches!(self, Self::Overload | Self::Overheat | Self::BrownOut | Self::ServoUnplugged)
    }

    /// True if the fault ends the host program.
    pub fn ends_host_program(self) -> bool {
        self == Self::HostKilled
    }

    /// Injects the fault.
    pub fn inject(self, robot: &mut LockstepRobot) {
        let chances = |chances: FaultProbabilities| Some(chances);
        let chances = match self {
            Self::Noise => chances(FaultProbabilities { noise: 0.3, ..FaultProbabilities::default() }),
            Self::Dropped => chances(FaultProbabilities { drop: 0.05, ..FaultProbabilities::default() }),
            Self::AllDropped => chances(FaultProbabilities { drop: 1.0, ..FaultProbabilities::default() }),
            Self::Delayed => chances(FaultProbabilities { delay: 0.05, ..FaultProbabilities::default() }),
            Self::Corrupt => chances(FaultProbabilities { corrupt: 0.05, ..FaultProbabilities::default() }),
            _ => None,
        };
        if let Some(chances) = chances {
            robot.devices().set_fault_probabilities(chances);
        }
        match self {
            Self::Overload => robot.devices().inject(FaultEvent::Overload(FAULTY_SERVO)),
            Self::Overheat => robot.devices().inject(FaultEvent::Overheat(FAULTY_SERVO)),
            Self::Dip => robot.devices().inject(FaultEvent::Voltage(8.0)),
            Self::BrownOut => robot.devices().inject(FaultEvent::Voltage(0.0)),
            Self::ServoUnplugged => robot.devices().inject(FaultEvent::Unplug(FAULTY_SERVO)),
            Self::AdapterUnplugged => robot.devices().unplug(Plug::Servos),
            Self::CamerasUnplugged => robot.devices().unplug(Plug::Cameras),
            Self::CameraFrozen => robot.devices().inject(FaultEvent::FreezeCamera(3)),
            Self::JpegCut => robot.devices().set_jpeg_cut_probability(1.0),
            Self::UdpLossy => inject_arm_fault(robot, Injection::LoseReplies(0.3)),
            Self::UdpSlow => inject_arm_fault(robot, Injection::DelayReplies(5)),
            Self::ArmDeaf => inject_arm_fault(robot, Injection::Deaf(true)),
            Self::ArmFault => inject_arm_fault(robot, Injection::JointFault { joint: 3, bits: FOLLOWING_ERROR }),
            Self::EmergencyStop => inject_arm_fault(robot, Injection::EmergencyStop(true)),
            Self::OperatorStop => robot.hold(),
            Self::HostKilled => robot.kill_host(),
            _ => {}
        }
    }

    /// Runs one tick after the fault. Returns the sent command, if the controller took part.
    pub fn run_tick(
        self,
        recorder: &mut SessionRecorder<LockstepRobot>,
        executor: &mut Executor,
    ) -> Result<Option<RobotCommand>> {
        match self {
            // Bypasses the recorder, which ended with the host.
            Self::HostKilled => {
                recorder.robot().wait_for_tick();
            }
            Self::ControllerSilent => {
                recorder.robot().idle_cycle();
                recorder.wait_for_tick();
            }
            Self::NotANumber => {
                if let Ok(observation) = recorder.observe().and_then(Readings::into_observation) {
                    let mut command = executor.tick(&observation)?;
                    command.servos[0] = ServoGoal::Current(f64::NAN);
                    // The command must be refused in this fault.
                    let _ = recorder.send(&command);
                }
                recorder.wait_for_tick();
            }
            _ => return tick(recorder, executor),
        }
        Ok(None)
    }
}

/// Runs one tick of `robot` under `executor`, which holds if the robot fails. Returns the sent command.
pub(super) fn tick(robot: &mut impl RobotBackend, executor: &mut Executor) -> Result<Option<RobotCommand>> {
    let sent = match robot.observe().and_then(Readings::into_observation) {
        Ok(observation) => robot.send(&executor.tick(&observation)?).ok(),
        Err(_) => None,
    };
    robot.wait_for_tick();
    Ok(sent)
}

/// Injects a fault into the emulated arm.
fn inject_arm_fault(robot: &mut LockstepRobot, injection: Injection) {
    robot.arm().inject(injection);
}
