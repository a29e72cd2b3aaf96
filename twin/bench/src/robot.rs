//! The robot of a run.

use std::path::Path;

use anyhow::Result;
use hand_model::{RobotModel, RobotSources};
use plant::identified::IdentifiedRobot;

/// Returns the robot of `sources`, or the built-in one without them; with the text of an `instance.toml`, the instance
/// that it describes. `path` is used in errors about that text.
pub fn robot_from_sources(sources: Option<&RobotSources>, individual: Option<&str>, path: &Path) -> Result<RobotModel> {
    let nominal = RobotModel::from_sources(sources)?;
    let Some(text) = individual else { return Ok(nominal) };
    Ok(IdentifiedRobot::parse(text, path, &nominal)?.instance.apply_to_robot(&nominal))
}
