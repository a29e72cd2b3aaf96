//! Required setup of a servo: checks, and provisioning from factory settings.

use std::time::Duration;

use dynamixel_bus::register::Register;
use dynamixel_bus::servo_bus::{BusError, BusSettings, PingReply, ServoBus};
use dynamixel_bus::x_series::hardware_error;
use dynamixel_bus::xc330;

use crate::config::BridgeConfig;

/// Operating mode 5, current-based position control: it controls force and position in one mode, so that no mode is
/// switched under load.
const REQUIRED_MODE: f64 = 5.0;
/// Time for which a scan listens at each rate: six answers at 9600 baud and the factory's return delay take 90 ms.
pub const SCAN_TIME: Duration = Duration::from_millis(120);
/// Time until a servo is back after its id or rate was changed.
const SETTLING_TIME: Duration = Duration::from_millis(50);

/// Result of one check.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SetupFinding {
    /// Item that was checked.
    pub item: String,
    pub found: String,
    pub expected: String,
    /// True if the value found is good enough.
    pub passed: bool,
}

impl SetupFinding {
    pub fn new(what: impl Into<String>, found: impl ToString, expected: impl ToString, good: bool) -> Self {
        Self { item: what.into(), found: found.to_string(), expected: expected.to_string(), passed: good }
    }
}

/// Returns the registers that provisioning sets and every check compares, with their values in SI.
pub fn required_registers(config: &BridgeConfig) -> Vec<(Register, f64)> {
    vec![
        (xc330::OPERATING_MODE, REQUIRED_MODE),
        (xc330::RETURN_DELAY_TIME, 0.0),
        (xc330::DRIVE_MODE, 0.0),
        (xc330::STATUS_RETURN_LEVEL, 2.0),
        (xc330::SHUTDOWN, f64::from(0x34)),
        (xc330::TEMPERATURE_LIMIT, 70.0),
        (xc330::CURRENT_LIMIT, config.limits.current),
    ]
}

/// Returns the value of the baud rate register for the configured rate; NaN if there is none.
fn baud_code(baud: u32) -> f64 {
    xc330::BAUD_RATES.iter().position(|rate| *rate == baud).map_or(f64::NAN, |code| code as f64)
}

/// Compares one servo with its required setup.
pub fn check(bus: &mut ServoBus, config: &BridgeConfig, id: u8, name: &str) -> Result<Vec<SetupFinding>, BusError> {
    let pinged = bus.ping(id)?;
    let what = |register: &str| format!("{name} ({id}): {register}");
    let mut findings = vec![SetupFinding::new(
        what("Model Number"),
        pinged.model,
        xc330::MODEL.number,
        pinged.model == xc330::MODEL.number,
    )];
    for (register, value) in required_registers(config) {
        let found = bus.read(id, &register)?;
        let good = register.holds(found, value);
        findings.push(SetupFinding::new(what(register.name), found, value, good));
    }
    let error = bus.read(id, &xc330::HARDWARE_ERROR_STATUS)?;
    let (words, mended) = (hardware_error::describe(error as u8), "none (else `ftac bridge reboot`)");
    findings.push(SetupFinding::new(what("Hardware Error Status"), words, mended, error == 0.0));
    let volts = bus.read(id, &xc330::PRESENT_INPUT_VOLTAGE)?;
    let [low, high] = config.limits.voltage;
    let good = (low..=high).contains(&volts);
    findings.push(SetupFinding::new(what("voltage, V"), format!("{volts:.1}"), format!("{low} to {high}"), good));
    let celsius = bus.read(id, &xc330::PRESENT_TEMPERATURE)?;
    let limit = config.limits.temperature;
    findings.push(SetupFinding::new(what("temperature, C"), celsius, format!("up to {limit}"), celsius <= limit));
    Ok(findings)
}

/// Finds all servos on the bus at every baud rate; returns them as (bits per second, servo).
pub fn scan(port: &std::path::Path) -> Result<Vec<(u32, PingReply)>, BusError> {
    let mut found = Vec::new();
    for baud in xc330::BAUD_RATES {
        let mut bus = ServoBus::open(port, BusSettings { baud, ..BusSettings::default() })?;
        found.extend(bus.scan(SCAN_TIME)?.into_iter().map(|pinged| (baud, pinged)));
    }
    Ok(found)
}

/// Reason why a servo was not provisioned.
#[derive(Debug, thiserror::Error)]
pub enum ProvisionError {
    /// The bus failed.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// There are more or fewer servos than one.
    #[error("found {0} servos ({1}), expected exactly one: connect them one after the other")]
    Count(usize, String),
    /// The servo is of another model.
    #[error("servo {id}: found model {found}, expected {expected}", expected = xc330::MODEL.number)]
    Model {
        id: u8,
        /// Model number found.
        found: u16,
    },
}

/// Gives the one servo on the bus the id `id` and the required settings, and reads all of them back. Returns the
/// servo's previous baud rate and identity.
pub fn provision(config: &BridgeConfig, id: u8) -> Result<(u32, PingReply), ProvisionError> {
    let port = &config.servos.port;
    let found = scan(port)?;
    let [(baud, servo)] = found[..] else {
        let names: Vec<String> = found.iter().map(|(baud, servo)| format!("{} at {baud}", servo.id)).collect();
        return Err(ProvisionError::Count(found.len(), names.join(", ")));
    };
    if servo.model != xc330::MODEL.number {
        return Err(ProvisionError::Model { id: servo.id, found: servo.model });
    }
    let mut bus = ServoBus::open(port, BusSettings { baud, ..BusSettings::default() })?;
    bus.write(servo.id, &xc330::TORQUE_ENABLE, 0.0)?;
    for (register, value) in required_registers(config) {
        bus.write(servo.id, &register, value)?;
    }
    bus.write(servo.id, &xc330::ID, f64::from(id))?;
    std::thread::sleep(SETTLING_TIME);
    bus.write(id, &xc330::BAUD_RATE, baud_code(config.servos.baud))?;
    std::thread::sleep(SETTLING_TIME);
    drop(bus);
    let mut bus = ServoBus::open(port, config.bus())?;
    bus.ping(id)?;
    let rest =
        [(xc330::TORQUE_ENABLE, 0.0), (xc330::ID, f64::from(id)), (xc330::BAUD_RATE, baud_code(config.servos.baud))];
    for (register, expected) in required_registers(config).into_iter().chain(rest) {
        bus.expect(id, &register, expected)?;
    }
    Ok((baud, servo))
}
