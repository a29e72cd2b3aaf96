//! Homing: finds a servo's open mark and its travel by driving it against its stops.
//!
//! One servo at a time: unwind with a small current until the spool stops at its open mark, wind with a moderate current until the digit stops,
//! then fade the current so that the springs open the digit gently. The position of the open mark is written to the servo as its homing offset,
//! so that it reads 0 there.

use std::time::{Duration, Instant};

use crate::calibration::ServoCalibration;
use crate::servo_bus::{BusError, ServoBus};
use crate::xc330;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HomingSettings {
    /// Current for unwinding to the open mark, A.
    pub open_current: f64,
    /// Current for winding to the closed stop, A.
    pub close_current: f64,
    /// A shaft slower than this, rad/s, for [`HomingSettings::still_for`] stands.
    pub still: f64,
    /// s.
    pub still_for: f64,
    /// Longest way to a stop, rad: more means that nothing stops the shaft.
    pub longest: f64,
    /// Longest wait for a stop, s.
    pub patience: f64,
    /// Time in which the current fades afterwards, s.
    pub fade: f64,
}

impl Default for HomingSettings {
    fn default() -> Self {
        Self {
            open_current: 0.06,
            close_current: 0.20,
            still: 0.05,
            still_for: 0.3,
            longest: 7.0,
            patience: 8.0,
            fade: 1.0,
        }
    }
}

/// Why a servo was not homed. Its torque is off.
#[derive(Debug, thiserror::Error)]
pub enum HomingError {
    /// The bus failed.
    #[error(transparent)]
    Bus(#[from] BusError),
    /// Nothing stopped the shaft.
    #[error(
        "servo {id}: went {way:.2} rad {direction} without a stop, expected at most {longest:.2}: is the cable off the spool?"
    )]
    NoStop {
        id: u8,
        /// `opening` or `closing`.
        direction: &'static str,
        /// How far it went, rad.
        way: f64,
        /// rad.
        longest: f64,
    },
    /// It did not come to rest.
    #[error("servo {id}: did not come to rest {direction} within {patience} s")]
    Restless {
        id: u8,
        /// `opening` or `closing`.
        direction: &'static str,
        /// s.
        patience: f64,
    },
    /// The stops are too close to each other or too far apart.
    #[error("servo {id}: found a travel of {found:.2} rad, expected 0.5 to 5.0: is the cable caught, or slack?")]
    Travel {
        id: u8,
        /// rad.
        found: f64,
    },
}

/// Homes servo `id`, writes its homing offset, and leaves it without torque.
pub fn home(bus: &mut ServoBus, id: u8, settings: &HomingSettings) -> Result<ServoCalibration, HomingError> {
    let result = feel(bus, id, settings);
    // Disable torque in every case.
    let off = bus.write(id, &xc330::TORQUE_ENABLE, 0.0);
    let (open, travel) = result?;
    off?;
    let unit = xc330::HOMING_OFFSET.unit.per_count();
    let offset = -(open / unit).round() as i32;
    bus.write(id, &xc330::HOMING_OFFSET, f64::from(offset) * unit)?;
    let pinged = bus.ping(id)?;
    Ok(ServoCalibration { id, model: pinged.model, firmware: pinged.firmware, homing_offset: offset, travel })
}

/// The open mark's reading with homing offset 0, and the travel, rad.
fn feel(bus: &mut ServoBus, id: u8, settings: &HomingSettings) -> Result<(f64, f64), HomingError> {
    bus.write(id, &xc330::TORQUE_ENABLE, 0.0)?;
    bus.write(id, &xc330::HOMING_OFFSET, 0.0)?;
    bus.write(id, &xc330::GOAL_CURRENT, settings.open_current)?;
    bus.write(id, &xc330::TORQUE_ENABLE, 1.0)?;
    let open = seek(bus, id, settings, "opening", -1.0)?;
    bus.write(id, &xc330::GOAL_CURRENT, settings.close_current)?;
    let closed = seek(bus, id, settings, "closing", 1.0)?;
    let steps = 20;
    for step in (0..steps).rev() {
        bus.write(id, &xc330::GOAL_CURRENT, settings.close_current * f64::from(step) / f64::from(steps))?;
        std::thread::sleep(Duration::from_secs_f64(settings.fade / f64::from(steps)));
    }
    let travel = closed - open;
    if !(0.5..=5.0).contains(&travel) {
        return Err(HomingError::Travel { id, found: travel });
    }
    Ok((open, travel))
}

/// Goes one way until the shaft stands; its reading there, rad.
fn seek(
    bus: &mut ServoBus,
    id: u8,
    settings: &HomingSettings,
    direction: &'static str,
    sign: f64,
) -> Result<f64, HomingError> {
    let start = bus.read(id, &xc330::PRESENT_POSITION)?;
    bus.write(id, &xc330::GOAL_POSITION, start + sign * (settings.longest + 1.0))?;
    let (began, mut moved) = (Instant::now(), Instant::now());
    loop {
        std::thread::sleep(Duration::from_millis(10));
        let at = bus.read(id, &xc330::PRESENT_POSITION)?;
        let way = (at - start).abs();
        if way > settings.longest {
            return Err(HomingError::NoStop { id, direction, way, longest: settings.longest });
        }
        if bus.read(id, &xc330::PRESENT_VELOCITY)?.abs() > settings.still {
            moved = Instant::now();
        }
        if moved.elapsed().as_secs_f64() > settings.still_for {
            return Ok(at);
        }
        if began.elapsed().as_secs_f64() > settings.patience {
            return Err(HomingError::Restless { id, direction, patience: settings.patience });
        }
    }
}
