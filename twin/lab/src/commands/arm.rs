//! `ftac arm`: checks of the arm.

use ftac::lab::arguments::arm::ArmCommand;
use ftac::terminal::{Outcome, Terminal};
use lab::arm_check;

use super::rows::show_rows;

/// Runs a command.
pub fn run(terminal: &Terminal, command: &ArmCommand) -> Outcome {
    let ArmCommand::Check { out, robot } = command;
    let rows = arm_check::run(&robot.model()?, terminal.seed, out.as_deref(), terminal.quiet)?;
    show_rows(terminal, &rows, out.as_deref())
}
