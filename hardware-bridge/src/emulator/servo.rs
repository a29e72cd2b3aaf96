//! One emulated XC330: its control table, refusals, shutdowns and bus watchdog.
//!
//! It has no clock and no input or output: time and shaft state are arguments, the goal is the result. Where the
//! e-Manual is silent, the emulator takes the interpretation that is harder on the host, marked "interpretation".

mod identity_faults;
mod indirect;
mod open_loop;
mod registered_write;

use dynamixel_bus::protocol2::ServoError;
use dynamixel_bus::register::{Access, Register, Unit};
use dynamixel_bus::x_series::{hardware_error, mode};
use dynamixel_bus::xc330::{self, REGISTERS};
use hand_model::robot::{ServoGoal, ServoState};

use crate::config::LimitConfig;

use self::indirect::MemoryWrite;

/// Time off the bus after a reboot, s.
const REBOOT_TIME: f64 = 0.34;
/// Supply voltage below which a servo is off, V. Interpretation.
const BROWN_OUT_VOLTAGE: f64 = 5.0;
/// Overload: a servo stalled above this current, A, for longer than [`OVERLOAD_TIME`], s, shuts down. Interpretation.
const OVERLOAD_CURRENT: f64 = 0.8;
const OVERLOAD_TIME: f64 = 1.0;
/// Temperature rise above ambient at 1 A in steady state, degrees Celsius, and its time constant, s. Interpretation.
const TEMPERATURE_RISE: f64 = 60.0;
const THERMAL_TIME_CONSTANT: f64 = 120.0;
const AMBIENT_TEMPERATURE: f64 = 28.0;
/// Value of the watchdog register after it has tripped: -1.
const WATCHDOG_TRIPPED: u8 = 0xFF;
/// Firmware version that knows fast sync read and has its indirect data at the address in ROBOTIS' older model file.
const DEFAULT_FIRMWARE: u8 = 46;

#[derive(Debug, Clone)]
pub struct EmulatedServo {
    memory: [u8; 256],
    /// Encoder counts, over all turns, at shaft angle 0; set by the mounting of the horn.
    zero: i64,
    /// Whole turns forgotten at the last power-up, counts.
    lost_turns: i64,
    shaft: ServoState,
    voltage: f64,
    heat: f64,
    overloaded_for: f64,
    /// Time since power-up, s.
    running_for: f64,
    watchdog_fed_at: f64,
    silent_until: f64,
    /// Position goal held since the watchdog tripped, counts.
    held_position: Option<i64>,
    /// Position goal of velocity control, counts.
    velocity_goal: f64,
    /// Time of the last watchdog trip, and its delay after the last packet heard, s.
    tripped_at: Option<(f64, f64)>,
    unplugged: bool,
    /// Registered write, which waits for an action: first register, bytes.
    registered: Option<(u16, Vec<u8>)>,
}

impl EmulatedServo {
    /// Creates a servo with factory settings, whose encoder shows `zero` counts at shaft angle 0.
    pub fn factory(zero: i64) -> Self {
        let mut servo = Self {
            memory: [0; 256],
            zero,
            lost_turns: 0,
            shaft: ServoState::default(),
            voltage: 11.1,
            heat: 0.0,
            overloaded_for: 0.0,
            running_for: 0.0,
            watchdog_fed_at: 0.0,
            silent_until: 0.0,
            held_position: None,
            velocity_goal: 0.0,
            tripped_at: None,
            unplugged: false,
            registered: None,
        };
        for register in REGISTERS.iter().filter(|register| register.access != Access::Ram) {
            servo.set(register, register.default.unwrap_or(0));
        }
        servo.set(&xc330::FIRMWARE_VERSION, DEFAULT_FIRMWARE.into());
        servo.power_up();
        servo
    }

    /// Sets another firmware version and restarts the servo.
    #[must_use]
    pub fn with_firmware(mut self, version: u8) -> Self {
        self.set(&xc330::FIRMWARE_VERSION, version.into());
        self.power_up();
        self
    }

    /// Creates a provisioned servo: `id`, 3 Mbaud, no return delay, current-based position control, the usual current
    /// limit.
    pub fn provisioned(id: u8, zero: i64) -> Self {
        let mut servo = Self::factory(zero);
        servo.set(&xc330::ID, i64::from(id));
        servo.set(&xc330::BAUD_RATE, 5);
        servo.set(&xc330::RETURN_DELAY_TIME, 0);
        servo.set(&xc330::OPERATING_MODE, mode::CURRENT_POSITION);
        servo.set(&xc330::CURRENT_LIMIT, (LimitConfig::default().current * 1e3) as i64);
        servo.power_up();
        servo
    }

    /// Returns the encoder counts over all turns at shaft angle 0.
    pub fn zero(&self) -> i64 {
        self.zero
    }

    /// Sets the homing offset, counts, as if it had been written before power-up.
    pub fn set_homing_offset(&mut self, counts: i32) {
        self.set(&xc330::HOMING_OFFSET, counts.into());
        self.update_present_block();
        self.set(&xc330::GOAL_POSITION, self.position());
    }

    pub fn id(&self) -> u8 {
        self.memory[usize::from(xc330::ID.address)]
    }

    /// Returns the baud rate, bits per second.
    pub fn baud(&self) -> u32 {
        xc330::BAUD_RATES[self.get(&xc330::BAUD_RATE) as usize]
    }

    /// Returns the return delay, s.
    pub fn return_delay(&self) -> f64 {
        self.get(&xc330::RETURN_DELAY_TIME) as f64 * Unit::ReturnDelay.per_count()
    }

    /// True if the servo takes part in the bus at `now` (s).
    pub fn listens(&self, now: f64) -> bool {
        !self.unplugged && self.voltage >= BROWN_OUT_VOLTAGE && now >= self.silent_until
    }

    /// True if the status byte of the servo's answers carries the alert bit.
    pub fn alert(&self) -> bool {
        self.get(&xc330::HARDWARE_ERROR_STATUS) != 0
    }

    /// Returns the status return level, that is, the instructions that the servo answers: 0 ping, 1 also reads, 2 all.
    pub fn return_level(&self) -> i64 {
        self.get(&xc330::STATUS_RETURN_LEVEL)
    }

    /// True if the bus watchdog has stopped the servo.
    pub fn watchdog_tripped(&self) -> bool {
        self.memory[usize::from(xc330::BUS_WATCHDOG.address)] == WATCHDOG_TRIPPED
    }

    /// Returns the time of the last watchdog trip, and its delay after the last packet heard, s.
    pub fn tripped_at(&self) -> Option<(f64, f64)> {
        self.tripped_at
    }

    /// Feeds the bus watchdog, as any instruction packet on the bus does.
    pub fn feed_watchdog(&mut self, now: f64) {
        self.watchdog_fed_at = now;
    }

    /// Reads `length` bytes from `address` on.
    pub fn read(&self, address: u16, length: u16) -> Result<Vec<u8>, ServoError> {
        if length == 0 {
            return Err(ServoError::DataLength);
        }
        let end = address.checked_add(length).filter(|end| usize::from(*end) <= self.memory.len());
        let end = end.ok_or(ServoError::Access)?;
        Ok((address..end).map(|place| self.memory[usize::from(self.resolve_address(place))]).collect())
    }

    /// Writes bytes from `address` on: all of them, or none with an error.
    pub fn write(&mut self, address: u16, data: &[u8]) -> Result<(), ServoError> {
        for change in self.decode_write(address, data)? {
            match change {
                MemoryWrite::Register(register, value) => self.apply(register, value),
                MemoryWrite::Pointer(slot, target) => self.set_pointer(slot, target),
                MemoryWrite::Byte(place, byte) => self.memory[usize::from(place)] = byte,
            }
        }
        Ok(())
    }

    /// Returns the changes that a write to registers would make, or the error with which it is refused.
    fn decode_register_writes(&self, address: u16, data: &[u8]) -> Result<Vec<MemoryWrite>, ServoError> {
        let (mut place, mut rest, mut writes) = (address, data, Vec::new());
        while !rest.is_empty() {
            let register = REGISTERS.iter().find(|register| register.address == place).ok_or(ServoError::Access)?;
            let size = usize::from(register.size);
            let bytes = rest.get(..size).ok_or(ServoError::DataLength)?;
            let value = decode(register, bytes);
            self.check(register, value)?;
            writes.push(MemoryWrite::Register(register, value));
            rest = &rest[size..];
            place += u16::from(register.size);
        }
        Ok(writes)
    }

    /// Restarts the servo, which is then off the bus for a while.
    pub fn reboot(&mut self, now: f64) {
        self.power_up();
        self.silent_until = now + REBOOT_TIME;
    }

    /// Advances the servo by `dt` to `now` (s), with the shaft's state from the plant.
    pub fn advance(&mut self, now: f64, dt: f64, shaft: ServoState) {
        self.shaft = shaft;
        self.running_for += dt;
        self.heat += (TEMPERATURE_RISE * shaft.current.powi(2) - self.heat) * dt / THERMAL_TIME_CONSTANT;
        let stalled = shaft.current.abs() > OVERLOAD_CURRENT && shaft.velocity.abs() < 0.1;
        self.overloaded_for = if stalled { self.overloaded_for + dt } else { 0.0 };
        if self.overloaded_for > OVERLOAD_TIME {
            self.raise_errors(hardware_error::OVERLOAD);
        }
        if self.temperature() > self.get(&xc330::TEMPERATURE_LIMIT) as f64 {
            self.raise_errors(hardware_error::OVERHEAT);
        }
        let tenths = (self.voltage * 10.0).round() as i64;
        let allowed = self.get(&xc330::MIN_VOLTAGE_LIMIT)..=self.get(&xc330::MAX_VOLTAGE_LIMIT);
        if self.voltage >= BROWN_OUT_VOLTAGE && !allowed.contains(&tenths) {
            self.raise_errors(hardware_error::VOLTAGE);
        }
        let watchdog = self.get(&xc330::BUS_WATCHDOG);
        if self.torque() && watchdog > 0 && now - self.watchdog_fed_at > watchdog as f64 * Unit::Watchdog.per_count() {
            self.memory[usize::from(xc330::BUS_WATCHDOG.address)] = WATCHDOG_TRIPPED;
            self.tripped_at = Some((now, now - self.watchdog_fed_at));
            self.held_position = Some(self.position());
        }
        self.advance_velocity_goal(dt);
        self.update_present_block();
    }

    /// Returns the goal that the servo applies to its shaft.
    pub fn applied_goal(&self) -> ServoGoal {
        let current_limit = self.get(&xc330::CURRENT_LIMIT) as f64 * 1e-3;
        let goal_current = self.get(&xc330::GOAL_CURRENT) as f64 * 1e-3;
        let position = self.held_position.unwrap_or_else(|| self.get(&xc330::GOAL_POSITION));
        let toward = |current_limit: f64| ServoGoal::Position { angle: self.angle_of(position), current_limit };
        if !self.torque() {
            return ServoGoal::Current(0.0);
        }
        match self.get(&xc330::OPERATING_MODE) {
            mode::CURRENT if self.held_position.is_some() => ServoGoal::Current(0.0),
            mode::CURRENT => ServoGoal::Current(self.sign() * goal_current),
            mode::PWM => ServoGoal::Current(if self.held_position.is_some() { 0.0 } else { self.open_loop_current() }),
            mode::VELOCITY if self.held_position.is_none() => {
                ServoGoal::Position { angle: self.angle_of(self.velocity_goal.round() as i64), current_limit }
            }
            mode::CURRENT_POSITION => toward(goal_current.abs().min(current_limit)),
            _ => toward(current_limit),
        }
    }

    /// Sets the supply voltage, V. Below the brown-out voltage the servo is off; it restarts when the voltage returns.
    pub fn set_voltage(&mut self, volts: f64, now: f64) {
        let was_on = self.voltage >= BROWN_OUT_VOLTAGE;
        self.voltage = volts;
        if was_on && volts < BROWN_OUT_VOLTAGE {
            self.power_up();
        } else if !was_on && volts >= BROWN_OUT_VOLTAGE {
            self.reboot(now);
        }
    }

    /// Sets the temperature, degrees Celsius.
    pub fn set_temperature(&mut self, celsius: f64) {
        self.heat = celsius - AMBIENT_TEMPERATURE;
    }

    /// Pulls its plug or puts it back; either way the servo restarts.
    pub fn set_unplugged(&mut self, unplugged: bool, now: f64) {
        self.unplugged = unplugged;
        self.reboot(now);
    }

    /// Sets bits of the hardware error status, and shuts down if the shutdown mask says so.
    pub fn raise_errors(&mut self, bits: u8) {
        let status = self.get(&xc330::HARDWARE_ERROR_STATUS) as u8 | bits;
        self.set(&xc330::HARDWARE_ERROR_STATUS, i64::from(status));
        if self.shut_down() {
            self.set(&xc330::TORQUE_ENABLE, 0);
        }
    }

    fn shut_down(&self) -> bool {
        self.get(&xc330::HARDWARE_ERROR_STATUS) & self.get(&xc330::SHUTDOWN) != 0
    }

    fn temperature(&self) -> f64 {
        AMBIENT_TEMPERATURE + self.heat
    }

    fn torque(&self) -> bool {
        self.get(&xc330::TORQUE_ENABLE) != 0 && !self.unplugged && self.voltage >= BROWN_OUT_VOLTAGE
    }

    fn sign(&self) -> f64 {
        if self.get(&xc330::DRIVE_MODE) & 1 == 0 { 1.0 } else { -1.0 }
    }

    /// Returns the encoder counts over all turns.
    fn encoder(&self) -> i64 {
        self.zero + (self.shaft.position / Unit::Angle.per_count()).round() as i64
    }

    /// Returns the present position, counts, as the host sees it.
    fn position(&self) -> i64 {
        self.sign() as i64 * (self.encoder() - self.lost_turns) + self.get(&xc330::HOMING_OFFSET)
    }

    /// Returns the shaft angle, rad, at which the present position would be `position`.
    fn angle_of(&self, position: i64) -> f64 {
        let encoder = self.sign() as i64 * (position - self.get(&xc330::HOMING_OFFSET)) + self.lost_turns;
        (encoder - self.zero) as f64 * Unit::Angle.per_count()
    }

    /// Applies a power-up: RAM is lost, whole turns are forgotten, torque is off.
    fn power_up(&mut self) {
        for register in REGISTERS.iter().filter(|register| register.access == Access::Ram) {
            self.set(register, register.default.unwrap_or(0));
        }
        self.set(&xc330::HARDWARE_ERROR_STATUS, 0);
        self.lost_turns = self.encoder().div_euclid(4096) * 4096;
        self.held_position = None;
        self.reset_pointers();
        self.clear_registered();
        self.overloaded_for = 0.0;
        self.running_for = 0.0;
        self.set(&xc330::GOAL_PWM, self.get(&xc330::PWM_LIMIT));
        self.set(&xc330::GOAL_CURRENT, self.get(&xc330::CURRENT_LIMIT));
        self.update_present_block();
        self.set(&xc330::GOAL_POSITION, self.position());
    }

    fn check(&self, register: &Register, value: i64) -> Result<(), ServoError> {
        let limited_by = |limit: &Register| {
            if value.abs() > self.get(limit) { Err(ServoError::DataLimit) } else { Ok(()) }
        };
        if register.access == Access::Read || register.access == Access::Eeprom && self.torque() {
            return Err(ServoError::Access);
        }
        if !(register.range.0..=register.range.1).contains(&value) {
            return Err(ServoError::DataRange);
        }
        let is = |other: &Register| register.address == other.address;
        let goal = (xc330::GOAL_PWM.address..=xc330::GOAL_POSITION.address).contains(&register.address);
        if goal && self.watchdog_tripped() {
            return Err(ServoError::DataRange);
        }
        if is(&xc330::OPERATING_MODE) && !matches!(value, 0 | 1 | 3 | 4 | 5 | 16)
            || is(&xc330::BUS_WATCHDOG) && value < 0
        {
            return Err(ServoError::DataRange);
        }
        if is(&xc330::TORQUE_ENABLE) && value == 1 && self.shut_down() {
            return Err(ServoError::ResultFail);
        }
        if is(&xc330::GOAL_CURRENT) {
            return limited_by(&xc330::CURRENT_LIMIT);
        }
        if is(&xc330::GOAL_PWM) {
            return limited_by(&xc330::PWM_LIMIT);
        }
        if is(&xc330::GOAL_VELOCITY) {
            return limited_by(&xc330::VELOCITY_LIMIT);
        }
        let bounded = is(&xc330::GOAL_POSITION) && self.get(&xc330::OPERATING_MODE) == mode::POSITION;
        let bounds = self.get(&xc330::MIN_POSITION_LIMIT)..=self.get(&xc330::MAX_POSITION_LIMIT);
        if bounded && !bounds.contains(&value) { Err(ServoError::DataLimit) } else { Ok(()) }
    }

    fn apply(&mut self, register: &Register, value: i64) {
        let turned_on = register.address == xc330::TORQUE_ENABLE.address && value == 1 && !self.torque();
        if turned_on {
            self.set(&xc330::GOAL_POSITION, self.position());
            self.velocity_goal = self.position() as f64;
        }
        if register.address == xc330::BUS_WATCHDOG.address && value == 0 {
            self.held_position = None;
        }
        self.set(register, value);
        if register.address == xc330::OPERATING_MODE.address {
            for reset in [&xc330::POSITION_P_GAIN, &xc330::POSITION_I_GAIN, &xc330::POSITION_D_GAIN] {
                self.set(reset, reset.default.unwrap_or(0));
            }
            self.set(&xc330::PROFILE_ACCELERATION, 0);
            self.set(&xc330::PROFILE_VELOCITY, 0);
            self.set(&xc330::GOAL_VELOCITY, 0);
            self.set(&xc330::GOAL_PWM, self.get(&xc330::PWM_LIMIT));
            self.set(&xc330::GOAL_CURRENT, self.get(&xc330::CURRENT_LIMIT));
        }
        self.update_present_block();
    }

    /// Updates the present block, and the tick, in the control table.
    fn update_present_block(&mut self) {
        let velocity = self.sign() * self.shaft.velocity / Unit::Velocity.per_count();
        self.set(&xc330::REALTIME_TICK, (self.running_for * 1e3) as i64 % 32_768);
        self.set(&xc330::PRESENT_CURRENT, (self.sign() * self.shaft.current * 1e3).round() as i64);
        self.set(&xc330::PRESENT_VELOCITY, velocity.round() as i64);
        self.set(&xc330::PRESENT_POSITION, self.position());
        self.set(&xc330::PRESENT_INPUT_VOLTAGE, (self.voltage * 10.0).round() as i64);
        self.set(&xc330::PRESENT_TEMPERATURE, self.temperature().round() as i64);
    }

    fn get(&self, register: &Register) -> i64 {
        let start = usize::from(register.address);
        decode(register, &self.memory[start..start + usize::from(register.size)])
    }

    fn set(&mut self, register: &Register, value: i64) {
        let (start, size) = (usize::from(register.address), usize::from(register.size));
        self.memory[start..start + size].copy_from_slice(&value.to_le_bytes()[..size]);
    }
}

fn decode(register: &Register, bytes: &[u8]) -> i64 {
    let negative = register.signed() && bytes.last().is_some_and(|byte| byte & 0x80 != 0);
    let mut wide = [if negative { 0xFF } else { 0 }; 8];
    wide[..bytes.len()].copy_from_slice(bytes);
    i64::from_le_bytes(wide)
}

#[cfg(test)]
#[path = "servo_tests.rs"]
mod tests;
