//! The XC330-T288-T: its control table as data, and its counts in SI units.
//!
//! A [`Register`] has an address, a size, a sign, a range and a unit. [`Register::write`] converts SI to bytes and checks the range;
//! [`Register::read`] converts back. The servo ignores its
//! own position limits (48, 52) in current and current-based position mode: the sender must clamp its goals.
//!
//! Source: ROBOTIS e-Manual, XC330-T288. The control loop does not use indirect addressing, whose addresses depend on
//! the firmware ([`Indirect`]): the two blocks that it needs are contiguous ([`GOAL_BLOCK`], [`PRESENT_BLOCK`]).

use std::ops::Range;

use crate::register::{Access, Register, Unit};

/// Model number that the servo returns to a ping.
pub const XC330_MODEL: u16 = 1220;
/// Baud rates by the value of the baud rate register. The 330 series stops here (no 4.5 Mbaud).
pub const BAUD_RATES: [u32; 7] = [9_600, 57_600, 115_200, 1_000_000, 2_000_000, 3_000_000, 4_000_000];
/// Goal current to goal position: one contiguous write, 18 bytes.
pub const GOAL_BLOCK: Range<u16> = 102..120;
/// Present current, velocity and position: one contiguous read, 10 bytes.
pub const PRESENT_BLOCK: Range<u16> = 126..136;
/// [`PRESENT_BLOCK`] extended up to present temperature: one contiguous read, 21 bytes.
pub const PRESENT_BLOCK_LONG: Range<u16> = 126..147;

/// Defines a constant for every line, and [`REGISTERS`] with all of them.
macro_rules! control_table {
    ($($id:ident: $address:literal $size:literal $name:literal $access:ident $default:expr, ($low:expr, $high:expr) $unit:ident;)*) => {
        $(
            #[doc = concat!($name, ", address ", $address, ", ", $size, " bytes.")]
            pub const $id: Register = Register {
                address: $address, size: $size, name: $name, access: Access::$access, default: $default, range: ($low, $high), unit: Unit::$unit,
            };
        )*
        /// The control table, by address.
        pub const REGISTERS: &[Register] = &[$($id),*];
    };
}

const I16: (i64, i64) = (i16::MIN as i64, i16::MAX as i64);
const I32: (i64, i64) = (i32::MIN as i64, i32::MAX as i64);

control_table! {
    MODEL_NUMBER:            0 2 "Model Number"            Read   Some(1220), (0, 65_535) Plain;
    MODEL_INFORMATION:       2 4 "Model Information"       Read   None, (0, 4_294_967_295) Plain;
    FIRMWARE_VERSION:        6 1 "Firmware Version"        Read   None, (0, 255) Plain;
    ID:                      7 1 "ID"                      Eeprom Some(1), (0, 252) Plain;
    BAUD_RATE:               8 1 "Baud Rate"               Eeprom Some(1), (0, 6) Plain;
    RETURN_DELAY_TIME:       9 1 "Return Delay Time"       Eeprom Some(250), (0, 254) ReturnDelay;
    DRIVE_MODE:             10 1 "Drive Mode"              Eeprom Some(0), (0, 13) Plain;
    OPERATING_MODE:         11 1 "Operating Mode"          Eeprom Some(3), (0, 16) Plain;
    SECONDARY_ID:           12 1 "Secondary ID"            Eeprom Some(255), (0, 255) Plain;
    PROTOCOL_TYPE:          13 1 "Protocol Type"           Eeprom Some(2), (2, 22) Plain;
    HOMING_OFFSET:          20 4 "Homing Offset"           Eeprom Some(0), (-1_044_479, 1_044_479) Angle;
    MOVING_THRESHOLD:       24 4 "Moving Threshold"        Eeprom Some(10), (0, 1023) Velocity;
    TEMPERATURE_LIMIT:      31 1 "Temperature Limit"       Eeprom Some(70), (0, 100) Celsius;
    MAX_VOLTAGE_LIMIT:      32 2 "Max Voltage Limit"       Eeprom Some(140), (55, 140) Voltage;
    MIN_VOLTAGE_LIMIT:      34 2 "Min Voltage Limit"       Eeprom Some(55), (55, 140) Voltage;
    PWM_LIMIT:              36 2 "PWM Limit"               Eeprom Some(885), (0, 885) DutyCycle;
    CURRENT_LIMIT:          38 2 "Current Limit"           Eeprom Some(910), (0, 910) Current;
    VELOCITY_LIMIT:         44 4 "Velocity Limit"          Eeprom Some(320), (0, 2047) Velocity;
    MAX_POSITION_LIMIT:     48 4 "Max Position Limit"      Eeprom Some(4095), (0, 4095) Angle;
    MIN_POSITION_LIMIT:     52 4 "Min Position Limit"      Eeprom Some(0), (0, 4095) Angle;
    STARTUP_CONFIGURATION:  60 1 "Startup Configuration"   Eeprom Some(0), (0, 255) Plain;
    PWM_SLOPE:              62 1 "PWM Slope"               Eeprom Some(255), (1, 255) Plain;
    SHUTDOWN:               63 1 "Shutdown"                Eeprom Some(0x34), (0, 255) Plain;
    TORQUE_ENABLE:          64 1 "Torque Enable"           Ram    Some(0), (0, 1) Plain;
    LED:                    65 1 "LED"                     Ram    Some(0), (0, 1) Plain;
    STATUS_RETURN_LEVEL:    68 1 "Status Return Level"     Ram    Some(2), (0, 2) Plain;
    REGISTERED_INSTRUCTION: 69 1 "Registered Instruction"  Read   Some(0), (0, 1) Plain;
    HARDWARE_ERROR_STATUS:  70 1 "Hardware Error Status"   Read   Some(0), (0, 255) Plain;
    VELOCITY_I_GAIN:        76 2 "Velocity I Gain"         Ram    Some(1200), (0, 16_383) Plain;
    VELOCITY_P_GAIN:        78 2 "Velocity P Gain"         Ram    Some(40), (0, 16_383) Plain;
    POSITION_D_GAIN:        80 2 "Position D Gain"         Ram    Some(0), (0, 16_383) Plain;
    POSITION_I_GAIN:        82 2 "Position I Gain"         Ram    Some(0), (0, 16_383) Plain;
    POSITION_P_GAIN:        84 2 "Position P Gain"         Ram    Some(900), (0, 16_383) Plain;
    FEEDFORWARD_2ND_GAIN:   88 2 "Feedforward 2nd Gain"    Ram    Some(0), (0, 16_383) Plain;
    FEEDFORWARD_1ST_GAIN:   90 2 "Feedforward 1st Gain"    Ram    Some(0), (0, 16_383) Plain;
    BUS_WATCHDOG:           98 1 "Bus Watchdog"            Ram    Some(0), (-1, 127) Watchdog;
    GOAL_PWM:              100 2 "Goal PWM"                Ram    None, (-885, 885) DutyCycle;
    GOAL_CURRENT:          102 2 "Goal Current"            Ram    None, (-910, 910) Current;
    GOAL_VELOCITY:         104 4 "Goal Velocity"           Ram    None, (-2047, 2047) Velocity;
    PROFILE_ACCELERATION:  108 4 "Profile Acceleration"    Ram    Some(0), (0, 32_767) Acceleration;
    PROFILE_VELOCITY:      112 4 "Profile Velocity"        Ram    Some(0), (0, 32_767) Velocity;
    GOAL_POSITION:         116 4 "Goal Position"           Ram    None, (-1_048_575, 1_048_575) Angle;
    REALTIME_TICK:         120 2 "Realtime Tick"           Read   None, (0, 32_767) Millisecond;
    MOVING:                122 1 "Moving"                  Read   Some(0), (0, 1) Plain;
    MOVING_STATUS:         123 1 "Moving Status"           Read   Some(0), (0, 255) Plain;
    PRESENT_PWM:           124 2 "Present PWM"             Read   None, (I16.0, I16.1) DutyCycle;
    PRESENT_CURRENT:       126 2 "Present Current"         Read   None, (I16.0, I16.1) Current;
    PRESENT_VELOCITY:      128 4 "Present Velocity"        Read   None, (I32.0, I32.1) Velocity;
    PRESENT_POSITION:      132 4 "Present Position"        Read   None, (I32.0, I32.1) Angle;
    VELOCITY_TRAJECTORY:   136 4 "Velocity Trajectory"     Read   None, (I32.0, I32.1) Velocity;
    POSITION_TRAJECTORY:   140 4 "Position Trajectory"     Read   None, (I32.0, I32.1) Angle;
    PRESENT_INPUT_VOLTAGE: 144 2 "Present Input Voltage"   Read   None, (0, 65_535) Voltage;
    PRESENT_TEMPERATURE:   146 1 "Present Temperature"     Read   None, (0, 255) Celsius;
    BACKUP_READY:          147 1 "Backup Ready"            Read   None, (0, 1) Plain;
}

/// Indirect addressing: each byte of the data area is an alias of the byte whose address is stored for it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Indirect {
    /// Start address of the data area.
    pub data: u16,
    /// Number of bytes in the data area, each with a two-byte address from [`Indirect::ADDRESS_AREA_START`] on.
    pub slots: u16,
}

impl Indirect {
    /// Start of the stored addresses.
    pub const ADDRESS_AREA_START: u16 = 168;
    /// First firmware version with the shorter area that the e-Manual describes.
    const SHORTER_FROM: u8 = 52;

    /// Returns the layout of this firmware version. ROBOTIS' model files have the data at 224 for older firmware and at
    /// 208 from 52 on; the addresses fill the space before the data.
    pub fn for_firmware(firmware: u8) -> Self {
        if firmware >= Self::SHORTER_FROM { Self { data: 208, slots: 20 } } else { Self { data: 224, slots: 28 } }
    }
}

/// Bits of the hardware error status register.
pub mod hardware_error {
    /// Input voltage outside its limits.
    pub const VOLTAGE: u8 = 1 << 0;
    /// Too hot.
    pub const OVERHEAT: u8 = 1 << 2;
    pub const ENCODER: u8 = 1 << 3;
    /// Electrical shock, or too little power for the motor.
    pub const SHOCK: u8 = 1 << 4;
    /// Load beyond the maximum for too long.
    pub const OVERLOAD: u8 = 1 << 5;

    /// Returns the names of the set bits, or `none` without any.
    pub fn describe(bits: u8) -> String {
        let named = [
            (VOLTAGE, "input voltage"),
            (OVERHEAT, "overheating"),
            (ENCODER, "encoder"),
            (SHOCK, "electrical shock"),
            (OVERLOAD, "overload"),
        ];
        let known = named.iter().fold(0, |known, (bit, _)| known | bit);
        let mut words: Vec<String> =
            named.iter().filter(|(bit, _)| bits & bit != 0).map(|(_, name)| (*name).to_owned()).collect();
        if bits & !known != 0 {
            words.push(format!("bits {:#04x}", bits & !known));
        }
        if words.is_empty() { "none".to_owned() } else { words.join(", ") }
    }
}

/// Operating modes.
pub mod mode {
    /// Current control.
    pub const CURRENT: i64 = 0;
    /// Velocity control.
    pub const VELOCITY: i64 = 1;
    /// Position control within one turn.
    pub const POSITION: i64 = 3;
    /// Multi-turn position control.
    pub const EXTENDED_POSITION: i64 = 4;
    /// Multi-turn position control under a current limit.
    pub const CURRENT_POSITION: i64 = 5;
    /// Direct control of the duty cycle.
    pub const PWM: i64 = 16;
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::register::RegisterError;
    use proptest::prelude::*;

    #[test]
    fn ordered_and_without_overlap() {
        for pair in REGISTERS.windows(2) {
            assert!(
                pair[0].address + u16::from(pair[0].size) <= pair[1].address,
                "{} and {}",
                pair[0].name,
                pair[1].name
            );
        }
    }

    #[test]
    fn defaults_and_ranges_fit() {
        for register in REGISTERS {
            let bits = 8 * u32::from(register.size);
            let (low, high) =
                if register.signed() { (-(1_i64 << (bits - 1)), (1 << (bits - 1)) - 1) } else { (0, (1 << bits) - 1) };
            assert!(low <= register.range.0 && register.range.1 <= high, "{}", register.name);
            if let Some(default) = register.default {
                assert!((register.range.0..=register.range.1).contains(&default), "{}", register.name);
            }
        }
    }

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
    fn blocks_hold_whole_registers() {
        let size = |block: &Range<u16>| {
            REGISTERS.iter().filter(|r| block.contains(&r.address)).map(|r| u16::from(r.size)).sum::<u16>()
        };
        for block in [GOAL_BLOCK, PRESENT_BLOCK, PRESENT_BLOCK_LONG] {
            assert_eq!(size(&block), block.end - block.start, "{block:?} has holes");
        }
    }

    #[test]
    fn present_block_read_back() {
        // -120 mA, -2 counts of velocity, position 4096.
        let block = [0x88, 0xFF, 0xFE, 0xFF, 0xFF, 0xFF, 0x00, 0x10, 0x00, 0x00];
        let value = |register: Register| register.read_from(&block, PRESENT_BLOCK.start).expect("in the block");
        assert!((value(PRESENT_CURRENT) + 0.12).abs() < 1e-12);
        assert!((value(PRESENT_VELOCITY) + 2.0 * 0.229 * TAU / 60.0).abs() < 1e-12);
        assert!((value(PRESENT_POSITION) - TAU).abs() < 1e-12);
        assert_eq!(PRESENT_TEMPERATURE.read_from(&block, PRESENT_BLOCK.start), None);
        assert_eq!(GOAL_CURRENT.read_from(&block, PRESENT_BLOCK.start), None);
    }

    /// A tripped bus watchdog reads -1 (255 on the wire), which is not a time in units of 20 ms.
    #[test]
    fn tripped_watchdog_is_negative() {
        assert!(BUS_WATCHDOG.read(&[255]).expect("one byte") < 0.0);
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

    proptest! {
        /// Every value that may be written is read back to within half a count.
        #[test]
        fn round_trip(register in prop::sample::select(REGISTERS), share in 0.0..=1.0_f64) {
            prop_assume!(register.access != Access::Read);
            let unit = register.unit.per_count();
            let si = unit * (register.range.0 as f64 + share * (register.range.1 - register.range.0) as f64);
            let bytes = register.write(si)?;
            prop_assert_eq!(bytes.len(), usize::from(register.size));
            prop_assert!((register.read(&bytes)? - si).abs() <= 0.500_001 * unit);
        }
    }
}
