//! The XC330-T288-T: its control table, and the blocks of registers that a control cycle needs.
//!
//! The servo ignores its own position limits (48, 52) in current and current-based position mode: the sender must clamp
//! its goals. The blocks are contiguous ([`GOAL_BLOCK`], [`PRESENT_BLOCK`]), so that a cycle needs no indirect
//! addressing, whose addresses depend on the firmware ([`Indirect`]). All models that measure current have the same
//! blocks.
//!
//! Source: ROBOTIS e-Manual, XC330-T288.
//!
//! # Example
//! ```
//! use dynamixel_bus::xc330::{PRESENT_BLOCK, PRESENT_CURRENT, PRESENT_POSITION};
//!
//! // A block as a sync read returns it: -120 mA, at rest, after one turn.
//! let block = [0x88, 0xFF, 0, 0, 0, 0, 0x00, 0x10, 0, 0];
//! assert_eq!(block.len(), PRESENT_BLOCK.len());
//! let current = PRESENT_CURRENT.read_from(&block, PRESENT_BLOCK.start).ok_or("not in the block")?;
//! let angle = PRESENT_POSITION.read_from(&block, PRESENT_BLOCK.start).ok_or("not in the block")?;
//! assert!((current + 0.12).abs() < 1e-9 && (angle - std::f64::consts::TAU).abs() < 1e-9);
//! # Ok::<(), &str>(())
//! ```

use std::ops::Range;

use crate::x_series::x_series;

/// Baud rates by the value of the baud rate register. The 330 series stops here (no 4.5 Mbaud).
pub const BAUD_RATES: [u32; 7] = [9_600, 57_600, 115_200, 1_000_000, 2_000_000, 3_000_000, 4_000_000];
/// Goal current to goal position: one contiguous write, 18 bytes.
pub const GOAL_BLOCK: Range<u16> = 102..120;
/// Present current, velocity and position: one contiguous read, 10 bytes.
pub const PRESENT_BLOCK: Range<u16> = 126..136;
/// [`PRESENT_BLOCK`] extended up to present temperature: one contiguous read, 21 bytes.
pub const PRESENT_BLOCK_LONG: Range<u16> = 126..147;

x_series! {
    model: 1220 "XC330-T288-T",
    baud_rates: &BAUD_RATES,
    protocol_types: (2, 22),
    temperature_limit: 70,
    voltage_limits: 55 to 140, least 55,
    velocity_limit: 320, greatest 2047,
    shutdown: 0x34,
    velocity_gains: i 1200 p 40,
    position_gains: d 0 i 0 p 900,
    limits {
        CURRENT_LIMIT:          38 2 "Current Limit"           Eeprom Some(910), (0, 910) Current;
    }
    setup {
        STARTUP_CONFIGURATION:  60 1 "Startup Configuration"   Eeprom Some(0), (0, 255) Plain;
        PWM_SLOPE:              62 1 "PWM Slope"               Eeprom Some(255), (1, 255) Plain;
    }
    goals {
        GOAL_CURRENT:          102 2 "Goal Current"            Ram    None, (-910, 910) Current;
    }
    present {
        PRESENT_CURRENT:       126 2 "Present Current"         Read   None, (-32_768, 32_767) Current;
    }
    end {
        BACKUP_READY:          147 1 "Backup Ready"            Read   None, (0, 1) Plain;
    }
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

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::register::Register;

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
}
