//! `ftac bridge clear-faults`: clears faults of the arm.

use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use clap::Args;
use hand_model::Arm;
use kinova_kortex::message::ArmState;
use robot_backends::arm_link::connect_arm;
use robot_backends::operator::operator_agrees_while;
use schemars::JsonSchema;
use serde::Serialize;

use super::shared::{ConfigArg, expect_no_robot};
use crate::terminal::Terminal;

/// Time limit for the arm to report that its faults are gone.
const CLEAR_TIMEOUT: Duration = Duration::from_secs(3);

/// Arguments of `bridge clear-faults`.
#[derive(Debug, Args)]
pub struct ClearArgs {
    #[command(flatten)]
    config: ConfigArg,
    /// Do not ask before clearing.
    #[arg(long)]
    yes: bool,
}

/// The arm's faults, in words.
#[derive(Debug, Serialize, JsonSchema)]
pub struct ClearFaultsOutput {
    before: String,
    now: String,
}

impl ClearFaultsOutput {
    fn print(&self, terminal: &Terminal) -> Result<()> {
        terminal.print(self, &format!("faults before: {}; now: {}\n", self.before, self.now))
    }
}

pub fn run(terminal: &Terminal, args: &ClearArgs) -> Result<Option<String>> {
    let config = args.config.read()?;
    expect_no_robot(&args.config.config)?;
    let Some(mut arm) = connect_arm(&config, Arm::gen3().home)? else {
        bail!("arm: found kind loopback, expected an arm")
    };
    let before = arm.cyclic.feedback()?.faults;
    let state = arm.base.arm_state()?;
    if before.is_empty() && state != ArmState::InFault {
        ClearFaultsOutput { before: "none".to_owned(), now: "none".to_owned() }.print(terminal)?;
        return Ok(None);
    }
    eprintln!("The arm reports {before}.");
    let question = "Once its faults are cleared, the arm can move again. Is their cause removed, its reach clear of people, and a hand on its emergency stop?";
    // The arm ends a session without heartbeats, also while the operator thinks.
    if !args.yes && !operator_agrees_while(question, || Ok(arm.keep_up()?))? {
        bail!("not cleared: the operator did not confirm");
    }
    arm.base.clear_faults().context("the arm keeps its faults")?;
    let begun = Instant::now();
    let mut left = arm.cyclic.feedback()?.faults;
    while !left.is_empty() && begun.elapsed() < CLEAR_TIMEOUT {
        std::thread::sleep(Duration::from_millis(50));
        arm.keep_up()?;
        left = arm.cyclic.feedback()?.faults;
    }
    let state = arm.base.arm_state()?;
    ClearFaultsOutput { before: before.to_string(), now: left.to_string() }.print(terminal)?;
    let still = || format!("the arm still reports {left}, and that it is in state {state:?}");
    Ok((!left.is_empty() || state == ArmState::InFault).then(still))
}
