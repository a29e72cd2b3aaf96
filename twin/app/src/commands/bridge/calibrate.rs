//! `ftac bridge calibrate`: the open marks and travels of all six servos.

use anyhow::{Context, Result, bail};
use hand_model::Hand;
use hardware_bridge::calibration::HandCalibration;
use hardware_bridge::config::BridgeConfig;
use hardware_bridge::homing::{HomingSettings, home};
use hardware_bridge::servo_bus::ServoBus;

use super::shared::{actuator_names, agreed, shown};
use crate::terminal::Terminal;

pub fn run(terminal: &Terminal, config: &BridgeConfig, yes: bool) -> Result<Option<String>> {
    if !yes && !agreed("Every digit will open, close and open again. Is the hand empty and clear of fingers?")? {
        bail!("not calibrated: the operator did not say yes");
    }
    let mut bus = ServoBus::open(&config.servos.port, config.bus())?;
    let settings = HomingSettings::default();
    let mut servos = Vec::new();
    for (id, name) in config.servos.ids.iter().zip(actuator_names()) {
        let servo = home(&mut bus, *id, &settings).with_context(|| name.clone())?;
        if !terminal.quiet {
            eprintln!(
                "{name:12} id {id:3}: open mark at {} counts, travel {:.2} rad",
                -servo.homing_offset, servo.travel
            );
        }
        servos.push(servo);
    }
    let servos = servos.try_into().map_err(|_| anyhow::anyhow!("found another number of servos than actuators"))?;
    let calibration = HandCalibration::new(&Hand::ftac().parameters.name, servos);
    calibration.write(&config.calibration)?;
    if terminal.json {
        println!("{}", serde_json::json!({"calibration": shown(&config.calibration), "crc": calibration.hash()}));
    } else {
        println!("written to {}, crc {}", shown(&config.calibration), calibration.hash());
    }
    Ok(None)
}
