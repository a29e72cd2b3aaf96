//! `ftac bridge scan`: who is on the servo bus?

use std::path::Path;

use anyhow::{Context as _, Result};
use hardware_bridge::setup;

use super::shared::ConfigArg;
use crate::terminal::Terminal;

pub fn run(terminal: &Terminal, port: Option<&Path>, config: &ConfigArg) -> Result<Option<String>> {
    let port = match port {
        Some(port) => port.to_owned(),
        None => config.read_without_password().context("--port names a port without a configuration")?.servos.port,
    };
    let found = setup::scan(&port)?;
    if terminal.json {
        let rows: Vec<_> = found
            .iter()
            .map(|(baud, servo)| {
                serde_json::json!({"id": servo.id, "baud": baud, "model": servo.model, "firmware": servo.firmware})
            })
            .collect();
        println!("{}", serde_json::json!({ "servos": rows }));
    } else {
        for (baud, servo) in &found {
            println!("id {:3}  {baud:7} baud  model {}  firmware {}", servo.id, servo.model, servo.firmware);
        }
    }
    let none = "no servo answered: check the port, the 12 V supply and the three-wire plugs";
    Ok(found.is_empty().then(|| format!("{}: {none}", port.display())))
}
