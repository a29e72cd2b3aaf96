//! A file with the limits of a robot that has its own driver.
//!
//! ```toml
//! version = 1
//!
//! [limits]                              # each field is optional
//! current = 0.4
//!
//! [limits.space]
//! table = 0.02
//! ```

use std::path::Path;

use hand_model::RobotModel;
use serde::Deserialize;
use toml::{Table, Value};

use super::limits::least_current_limit;
use super::{ConfigError, LimitConfig};
use crate::config::secrets::syntax_message;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LimitsFile {
    version: u32,
    #[serde(default)]
    limits: Table,
}

impl LimitConfig {
    /// Reads a file of limits for a robot of this model with servo cycles at `rate` (Hz). What it does not name is as
    /// in [`LimitConfig::for_robot`].
    pub fn read(path: &Path, robot: &RobotModel, rate: f64) -> Result<Self, ConfigError> {
        let text = std::fs::read_to_string(path).map_err(|source| ConfigError::Io { path: path.to_owned(), source })?;
        Self::parse(&text, path, robot, rate)
    }

    fn parse(text: &str, path: &Path, robot: &RobotModel, rate: f64) -> Result<Self, ConfigError> {
        let syntax = |error: &toml::de::Error| ConfigError::Syntax {
            path: path.to_owned(),
            message: syntax_message(text, error),
        };
        let field = |(field, found, expected)| ConfigError::Field { path: path.to_owned(), field, found, expected };
        let file: LimitsFile = toml::from_str(text).map_err(|error| syntax(&error))?;
        if file.version != 1 {
            return Err(field(("version".to_owned(), file.version.to_string(), "1".to_owned())));
        }
        // Every field has a TOML form.
        let usual = Table::try_from(Self::for_robot(robot)).unwrap_or_default();
        let with = |fields: Table| {
            let mut limits = usual.clone();
            overlay(&mut limits, fields);
            limits.try_into::<Self>()
        };
        let limits = match with(file.limits.clone()) {
            Ok(limits) => limits,
            // The error of all fields together has no place in the text: the first that is wrong alone is named.
            Err(error) => {
                let wrong = leaves(&file.limits).into_iter().find_map(|(path, value)| {
                    let mistaken = with(nested(&path, value.clone())).err()?;
                    // "invalid type: string "x", expected f64"
                    let message = mistaken.message();
                    let expected = message.split_once("expected ").map_or(message, |(_, expected)| expected);
                    Some((format!("limits.{}", path.join(".")), value.to_string(), expected.to_owned()))
                });
                return Err(wrong.map_or_else(|| syntax(&error), field));
            }
        };
        match limits.first_error(&robot.arm.effort_limits, rate, least_current_limit(robot)) {
            Some(error) => Err(field(error)),
            None => Ok(limits),
        }
    }
}

/// Returns the fields of a table and of those in it, each with its path.
fn leaves(table: &Table) -> Vec<(Vec<&str>, &Value)> {
    let mut found = Vec::new();
    for (name, value) in table {
        match value {
            Value::Table(inner) => found.extend(leaves(inner).into_iter().map(|(mut path, value)| {
                path.insert(0, name.as_str());
                (path, value)
            })),
            value => found.push((vec![name.as_str()], value)),
        }
    }
    found
}

/// Returns a table with one field at `path`.
fn nested(path: &[&str], value: Value) -> Table {
    let mut inner = value;
    for name in path.iter().rev() {
        inner = Value::Table(Table::from_iter([((*name).to_owned(), inner)]));
    }
    match inner {
        Value::Table(table) => table,
        _ => Table::new(),
    }
}

/// Replaces values of `table` by those of `other`, table by table.
fn overlay(table: &mut Table, other: Table) {
    for (name, value) in other {
        match (table.get_mut(&name), value) {
            (Some(Value::Table(own)), Value::Table(value)) => overlay(own, value),
            (_, value) => {
                table.insert(name, value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    /// The current of a robot's weakest servo is the most that is asked for, whether there is a file or not.
    #[test]
    fn weak_servos_get_less_current() {
        let mut robot = RobotModel::ftac_gen3();
        assert_eq!(LimitConfig::for_robot(&robot), LimitConfig::default());
        Arc::make_mut(&mut robot.hand).servos[2].current_limit = 0.2;
        let limits = LimitConfig::for_robot(&robot);
        assert_eq!((limits.current, limits.hold_current), (0.2, 0.2));
        let read = LimitConfig::parse("version = 1", Path::new("limits.toml"), &robot, 100.0);
        assert_eq!(read.expect("the same"), limits);
    }

    /// The joints of another arm may have more torque than those of a Gen3.
    #[test]
    fn strong_arms_keep_their_torque() {
        let mut robot = RobotModel::ftac_gen3();
        let arm = Arc::make_mut(&mut robot.arm);
        arm.name = "strong".to_owned();
        arm.effort_limits[0] = 150.0;
        let read =
            LimitConfig::parse("version = 1", Path::new("limits.toml"), &robot, 100.0).expect("its own defaults");
        assert_eq!(read.arm.torque[0], 150.0);
    }

    #[test]
    fn a_value_of_another_kind_is_named() {
        for (text, words) in [
            ("current = \"x\"", "limits.current: found \"x\", expected f64"),
            ("arm = 5", "limits.arm: found 5"),
            ("[limits.space]\ntable = true", "limits.space.table: found true"),
            ("[limits.arm]\njolts = 1.0", "limits.arm.jolts: found 1.0, expected one of `acceleration`"),
        ] {
            let error = parse(&format!("version = 1\n[limits]\n{text}")).expect_err("refused");
            assert!(error.contains(words), "{error}");
        }
    }

    fn parse(text: &str) -> Result<LimitConfig, String> {
        LimitConfig::parse(text, Path::new("limits.toml"), &RobotModel::ftac_gen3(), 100.0)
            .map_err(|error| error.to_string())
    }

    #[test]
    fn fields_that_are_not_named_keep_their_values() {
        let limits = parse("version = 1\n[limits]\ncurrent = 0.3\nhold_current = 0.2\n[limits.space]\ntable = 0.02\n");
        let limits = limits.expect("good");
        let usual = LimitConfig::default();
        assert_eq!((limits.current, limits.space.table, limits.speed), (0.3, 0.02, usual.speed));
        assert_eq!((limits.arm, limits.space.high), (usual.arm, usual.space.high));
    }

    #[test]
    fn errors_name_file_field_found_and_expected() {
        for (text, words) in [
            ("version = 2\n", "limits.toml: version: found 2, expected 1"),
            ("version = 1\n[limits]\ncurrent = 1.5\n", "limits.toml: limits.current: found 1.5, expected 0.01 to 0.91"),
            ("version = 1\n[limits]\ncurent = 0.5\n", "limits.curent: found 0.5, expected one of `speed`, `current`"),
            ("version = 1\n[limits.arm]\ntorque = [1.0]\n", "limits.arm.torque: found 1 numbers, expected 7"),
            ("version = 1\n[limits]\nstaleness = 0.01\n", "limits.staleness: found 0.01, expected 0.02 to 1"),
        ] {
            let error = parse(text).expect_err("refused");
            assert!(error.contains(words), "{error}");
        }
    }
}
