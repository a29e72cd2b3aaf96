//! Registers of a servo's control table, and their values in SI units.
//!
//! A [`Register`] has an address, a size, a range and a unit. [`Register::write`] converts a value in SI to bytes and
//! checks its range; [`Register::read`] converts back. Positions are in rad, velocities in rad/s, accelerations in
//! rad/s^2, currents in A, voltages in V, times in s, temperatures in degrees Celsius.
//!
//! # Example
//! ```
//! use dynamixel_bus::register::RegisterError;
//! use dynamixel_bus::xc330::{GOAL_CURRENT, GOAL_POSITION};
//!
//! let bytes = GOAL_POSITION.write(std::f64::consts::PI)?;
//! assert_eq!(bytes, 2048_i32.to_le_bytes());
//! assert!((GOAL_POSITION.read(&bytes)? - std::f64::consts::PI).abs() < 1e-9);
//!
//! // 1.2 A is beyond the range of the servo.
//! assert!(matches!(GOAL_CURRENT.write(1.2), Err(RegisterError::Range { .. })));
//! # Ok::<(), RegisterError>(())
//! ```

use std::f64::consts::TAU;

/// Encoder counts per turn.
pub const COUNTS_PER_TURN: f64 = 4096.0;

/// Write access to a register.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// Read-only: only the servo changes it.
    Read,
    /// Writable by the host while torque is off; retained without power.
    Eeprom,
    /// Writable by the host at any time; lost at power-off and reboot.
    Ram,
}

/// Unit of one count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    /// A number, code or mask; not converted.
    Plain,
    /// 1/4096 turn -> rad.
    Angle,
    /// 0.229 rev/min -> rad/s.
    Velocity,
    /// 214.577 rev/min^2 -> rad/s^2.
    Acceleration,
    /// 1 mA -> A; measured at the power input. In the 330 series.
    Current,
    /// 2.69 mA -> A. In the 430 and 540 series.
    CoarseCurrent,
    /// 0.1 % of the maximum torque, estimated -> share of it. In models that do not measure current.
    Load,
    /// 0.1 V -> V.
    Voltage,
    /// Share of the full duty cycle, 885 counts = 1.
    DutyCycle,
    /// Degrees Celsius, not converted.
    Celsius,
    /// 2 us -> s.
    ReturnDelay,
    /// 1 ms -> s.
    Millisecond,
    /// 20 ms -> s.
    Watchdog,
}

impl Unit {
    /// SI (or degrees Celsius) per count.
    pub fn per_count(self) -> f64 {
        match self {
            Self::Plain | Self::Celsius => 1.0,
            Self::Angle => TAU / COUNTS_PER_TURN,
            Self::Velocity => 0.229 * TAU / 60.0,
            Self::Acceleration => 214.577 * TAU / 3600.0,
            Self::Current | Self::Load | Self::Millisecond => 1e-3,
            Self::CoarseCurrent => 2.69e-3,
            Self::Voltage => 0.1,
            Self::DutyCycle => 1.0 / 885.0,
            Self::ReturnDelay => 2e-6,
            Self::Watchdog => 20e-3,
        }
    }
}

/// One entry of the control table.
///
/// A register that is not in [`crate::models`] is a constant of the program that uses it:
/// ```
/// use dynamixel_bus::register::{Access, Register, Unit};
///
/// const PRESENT_CURRENT: Register = Register {
///     address: 126,
///     size: 2,
///     name: "Present Current",
///     access: Access::Read,
///     default: None,
///     range: (-32_768, 32_767),
///     unit: Unit::CoarseCurrent,
/// };
/// assert!((PRESENT_CURRENT.read(&[0x9C, 0xFF])? + 0.269).abs() < 1e-12);
/// # Ok::<(), dynamixel_bus::RegisterError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Register {
    /// Address of the first byte.
    pub address: u16,
    /// Size in bytes, 1, 2 or 4; little-endian.
    pub size: u8,
    /// Name in the e-Manual.
    pub name: &'static str,
    /// Write access to the register.
    pub access: Access,
    /// Factory value in counts, if there is one.
    pub default: Option<i64>,
    /// Range in counts, both ends included, of the values that may be written or, in a read-only register, shown.
    pub range: (i64, i64),
    /// Unit of one count.
    pub unit: Unit,
}

/// A value that does not fit a register.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RegisterError {
    /// The value is outside the register's range.
    #[error("{register}: found {found}, expected {low} to {high}")]
    Range {
        /// Name of the register.
        register: &'static str,
        /// Value given, SI.
        found: f64,
        /// Least permitted value, SI.
        low: f64,
        /// Greatest permitted value, SI.
        high: f64,
    },
    /// The host cannot write the register.
    #[error("{0}: read-only")]
    ReadOnly(&'static str),
    /// The number of bytes is not the register's size.
    #[error("{register}: found {found} bytes, expected {expected}")]
    Length {
        /// Name of the register.
        register: &'static str,
        /// Number of bytes given.
        found: usize,
        /// Size of the register, bytes.
        expected: usize,
    },
}

impl Register {
    /// Returns true if `found` equals `expected` to within the register's resolution.
    pub fn holds(&self, found: f64, expected: f64) -> bool {
        (found - expected).abs() <= 0.51 * self.unit.per_count()
    }

    /// True if the register is signed (two's complement).
    pub fn signed(&self) -> bool {
        self.range.0 < 0
    }

    /// Encodes a value in SI as bytes, rounded to the nearest count.
    pub fn write(&self, si: f64) -> Result<Vec<u8>, RegisterError> {
        if self.access == Access::Read {
            return Err(RegisterError::ReadOnly(self.name));
        }
        let (low, high) = (self.range.0 as f64, self.range.1 as f64);
        let counts = (si / self.unit.per_count()).round();
        if !(low..=high).contains(&counts) {
            let si_of = |counts: f64| counts * self.unit.per_count();
            return Err(RegisterError::Range { register: self.name, found: si, low: si_of(low), high: si_of(high) });
        }
        Ok((counts as i64).to_le_bytes()[..usize::from(self.size)].to_vec())
    }

    /// Decodes the servo's bytes to a value in SI.
    pub fn read(&self, bytes: &[u8]) -> Result<f64, RegisterError> {
        let size = usize::from(self.size);
        if bytes.len() != size {
            return Err(RegisterError::Length { register: self.name, found: bytes.len(), expected: size });
        }
        let negative = self.signed() && bytes[size - 1] & 0x80 != 0;
        let mut wide = [if negative { 0xFF } else { 0 }; 8];
        wide[..size].copy_from_slice(bytes);
        Ok(i64::from_le_bytes(wide) as f64 * self.unit.per_count())
    }

    /// Decodes the register, in SI, from a block of registers that starts at address `start`; `None` if the block does
    /// not hold all of it.
    pub fn read_from(&self, block: &[u8], start: u16) -> Option<f64> {
        let first = usize::from(self.address.checked_sub(start)?);
        self.read(block.get(first..first + usize::from(self.size))?).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::xc330::{
        CURRENT_LIMIT, GOAL_CURRENT, GOAL_POSITION, MAX_VOLTAGE_LIMIT, PRESENT_POSITION, PWM_LIMIT, RETURN_DELAY_TIME,
        VELOCITY_LIMIT,
    };

    /// Compares units with the figures in the e-Manual, to half of their last digit.
    #[test]
    fn published_units() {
        let si = |register: Register, counts: f64| counts * register.unit.per_count();
        assert!((si(PRESENT_POSITION, 1.0).to_degrees() - 0.088).abs() < 5e-4);
        assert!((si(RETURN_DELAY_TIME, 250.0) - 500e-6).abs() < 1e-12);
        assert!((si(VELOCITY_LIMIT, 320.0) * 60.0 / TAU - 73.28).abs() < 1e-9);
        assert!((si(PWM_LIMIT, 1.0) - 0.00113).abs() < 5e-6);
        assert!((si(CURRENT_LIMIT, 910.0) - 0.91).abs() < 1e-12);
        assert!((si(MAX_VOLTAGE_LIMIT, 140.0) - 14.0).abs() < 1e-12);
    }

    #[test]
    fn refusals_are_named() {
        let error = GOAL_CURRENT.write(1.2).expect_err("above the limit");
        assert_eq!(error.to_string(), "Goal Current: found 1.2, expected -0.91 to 0.91");
        assert!(GOAL_POSITION.write(f64::NAN).is_err());
        assert_eq!(PRESENT_POSITION.write(0.0), Err(RegisterError::ReadOnly("Present Position")));
        assert_eq!(
            GOAL_CURRENT.read(&[1]),
            Err(RegisterError::Length { register: "Goal Current", found: 1, expected: 2 })
        );
    }
}
