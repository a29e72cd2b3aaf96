//! The six servos as one hand: angles from the open mark, goals, torque, watchdog, audit.

use crate::supported_robot::SERVOS;
use dynamixel_bus::protocol2::{ReplyError, Status};
use dynamixel_bus::register::Register;
use dynamixel_bus::servo_bus::{BusError, ServoBus};
use dynamixel_bus::xc330::{self, PRESENT_BLOCK_LONG};
use hand_model::robot::ServoState;
use hand_model::{ActuatorVector, Digit};
use robot_session_log::LinkTap;

use crate::calibration::{HandCalibration, turn_offset};
use crate::safety::checks::ServoReading;
use crate::safety::limits::SafeGoal;
use crate::safety::state::StopCause;

/// First register of an audit, which reads from torque enable to bus watchdog.
const AUDIT_START: u16 = xc330::TORQUE_ENABLE.address;
const AUDIT_LENGTH: u16 = xc330::BUS_WATCHDOG.address + 1 - AUDIT_START;
/// Number of times that a servo that does not answer is asked.
const READ_ATTEMPTS: usize = 2;

/// Returns a tap of the servo bus that records through `tap`.
pub(crate) fn servo_tap(tap: LinkTap) -> dynamixel_bus::Tap {
    dynamixel_bus::Tap::new(move |direction, bytes| {
        let direction = match direction {
            dynamixel_bus::Direction::Sent => robot_session_log::Direction::Sent,
            dynamixel_bus::Direction::Received => robot_session_log::Direction::Received,
        };
        tap.copy_packet(direction, bytes);
    })
}

/// The servos behind an open bus.
#[derive(Debug)]
pub struct HandBus {
    pub bus: ServoBus,
    ids: [u8; SERVOS],
    fast: bool,
    /// Whole turns to subtract from each reading, rad, once known.
    turn_offsets: [Option<f64>; SERVOS],
}

impl HandBus {
    /// Wraps the servos `ids` on `bus`, read with fast sync reads if `fast`.
    pub fn new(bus: ServoBus, ids: [u8; SERVOS], fast: bool) -> Self {
        Self { bus, ids, fast, turn_offsets: [None; SERVOS] }
    }

    /// Returns the ids in actuator order.
    pub fn ids(&self) -> &[u8; SERVOS] {
        &self.ids
    }

    /// Compares the servos' homing offsets with the calibration's. Returns the first that differs, as (actuator, found,
    /// expected) in counts.
    pub fn compare_homing_offsets(
        &mut self,
        calibration: &HandCalibration,
    ) -> Result<Option<(usize, i64, i64)>, BusError> {
        let per_count = xc330::HOMING_OFFSET.unit.per_count();
        for (n, servo) in calibration.servos.iter().enumerate() {
            let found = (self.bus.read(self.ids[n], &xc330::HOMING_OFFSET)? / per_count).round() as i64;
            if found != i64::from(servo.homing_offset) {
                return Ok(Some((n, found, servo.homing_offset.into())));
            }
        }
        Ok(None)
    }

    /// Reads every servo at `now` (s); `None` for a servo without a usable answer.
    pub fn read(&mut self, now: f64) -> Result<[Option<ServoReading>; SERVOS], BusError> {
        let (start, length) = (PRESENT_BLOCK_LONG.start, PRESENT_BLOCK_LONG.end - PRESENT_BLOCK_LONG.start);
        let replies = if self.fast {
            self.bus.fast_sync_read(&self.ids, start, length)?
        } else {
            self.bus.sync_read(&self.ids, start, length)?
        };
        let mut read = |n: usize, reply: &Result<Status, ReplyError>| {
            let Status { data, alert, .. } = reply.as_ref().ok()?;
            decode_reading(data, *alert, &mut self.turn_offsets[n], now)
        };
        Ok(std::array::from_fn(|n| read(n, &replies[n])))
    }

    /// Sends goals, the current first, so that no position is approached with an older, larger current.
    pub fn send(&mut self, goals: &[SafeGoal]) -> Result<(), BusError> {
        self.sync_write(&xc330::GOAL_CURRENT, |n| goals[n].current)?;
        let forget = self.turn_offsets;
        self.sync_write(&xc330::GOAL_POSITION, |n| goals[n].angle + forget[n].unwrap_or(0.0))
    }

    /// Switches the torque on without a jerk: zero current, goals at the shafts' positions, and the watchdog off until
    /// all servos are on.
    pub fn torque_on(&mut self, goals: &[SafeGoal], watchdog: f64) -> Result<(), BusError> {
        self.set_watchdog(0.0)?;
        let idle: ActuatorVector<SafeGoal> = goals.iter().map(|goal| SafeGoal { current: 0.0, ..*goal }).collect();
        self.send(&idle)?;
        let ids = self.ids;
        for result in self.bus.set_torque(&ids, true) {
            result?;
        }
        self.send(goals)?;
        self.set_watchdog(watchdog)
    }

    /// Disables the torque of every servo, even if some fail, and reads back whether it is off. Returns the servos for
    /// which it is not known to be off, with the reasons.
    pub fn torque_off(&mut self) -> Vec<String> {
        let ids = self.ids;
        // A lost answer must not leave a torque on.
        for _ in 0..READ_ATTEMPTS {
            if self.bus.set_torque(&ids, false).iter().all(Result::is_ok) {
                break;
            }
        }
        let names = Digit::ALL.map(Digit::name).into_iter().chain(["opposition"]);
        let unsure = names.zip(ids).filter_map(|(name, id)| {
            let mut off = self.bus.expect(id, &xc330::TORQUE_ENABLE, 0.0);
            for _ in 1..READ_ATTEMPTS {
                off = off.or_else(|_| self.bus.expect(id, &xc330::TORQUE_ENABLE, 0.0));
            }
            off.err().map(|error| format!("{name}: {error}"))
        });
        unsure.collect()
    }

    /// Sets the servos' bus watchdog, s; 0 switches it off and clears one that tripped. Every servo must acknowledge.
    pub fn set_watchdog(&mut self, seconds: f64) -> Result<(), BusError> {
        for id in self.ids {
            self.bus.write(id, &xc330::BUS_WATCHDOG, seconds)?;
        }
        Ok(())
    }

    /// Audits servo `n`, whose torque should be on: checks its torque, error status and watchdog, which a sync write
    /// does not report.
    pub fn audit(&mut self, n: usize) -> Result<Option<StopCause>, BusError> {
        let status = self.bus.read_block(self.ids[n], AUDIT_START, AUDIT_LENGTH)?;
        let value = |register: Register| register.read_from(&status.data, AUDIT_START).unwrap_or(f64::NAN);
        Ok(if value(xc330::HARDWARE_ERROR_STATUS) != 0.0 {
            Some(StopCause::ServoAlert(n))
        } else if value(xc330::TORQUE_ENABLE) != 1.0 {
            Some(StopCause::TorqueLost(n))
        } else if value(xc330::BUS_WATCHDOG) < 0.0 {
            Some(StopCause::WatchdogTripped(n))
        } else {
            None
        })
    }

    fn sync_write(&mut self, register: &Register, value: impl Fn(usize) -> f64) -> Result<(), BusError> {
        let values: [(u8, f64); SERVOS] = std::array::from_fn(|n| (self.ids[n], value(n)));
        self.bus.sync_write_values(register, &values)
    }
}

/// Decodes a servo's present block and alert bit as a reading at `now` (s). The first reading also sets the whole turns
/// to subtract.
pub(crate) fn decode_reading(block: &[u8], alert: bool, forget: &mut Option<f64>, now: f64) -> Option<ServoReading> {
    let value = |register: Register| register.read_from(block, PRESENT_BLOCK_LONG.start);
    let raw = value(xc330::PRESENT_POSITION)?;
    let forget = *forget.get_or_insert_with(|| turn_offset(raw));
    let state = ServoState {
        position: raw - forget,
        velocity: value(xc330::PRESENT_VELOCITY)?,
        current: value(xc330::PRESENT_CURRENT)?,
        temperature: value(xc330::PRESENT_TEMPERATURE)?,
    };
    Some(ServoReading { received_at: now, state, voltage: Some(value(xc330::PRESENT_INPUT_VOLTAGE)?), alert })
}
