//! What the bridge's commands share: the configuration's place, findings.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use clap::Args;
use hand_model::Hand;
use hardware_bridge::config::BridgeConfig;
use hardware_bridge::remote::{self, Wish, places};
use hardware_bridge::setup::Finding;
use schemars::JsonSchema;
use serde::Serialize;

use crate::terminal::Terminal;

/// Where the configuration is.
#[derive(Debug, Clone, Args)]
pub struct ConfigArg {
    /// Configuration of the bridge.
    #[arg(long, default_value = "bridge.toml")]
    pub config: PathBuf,
}

impl ConfigArg {
    pub fn read(&self) -> Result<BridgeConfig> {
        Ok(BridgeConfig::read(&self.config)?)
    }

    /// For what has nothing to do with the arm: its password is not looked for.
    pub fn read_without_password(&self) -> Result<BridgeConfig> {
        Ok(BridgeConfig::read_without_password(&self.config)?)
    }
}

/// The names of the hand's actuators, in order.
pub fn actuator_names(hand: &Hand) -> Vec<String> {
    hand.parameters.actuator.iter().map(|actuator| actuator.name.clone()).collect()
}

/// A finding as it is printed.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Row {
    /// Quantity that was measured.
    what: String,
    /// Outcome: see the command's help.
    found: String,
    /// Expected outcome.
    expected: String,
    /// True if it is as it should be.
    ok: bool,
}

/// Findings as they are printed.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Findings {
    /// One entry a row of the table.
    rows: Vec<Row>,
}

pub fn rows(findings: &[Finding]) -> Vec<Row> {
    let row = |Finding { what, found, expected, good }: Finding| Row { what, found, expected, ok: good };
    findings.iter().cloned().map(row).collect()
}

/// Prints findings; the first that is not good is the shortfall.
pub fn tell(terminal: &Terminal, findings: &[Finding]) -> Result<Option<String>> {
    terminal.print(&Findings { rows: rows(findings) }, &table(terminal, findings))?;
    Ok(shortfall(findings))
}

/// Findings as a table, a line each; those that are good only where not quiet.
pub fn table(terminal: &Terminal, findings: &[Finding]) -> String {
    let line = |one: &Finding| {
        let verdict = if one.good { "ok" } else { "DIFFERS" };
        format!("{:44} {:>26}   {:34} {verdict}\n", one.what, one.found, one.expected)
    };
    findings.iter().filter(|one| !terminal.quiet || !one.good).map(line).collect()
}

/// The first finding that is not good, and how many more there are.
pub fn shortfall(findings: &[Finding]) -> Option<String> {
    let bad: Vec<&Finding> = findings.iter().filter(|one| !one.good).collect();
    let first = bad.first()?;
    let more = if bad.len() > 1 { format!(" (and {} more)", bad.len() - 1) } else { String::new() };
    Some(format!("{}: found {}, expected {}{more}", first.what, first.found, first.expected))
}

/// How a path is shown.
pub fn shown(path: &Path) -> String {
    path.display().to_string()
}

/// Refuses while a robot of the configuration at `config` runs.
pub fn expect_no_robot(config: &Path) -> Result<()> {
    let own: Vec<_> = places::find().0.into_iter().filter(|socket| places::is_of(socket, config)).collect();
    if let Some(robot) = remote::ask_all(&own, Wish::State).into_iter().find_map(|(_, answer)| answer.ok()) {
        bail!("a robot is running ({}: {}); expected none: end its trial first", robot.of, robot.text);
    }
    Ok(())
}
