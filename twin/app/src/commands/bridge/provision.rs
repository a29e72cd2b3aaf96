//! `ftac bridge provision`: writes id and settings to one new servo.

use std::path::Path;

use anyhow::{Context, Result};
use dynamixel_bus::servo_bus::latency_timer::{self, LatencyTimer};
use hardware_bridge::setup;
use schemars::JsonSchema;
use serde::Serialize;

use super::shared::{ConfigArg, actuator_names};
use crate::options::robot::RobotArgs;
use crate::terminal::Terminal;

/// Address of a servo on the bus.
#[derive(Debug, Serialize, JsonSchema)]
struct ServoAddress {
    /// Bus id.
    id: u8,
    /// Baud rate of the bus, bit/s.
    baud: u32,
}

/// JSON output of `bridge provision`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct ProvisionOutput<'a> {
    /// The actuator.
    actuator: &'a str,
    #[serde(flatten)]
    now: ServoAddress,
    /// Its previous id and rate.
    was: ServoAddress,
}

pub fn run(terminal: &Terminal, actuator: &str, robot: &RobotArgs, config: &ConfigArg) -> Result<Option<String>> {
    let config = &config.read_without_password()?;
    let names = actuator_names(&robot.model()?.hand);
    let n = names
        .iter()
        .position(|name| name == actuator)
        .with_context(|| format!("--actuator: found `{actuator}`, expected one of {}", names.join(", ")))?;
    let id = config.servos.ids[n];
    let (baud, was) = setup::provision(config, id)?;
    match latency_timer::set(&config.servos.port, Path::new(latency_timer::SYSTEM_FOLDER), 1) {
        Ok(LatencyTimer::Milliseconds(ms)) => eprintln!("the adapter's latency timer is {ms} ms"),
        Ok(LatencyTimer::Absent) => {}
        Err(error) => eprintln!("the adapter's latency timer could not be set: {error}"),
    }
    let now = ServoAddress { id, baud: config.servos.baud };
    let text = format!("{actuator}: id {} at {baud} baud is now id {id} at {} baud, and set up\n", was.id, now.baud);
    terminal.print(&ProvisionOutput { actuator, now, was: ServoAddress { id: was.id, baud } }, &text)?;
    Ok(None)
}
