//! `bridge.toml`: the devices and the limits of a robot.
//!
//! ```toml
//! version = 1
//! calibration = "calibration.json"      # beside this file
//! stop_socket = "stop"                  # optional: a stop socket in addition to the default one, which any terminal finds
//!
//! [servos]
//! port = "/dev/serial/by-id/usb-FTDI_..."
//! ids = [1, 2, 3, 4, 5, 6]              # thumb, index, middle, ring, little, opposition
//!
//! [cameras]
//! port = "/dev/serial/by-id/usb-..."
//!
//! # or webcams instead (feature `uvc`), one section each; together they show all cameras of the hand
//! [[uvc]]
//! device = "0123456"                    # path, part of a name below /dev/v4l/by-id (serial number), or the card's name
//! size = [640, 480]
//! format = "mjpeg"                      # or "yuyv"
//! squares = [{ camera = 0, x = 0, y = 0 }, { camera = 1, x = 240, y = 0 }]
//!
//! [arm]
//! kind = "kortex"                       # or "loopback": no arm
//! host = "192.168.1.10"
//! user = "ftac"
//! password_file = "arm-password"        # readable by its owner alone; or the variable FTAC_ARM_PASSWORD
//!
//! [limits]                              # optional, as is each of its fields
//! current = 0.6
//! ```

mod limits;
mod limits_file;
pub mod secrets;
mod uvc;

use std::path::{Path, PathBuf};

use dynamixel_bus::servo_bus::BusSettings;
use dynamixel_bus::xc330;
use hand_model::Arm;
use kinova_kortex::arm::{TCP_PORT, UDP_PORT};
use kinova_kortex::joints::JOINTS;
use serde::{Deserialize, Serialize};

use crate::safety::limits::SafetyLimits;
use crate::supported_robot::SERVOS;

pub use limits::{ArmLimitConfig, LimitConfig, WorkspaceConfig};
use secrets::{Password, syntax_message};
pub use uvc::{UvcConfig, UvcFormat, UvcSquare};

/// Range of the rate of the servo cycles, Hz.
pub const RATES: (f64, f64) = (20.0, 500.0);
/// Current limit of the hand's servos, A.
const MAX_CURRENT: f64 = 0.91;

/// Error in a configuration or calibration file.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read or written.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// The file is not well-formed, or has unknown fields.
    #[error("{path}: {message}")]
    Syntax {
        /// The file.
        path: PathBuf,
        /// The parser's message, with the position.
        message: String,
    },
    /// A field has an invalid value.
    #[error("{path}: {field}: found {found}, expected {expected}")]
    Field {
        /// The file.
        path: PathBuf,
        /// Name of the field, such as `servos.ids`.
        field: String,
        /// Value in the file.
        found: String,
        /// Permitted value or range.
        expected: String,
    },
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BridgeConfig {
    /// Version of this format: 1.
    pub version: u32,
    /// Calibration file, relative to this file.
    pub calibration: PathBuf,
    /// Additional socket of the remote stop, accessible only to its owner; relative to this file.
    /// ([`crate::remote::socket_paths`] has the usual one.)
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stop_socket: Option<PathBuf>,
    /// File from which the configuration was read; empty if none.
    #[serde(skip)]
    pub file: PathBuf,
    /// The servo bus.
    pub servos: ServoConfig,
    /// The camera board; `None` with UVC devices, or on a robot without touch.
    pub cameras: Option<CameraConfig>,
    /// UVC devices instead of the camera board.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub uvc: Vec<UvcConfig>,
    pub arm: ArmConfig,
    /// Limits that the supervisor enforces.
    #[serde(default)]
    pub limits: LimitConfig,
}

/// The servo bus.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ServoConfig {
    /// Serial port; a path below `/dev/serial/by-id` survives replugging.
    pub port: PathBuf,
    /// Ids in actuator order: thumb, index, middle, ring, little, opposition.
    pub ids: [u8; SERVOS],
    /// Baud rate, bits per second.
    #[serde(default = "default_baud")]
    pub baud: u32,
    /// Rate of the servo cycle, Hz.
    #[serde(default = "default_rate")]
    pub rate: f64,
    /// True if the servos are read by fast sync reads (firmware 46 and later).
    #[serde(default)]
    pub fast_sync_read: bool,
    /// Time-out of an answer beyond its time on the line, s.
    #[serde(default = "default_slack")]
    pub slack: f64,
}

fn default_baud() -> u32 {
    BusSettings::default().baud
}

fn default_rate() -> f64 {
    200.0
}

fn default_slack() -> f64 {
    BusSettings::default().slack
}

/// The camera board.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraConfig {
    /// Serial port.
    pub port: PathBuf,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum ArmConfig {
    /// No arm: set-points come back as measurements.
    Loopback {},
    /// A Kinova Gen3.
    Kortex {
        /// Host name or IP address.
        host: String,
        /// TCP port for calls.
        #[serde(default = "default_tcp")]
        tcp_port: u16,
        /// UDP port for the cyclic exchange.
        #[serde(default = "default_udp")]
        udp_port: u16,
        /// User name on the arm.
        user: String,
        /// Password; this file must then be readable only by its owner.
        #[serde(default, skip_serializing)]
        password: Option<Password>,
        /// File that holds only the password, relative to this file.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        password_file: Option<PathBuf>,
    },
}

fn default_tcp() -> u16 {
    TCP_PORT
}

fn default_udp() -> u16 {
    UDP_PORT
}

impl BridgeConfig {
    /// Reads and checks a configuration; relative paths in it become relative to its folder.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let mut config = Self::read_without_password(path)?;
        config.find_password(path)?;
        Ok(config)
    }

    /// Like [`Self::read`], but without the arm's password, for callers that do not use the arm.
    pub fn read_without_password(path: &Path) -> Result<Self, ConfigError> {
        let text = std::fs::read_to_string(path).map_err(|source| ConfigError::Io { path: path.to_owned(), source })?;
        Self::parse(&text, path)
    }

    /// Reads and checks a configuration's text; `path` is used in errors and for relative paths.
    pub fn parse(text: &str, path: &Path) -> Result<Self, ConfigError> {
        let mut config: Self = toml::from_str(text)
            .map_err(|error| ConfigError::Syntax { path: path.to_owned(), message: syntax_message(text, &error) })?;
        config.check(path)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        config.calibration = folder.join(&config.calibration);
        config.stop_socket = config.stop_socket.map(|socket| folder.join(socket));
        config.file = path.to_owned();
        Ok(config)
    }

    /// Returns the configuration as TOML text.
    pub fn to_toml(&self) -> String {
        // Every field has a TOML form.
        toml::to_string(self).unwrap_or_default()
    }

    /// Returns the settings of the servo bus.
    pub fn bus(&self) -> BusSettings {
        BusSettings { baud: self.servos.baud, return_delay: 0.0, slack: self.servos.slack }
    }

    /// Returns the supervisor's limits, with the servos' travel (rad) from the calibration.
    pub fn limits(&self, travel: &[f64], arm: &Arm) -> SafetyLimits {
        self.limits.limits(travel, arm)
    }

    fn check(&self, path: &Path) -> Result<(), ConfigError> {
        let field = |name: &str, found: String, expected: String| {
            Err(ConfigError::Field { path: path.to_owned(), field: name.to_owned(), found, expected })
        };
        if self.version != 1 {
            return field("version", self.version.to_string(), "1".into());
        }
        let ids = &self.servos.ids;
        let twice = ids.iter().enumerate().any(|(n, id)| ids[..n].contains(id));
        if twice || ids.iter().any(|id| *id > 252) {
            return field("servos.ids", format!("{ids:?}"), "six different ids from 0 to 252".into());
        }
        if !xc330::BAUD_RATES.contains(&self.servos.baud) {
            return field("servos.baud", self.servos.baud.to_string(), format!("one of {:?}", xc330::BAUD_RATES));
        }
        if self.cameras.is_some() && !self.uvc.is_empty() {
            return field("uvc", format!("{} devices and [cameras]", self.uvc.len()), "one or the other".into());
        }
        if let Some((name, found, expected)) = uvc::find_square_error(&self.uvc) {
            return field(&name, found, expected);
        }
        let (rate, slack) = (self.servos.rate, self.servos.slack);
        for (name, value, (low, high)) in [("servos.rate", rate, RATES), ("servos.slack", slack, (0.001, 1.0))] {
            if !(low..=high).contains(&value) {
                return field(name, value.to_string(), format!("{low} to {high}"));
            }
        }
        if let Some((name, found, expected)) = self.limits.first_error(&[0.0; JOINTS], rate, MAX_CURRENT) {
            return field(&name, found, expected);
        }
        Ok(())
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) const GOOD: &str = r#"
        version = 1
        calibration = "calibration.json"
        stop_socket = "stop"
        [servos]
        port = "/dev/ttyUSB0"
        ids = [1, 2, 3, 4, 5, 6]
        [arm]
        kind = "loopback"
        [limits]
        current = 0.5
    "#;

    fn error(from: &str, to: &str) -> String {
        assert!(GOOD.contains(from));
        BridgeConfig::parse(&GOOD.replace(from, to), Path::new("x/bridge.toml")).expect_err("bad").to_string()
    }

    #[test]
    fn defaults_and_paths() {
        let config = BridgeConfig::parse(GOOD, Path::new("x/bridge.toml")).expect("good");
        assert_eq!((config.servos.baud, config.servos.rate, config.limits.current), (3_000_000, 200.0, 0.5));
        assert_eq!(config.calibration, Path::new("x/calibration.json"));
        let again = BridgeConfig::parse(&config.to_toml(), Path::new("bridge.toml")).expect("its own words");
        let again = BridgeConfig { file: config.file.clone(), ..again };
        assert_eq!(again, config);
    }

    #[test]
    fn errors_name_file_field_found_and_expected() {
        assert_eq!(error("version = 1", "version = 3"), "x/bridge.toml: version: found 3, expected 1");
        assert_eq!(
            error("[1, 2, 3, 4, 5, 6]", "[1, 2, 3, 4, 5, 5]"),
            "x/bridge.toml: servos.ids: found [1, 2, 3, 4, 5, 5], expected six different ids from 0 to 252"
        );
        assert_eq!(error("0.5", "1.5"), "x/bridge.toml: limits.current: found 1.5, expected 0.01 to 0.91");
        assert!(error("0.5", "nan").contains("limits.current: found NaN"));
        assert!(error("loopback", "ur5").contains("ur5"));
        let unknown = error("current", "curent");
        assert!(unknown.contains("x/bridge.toml") && unknown.contains("curent"), "{unknown}");
    }

    /// Joints that turn freely stay free; the others have their limits.
    #[test]
    fn arm_limits_are_the_models() {
        let config = BridgeConfig::parse(GOOD, Path::new("bridge.toml")).expect("good");
        let arm = Arm::gen3();
        let limits = config.limits(&[4.0; SERVOS], &arm);
        assert_eq!(limits.arm.speed, arm.velocity_limits);
        assert!(limits.arm.angle.iter().all(|(low, high)| low < high), "{:?}", limits.arm.angle);
    }
}
