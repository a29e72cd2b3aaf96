//! `ftac arm`.

use std::path::PathBuf;

use clap::Subcommand;
use lab::arm_check;

use super::rows::show_rows;
use crate::options::robot::RobotArgs;
use crate::terminal::{Outcome, Terminal};

/// `arm` commands.
#[derive(Debug, Subcommand)]
pub enum ArmCommand {
    /// Check the arm: limits, gravity compensation, inverse kinematics, reach, and what it does where it cannot follow.
    Check {
        /// Folder for pictures and check.json.
        #[arg(long)]
        out: Option<PathBuf>,
        #[command(flatten)]
        robot: RobotArgs,
    },
}

/// Runs a command.
pub fn run(terminal: &Terminal, command: &ArmCommand) -> Outcome {
    let ArmCommand::Check { out, robot } = command;
    let rows = arm_check::run(&robot.model()?, terminal.seed, out.as_deref(), terminal.quiet)?;
    show_rows(terminal, &rows, out.as_deref())
}
