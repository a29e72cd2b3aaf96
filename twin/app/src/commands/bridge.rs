//! `ftac bridge`: setup and operation of the real robot, and its emulator.

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
    /// Set up this computer: name and permissions of the servo adapter, real-time scheduling, a stop at shutdown.
    Install(install::InstallArgs),
    /// Scan a port for servos at every baud rate.
    Scan {
        /// Serial port; default: that of the configuration.
        #[arg(long)]
        port: Option<PathBuf>,
        #[command(flatten)]
        config: ConfigArg,
    },
    /// Check the state and settings of every device. Moves nothing.
    Doctor(doctor::DoctorArgs),
    /// Write id and settings to the only servo on the bus.
    Provision {
        /// Actuator that the servo will drive: thumb, index, middle, ring, little or opposition.
        #[arg(long)]
        actuator: String,
        #[command(flatten)]
        robot: RobotArgs,
        #[command(flatten)]
        config: ConfigArg,
    },
    /// Find the open mark and travel of every servo by its end stops. Moves the fingers, one after the other.
    Calibrate(calibrate::CalibrateArgs),
    /// Emulate servos and camera board on pseudo-terminals until interrupted.
    Emulate(emulate::EmulateArgs),
    /// Inject every fault into every phase of a trial on the emulated robot, and report the outcomes.
    Faults(faults::FaultArgs),
    /// Close and open the hand gently: the first motion of a new hand.
    Exercise(exercise::ExerciseArgs),
    /// Register the pose of the arm's base by touching balls on three marks. Moves arm and hand.
    Register(register::RegisterArgs),
    /// Draw the positions of a combination's objects on an A3 sheet in full size.
    Sheet(sheet::SheetArgs),
    /// Stop the robots that run in other terminals: they hold their position and grip.
    Stop(stop::StopArgs),
    /// Restart servos that have shut down (overload, low voltage, overheating) and check them. The grip is lost: asks
    /// first.
    Reboot(reboot::RebootArgs),
    /// Clear the arm's faults once their cause is gone; afterwards the arm can move again. Asks first.
    ClearFaults(clear_faults::ClearArgs),
}

/// Runs a `bridge` command.
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
