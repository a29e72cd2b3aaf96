//! Properties that all servos of the X series share: most of the control table, operating modes, hardware errors.
//!
//! Source: ROBOTIS e-Manual, the pages of the models in [`crate::models`].

/// Baud rates, bits per second, by the value of the baud rate register. The 330 series stops at 4 Mbaud.
pub const BAUD_RATES: [u32; 8] = [9_600, 57_600, 115_200, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000];

/// Bits of the hardware error status register.
///
/// ```
/// use dynamixel_bus::x_series::hardware_error;
///
/// assert_eq!(hardware_error::describe(0x24), "overheating, overload");
/// ```
pub mod hardware_error {
    /// Input voltage outside its limits.
    pub const VOLTAGE: u8 = 1 << 0;
    /// Too hot.
    pub const OVERHEAT: u8 = 1 << 2;
    /// The encoder does not work.
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

/// Defines a constant for every line, `REGISTERS` with all of them, and `MODEL`.
macro_rules! control_table {
    (
        $number:literal $name:literal $baud_rates:expr;
        $($id:ident: $address:literal $size:literal $register:literal $access:ident $default:expr, ($low:expr, $high:expr) $unit:ident;)*
    ) => {
        $(
            #[doc = concat!($register, ", address ", $address, ", ", $size, " bytes.")]
            pub const $id: $crate::register::Register = $crate::register::Register {
                address: $address,
                size: $size,
                name: $register,
                access: $crate::register::Access::$access,
                default: $default,
                range: ($low, $high),
                unit: $crate::register::Unit::$unit,
            };
        )*
        /// The control table, by address.
        pub const REGISTERS: &[$crate::register::Register] = &[$($id),*];
        /// The model.
        pub const MODEL: $crate::models::Model =
            $crate::models::Model { number: $number, name: $name, registers: REGISTERS, baud_rates: $baud_rates };
    };
}

/// Defines the control table of one model: the registers that all models have, with this model's limits and factory
/// values, and the model's own registers at the places where they belong by address.
macro_rules! x_series {
    (
        model: $number:literal $name:literal,
        baud_rates: $baud_rates:expr,
        protocol_types: $protocols:expr,
        temperature_limit: $temperature:literal,
        voltage_limits: $low_voltage:literal to $high_voltage:literal, least $least_voltage:literal,
        velocity_limit: $velocity:literal, greatest $greatest_velocity:literal,
        shutdown: $shutdown:literal,
        velocity_gains: i $velocity_i:literal p $velocity_p:literal,
        position_gains: d $position_d:literal i $position_i:literal p $position_p:literal,
        limits { $($limits:tt)* }
        setup { $($setup:tt)* }
        goals { $($goals:tt)* }
        present { $($present:tt)* }
        end { $($end:tt)* }
    ) => {
        $crate::x_series::control_table! {
            $number $name $baud_rates;
            MODEL_NUMBER:            0 2 "Model Number"            Read   Some($number), (0, 65_535) Plain;
            MODEL_INFORMATION:       2 4 "Model Information"       Read   None, (0, 4_294_967_295) Plain;
            FIRMWARE_VERSION:        6 1 "Firmware Version"        Read   None, (0, 255) Plain;
            ID:                      7 1 "ID"                      Eeprom Some(1), (0, 252) Plain;
            BAUD_RATE:               8 1 "Baud Rate"               Eeprom Some(1), (0, $baud_rates.len() as i64 - 1) Plain;
            RETURN_DELAY_TIME:       9 1 "Return Delay Time"       Eeprom Some(250), (0, 254) ReturnDelay;
            DRIVE_MODE:             10 1 "Drive Mode"              Eeprom Some(0), (0, 13) Plain;
            OPERATING_MODE:         11 1 "Operating Mode"          Eeprom Some(3), (0, 16) Plain;
            SECONDARY_ID:           12 1 "Secondary ID"            Eeprom Some(255), (0, 255) Plain;
            PROTOCOL_TYPE:          13 1 "Protocol Type"           Eeprom Some(2), ($protocols.0, $protocols.1) Plain;
            HOMING_OFFSET:          20 4 "Homing Offset"           Eeprom Some(0), (-1_044_479, 1_044_479) Angle;
            MOVING_THRESHOLD:       24 4 "Moving Threshold"        Eeprom Some(10), (0, 1023) Velocity;
            TEMPERATURE_LIMIT:      31 1 "Temperature Limit"       Eeprom Some($temperature), (0, 100) Celsius;
            MAX_VOLTAGE_LIMIT:      32 2 "Max Voltage Limit"       Eeprom Some($high_voltage), ($least_voltage, $high_voltage) Voltage;
            MIN_VOLTAGE_LIMIT:      34 2 "Min Voltage Limit"       Eeprom Some($low_voltage), ($least_voltage, $high_voltage) Voltage;
            PWM_LIMIT:              36 2 "PWM Limit"               Eeprom Some(885), (0, 885) DutyCycle;
            $($limits)*
            VELOCITY_LIMIT:         44 4 "Velocity Limit"          Eeprom Some($velocity), (0, $greatest_velocity) Velocity;
            MAX_POSITION_LIMIT:     48 4 "Max Position Limit"      Eeprom Some(4095), (0, 4095) Angle;
            MIN_POSITION_LIMIT:     52 4 "Min Position Limit"      Eeprom Some(0), (0, 4095) Angle;
            $($setup)*
            SHUTDOWN:               63 1 "Shutdown"                Eeprom Some($shutdown), (0, 255) Plain;
            TORQUE_ENABLE:          64 1 "Torque Enable"           Ram    Some(0), (0, 1) Plain;
            LED:                    65 1 "LED"                     Ram    Some(0), (0, 1) Plain;
            STATUS_RETURN_LEVEL:    68 1 "Status Return Level"     Ram    Some(2), (0, 2) Plain;
            REGISTERED_INSTRUCTION: 69 1 "Registered Instruction"  Read   Some(0), (0, 1) Plain;
            HARDWARE_ERROR_STATUS:  70 1 "Hardware Error Status"   Read   Some(0), (0, 255) Plain;
            VELOCITY_I_GAIN:        76 2 "Velocity I Gain"         Ram    Some($velocity_i), (0, 16_383) Plain;
            VELOCITY_P_GAIN:        78 2 "Velocity P Gain"         Ram    Some($velocity_p), (0, 16_383) Plain;
            POSITION_D_GAIN:        80 2 "Position D Gain"         Ram    Some($position_d), (0, 16_383) Plain;
            POSITION_I_GAIN:        82 2 "Position I Gain"         Ram    Some($position_i), (0, 16_383) Plain;
            POSITION_P_GAIN:        84 2 "Position P Gain"         Ram    Some($position_p), (0, 16_383) Plain;
            FEEDFORWARD_2ND_GAIN:   88 2 "Feedforward 2nd Gain"    Ram    Some(0), (0, 16_383) Plain;
            FEEDFORWARD_1ST_GAIN:   90 2 "Feedforward 1st Gain"    Ram    Some(0), (0, 16_383) Plain;
            BUS_WATCHDOG:           98 1 "Bus Watchdog"            Ram    Some(0), (-1, 127) Watchdog;
            GOAL_PWM:              100 2 "Goal PWM"                Ram    None, (-885, 885) DutyCycle;
            $($goals)*
            GOAL_VELOCITY:         104 4 "Goal Velocity"           Ram    None, (-$greatest_velocity, $greatest_velocity) Velocity;
            PROFILE_ACCELERATION:  108 4 "Profile Acceleration"    Ram    Some(0), (0, 32_767) Acceleration;
            PROFILE_VELOCITY:      112 4 "Profile Velocity"        Ram    Some(0), (0, 32_767) Velocity;
            GOAL_POSITION:         116 4 "Goal Position"           Ram    None, (-1_048_575, 1_048_575) Angle;
            REALTIME_TICK:         120 2 "Realtime Tick"           Read   None, (0, 32_767) Millisecond;
            MOVING:                122 1 "Moving"                  Read   Some(0), (0, 1) Plain;
            MOVING_STATUS:         123 1 "Moving Status"           Read   Some(0), (0, 255) Plain;
            PRESENT_PWM:           124 2 "Present PWM"             Read   None, (-32_768, 32_767) DutyCycle;
            $($present)*
            PRESENT_VELOCITY:      128 4 "Present Velocity"        Read   None, (-2_147_483_648, 2_147_483_647) Velocity;
            PRESENT_POSITION:      132 4 "Present Position"        Read   None, (-2_147_483_648, 2_147_483_647) Angle;
            VELOCITY_TRAJECTORY:   136 4 "Velocity Trajectory"     Read   None, (-2_147_483_648, 2_147_483_647) Velocity;
            POSITION_TRAJECTORY:   140 4 "Position Trajectory"     Read   None, (-2_147_483_648, 2_147_483_647) Angle;
            PRESENT_INPUT_VOLTAGE: 144 2 "Present Input Voltage"   Read   None, (0, 65_535) Voltage;
            PRESENT_TEMPERATURE:   146 1 "Present Temperature"     Read   None, (0, 255) Celsius;
            $($end)*
        }
    };
}

pub(crate) use {control_table, x_series};
