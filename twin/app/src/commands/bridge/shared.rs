//! Shared parts of the bridge's commands: the configuration option and findings.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use clap::Args;
use hand_model::Hand;
use hardware_bridge::config::BridgeConfig;
use hardware_bridge::remote::{self, RemoteCommand, socket_paths};
use hardware_bridge::setup::SetupFinding;
use schemars::JsonSchema;
use serde::Serialize;

use crate::terminal::Terminal;

/// Option for the configuration file.
#[derive(Debug, Clone, Args)]
pub struct ConfigArg {
    /// Configuration of the bridge.
    #[arg(long, default_value = "bridge.toml")]
    pub config: PathBuf,
}

impl ConfigArg {
    pub fn read(&self) -> Result<BridgeConfig> {
        BridgeConfig::read(&self.config).context("--config")
    }

    /// Reads the configuration without looking for the arm's password, for commands that do not need the arm.
    pub fn read_without_password(&self) -> Result<BridgeConfig> {
        BridgeConfig::read_without_password(&self.config).context("--config")
    }
}

/// Returns the names of the hand's actuators, in order.
pub fn actuator_names(hand: &Hand) -> Vec<String> {
    hand.parameters.actuator.iter().map(|actuator| actuator.name.clone()).collect()
}

/// A finding, as printed.
#[derive(Debug, Serialize, JsonSchema)]
pub struct FindingRow {
    /// Checked quantity.
    what: String,
    /// Value found.
    found: String,
    /// Expected value.
    expected: String,
    /// True if the value is as it should be.
    ok: bool,
}

/// Findings, as printed.
#[derive(Debug, Serialize, JsonSchema)]
pub struct FindingsOutput {
    /// One entry per row of the table.
    rows: Vec<FindingRow>,
}

pub fn finding_rows(findings: &[SetupFinding]) -> Vec<FindingRow> {
    let row = |SetupFinding { item: what, found, expected, passed: good }: SetupFinding| FindingRow {
        what,
        found,
        expected,
        ok: good,
    };
    findings.iter().cloned().map(row).collect()
}

/// Prints findings. The first bad one is the shortfall.
pub fn print_findings(terminal: &Terminal, findings: &[SetupFinding]) -> Result<Option<String>> {
    terminal.print(&FindingsOutput { rows: finding_rows(findings) }, &format_findings(terminal, findings))?;
    Ok(shortfall(findings))
}

/// Formats findings as a table, one per line. With --quiet, only the bad ones.
pub fn format_findings(terminal: &Terminal, findings: &[SetupFinding]) -> String {
    let line = |one: &SetupFinding| {
        let verdict = if one.passed { "ok" } else { "DIFFERS" };
        format!("{:44} {:>26}   {:34} {verdict}\n", one.item, one.found, one.expected)
    };
    findings.iter().filter(|one| !terminal.quiet || !one.passed).map(line).collect()
}

/// Describes the first bad finding, and gives the number of further ones.
pub fn shortfall(findings: &[SetupFinding]) -> Option<String> {
    let bad: Vec<&SetupFinding> = findings.iter().filter(|one| !one.passed).collect();
    let first = bad.first()?;
    let more = if bad.len() > 1 { format!(" (and {} more)", bad.len() - 1) } else { String::new() };
    Some(format!("{}: found {}, expected {}{more}", first.item, first.found, first.expected))
}

/// Formats a path for display.
pub fn display_path(path: &Path) -> String {
    path.display().to_string()
}

/// Returns an error while a robot of the configuration at `config` runs.
pub fn expect_no_robot(config: &Path) -> Result<()> {
    let own: Vec<_> = socket_paths::find_sockets()
        .0
        .into_iter()
        .filter(|socket| socket_paths::belongs_to_robot(socket, config))
        .collect();
    if let Some(robot) = remote::ask_all(&own, RemoteCommand::State).into_iter().find_map(|(_, answer)| answer.ok()) {
        bail!("a robot is running ({}: {}); expected none: end its trial first", robot.robot, robot.text);
    }
    Ok(())
}
