//! `ftac bridge install`: sets up the computer for the bridge with system files, and reports each step in words.

use std::os::unix::fs::MetadataExt as _;
use std::path::PathBuf;

use anyhow::{Context, bail, ensure};
use clap::Args;
use ftac_platform::child;
use hardware_bridge::install::{self, FileContent, InstallSetup, OPERATOR_GROUP};
use schemars::JsonSchema;
use serde::Serialize;

use super::shared::ConfigArg;
use crate::terminal::{Outcome, Terminal};

/// Arguments of `bridge install`.
#[derive(Debug, Args)]
pub struct InstallArgs {
    #[command(flatten)]
    config: ConfigArg,
    /// Serial number of the servo adapter; default: that in the port name of the configuration, else any known adapter.
    #[arg(long)]
    serial: Option<String>,
    /// Write below this folder instead of / and run no system commands: to inspect the files, or for a system image.
    #[arg(long)]
    root: Option<PathBuf>,
    /// Remove the installation.
    #[arg(long)]
    remove: bool,
    /// Only print the files.
    #[arg(long, conflicts_with = "remove")]
    dry_run: bool,
}

/// A file of the installation.
#[derive(Debug, Serialize, JsonSchema)]
struct InstalledFile {
    /// Path of the file.
    path: PathBuf,
    /// Purpose of the file.
    purpose: &'static str,
}

/// JSON output of `bridge install`, also of a dry run.
#[derive(Debug, Serialize, JsonSchema)]
pub struct InstallOutput {
    /// Files of the installation.
    files: Vec<InstalledFile>,
    /// System commands that were run.
    done: Vec<String>,
}

/// System commands that activate the files after they were written or removed.
const ACTIVATION_COMMANDS: [&[&str]; 5] = [
    &["udevadm", "control", "--reload"],
    &["udevadm", "trigger", "--subsystem-match=tty", "--subsystem-match=usb-serial"],
    &["systemctl", "daemon-reload"],
    &["systemd-tmpfiles", "--create", "/etc/tmpfiles.d/ftac.conf"],
    &["systemctl", "enable", "--now", "ftac-stop.service"],
];
/// System command to run before the files are removed.
const DEACTIVATION_COMMAND: &[&str] = &["systemctl", "disable", "ftac-stop.service"];

/// Runs `ftac bridge install`.
pub fn run(terminal: &Terminal, args: &InstallArgs) -> Outcome {
    // The configuration is only read for the adapter's port.
    let serial = match &args.serial {
        Some(serial) => Some(serial.clone()),
        None => {
            let bridge =
                args.config.read_without_password().context("--serial names an adapter without a configuration")?;
            install::serial_of(&bridge.servos.port)
        }
    };
    if let Some(odd) = serial.as_ref().filter(|serial| !serial.chars().all(|c| c.is_ascii_alphanumeric())) {
        bail!("--serial: found `{odd}`, expected letters and digits");
    }
    let program = std::env::current_exe().context("the program's path")?;
    let files = install::files(&InstallSetup { serial, program });
    let root = args.root.clone().unwrap_or_else(|| PathBuf::from("/"));
    let system = args.root.is_none();
    let rows =
        || files.iter().map(|file| InstalledFile { path: root.join(file.path), purpose: file.purpose }).collect();
    if args.dry_run {
        let text: String = files
            .iter()
            .map(|file| match &file.content {
                FileContent::Text(text) => format!("== {}\n{text}\n", root.join(file.path).display()),
                FileContent::Program(program) => {
                    format!("== {}\na copy of {}\n\n", root.join(file.path).display(), program.display())
                }
            })
            .collect();
        terminal.print(&InstallOutput { files: rows(), done: Vec::new() }, &text)?;
        return Ok(None);
    }
    let user = std::fs::metadata("/proc/self").context("/proc/self")?.uid();
    ensure!(
        !system || user == 0,
        "found user {user}, expected root: `sudo {} bridge install --config {}` (or --root FOLDER, or --dry-run)",
        std::env::args().next().unwrap_or_else(|| "ftac".into()),
        args.config.config.display()
    );
    let mut done = Vec::new();
    let mut failed = Vec::new();
    let mut tell = |command: &[&str]| match run_system_command(command) {
        Ok(()) => done.push(command.join(" ")),
        Err(why) => failed.push(format!("`{}`: {why}", command.join(" "))),
    };
    let text = if args.remove {
        if system {
            tell(DEACTIVATION_COMMAND);
        }
        let removed = install::remove(&root, &files)?;
        removed.iter().map(|path| format!("removed {}\n", path.display())).collect::<String>()
    } else {
        install::write(&root, &files)?;
        files.iter().map(|file| format!("{}: {}\n", root.join(file.path).display(), file.purpose)).collect()
    };
    if system {
        let commands = if args.remove { &ACTIVATION_COMMANDS[..3] } else { &ACTIVATION_COMMANDS[..] };
        commands.iter().for_each(|command| tell(command));
        // The user who called sudo.
        match std::env::var("SUDO_USER") {
            Ok(user) if !args.remove => tell(&["usermod", "-a", "-G", OPERATOR_GROUP, &user]),
            _ => {}
        }
    }
    let told: String = done.iter().map(|command| format!("done: {command}\n")).collect();
    let hint = if args.remove {
        ""
    } else {
        "log out and in again: groups and scheduling limits hold from the next login on\n"
    };
    terminal.print(&InstallOutput { files: rows(), done }, &format!("{text}{told}{hint}"))?;
    Ok((!failed.is_empty()).then(|| failed.join("; ")))
}

/// Runs a system command. The error is its stderr.
fn run_system_command(command: &[&str]) -> Result<(), String> {
    let (program, arguments) = command.split_first().ok_or("no program")?;
    let output = child::command(program).args(arguments).output().map_err(|error| error.to_string())?;
    if output.status.success() {
        return Ok(());
    }
    Err(String::from_utf8_lossy(&output.stderr).trim().to_owned())
}
