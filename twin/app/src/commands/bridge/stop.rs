//! `ftac bridge stop`: stops or releases robots that run in other terminals.
//!
//! It needs only their stop sockets: no readable configuration, no password, no port.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use clap::Args;
use dynamixel_bus::servo_bus::ServoBus;
use hardware_bridge::config::BridgeConfig;
use hardware_bridge::hand_bus::HandBus;
use hardware_bridge::remote::{self, RemoteAnswer, RemoteCommand, RemoteError, socket_paths};
use schemars::JsonSchema;
use serde::Serialize;

use super::shared::display_path;
use crate::terminal::{Outcome, Terminal};

/// Arguments of `bridge stop`.
#[derive(Debug, Args)]
pub struct StopArgs {
    /// Stop only the robot that was started with this configuration, even if the file has changed since; default: all
    /// robots on this computer that this user may stop.
    #[arg(long)]
    config: Option<PathBuf>,
    /// Stop only the robot that listens on this stop socket.
    #[arg(long, conflicts_with = "config")]
    socket: Option<PathBuf>,
    /// Release instead: the springs open the hand. If several robots run, one must be named. If none runs, the torque
    /// of the servos of --config is switched off directly.
    #[arg(long)]
    release: bool,
}

/// A robot that was asked to stop.
#[derive(Debug, Serialize, JsonSchema)]
struct StoppedRobot {
    /// Its stop socket.
    socket: PathBuf,
    /// Its configuration and process.
    #[serde(skip_serializing_if = "Option::is_none")]
    robot: Option<String>,
    /// State read back, or the reason why none was.
    state: String,
    /// True if the state read back is the requested one.
    ok: bool,
}

/// JSON output of `bridge stop`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct StopReport {
    /// Robots that were asked to stop; empty if no bridge is running.
    robots: Vec<StoppedRobot>,
    /// State read back directly from the servos.
    #[serde(skip_serializing_if = "Option::is_none")]
    state: Option<String>,
    /// Servos whose torque was not read back as off, each with the reason.
    #[serde(skip_serializing_if = "Option::is_none")]
    torque_unknown: Option<Vec<String>>,
}

/// Runs `ftac bridge stop`.
pub fn run(terminal: &Terminal, args: &StopArgs) -> Outcome {
    let command = if args.release { RemoteCommand::Release } else { RemoteCommand::Hold };
    let (sockets, looked) = sockets(args);
    if args.release && sockets.len() > 1 {
        let robots = answering(remote::ask_all(&sockets, RemoteCommand::State));
        if robots.len() > 1 {
            let listed: Vec<String> = robots.iter().map(|(socket, _)| display_path(socket)).collect();
            let (count, listed) = (robots.len(), listed.join(", "));
            bail!("found {count} robots, expected one to release: name it by --config or --socket ({listed})");
        }
    }
    let answers = answering(remote::ask_all(&sockets, command));
    if answers.is_empty() {
        return stop_without_bridge(terminal, args, &looked);
    }
    print_answers(terminal, &answers)?;
    let failed: Vec<String> =
        answers.iter().filter_map(|(_, answer)| Some(answer.as_ref().err()?.to_string())).collect();
    Ok((!failed.is_empty()).then(|| failed.join("; ")))
}

type SocketAnswer = (PathBuf, Result<RemoteAnswer, RemoteError>);

/// Keeps the answers of sockets on which a robot listens.
fn answering(answers: Vec<SocketAnswer>) -> Vec<SocketAnswer> {
    answers.into_iter().filter(|(_, answer)| !matches!(answer, Err(RemoteError::NoBridge { .. }))).collect()
}

/// Returns the sockets to write to, and the folders that were searched for them.
fn sockets(args: &StopArgs) -> (Vec<PathBuf>, Vec<PathBuf>) {
    if let Some(socket) = &args.socket {
        return (vec![socket.clone()], vec![socket.clone()]);
    }
    let (mut sockets, mut looked) = socket_paths::find_sockets();
    if let Some(config) = &args.config {
        sockets.retain(|socket| socket_paths::belongs_to_robot(socket, config));
        // The socket named by the configuration may be the only one that this user can reach. An unreadable
        // configuration names none.
        let own = BridgeConfig::read_without_password(config).ok().and_then(|config| config.stop_socket);
        if sockets.is_empty() {
            sockets.extend(own.iter().cloned());
        }
        looked.extend(own);
    }
    (sockets, looked)
}

/// Handles the case that no bridge is running: a release then switches the torque of the servos off directly.
fn stop_without_bridge(terminal: &Terminal, args: &StopArgs, looked: &[PathBuf]) -> Outcome {
    let looked: Vec<String> = looked.iter().map(|place| display_path(place)).collect();
    let nobody = format!("no bridge is running that this user may stop (looked in {})", looked.join(", "));
    if !args.release {
        let rest = "servos of an ended program hold, or were stopped by their watchdogs; --release opens the hand";
        return Ok(Some(format!("{nobody}; {rest}")));
    }
    if args.socket.is_some() {
        // The servos of another robot must not be let go.
        let rest = "--config names the robot whose servos are to be released directly";
        return Ok(Some(format!("{nobody}; {rest}")));
    }
    let file = args.config.as_deref().unwrap_or(Path::new("bridge.toml"));
    let config = BridgeConfig::read_without_password(file)
        .with_context(|| format!("{nobody}; the port of the servos is needed to switch their torque off directly"))?;
    let bus = ServoBus::open(&config.servos.port, config.bus()).context(nobody.clone())?;
    let unsure = HandBus::new(bus, config.servos.ids, config.servos.fast_sync_read).torque_off();
    let count = config.servos.ids.len();
    let state = format!("torque read back as off from {} of {count} servos", count - unsure.len());
    let shortfall = (!unsure.is_empty()).then(|| format!("the torque may be on: {}", unsure.join("; ")));
    let text = format!("{nobody}; {state}\n");
    terminal.print(&StopReport { robots: Vec::new(), state: Some(state), torque_unknown: Some(unsure) }, &text)?;
    Ok(shortfall)
}

fn print_answers(terminal: &Terminal, answers: &[SocketAnswer]) -> Result<()> {
    let row = |(socket, answer): &SocketAnswer| {
        let (robot, state) = match answer {
            Ok(RemoteAnswer { text, robot: of }) => (Some(of.clone()), text.clone()),
            Err(RemoteError::Refused { of, reason }) => (Some(of.clone()), reason.clone()),
            Err(error) => (None, error.to_string()),
        };
        StoppedRobot { socket: socket.clone(), robot, state, ok: answer.is_ok() }
    };
    let answered = answers.iter().filter_map(|(_, answer)| answer.as_ref().ok());
    let text: String = answered.map(|RemoteAnswer { text, robot: of }| format!("{of}: {text}\n")).collect();
    terminal.print(&StopReport { robots: answers.iter().map(row).collect(), state: None, torque_unknown: None }, &text)
}
