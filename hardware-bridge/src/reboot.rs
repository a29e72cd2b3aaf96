//! Recovery of a servo that has shut down or reports an error: a restart, and a check of the restarted servo.
//!
//! A restart loses the torque and everything in RAM, and the servo drops its object. It is therefore done only on
//! request.

use std::time::{Duration, Instant};

use dynamixel_bus::servo_bus::{BusError, ServoBus};
use dynamixel_bus::xc330;

use crate::calibration::{ServoCalibration, turn_offset};
use crate::config::BridgeConfig;
use crate::setup::{self, SetupFinding};

/// Longest wait for a servo that restarts; about a third of a second is usual.
const REBOOT_TIMEOUT: Duration = Duration::from_secs(3);
/// Polling interval while a servo restarts.
const POLL_INTERVAL: Duration = Duration::from_millis(50);
/// Tolerance of a shaft's angle outside its travel, rad: cables stretch.
const ANGLE_TOLERANCE: f64 = 0.15;

/// Reads the hardware error status of a servo.
pub fn error_status(bus: &mut ServoBus, id: u8) -> Result<u8, BusError> {
    Ok(bus.read(id, &xc330::HARDWARE_ERROR_STATUS)? as u8)
}

/// Restarts a servo and waits until it answers again.
pub fn reboot(bus: &mut ServoBus, id: u8) -> Result<(), BusError> {
    // The acknowledgement may be lost, or overtaken by the restart, so the servo itself is pinged afterwards.
    let consent = bus.reboot(id);
    let begun = Instant::now();
    std::thread::sleep(POLL_INTERVAL);
    loop {
        match bus.ping(id) {
            Ok(_) => return Ok(()),
            Err(error) if begun.elapsed() > REBOOT_TIMEOUT => return consent.and(Err(error)),
            Err(_) => std::thread::sleep(POLL_INTERVAL),
        }
    }
}

/// Checks a restarted servo: settings, errors, supply and temperature, torque, and whether it is the calibrated servo
/// and knows its angle.
pub fn check(
    bus: &mut ServoBus,
    config: &BridgeConfig,
    (id, name): (u8, &str),
    calibration: Option<&ServoCalibration>,
) -> Result<Vec<SetupFinding>, BusError> {
    let mut findings = setup::check(bus, config, id, name)?;
    let what = |thing: &str| format!("{name} ({id}): {thing}");
    let torque = bus.read(id, &xc330::TORQUE_ENABLE)?;
    findings.push(SetupFinding::new(what("torque"), if torque == 0.0 { "off" } else { "on" }, "off", torque == 0.0));
    let Some(calibration) = calibration else {
        findings.push(SetupFinding::new(what("calibration"), "none", "any", true));
        return Ok(findings);
    };
    let offset = (bus.read(id, &xc330::HOMING_OFFSET)? / xc330::HOMING_OFFSET.unit.per_count()).round() as i64;
    let expected = i64::from(calibration.homing_offset);
    findings.push(SetupFinding::new(what("Homing Offset, counts"), offset, expected, offset == expected));
    let raw = bus.read(id, &xc330::PRESENT_POSITION)?;
    let angle = raw - turn_offset(raw);
    let good = (-ANGLE_TOLERANCE..=calibration.travel + ANGLE_TOLERANCE).contains(&angle);
    let travel = format!("0 to {:.2}", calibration.travel);
    findings.push(SetupFinding::new(what("angle from the open mark, rad"), format!("{angle:.2}"), travel, good));
    Ok(findings)
}
