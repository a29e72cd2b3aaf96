//! The robot of a run.

use std::path::Path;

use anyhow::Result;
use hand_model::{RobotModel, RobotSources};
use plant::identified::IdentifiedRobot;

/// The robot made of `sources`, or the built-in one without; the individual of it that the text of an `individual.toml` describes, if there
/// is one. `path` is used in errors of that text.
pub fn robot_of(sources: Option<&RobotSources>, individual: Option<&str>, path: &Path) -> Result<RobotModel> {
    let nominal = RobotModel::of(sources)?;
    let Some(text) = individual else { return Ok(nominal) };
    Ok(IdentifiedRobot::parse(text, path, &nominal)?.individual.robot(&nominal))
}
