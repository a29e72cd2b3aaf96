//! Homing: finds a servo's open mark and its travel by driving it against its stops.
//!
//! [`find_stops`] handles one servo at a time. It unwinds with a small current until the spool stops at its open mark,
//! winds with a moderate current until the digit stops, and then fades the current so that the springs open the digit
//! gently. It writes nothing to the servo's EEPROM. [`write_offsets`] writes the open marks of all servos as their
//! homing offsets, so that each reads 0 there.

use std::time::{Duration, Instant};

use dynamixel_bus::protocol2::ReplyError;
use dynamixel_bus::register::Register;
use dynamixel_bus::servo_bus::{BusError, ServoBus};
use dynamixel_bus::xc330;

use crate::calibration::ServoCalibration;

/// Time after which a servo's clock wraps around, s.
const SERVO_CLOCK_PERIOD: f64 = 32.768;

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HomingSettings {
    /// Current for unwinding to the open mark, A.
    pub open_current: f64,
    /// Current for winding to the closed stop, A.
    pub close_current: f64,
    /// Least progress of a moving shaft, rad: one that makes less in [`HomingSettings::stall_time`] has met its stop.
    /// It may oscillate there, because gears have backlash and a stop is compliant.
    pub min_progress: f64,
    /// Time without progress after which a shaft counts as stopped, s.
    pub stall_time: f64,
    /// Maximum distance to a stop, rad: a longer one means that nothing stops the shaft.
    pub max_travel: f64,
    /// Longest wait for a stop, s.
    pub timeout: f64,
    /// Time in which the current fades afterwards, s.
    pub fade_time: f64,
    /// Time limit of the servo's bus watchdog, s: it stops by itself if the host is silent for longer.
    pub watchdog: f64,
}

impl Default for HomingSettings {
    fn default() -> Self {
        Self {
            open_current: 0.06,
            close_current: 0.20,
            min_progress: 0.015,
            stall_time: 0.3,
            max_travel: 7.0,
            timeout: 8.0,
            fade_time: 1.0,
            watchdog: 2.54,
        }
    }
}

/// Reason why a servo was not homed. Its EEPROM is unchanged, and its torque was read back as off, except for
/// [`HomingError::TorqueOn`].
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
        /// Distance travelled, rad.
        way: f64,
        /// Maximum distance, rad.
        longest: f64,
    },
    /// The shaft kept moving slowly until the time limit.
    #[error(
        "servo {id}: still moves on {direction} after {time_limit} s: is the cable off the spool, or does it slip?"
    )]
    StopTimeout {
        id: u8,
        /// `opening` or `closing`.
        direction: &'static str,
        /// Time limit, s.
        time_limit: f64,
    },
    /// The stops are too close to each other or too far apart.
    #[error("servo {id}: found a travel of {found:.2} rad, expected 0.5 to 5.0: is the cable caught, or slack?")]
    Travel {
        id: u8,
        /// Travel found, rad.
        found: f64,
    },
    /// Not all offsets were written, and not all old ones could be restored.
    #[error("{reason}; servos {ids:?} keep a new homing offset: calibrate again")]
    HalfStored {
        /// Error that stopped the writing.
        reason: BusError,
        /// Servos with a new offset.
        ids: Vec<u8>,
    },
    #[error("servo {id}: stopped itself after {silence} s without a packet: is this computer too busy?")]
    WatchdogTripped {
        id: u8,
        /// Time limit of the watchdog that tripped, s.
        silence: f64,
    },
    /// The torque is not known to be off, for the reason `why`; `first` is an earlier error, if any.
    #[error("{first}servo {id}: its torque may be on ({why}): switch the supply off")]
    TorqueOn { id: u8, first: String, why: BusError },
    #[error("stopped by the operator")]
    Interrupted,
}

/// Finds the stops of servo `id`, and leaves it without torque, its EEPROM unchanged. It ends at once when
/// `interrupted` returns true.
pub fn find_stops(
    bus: &mut ServoBus,
    id: u8,
    settings: &HomingSettings,
    interrupted: &dyn Fn() -> bool,
) -> Result<ServoCalibration, HomingError> {
    let pinged = bus.ping(id)?;
    let unit = xc330::HOMING_OFFSET.unit.per_count();
    let known = bus.read(id, &xc330::HOMING_OFFSET)?;
    let result = seek_both(bus, id, settings, interrupted).map_err(|error| {
        // A servo whose watchdog has stopped it refuses goals.
        let refused = matches!(error, HomingError::Bus(BusError::Reply(ReplyError::Refused { .. })));
        match bus.read(id, &xc330::BUS_WATCHDOG) {
            Ok(state) if refused && state < 0.0 => HomingError::WatchdogTripped { id, silence: settings.watchdog },
            _ => error,
        }
    });
    // In every case; a lost answer must not leave the torque on.
    let mut off = torque_off(bus, id);
    for _ in 0..2 {
        off = off.or_else(|_| torque_off(bus, id));
    }
    let watchdog = bus.write(id, &xc330::BUS_WATCHDOG, 0.0);
    if let Err(why) = off {
        let first = result.err().map_or_else(String::new, |error| format!("{error}; "));
        return Err(HomingError::TorqueOn { id, first, why });
    }
    let (open, travel) = result?;
    watchdog?;
    let homing_offset = -((open - known) / unit).round() as i32;
    Ok(ServoCalibration { id, model: pinged.model, firmware: pinged.firmware, homing_offset, travel })
}

/// Switches the torque off and reads it back.
fn torque_off(bus: &mut ServoBus, id: u8) -> Result<(), BusError> {
    bus.write(id, &xc330::TORQUE_ENABLE, 0.0)?;
    bus.expect(id, &xc330::TORQUE_ENABLE, 0.0)
}

/// Writes the homing offsets of all `servos`. If one cannot be written, it and those before it get their old ones back.
pub fn write_offsets(bus: &mut ServoBus, servos: &[ServoCalibration]) -> Result<(), HomingError> {
    let unit = xc330::HOMING_OFFSET.unit.per_count();
    let old = servos.iter().map(|servo| bus.read(servo.id, &xc330::HOMING_OFFSET)).collect::<Result<Vec<_>, _>>()?;
    for (n, servo) in servos.iter().enumerate() {
        let wanted = f64::from(servo.homing_offset) * unit;
        let written = bus.write(servo.id, &xc330::HOMING_OFFSET, wanted);
        let Err(reason) = written.and_then(|()| bus.expect(servo.id, &xc330::HOMING_OFFSET, wanted)) else {
            continue;
        };
        // The servo that failed may have taken the write, and only its answer was lost.
        let changed = servos[..=n].iter().zip(&old);
        let mut ids = Vec::new();
        for (servo, old) in changed {
            if bus.write(servo.id, &xc330::HOMING_OFFSET, *old).is_err() {
                ids.push(servo.id);
            }
        }
        return Err(if ids.is_empty() { reason.into() } else { HomingError::HalfStored { reason, ids } });
    }
    Ok(())
}

/// Seeks both stops; returns the reading at the open mark, and the travel, rad.
fn seek_both(
    bus: &mut ServoBus,
    id: u8,
    settings: &HomingSettings,
    interrupted: &dyn Fn() -> bool,
) -> Result<(f64, f64), HomingError> {
    bus.write(id, &xc330::TORQUE_ENABLE, 0.0)?;
    // Writing 0 first clears a watchdog that has tripped.
    bus.write(id, &xc330::BUS_WATCHDOG, 0.0)?;
    bus.write(id, &xc330::GOAL_CURRENT, settings.open_current)?;
    bus.write(id, &xc330::BUS_WATCHDOG, settings.watchdog)?;
    bus.write(id, &xc330::TORQUE_ENABLE, 1.0)?;
    let open = seek(bus, id, settings, interrupted, ("opening", -1.0))?;
    bus.write(id, &xc330::GOAL_CURRENT, settings.close_current)?;
    let closed = seek(bus, id, settings, interrupted, ("closing", 1.0))?;
    let steps = 20;
    for step in (0..steps).rev() {
        bus.write(id, &xc330::GOAL_CURRENT, settings.close_current * f64::from(step) / f64::from(steps))?;
        std::thread::sleep(Duration::from_secs_f64(settings.fade_time / f64::from(steps)));
    }
    let travel = closed - open;
    if !(0.5..=5.0).contains(&travel) {
        return Err(HomingError::Travel { id, found: travel });
    }
    Ok((open, travel))
}

/// Drives one way (its name and sign) until the shaft stops; returns the mean of its readings from then on, rad.
fn seek(
    bus: &mut ServoBus,
    id: u8,
    settings: &HomingSettings,
    interrupted: &dyn Fn() -> bool,
    (direction, sign): (&'static str, f64),
) -> Result<f64, HomingError> {
    let (mut tick, start) = read_timed_position(bus, id)?;
    bus.write(id, &xc330::GOAL_POSITION, start + sign * (settings.max_travel + 1.0))?;
    let began = Instant::now();
    // Time on the servo's own clock: during a delay of the host, a moving shaft must not count as one at its stop.
    let mut elapsed = 0.0;
    let mut stop = StopDetector::new(sign * start);
    loop {
        std::thread::sleep(Duration::from_millis(10));
        if interrupted() {
            return Err(HomingError::Interrupted);
        }
        let (now, at) = read_timed_position(bus, id)?;
        elapsed += (now - tick).rem_euclid(SERVO_CLOCK_PERIOD);
        tick = now;
        let way = (at - start).abs();
        if way > settings.max_travel {
            return Err(HomingError::NoStop { id, direction, way, longest: settings.max_travel });
        }
        if let Some(mean) = stop.update(elapsed, sign * at, settings) {
            return Ok(sign * mean);
        }
        let stuck = began.elapsed().as_secs_f64() > 10.0 * settings.timeout;
        if elapsed > settings.timeout || stuck {
            return Err(HomingError::StopTimeout { id, direction, time_limit: settings.timeout });
        }
    }
}

/// Reads a servo's own time (s, modulo [`SERVO_CLOCK_PERIOD`]) and its position (rad), both of the same moment.
fn read_timed_position(bus: &mut ServoBus, id: u8) -> Result<(f64, f64), HomingError> {
    let first = xc330::REALTIME_TICK.address;
    let last = xc330::PRESENT_POSITION.address + u16::from(xc330::PRESENT_POSITION.size);
    let mut answer = bus.read_block(id, first, last - first);
    // One lost answer does not restart the search.
    for _ in 0..2 {
        answer = answer.or_else(|_| bus.read_block(id, first, last - first));
    }
    let block = answer?.data;
    let read = |register: Register| {
        register.read_from(&block, first).ok_or(HomingError::Bus(BusError::Reply(ReplyError::Missing(id))))
    };
    Ok((read(xc330::REALTIME_TICK)?, read(xc330::PRESENT_POSITION)?))
}

/// Detector of the stop, for readings that rise on the way to it.
#[derive(Debug)]
struct StopDetector {
    /// Furthest reading at the last progress, rad; `since` is the time of that, s.
    furthest: f64,
    since: f64,
    /// Sum of the readings since then; `count` is their number.
    sum: f64,
    count: u32,
}

impl StopDetector {
    fn new(start: f64) -> Self {
        Self { furthest: start, since: 0.0, sum: 0.0, count: 0 }
    }

    /// Takes a reading (rad) at a time (s). Returns the mean of the readings at the stop, once there was no progress
    /// for long enough.
    fn update(&mut self, time: f64, reading: f64, settings: &HomingSettings) -> Option<f64> {
        if reading > self.furthest + settings.min_progress {
            *self = Self { furthest: reading, since: time, sum: 0.0, count: 0 };
        }
        self.sum += reading;
        self.count += 1;
        // A host that was delayed has too few readings.
        let enough = time - self.since > settings.stall_time && self.count > 5;
        enough.then(|| self.sum / f64::from(self.count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// A shaft that oscillates at its stop is found there, whatever its speed on the way; one that moves on is not.
        #[test]
        fn a_stop_is_found_where_it_is(way in 0.1..4.0_f64, speed in 0.3..6.0_f64, swing in 0.0..0.03_f64, beat in 40.0..140.0_f64) {
            let settings = HomingSettings::default();
            let mut stop = StopDetector::new(0.0);
            let found = (1..2000).find_map(|n| {
                let time = 0.01 * f64::from(n);
                let free = speed * time;
                let at = if free < way { free } else { way + swing * (beat * time).sin() };
                stop.update(time, at, &settings)
            });
            prop_assert!(found.is_some_and(|found| (found - way).abs() < 0.02 + 0.5 * swing), "{found:?} for {way}");
            let mut stop = StopDetector::new(0.0);
            prop_assert!((1..700).all(|n| stop.update(0.01 * f64::from(n), 0.01 * speed * f64::from(n), &settings).is_none()));
        }
    }
}
