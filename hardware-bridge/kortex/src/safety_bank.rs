//! Fault and warning banks: 32 bits, each a safety of the base or of a joint.
//!
//! Source of the bits: `SafetyIdentifier` in the maker's `Base.proto`, `SafetyIdentifierBankA` in
//! `ActuatorConfig.proto`. No bit of bank B is named there; a set one is reported by its number.

use std::fmt;

use crate::joints::JOINTS;

/// Names of a bank's bits, from bit 0.
pub type Names = &'static [&'static str];

/// Names of the base's safeties.
pub const BASE: Names = &[
    "firmware update failure",
    "external communication error",
    "ambient temperature too high",
    "core temperature too high",
    "joint fault",
    "cyclic data jitter",
    "event log full",
    "no kinematics support",
    "brake removal failure",
    "network error",
    "pose out of reach",
    "joint detection error",
    "network initialization error",
    "current too high",
    "voltage too high",
    "voltage too low",
    "tool translation too fast",
    "tool rotation too fast",
    "tool translation accelerates too much",
    "tool rotation accelerates too much",
    "tool force too high",
    "tool torque too high",
    "payload too high",
    "emergency stop",
    "emergency line",
    "inrush current limiter fault",
    "non-volatile memory corrupted",
    "incompatible firmware",
    "power-on self-test failure",
    "discrete input stuck",
    "illegal arm position",
];

/// Names of a joint's safeties.
pub const ACTUATOR: Names = &[
    "following error",
    "speed too high",
    "upper joint limit",
    "lower joint limit",
    "strain gauge mismatch",
    "torque too high",
    "unreliable absolute position",
    "magnetic position",
    "Hall position",
    "Hall sequence",
    "encoder and Hall sensor disagree",
    "encoder and index disagree",
    "encoder and magnetic sensor disagree",
    "motor current too high",
    "motor current mismatch",
    "voltage too high",
    "voltage too low",
    "motor temperature too high",
    "core temperature too high",
    "non-volatile memory corrupted",
    "motor driver fault",
    "emergency line",
    "communication tick lost",
    "watchdog",
    "unreliable capacitive sensor",
    "unexpected gear ratio",
    "Hall and magnetic sensor disagree",
    "brake drive fault",
    "brake release moved too far",
];

/// Bit of [`BASE`]: a joint has a fault.
pub const JOINT_FAULT: u32 = 1 << 4;
/// Bit of [`BASE`]: the emergency stop is pressed, on the arm or by a call.
pub const EMERGENCY_STOP: u32 = 1 << 23;
/// Bit of [`BASE`]: the emergency line is open.
pub const EMERGENCY_LINE: u32 = 1 << 24;
/// Bit of [`ACTUATOR`]: following error, the joint is not where it was commanded.
pub const FOLLOWING_ERROR: u32 = 1;
/// Bit of [`ACTUATOR`]: watchdog, commands stopped coming.
pub const WATCHDOG: u32 = 1 << 23;

/// Both words of a bank.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
pub struct Banks {
    /// Bank A, with the bits in [`BASE`] or [`ACTUATOR`].
    pub a: u32,
    /// Bank B.
    pub b: u32,
}

impl Banks {
    /// True if no bit is set.
    pub fn is_empty(self) -> bool {
        self == Self::default()
    }

    /// Returns the names of the set bits.
    pub fn words(self, names: Names) -> Vec<String> {
        let bits = |bank: u32| (0..u32::BITS as usize).filter(move |bit| bank >> bit & 1 == 1);
        let named =
            bits(self.a).map(|bit| names.get(bit).map_or_else(|| format!("bit {bit}"), |name| (*name).to_owned()));
        named.chain(bits(self.b).map(|bit| format!("bank B bit {bit}"))).collect()
    }
}

/// Faults, or warnings, of the whole arm.
///
/// # Example
/// ```
/// use kinova_kortex::safety_bank::{FOLLOWING_ERROR, JOINT_FAULT, Report};
///
/// let mut report = Report::default();
/// report.base.a = JOINT_FAULT;
/// report.joints[2].a = FOLLOWING_ERROR;
/// assert_eq!(report.to_string(), "base: joint fault; joint 3: following error");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
pub struct Report {
    /// Banks of the base.
    pub base: Banks,
    /// Banks of each joint.
    pub joints: [Banks; JOINTS],
}

impl Report {
    /// True if there are no faults or warnings.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// True if every joint's watchdog has stopped it: commands did not reach the arm.
    pub fn is_watchdog(&self) -> bool {
        self.joints.iter().all(|joint| joint.a & WATCHDOG != 0)
    }

    /// True if an emergency stop or the open emergency line is among them.
    pub fn is_emergency_stop(&self) -> bool {
        self.base.a & (EMERGENCY_STOP | EMERGENCY_LINE) != 0
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let base = std::iter::once(("base".to_owned(), self.base.words(BASE)));
        let joints = (1..).zip(&self.joints).map(|(n, banks)| (format!("joint {n}"), banks.words(ACTUATOR)));
        let parts: Vec<String> = base
            .chain(joints)
            .filter(|(_, words)| !words.is_empty())
            .map(|(who, words)| format!("{who}: {}", words.join(", ")))
            .collect();
        f.write_str(&if parts.is_empty() { "none".to_owned() } else { parts.join("; ") })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The bits have the values that the maker publishes.
    #[test]
    fn bits_are_where_they_belong() {
        let name = |names: Names, value: u32| names[value.trailing_zeros() as usize];
        assert_eq!(name(BASE, 0x10), "joint fault");
        assert_eq!(name(BASE, 0x2000), "current too high");
        assert_eq!(name(BASE, 0x80_0000), "emergency stop");
        assert_eq!(name(BASE, 0x4000_0000), "illegal arm position");
        assert_eq!(name(ACTUATOR, 0x1), "following error");
        assert_eq!(name(ACTUATOR, 0x2000), "motor current too high");
        assert_eq!(name(ACTUATOR, 0x20_0000), "emergency line");
        assert_eq!(name(ACTUATOR, 0x80_0000), "watchdog");
        assert_eq!(name(ACTUATOR, 0x1000_0000), "brake release moved too far");
        assert_eq!((BASE.len(), ACTUATOR.len()), (31, 29));
    }

    #[test]
    fn report_in_words() {
        let mut report = Report::default();
        assert_eq!(report.to_string(), "none");
        report.base.a = JOINT_FAULT;
        report.joints[2] = Banks { a: FOLLOWING_ERROR | 1 << 31, b: 2 };
        assert_eq!(report.to_string(), "base: joint fault; joint 3: following error, bit 31, bank B bit 1");
        assert!(!report.is_emergency_stop());
    }
}
