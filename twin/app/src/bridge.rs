//! `ftac bridge`: everything about the real robot, and its emulator.

mod calibrate;
mod doctor;
mod emulate;
mod exercise;
mod faults;
mod provision;
mod scan;
mod stop;

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context as _, Result};
use clap::{Args, Subcommand};
use hand_model::{ARM_JOINTS, Hand};
use hardware_bridge::arm_link::{ArmLink, LoopbackArm};
use hardware_bridge::config::{ArmConfig, BridgeConfig};
use hardware_bridge::kortex_link::KortexLink;
use hardware_bridge::setup::Finding;
use kortex::{Address, Credentials, Timeouts};

use crate::cli::Cli;

/// `bridge` commands.
#[derive(Debug, Subcommand)]
pub enum BridgeCommand {
    /// Look for servos on a port, at every rate.
    Scan {
        /// The port; default: the configuration's.
        #[arg(long)]
        port: Option<PathBuf>,
        #[command(flatten)]
        config: ConfigArg,
    },
    /// Compare every device with what it should be. Moves nothing.
    Doctor(ConfigArg),
    /// Give the one servo on the bus its id and its settings.
    Provision {
        /// Which actuator it will be: thumb, index, middle, ring, little or opposition.
        #[arg(long)]
        actuator: String,
        #[command(flatten)]
        config: ConfigArg,
    },
    /// Find every servo's open mark and travel by feeling. Moves the fingers, one after the other.
    Calibrate {
        #[command(flatten)]
        config: ConfigArg,
        /// Do not ask before moving.
        #[arg(long)]
        yes: bool,
    },
    /// Emulate servos and camera board on pseudo-terminals until interrupted.
    Emulate(emulate::EmulateArgs),
    /// Inject every fault into every phase of a trial on the emulated robot, and say what came of it.
    Faults(faults::FaultArgs),
    /// Close and open the hand gently: the first motion of a new hand.
    Exercise(exercise::ExerciseArgs),
    /// Stop the robot that runs in another terminal: it holds what it holds.
    Stop {
        #[command(flatten)]
        config: ConfigArg,
        /// Let go instead: the springs open the hand.
        #[arg(long)]
        release: bool,
    },
    /// Let a robot that was stopped go on.
    Resume(ConfigArg),
}

/// Where the configuration is.
#[derive(Debug, Clone, Args)]
pub struct ConfigArg {
    /// Configuration of the bridge.
    #[arg(long, default_value = "bridge.toml")]
    pub config: PathBuf,
}

impl ConfigArg {
    fn read(&self) -> Result<BridgeConfig> {
        Ok(BridgeConfig::read(&self.config)?)
    }
}

/// Runs a command.
pub fn run(cli: &Cli, command: &BridgeCommand) -> Result<Option<String>> {
    match command {
        BridgeCommand::Scan { port, config } => scan::run(cli, port.as_deref(), config),
        BridgeCommand::Doctor(config) => doctor::run(cli, &config.read()?),
        BridgeCommand::Provision { actuator, config } => provision::run(cli, actuator, &config.read()?),
        BridgeCommand::Calibrate { config, yes } => calibrate::run(cli, &config.read()?, *yes),
        BridgeCommand::Emulate(args) => emulate::run(cli, args),
        BridgeCommand::Faults(args) => faults::run(cli, args),
        BridgeCommand::Exercise(args) => exercise::run(cli, args),
        BridgeCommand::Stop { config, release } => stop::stop(cli, &config.read()?, *release),
        BridgeCommand::Resume(config) => stop::resume(cli, &config.read()?),
    }
}

/// The actuators' names, in order.
fn actuator_names() -> Vec<String> {
    Hand::ftac().parameters.actuator.into_iter().map(|actuator| actuator.name).collect()
}

/// The client of the configured arm, connected. `near` is the posture it is expected in, rad.
pub(crate) fn arm_link(config: &BridgeConfig, near: [f64; ARM_JOINTS]) -> Result<Box<dyn ArmLink>> {
    match &config.arm {
        ArmConfig::Loopback => Ok(Box::new(LoopbackArm::at(near))),
        ArmConfig::Kortex { host, tcp_port, udp_port, user, password } => {
            let address = Address { tcp: (*host, *tcp_port).into(), udp: (*host, *udp_port).into() };
            let credentials = Credentials { user: user.clone(), password: password.clone() };
            let arm = kortex::Arm::connect(address, &credentials, Timeouts::default(), near)
                .with_context(|| format!("arm at {host}"))?;
            let tick = Duration::from_secs_f64(1.0 / config.servos.rate);
            Ok(Box::new(KortexLink::new(arm, tick, Duration::from_secs_f64(config.limits.arm_watchdog))))
        }
    }
}

/// Prints findings; the first that is not good is the shortfall.
fn tell(cli: &Cli, findings: &[Finding]) -> Option<String> {
    if cli.json {
        let rows: Vec<_> = findings
            .iter()
            .map(|one| {
                serde_json::json!({"what": one.what, "found": one.found, "expected": one.expected, "ok": one.good})
            })
            .collect();
        println!("{}", serde_json::json!({ "rows": rows }));
    } else {
        for one in findings.iter().filter(|one| !cli.quiet || !one.good) {
            let verdict = if one.good { "ok" } else { "DIFFERS" };
            println!("{:44} {:>26}   {:34} {verdict}", one.what, one.found, one.expected);
        }
    }
    let bad: Vec<&Finding> = findings.iter().filter(|one| !one.good).collect();
    let first = bad.first()?;
    let more = if bad.len() > 1 { format!(" (and {} more)", bad.len() - 1) } else { String::new() };
    Some(format!("{}: found {}, expected {}{more}", first.what, first.found, first.expected))
}

/// Whether the operator agrees, asked in the terminal.
pub(crate) fn agreed(question: &str) -> Result<bool> {
    eprint!("{question} [yes/no] ");
    let mut line = String::new();
    std::io::stdin().read_line(&mut line)?;
    Ok(line.trim() == "yes")
}

/// How a path is shown.
fn shown(path: &Path) -> String {
    path.display().to_string()
}
