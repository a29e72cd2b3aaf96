//! Arguments of `ftac arm`.

use std::path::PathBuf;

use clap::Subcommand;

use crate::options::robot::RobotArgs;

/// `arm` commands.
#[derive(Debug, Subcommand)]
pub enum ArmCommand {
    /// Check the arm: limits, gravity compensation, inverse kinematics, reach, and behaviour when it cannot follow.
    Check {
        /// Folder for pictures and check.json.
        #[arg(long)]
        out: Option<PathBuf>,
        #[command(flatten)]
        robot: RobotArgs,
    },
}
