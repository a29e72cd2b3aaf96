//! The command line.

use std::ffi::OsString;
use std::path::PathBuf;

use clap::{Command as Described, CommandFactory as _, Parser, Subcommand};
use clap_complete::Shell;

use crate::commands::bench::BenchArgs;
use crate::commands::board::BoardCommand;
use crate::commands::bridge::BridgeCommand;
use crate::commands::combos::CombosArgs;
use crate::commands::demo::DemoArgs;
use crate::commands::demonstrations::DemonstrationsArgs;
use crate::commands::export::ExportCommand;
use crate::commands::grasps::GraspsCommand;
use crate::commands::hand::HandCommand;
use crate::commands::optics::OpticsCommand;
use crate::commands::ros2::Ros2Command;
use crate::commands::sweep::SweepCommand;
use crate::commands::sysid::SysidCommand;
use crate::commands::touch::TouchCommand;
use crate::commands::transport::TransportArgs;
use crate::commands::trial::TrialArgs;
use crate::commands::{
    bench, board, bridge, combos, demo, demonstrations, export, grasps, hand, optics, replay, report, ros2, schema,
    shell, sweep, sysid, touch, transport, trial, view,
};
use crate::front::CommandLine;
use crate::lab::arguments::arm::ArmCommand;
use crate::lab::arguments::report::ReportArgs;
use crate::lab::arguments::study::StudyArgs;
use crate::lab::hand_over::LabProgram;
use crate::lab::identity::identity;
use crate::options::backend::RobotOption;
use crate::terminal::{Outcome, Terminal};

/// Simulation, controller and hardware bridge of the F-TAC Hand on a Kinova Gen3 arm.
#[derive(Debug, Parser)]
#[command(name = "ftac", version, about, long_about = None)]
pub struct Cli {
    /// Options of every command.
    #[command(flatten)]
    pub terminal: Terminal,
    /// Command to run.
    #[command(subcommand)]
    pub command: FtacCommand,
}

/// Commands.
#[derive(Debug, Subcommand)]
pub enum FtacCommand {
    /// Show one trial under touch and blind side by side, in the viewer or as a page with a film.
    Demo(DemoArgs),
    /// Run the multi-object benchmark under all conditions.
    Bench(Box<BenchArgs>),
    /// List the object combinations by number and name.
    Combos(CombosArgs),
    /// Run many benchmarks along parameter axes, on this machine or on Slurm.
    #[command(subcommand)]
    Sweep(SweepCommand),
    /// Run one trial and record it.
    Trial(TrialArgs),
    /// Carry balls to one place, as many per trip as the hand holds, and compare with one ball per trip.
    Transport(TransportArgs),
    /// Open a recording, a session or a result folder in the Rerun viewer.
    View {
        /// An .rrd file, a session (MCAP), or a folder with either; a session is exported to an .rrd file beside it.
        path: PathBuf,
    },
    /// Run the control stack on a recorded session (MCAP), or on all sessions of a folder, and check that every command
    /// is bit-identical.
    Replay {
        /// Session file, or folder of sessions, of `trial --session DIR` or `bench --robot emulated|hardware`.
        recording: PathBuf,
        /// Run nothing; compare this session with the first one and report the first observation or command that
        /// differs.
        #[arg(long)]
        against: Option<PathBuf>,
    },
    /// Export recorded sessions to the formats of other programs.
    #[command(subcommand)]
    Export(ExportCommand),
    /// Run trials of the policy touch and write the clean ones as a LeRobot data set (v3.0) of demonstrations, with a
    /// card. Needs the Python package ftac[lerobot].
    Demonstrations(DemonstrationsArgs),
    /// Rebuild report.html, trials.csv and summary.json from result folders, and merge shards. For a sweep: curves and
    /// contrasts.
    Report(ReportArgs),
    /// Keep results of policies in one table: make rows from runs, list them, and check them.
    #[command(subcommand)]
    Board(BoardCommand),
    /// Run the whole grasp study and write its page: types, contact maps, energy landscape, comparison of hands.
    /// Resumes if interrupted.
    Study(StudyArgs),
    /// Check, close, draw and export the hand.
    #[command(subcommand)]
    Hand(HandCommand),
    /// Check the arm that carries the hand.
    #[command(subcommand)]
    Arm(ArmCommand),
    /// Synthesize, evaluate and show grasps; make repertoires and tables of grasp pairs.
    #[command(subcommand)]
    Grasps(GraspsCommand),
    /// Calibrate, train and evaluate tactile perception (photometric stereo).
    #[command(subcommand)]
    Touch(TouchCommand),
    /// Render tactile images, calibrate real sensors and reconstruct surfaces.
    #[command(subcommand)]
    Optics(OpticsCommand),
    /// Excite a robot and identify its parameters, for use in place of the nominal model.
    #[command(subcommand)]
    Sysid(SysidCommand),
    /// Publish sessions on ROS 2 topics, without a ROS installation.
    #[command(subcommand)]
    Ros2(Ros2Command),
    /// Set up and operate the real robot's devices, or their emulator.
    #[command(subcommand)]
    Bridge(BridgeCommand),
    /// Print a completion script for a shell.
    Completions {
        /// The shell.
        shell: Shell,
    },
    /// Print the JSON Schema of a command's `--json` output.
    Schema {
        /// Command, such as `grasps generate`; default: all commands.
        command: Vec<String>,
    },
    /// Write the reference pages of the book: commands, JSON output, columns of tables.
    #[command(hide = true)]
    Reference {
        /// Folder for the pages, twin/guide/src/reference in the repository.
        #[arg(long)]
        out: PathBuf,
    },
    /// Write manual pages.
    Man {
        /// The folder for them, such as ~/.local/share/man/man1.
        #[arg(long)]
        out: PathBuf,
    },
}

/// Commands grouped by purpose, in the order of `ftac --help`.
pub(crate) const COMMAND_GROUPS: [(&str, &[&str]); 5] = [
    ("Run trials", &["demo", "bench", "combos", "sweep", "trial", "transport", "demonstrations"]),
    ("Look at results", &["view", "report", "board", "export", "replay", "ros2"]),
    ("Study the parts", &["study", "hand", "arm", "grasps", "touch", "optics"]),
    ("Drive the real robot", &["bridge", "sysid"]),
    ("Set up the terminal", &["completions", "man", "schema", "help"]),
];

/// Builds the command line with its help in groups. Options accept negative numbers.
pub fn command_definition() -> Described {
    let command = with_negative_numbers(Cli::command());
    let mut groups = String::new();
    for (title, names) in COMMAND_GROUPS {
        groups += &format!("{title}:\n");
        for name in names {
            let about = command.find_subcommand(name).and_then(|found| found.get_about()).map(ToString::to_string);
            let about = about.unwrap_or_else(|| "Print this message or the help of a command".to_owned());
            groups += &format!("  {name:<12} {about}\n");
        }
        groups.push('\n');
    }
    command.help_template(format!("{{about}}\n\n{{usage-heading}} {{usage}}\n\n{groups}Options:\n{{options}}\n"))
}

/// Lets option values begin with a minus sign: the command itself reports a negative number that it cannot use.
pub fn with_negative_numbers(command: Described) -> Described {
    let command = command.mut_args(|argument| match argument.get_action().takes_values() {
        true => argument.allow_negative_numbers(true),
        false => argument,
    });
    command.mut_subcommands(with_negative_numbers)
}

impl CommandLine for Cli {
    fn definition() -> Described {
        command_definition()
    }

    fn terminal(&self) -> &Terminal {
        &self.terminal
    }

    fn moves_devices(&self) -> bool {
        match &self.command {
            FtacCommand::Bridge(_) => true,
            FtacCommand::Trial(args) => args.config.is_some() || matches!(args.robot, RobotOption::Driver(_)),
            FtacCommand::Bench(args) => args.config.is_some() || matches!(args.robot, Some(RobotOption::Driver(_))),
            FtacCommand::Sysid(SysidCommand::Excite(args)) => args.config.is_some(),
            _ => false,
        }
    }

    fn execute(&self, arguments: &[OsString]) -> Outcome {
        let terminal = &self.terminal;
        let lab = &LabProgram { arguments, identity: || identity(command_definition()) };
        match &self.command {
            FtacCommand::Demo(args) => demo::run(terminal, args),
            FtacCommand::Bench(args) => bench::benchmark(terminal, args),
            FtacCommand::Combos(args) => combos::run(terminal, args),
            FtacCommand::Sweep(command) => sweep::run(terminal, command),
            FtacCommand::Trial(args) => trial::trial(terminal, args),
            FtacCommand::Replay { recording, against: None } => replay::command(terminal, recording),
            FtacCommand::Replay { recording, against: Some(other) } => {
                replay::compare_sessions(terminal, recording, other)
            }
            FtacCommand::Transport(args) => transport::run(terminal, args),
            FtacCommand::View { path } => view::run(terminal, path),
            FtacCommand::Export(command) => export::run(terminal, command),
            FtacCommand::Demonstrations(args) => demonstrations::run(terminal, args),
            FtacCommand::Report(args) => report::run(terminal, args, lab),
            FtacCommand::Board(command) => board::run(terminal, command),
            FtacCommand::Hand(command) => hand::run(terminal, command, lab),
            FtacCommand::Grasps(command) => grasps::run(terminal, command, lab),
            FtacCommand::Touch(command) => touch::run(terminal, command, lab),
            FtacCommand::Study(_) | FtacCommand::Arm(_) | FtacCommand::Reference { .. } => Err(lab.exec_lab()),
            FtacCommand::Optics(command) => optics::run(terminal, command),
            FtacCommand::Bridge(command) => bridge::run(terminal, command),
            FtacCommand::Ros2(command) => ros2::run(terminal, command),
            FtacCommand::Sysid(command) => sysid::run(terminal, command),
            FtacCommand::Completions { shell } => shell::print_completions(*shell, command_definition()),
            FtacCommand::Man { out } => shell::write_manual(out, command_definition()),
            FtacCommand::Schema { command } => schema::run(terminal, command, &command_definition(), lab),
        }
    }
}

/// Checks that `ftac` accepts these arguments. The error is the first line of its message otherwise.
pub fn parse_arguments(arguments: &[&str]) -> Result<(), String> {
    match command_definition().try_get_matches_from(std::iter::once("ftac").chain(arguments.iter().copied())) {
        Ok(_) => Ok(()),
        Err(error) => Err(error.to_string().lines().next().unwrap_or_default().to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    /// Each command that is not hidden is listed in one group of the help, with its summary.
    #[test]
    fn every_command_is_in_the_help() {
        let mut command = command_definition();
        let help = command.render_help().to_string();
        let shown = command.get_subcommands().filter(|found| !found.is_hide_set());
        let names: BTreeSet<String> = shown.map(|found| found.get_name().to_owned()).collect();
        for name in &names {
            assert_eq!(help.matches(&format!("\n  {name} ")).count(), 1, "{name}:\n{help}");
        }
        assert!(names.len() > 10, "{names:?}");
    }

    #[test]
    fn every_command_has_a_page() {
        let folder = tempfile::tempdir().expect("a folder");
        shell::write_manual(folder.path(), command_definition()).expect("written");
        let page = |name: &str| std::fs::read_to_string(folder.path().join(name)).expect("a page");
        assert!(page("ftac.1").contains("bench") && page("ftac-bench.1").contains("noise\\-scale"));
    }
}
