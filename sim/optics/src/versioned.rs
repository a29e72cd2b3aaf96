//! TOML files with a version number. The version is checked before anything else, so that a file of another version is
//! reported as such, and not by the first field that differs.

use serde::Deserialize;
use serde::de::DeserializeOwned;

use crate::error::OpticsError;

#[derive(Deserialize)]
struct Version {
    version: Option<u32>,
}

/// Parses a file's text, which must have the version `expected`.
pub(crate) fn parse<T: DeserializeOwned>(text: &str, expected: u32) -> Result<T, OpticsError> {
    let Version { version } = toml::from_str(text).map_err(OpticsError::calibration)?;
    if version != Some(expected) {
        let found = version.map_or_else(|| "none".to_owned(), |found| found.to_string());
        return Err(OpticsError::calibration(format!("version: found {found}; expected {expected}")));
    }
    toml::from_str(text).map_err(OpticsError::calibration)
}
