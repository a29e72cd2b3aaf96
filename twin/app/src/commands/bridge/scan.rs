//! `ftac bridge scan`: finds the servos on a bus.

use std::path::Path;

use anyhow::{Context as _, Result};
use dynamixel_bus::servo_bus::PingReply;
use hardware_bridge::setup;
use schemars::JsonSchema;
use serde::Serialize;

use super::shared::ConfigArg;
use crate::terminal::Terminal;

/// A servo that answered.
#[derive(Debug, Serialize, JsonSchema)]
struct ScannedServo {
    /// Bus id.
    id: u8,
    /// Baud rate of the bus, bit/s.
    baud: u32,
    /// Model number that the servo reports.
    model: u16,
    /// Firmware version that the servo reports.
    firmware: u8,
}

/// JSON output of `bridge scan`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct ScanOutput {
    /// The servos that answered.
    servos: Vec<ScannedServo>,
}

pub fn run(terminal: &Terminal, port: Option<&Path>, config: &ConfigArg) -> Result<Option<String>> {
    let port = match port {
        Some(port) => port.to_owned(),
        None => config.read_without_password().context("--port names a port without a configuration")?.servos.port,
    };
    let found = setup::scan(&port)?;
    let line = |(baud, servo): &(u32, PingReply)| {
        format!("id {:3}  {baud:7} baud  model {}  firmware {}\n", servo.id, servo.model, servo.firmware)
    };
    let text: String = found.iter().map(line).collect();
    let servo = |(baud, PingReply { id, model, firmware }): &(u32, PingReply)| ScannedServo {
        id: *id,
        baud: *baud,
        model: *model,
        firmware: *firmware,
    };
    terminal.print(&ScanOutput { servos: found.iter().map(servo).collect() }, &text)?;
    let none = "no servo answered: check the port, the 12 V supply and the three-wire plugs";
    Ok(found.is_empty().then(|| format!("{}: {none}", port.display())))
}
