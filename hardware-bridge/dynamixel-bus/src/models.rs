//! Servo models of the X series, with their control tables.
//!
//! [`Model::by_number`] finds the model that a servo names in its answer to a ping. The module of a model has a constant
//! for each of its registers. The XC330-T288-T is in [`crate::xc330`].
//!
//! A model that is not here needs no change of this crate: define its [`Register`]s, or use those of a model with the
//! same ones. All models of the X series have the same addresses; they differ in limits, gains and the unit of current.
//!
//! Source: ROBOTIS e-Manual, the page of each model. No table has been checked on a servo.
//!
//! # Example
//! ```
//! use dynamixel_bus::models::{Model, xm430_w350};
//!
//! // The answer to a ping has the model number 1020.
//! let model = Model::by_number(1020).ok_or("unknown model")?;
//! assert_eq!(model.name, "XM430-W350");
//! let current = model.register("Goal Current").ok_or("no such register")?;
//! assert_eq!(current, &xm430_w350::GOAL_CURRENT);
//! // A count of current is 2.69 mA in this model, and 1 mA in the small ones.
//! assert_eq!(current.write(0.269)?, 100_i16.to_le_bytes());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use crate::register::Register;
use crate::x_series::{BAUD_RATES, x_series};
use crate::xc330;

/// A servo model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Model {
    /// Model number that the servo returns to a ping.
    pub number: u16,
    /// Name in the e-Manual.
    pub name: &'static str,
    /// Control table, by address.
    pub registers: &'static [Register],
    /// Baud rates, bits per second, by the value of the baud rate register.
    pub baud_rates: &'static [u32],
}

/// All models with a control table in this crate.
pub const MODELS: &[Model] = &[
    xm430_w350::MODEL,
    xm430_w210::MODEL,
    xl430_w250::MODEL,
    xm540_w270::MODEL,
    xl330_m077::MODEL,
    xl330_m288::MODEL,
    xc330::MODEL,
    xc330_m288::MODEL,
];

impl Model {
    /// Finds a model by its number; `None` if this crate does not have it.
    pub fn by_number(number: u16) -> Option<&'static Self> {
        MODELS.iter().find(|model| model.number == number)
    }

    /// Finds a register by its name in the e-Manual; `None` if the model has none of this name.
    pub fn register(&self, name: &str) -> Option<&'static Register> {
        self.registers.iter().find(|register| register.name == name)
    }
}

/// XL330-M077-T: 5 V, gear ratio 77.
pub mod xl330_m077 {
    use super::*;

    x_series! {
        model: 1190 "XL330-M077-T",
        baud_rates: &xc330::BAUD_RATES,
        protocol_types: (2, 22),
        temperature_limit: 70,
        voltage_limits: 35 to 70, least 31,
        velocity_limit: 1620, greatest 2047,
        shutdown: 0x35,
        velocity_gains: i 400 p 40,
        position_gains: d 0 i 400 p 400,
        limits {
            CURRENT_LIMIT: 38 2 "Current Limit" Eeprom Some(1750), (0, 1750) Current;
        }
        setup {
            PWM_SLOPE: 62 1 "PWM Slope" Eeprom Some(140), (1, 255) Plain;
        }
        goals {
            GOAL_CURRENT: 102 2 "Goal Current" Ram None, (-1750, 1750) Current;
        }
        present {
            PRESENT_CURRENT: 126 2 "Present Current" Read None, (-32_768, 32_767) Current;
        }
        end {}
    }
}

/// XL330-M288-T: 5 V, gear ratio 288.
pub mod xl330_m288 {
    use super::*;

    x_series! {
        model: 1200 "XL330-M288-T",
        baud_rates: &xc330::BAUD_RATES,
        protocol_types: (2, 22),
        temperature_limit: 70,
        voltage_limits: 35 to 70, least 31,
        velocity_limit: 445, greatest 2047,
        shutdown: 0x35,
        velocity_gains: i 1600 p 180,
        position_gains: d 0 i 0 p 400,
        limits {
            CURRENT_LIMIT: 38 2 "Current Limit" Eeprom Some(1750), (0, 1750) Current;
        }
        setup {
            STARTUP_CONFIGURATION: 60 1 "Startup Configuration" Eeprom Some(0), (0, 255) Plain;
            PWM_SLOPE: 62 1 "PWM Slope" Eeprom Some(140), (1, 255) Plain;
        }
        goals {
            GOAL_CURRENT: 102 2 "Goal Current" Ram None, (-1750, 1750) Current;
        }
        present {
            PRESENT_CURRENT: 126 2 "Present Current" Read None, (-32_768, 32_767) Current;
        }
        end {
            BACKUP_READY: 147 1 "Backup Ready" Read None, (0, 1) Plain;
        }
    }
}

/// XC330-M288-T: 5 V, gear ratio 288.
pub mod xc330_m288 {
    use super::*;

    x_series! {
        model: 1240 "XC330-M288-T",
        baud_rates: &xc330::BAUD_RATES,
        protocol_types: (2, 22),
        temperature_limit: 70,
        voltage_limits: 35 to 70, least 31,
        velocity_limit: 350, greatest 2047,
        shutdown: 0x34,
        velocity_gains: i 1600 p 50,
        position_gains: d 500 i 0 p 1100,
        limits {
            CURRENT_LIMIT: 38 2 "Current Limit" Eeprom Some(2352), (0, 2352) Current;
        }
        setup {
            STARTUP_CONFIGURATION: 60 1 "Startup Configuration" Eeprom Some(0), (0, 255) Plain;
            PWM_SLOPE: 62 1 "PWM Slope" Eeprom Some(140), (1, 255) Plain;
        }
        goals {
            GOAL_CURRENT: 102 2 "Goal Current" Ram None, (-2352, 2352) Current;
        }
        present {
            PRESENT_CURRENT: 126 2 "Present Current" Read None, (-32_768, 32_767) Current;
        }
        end {
            BACKUP_READY: 147 1 "Backup Ready" Read None, (0, 1) Plain;
        }
    }
}

/// XL430-W250-T: it measures load, not current.
pub mod xl430_w250 {
    use super::*;

    x_series! {
        model: 1060 "XL430-W250-T",
        baud_rates: &BAUD_RATES,
        protocol_types: (1, 2),
        temperature_limit: 72,
        voltage_limits: 60 to 140, least 60,
        velocity_limit: 265, greatest 1023,
        shutdown: 0x34,
        velocity_gains: i 1000 p 100,
        position_gains: d 4000 i 0 p 640,
        limits {}
        setup {
            STARTUP_CONFIGURATION: 60 1 "Startup Configuration" Eeprom Some(0), (0, 255) Plain;
        }
        goals {}
        present {
            PRESENT_LOAD: 126 2 "Present Load" Read None, (-1000, 1000) Load;
        }
        end {
            BACKUP_READY: 147 1 "Backup Ready" Read None, (0, 1) Plain;
        }
    }
}

/// XM430-W350.
pub mod xm430_w350 {
    use super::*;

    x_series! {
        model: 1020 "XM430-W350",
        baud_rates: &BAUD_RATES,
        protocol_types: (1, 2),
        temperature_limit: 80,
        voltage_limits: 95 to 160, least 95,
        velocity_limit: 200, greatest 1023,
        shutdown: 0x34,
        velocity_gains: i 1920 p 100,
        position_gains: d 0 i 0 p 800,
        limits {
            CURRENT_LIMIT: 38 2 "Current Limit" Eeprom Some(1193), (0, 1193) CoarseCurrent;
        }
        setup {}
        goals {
            GOAL_CURRENT: 102 2 "Goal Current" Ram None, (-1193, 1193) CoarseCurrent;
        }
        present {
            PRESENT_CURRENT: 126 2 "Present Current" Read None, (-32_768, 32_767) CoarseCurrent;
        }
        end {}
    }
}

/// XM430-W210.
pub mod xm430_w210 {
    use super::*;

    x_series! {
        model: 1030 "XM430-W210",
        baud_rates: &BAUD_RATES,
        protocol_types: (1, 2),
        temperature_limit: 80,
        voltage_limits: 95 to 160, least 95,
        velocity_limit: 330, greatest 1023,
        shutdown: 0x34,
        velocity_gains: i 1920 p 100,
        position_gains: d 0 i 0 p 800,
        limits {
            CURRENT_LIMIT: 38 2 "Current Limit" Eeprom Some(1193), (0, 1193) CoarseCurrent;
        }
        setup {}
        goals {
            GOAL_CURRENT: 102 2 "Goal Current" Ram None, (-1193, 1193) CoarseCurrent;
        }
        present {
            PRESENT_CURRENT: 126 2 "Present Current" Read None, (-32_768, 32_767) CoarseCurrent;
        }
        end {}
    }
}

/// XM540-W270: three external ports.
pub mod xm540_w270 {
    use super::*;

    x_series! {
        model: 1120 "XM540-W270",
        baud_rates: &BAUD_RATES,
        protocol_types: (1, 2),
        temperature_limit: 80,
        voltage_limits: 95 to 160, least 95,
        velocity_limit: 128, greatest 1023,
        shutdown: 0x34,
        velocity_gains: i 1920 p 100,
        position_gains: d 0 i 0 p 800,
        limits {
            CURRENT_LIMIT: 38 2 "Current Limit" Eeprom Some(2047), (0, 2047) CoarseCurrent;
        }
        setup {
            EXTERNAL_PORT_MODE_1: 56 1 "External Port Mode 1" Eeprom Some(3), (0, 3) Plain;
            EXTERNAL_PORT_MODE_2: 57 1 "External Port Mode 2" Eeprom Some(3), (0, 3) Plain;
            EXTERNAL_PORT_MODE_3: 58 1 "External Port Mode 3" Eeprom Some(3), (0, 3) Plain;
        }
        goals {
            GOAL_CURRENT: 102 2 "Goal Current" Ram None, (-2047, 2047) CoarseCurrent;
        }
        present {
            PRESENT_CURRENT: 126 2 "Present Current" Read None, (-32_768, 32_767) CoarseCurrent;
        }
        end {
            EXTERNAL_PORT_DATA_1: 152 2 "External Port Data 1" Ram None, (0, 65_535) Plain;
            EXTERNAL_PORT_DATA_2: 154 2 "External Port Data 2" Ram None, (0, 65_535) Plain;
            EXTERNAL_PORT_DATA_3: 156 2 "External Port Data 3" Ram None, (0, 65_535) Plain;
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::register::Access;

    #[test]
    fn every_number_once() {
        for model in MODELS {
            assert_eq!(Model::by_number(model.number), Some(model), "{}", model.name);
            assert_eq!(model.registers[0].default, Some(model.number.into()), "{}", model.name);
        }
        assert_eq!(Model::by_number(0), None);
    }

    #[test]
    fn ordered_and_without_overlap() {
        for model in MODELS {
            for pair in model.registers.windows(2) {
                let [first, second] = pair else { panic!("two registers") };
                let end = first.address + u16::from(first.size);
                assert!(end <= second.address, "{}: {} and {}", model.name, first.name, second.name);
            }
        }
    }

    #[test]
    fn defaults_and_ranges_fit() {
        for register in MODELS.iter().flat_map(|model| model.registers) {
            let bits = 8 * u32::from(register.size);
            let (low, high) =
                if register.signed() { (-(1_i64 << (bits - 1)), (1 << (bits - 1)) - 1) } else { (0, (1 << bits) - 1) };
            assert!(low <= register.range.0 && register.range.1 <= high, "{}", register.name);
            if let Some(default) = register.default {
                assert!((register.range.0..=register.range.1).contains(&default), "{}", register.name);
            }
        }
    }

    /// Currents and voltages of the published figures: 910 mA, 1193 counts of 2.69 mA, 16 V.
    #[test]
    fn published_limits() {
        let limit = |model: &Model, name: &str| {
            let register = model.register(name).expect("there");
            register.range.1 as f64 * register.unit.per_count()
        };
        assert!((limit(&xc330::MODEL, "Current Limit") - 0.91).abs() < 1e-9);
        assert!((limit(&xm430_w350::MODEL, "Current Limit") - 3.209).abs() < 1e-3);
        assert!((limit(&xm540_w270::MODEL, "Max Voltage Limit") - 16.0).abs() < 1e-9);
        assert!(xl430_w250::MODEL.register("Present Current").is_none());
        assert!((limit(&xl430_w250::MODEL, "Present Load") - 1.0).abs() < 1e-9);
    }

    proptest! {
        /// Every value that may be written is read back to within half a count.
        #[test]
        fn round_trip(
            model in prop::sample::select(MODELS),
            register in any::<prop::sample::Index>(),
            share in 0.0..=1.0_f64,
        ) {
            let register = register.get(model.registers);
            prop_assume!(register.access != Access::Read);
            let unit = register.unit.per_count();
            let si = unit * (register.range.0 as f64 + share * (register.range.1 - register.range.0) as f64);
            let bytes = register.write(si)?;
            prop_assert_eq!(bytes.len(), usize::from(register.size));
            prop_assert!((register.read(&bytes)? - si).abs() <= 0.500_001 * unit);
        }
    }
}
