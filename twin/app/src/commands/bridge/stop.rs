//! `ftac bridge stop`: a word to the robot that runs in another terminal.

use anyhow::Result;
use hardware_bridge::config::BridgeConfig;
use hardware_bridge::remote::{self, RemoteError, Wish};
use hardware_bridge::servo_bus::ServoBus;

use crate::terminal::Terminal;

/// Stops the running robot. Where none runs, a release still takes the torque off the servos, directly.
pub fn stop(terminal: &Terminal, config: &BridgeConfig, release: bool) -> Result<Option<String>> {
    let wish = if release { Wish::Release } else { Wish::Hold };
    match remote::ask(&config.stop_socket, wish) {
        Ok(state) => {
            tell(terminal, &state);
            Ok(None)
        }
        Err(RemoteError::Nobody { .. }) if release => {
            let mut bus = ServoBus::open(&config.servos.port, config.bus())?;
            let failed: Vec<String> = bus
                .set_torque(&config.servos.ids, false)
                .into_iter()
                .filter_map(Result::err)
                .map(|e| e.to_string())
                .collect();
            tell(terminal, "no bridge is running; torque is off");
            Ok((!failed.is_empty()).then(|| failed.join("; ")))
        }
        Err(error @ RemoteError::Nobody { .. }) => Ok(Some(format!(
            "{error}; servos whose program ended hold, or were stopped by their own watchdogs; --release opens the hand"
        ))),
        Err(error) => Err(error.into()),
    }
}

fn tell(terminal: &Terminal, state: &str) {
    if terminal.json {
        println!("{}", serde_json::json!({ "state": state }));
    } else {
        println!("{state}");
    }
}
