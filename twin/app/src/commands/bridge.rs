//! `ftac bridge`: everything about the real robot, and its emulator.

pub mod calibrate;
pub mod clear_faults;
mod doctor;
pub mod emulate;
pub mod exercise;
mod faults;
pub mod install;
pub mod provision;
pub mod reboot;
pub mod register;
pub mod scan;
pub mod shared;
pub mod sheet;
pub mod stop;

use std::path::PathBuf;

use clap::Subcommand;

use self::shared::ConfigArg;
use crate::options::robot::RobotArgs;
use crate::terminal::{Outcome, Terminal};

/// `bridge` commands.
#[derive(Debug, Subcommand)]
pub enum BridgeCommand {
    /// Set up this computer: name and access of the servo adapter, real-time scheduling, a stop at shutdown.
    Install(install::InstallArgs),
    /// Look for servos on a port, at every rate.
    Scan {
        /// The port; default: the configuration's.
        #[arg(long)]
        port: Option<PathBuf>,
        #[command(flatten)]
        config: ConfigArg,
    },
    /// Compare every device with what it should be. Moves nothing.
    Doctor(doctor::DoctorArgs),
    /// Give the one servo on the bus its id and its settings.
    Provision {
        /// Which actuator it will be: thumb, index, middle, ring, little or opposition.
        #[arg(long)]
        actuator: String,
        #[command(flatten)]
        robot: RobotArgs,
        #[command(flatten)]
        config: ConfigArg,
    },
    /// Find every servo's open mark and travel by feeling. Moves the fingers, one after the other.
    Calibrate(calibrate::CalibrateArgs),
    /// Emulate servos and camera board on pseudo-terminals until interrupted.
    Emulate(emulate::EmulateArgs),
    /// Inject every fault into every phase of a trial on the emulated robot, and say what came of it.
    Faults(faults::FaultArgs),
    /// Close and open the hand gently: the first motion of a new hand.
    Exercise(exercise::ExerciseArgs),
    /// Find where the arm's base stands, by touching balls on three marks. Moves arm and hand.
    Register(register::RegisterArgs),
    /// Draw where the objects of a combination stand, as an A3 sheet in full size.
    Sheet(sheet::SheetArgs),
    /// Stop the robots that run in other terminals: they hold what they hold.
    Stop(stop::StopArgs),
    /// Restart servos that have shut down (overload, low voltage, overheating) and look at what came back. Grip is lost: asks first.
    Reboot(reboot::RebootArgs),
    /// Clear the arm's faults once their cause is gone: afterwards it can move again. Asks first.
    ClearFaults(clear_faults::ClearArgs),
}

/// Runs a command.
pub fn run(terminal: &Terminal, command: &BridgeCommand) -> Outcome {
    match command {
        BridgeCommand::Install(args) => install::run(terminal, args),
        BridgeCommand::Scan { port, config } => scan::run(terminal, port.as_deref(), config),
        BridgeCommand::Doctor(args) => doctor::run(terminal, args),
        BridgeCommand::Provision { actuator, robot, config } => provision::run(terminal, actuator, robot, config),
        BridgeCommand::Calibrate(args) => calibrate::run(terminal, args),
        BridgeCommand::Emulate(args) => emulate::run(terminal, args),
        BridgeCommand::Faults(args) => faults::run(terminal, args),
        BridgeCommand::Exercise(args) => exercise::run(terminal, args),
        BridgeCommand::Stop(args) => stop::run(terminal, args),
        BridgeCommand::Sheet(args) => sheet::run(terminal, args),
        BridgeCommand::Register(args) => register::run(terminal, args),
        BridgeCommand::Reboot(args) => reboot::run(terminal, args),
        BridgeCommand::ClearFaults(args) => clear_faults::run(terminal, args),
    }
}
