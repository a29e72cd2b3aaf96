//! `ftac bridge install`: the computer's part of the bridge, as files of the system, with what was done in words.

use std::os::unix::fs::MetadataExt as _;
use std::path::PathBuf;

use anyhow::{Context, bail, ensure};
use clap::Args;
use hardware_bridge::install::{self, Content, GROUP, Setup};
use platform::child;
use schemars::JsonSchema;
use serde::Serialize;

use super::shared::ConfigArg;
use crate::terminal::{Outcome, Terminal};

/// Arguments of `bridge install`.
#[derive(Debug, Args)]
pub struct InstallArgs {
    #[command(flatten)]
    config: ConfigArg,
    /// Serial number of the servo adapter; default: the one in the name of the configuration's port, else any known adapter.
    #[arg(long)]
    serial: Option<String>,
    /// Write below this folder instead of /, and tell the system nothing: to look at the files, or for an image.
    #[arg(long)]
    root: Option<PathBuf>,
    /// Take away what was installed.
    #[arg(long)]
    remove: bool,
    /// Only show the files.
    #[arg(long, conflicts_with = "remove")]
    dry_run: bool,
}

/// A file of the installation.
#[derive(Debug, Serialize, JsonSchema)]
struct InstalledFile {
    /// The file.
    path: PathBuf,
    /// Its purpose.
    purpose: &'static str,
}

/// Printed once it is installed or removed, or of what would be.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Installed {
    /// Files of the installation.
    files: Vec<InstalledFile>,
    /// Commands that the system was told.
    done: Vec<String>,
}

/// What makes the system take notice, after the files were written or removed.
const NOTICE: [&[&str]; 5] = [
    &["udevadm", "control", "--reload"],
    &["udevadm", "trigger", "--subsystem-match=tty", "--subsystem-match=usb-serial"],
    &["systemctl", "daemon-reload"],
    &["systemd-tmpfiles", "--create", "/etc/tmpfiles.d/ftac.conf"],
    &["systemctl", "enable", "--now", "ftac-stop.service"],
];
/// Before they are removed.
const FAREWELL: &[&str] = &["systemctl", "disable", "ftac-stop.service"];

/// `ftac bridge install`.
pub fn run(terminal: &Terminal, args: &InstallArgs) -> Outcome {
    // The configuration tells the adapter, and nothing else.
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
    let program = std::env::current_exe().context("the program's own place")?;
    let files = install::files(&Setup { serial, program });
    let root = args.root.clone().unwrap_or_else(|| PathBuf::from("/"));
    let system = args.root.is_none();
    let rows =
        || files.iter().map(|file| InstalledFile { path: root.join(file.path), purpose: file.purpose }).collect();
    if args.dry_run {
        let text: String = files
            .iter()
            .map(|file| match &file.content {
                Content::Text(text) => format!("== {}\n{text}\n", root.join(file.path).display()),
                Content::Program(program) => {
                    format!("== {}\na copy of {}\n\n", root.join(file.path).display(), program.display())
                }
            })
            .collect();
        terminal.print(&Installed { files: rows(), done: Vec::new() }, &text)?;
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
    let mut tell = |command: &[&str]| match notice(command) {
        Ok(()) => done.push(command.join(" ")),
        Err(why) => failed.push(format!("`{}`: {why}", command.join(" "))),
    };
    let text = if args.remove {
        if system {
            tell(FAREWELL);
        }
        let removed = install::remove(&root, &files)?;
        removed.iter().map(|path| format!("removed {}\n", path.display())).collect::<String>()
    } else {
        install::write(&root, &files)?;
        files.iter().map(|file| format!("{}: {}\n", root.join(file.path).display(), file.purpose)).collect()
    };
    if system {
        let commands = if args.remove { &NOTICE[..3] } else { &NOTICE[..] };
        commands.iter().for_each(|command| tell(command));
        // The name under which sudo was called.
        match std::env::var("SUDO_USER") {
            Ok(user) if !args.remove => tell(&["usermod", "-a", "-G", GROUP, &user]),
            _ => {}
        }
    }
    let told: String = done.iter().map(|command| format!("done: {command}\n")).collect();
    let hint = if args.remove {
        ""
    } else {
        "log out and in again: groups and scheduling limits hold from the next login on\n"
    };
    terminal.print(&Installed { files: rows(), done }, &format!("{text}{told}{hint}"))?;
    Ok((!failed.is_empty()).then(|| failed.join("; ")))
}

/// Runs a program of the system.
fn notice(command: &[&str]) -> Result<(), String> {
    let (program, arguments) = command.split_first().ok_or("no program")?;
    let output = child::command(program).args(arguments).output().map_err(|error| error.to_string())?;
    if output.status.success() {
        return Ok(());
    }
    Err(String::from_utf8_lossy(&output.stderr).trim().to_owned())
}
