//! The calibration of one hand's servos: the open mark and the travel of each.
//!
//! Homing offsets are stored twice, in the servos' EEPROM and in this file. They serve as serial numbers, which the
//! XC330 lacks: a servo that was replaced or remounted has another offset and is refused. The file carries a CRC of its
//! content, so that manual edits are refused as well.

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::config::ConfigError;
use crate::supported_robot::SERVOS;
use crate::tactile_link::frame::digest;

/// Version of this format.
const VERSION: u32 = 1;
/// Maximum distance of a shaft before the open mark that is assumed at power-up, as a share of a turn.
const OPEN_MARK_MARGIN: f64 = 0.2;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ServoCalibration {
    /// Id on the bus.
    pub id: u8,
    /// Model number.
    pub model: u16,
    /// Firmware version.
    pub firmware: u8,
    /// Homing offset written to the servo, encoder counts: with it the open mark reads 0.
    pub homing_offset: i32,
    /// Angle from the open mark to the closed stop, rad.
    pub travel: f64,
}

/// The calibration of all six servos.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HandCalibration {
    version: u32,
    /// Name of the calibrated hand model.
    pub hand: String,
    /// The servos, in actuator order.
    pub servos: [ServoCalibration; SERVOS],
    /// CRC-32C of the rest, in hexadecimal.
    crc: String,
}

impl HandCalibration {
    pub fn new(hand: &str, servos: [ServoCalibration; SERVOS]) -> Self {
        let mut calibration = Self { version: VERSION, hand: hand.to_owned(), servos, crc: String::new() };
        calibration.crc = calibration.hash();
        calibration
    }

    /// Returns the CRC of all other fields. Recordings store it.
    pub fn hash(&self) -> String {
        let bare = Self { crc: String::new(), ..self.clone() };
        // Numbers and strings always have a JSON form.
        let text = serde_json::to_string(&bare).unwrap_or_default();
        format!("{:08x}", digest(text.as_bytes()))
    }

    /// Returns the travel of every servo, rad.
    pub fn travel(&self) -> [f64; SERVOS] {
        std::array::from_fn(|n| self.servos[n].travel)
    }

    /// Reads a file and checks version, CRC and travel.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let text = std::fs::read_to_string(path).map_err(|source| ConfigError::Io { path: path.to_owned(), source })?;
        let calibration: Self = serde_json::from_str(&text)
            .map_err(|error| ConfigError::Syntax { path: path.to_owned(), message: error.to_string() })?;
        let field = |name: &str, found: String, expected: String| {
            Err(ConfigError::Field { path: path.to_owned(), field: name.to_owned(), found, expected })
        };
        if calibration.version != VERSION {
            return field("version", calibration.version.to_string(), VERSION.to_string());
        }
        if calibration.crc != calibration.hash() {
            let expected = format!("{}; the file was edited: calibrate again", calibration.hash());
            return field("crc", calibration.crc, expected);
        }
        for (n, servo) in calibration.servos.iter().enumerate() {
            if !(0.5..(1.0 - OPEN_MARK_MARGIN) * TAU).contains(&servo.travel) {
                return field(&format!("servos[{n}].travel"), servo.travel.to_string(), "0.5 to 5.03 rad".into());
            }
        }
        Ok(calibration)
    }

    pub fn write(&self, path: &Path) -> Result<(), ConfigError> {
        let text = serde_json::to_string_pretty(self).unwrap_or_default();
        write(path, &(text + "\n"))
    }
}

/// Results of a calibration that failed, kept beside the calibration file.
pub struct PartialCalibration(PathBuf);

impl PartialCalibration {
    /// Returns the unfinished calibration beside the calibration file at `path`.
    pub fn beside(path: &Path) -> Self {
        let mut name = path.as_os_str().to_owned();
        name.push(".part");
        Self(name.into())
    }

    pub fn path(&self) -> &Path {
        &self.0
    }

    /// Reads the servos found, in the order of `ids`; others than these are refused.
    pub fn read(&self, ids: &[u8; SERVOS]) -> Result<Vec<ServoCalibration>, ConfigError> {
        let path = &self.0;
        let text = std::fs::read_to_string(path).map_err(|source| ConfigError::Io { path: path.clone(), source })?;
        let servos: Vec<ServoCalibration> = serde_json::from_str(&text)
            .map_err(|error| ConfigError::Syntax { path: path.clone(), message: error.to_string() })?;
        let known: Vec<u8> = servos.iter().map(|servo| servo.id).collect();
        if !ids.starts_with(&known) {
            return Err(ConfigError::Field {
                path: path.clone(),
                field: "id".into(),
                found: format!("{known:?}"),
                expected: format!("the first of {ids:?}"),
            });
        }
        Ok(servos)
    }

    pub fn write(&self, servos: &[ServoCalibration]) -> Result<(), ConfigError> {
        write(&self.0, &(serde_json::to_string_pretty(servos).unwrap_or_default() + "\n"))
    }

    /// Removes it, if it is there.
    pub fn remove(&self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

fn write(path: &Path, text: &str) -> Result<(), ConfigError> {
    ftac_platform::file::write_atomically(path, text.as_bytes())
        .map_err(|source| ConfigError::Io { path: path.to_owned(), source })
}

/// Returns the whole turns (rad) to subtract from a servo's readings to get angles from the open mark. After power-up a
/// servo knows its angle only within one turn; `reading` (rad) is its present one.
pub fn turn_offset(reading: f64) -> f64 {
    ((reading + OPEN_MARK_MARGIN * TAU) / TAU).floor() * TAU
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn calibration() -> HandCalibration {
        let servo = |id| ServoCalibration { id, model: 1220, firmware: 46, homing_offset: -700, travel: 4.0 };
        HandCalibration::new("ftac", std::array::from_fn(|n| servo(n as u8 + 1)))
    }

    #[test]
    fn file_round_trip_and_refusals() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("calibration.json");
        calibration().write(&path).expect("written");
        assert_eq!(HandCalibration::read(&path).expect("its own words"), calibration());
        let text = std::fs::read_to_string(&path).expect("text");
        std::fs::write(&path, text.replacen("-700", "-701", 1)).expect("written");
        let message = HandCalibration::read(&path).expect_err("changed").to_string();
        assert!(message.contains("calibration.json: crc: found"), "{message}");
        std::fs::write(&path, "{").expect("written");
        assert!(matches!(HandCalibration::read(&path), Err(ConfigError::Syntax { .. })));
    }

    proptest! {
        /// The angle from the open mark is recovered whatever turn the servo woke up in.
        #[test]
        fn turns(angle in -1.2..5.0_f64, turns in -3..3_i32) {
            let reading = angle + f64::from(turns) * TAU;
            prop_assert!((reading - turn_offset(reading) - angle).abs() < 1e-9);
        }
    }
}
