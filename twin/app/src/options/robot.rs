//! Options for the robot of a command and for the calibration of its pads.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use bench::builtin::parse_pads;
use bench::trial::Means;
use clap::Args;
use hand_model::RobotModel;
use plant::identified::IdentifiedRobot;
use scenarios::record::Condition;

use crate::options::body::Body;

/// Option for the robot.
#[derive(Debug, Clone, Default, Args)]
pub struct RobotArgs {
    /// Robot file (arm, hand and pads); default: the F-TAC Hand on a Gen3.
    #[arg(long, value_name = "FILE")]
    pub robot_model: Option<PathBuf>,
}

impl RobotArgs {
    /// Reads the robot.
    pub fn model(&self) -> Result<RobotModel> {
        let Some(path) = &self.robot_model else { return Ok(RobotModel::ftac_gen3()) };
        RobotModel::read(path).context("--robot-model")
    }
}

/// Returns the text of the file that `--individual` names, validated against the robot `nominal`, and the name to use
/// in errors.
pub fn individual(path: Option<&Path>, nominal: &RobotModel) -> Result<(Option<String>, PathBuf)> {
    let text = identified(path, nominal)?.map(|(text, _)| text);
    Ok((text, PathBuf::from("--individual")))
}

/// Reads the file that `--individual` names: its text, and the robot that it describes.
fn identified(path: Option<&Path>, nominal: &RobotModel) -> Result<Option<(String, IdentifiedRobot)>> {
    let Some(path) = path else { return Ok(None) };
    let text = ftac_platform::data::read_text(path).context("--individual")?;
    let own = IdentifiedRobot::parse(&text, path, nominal).context("--individual")?;
    Ok(Some((text, own)))
}

/// Returns the robot that `--individual` names, an individual of `nominal`; `nominal` itself if it names none.
pub fn individual_of(path: Option<&Path>, nominal: &RobotModel) -> Result<RobotModel> {
    Ok(identified(path, nominal)?.map_or_else(|| nominal.clone(), |(_, own)| own.individual.robot(nominal)))
}

/// Returns the text of the file that `--pads` names, validated as a calibration of every pad of the robot.
pub fn pads(path: Option<&Path>, robot: &RobotModel) -> Result<Option<String>> {
    let Some(path) = path else { return Ok(None) };
    let text = ftac_platform::data::read_text(path).context("--pads")?;
    parse_pads(&robot.hand, &text, path).context("--pads")?;
    Ok(Some(text))
}

/// Warns that the pads of a real hand are treated as nominal, if tactile images are used and `pads` gives no
/// calibration of its own.
pub fn say_whose_pads(robot: Body, conditions: &[Condition], pads: Option<&str>) {
    let sees = |condition: &Condition| Means::of(*condition).is_some_and(Means::see_images);
    if robot == Body::Hardware && pads.is_none() && conditions.iter().any(sees) {
        eprintln!(
            "warning: touch uses the designed pads' calibration, and takes objects to sink in as its scenario says: this hand's own pads have none (--pads)"
        );
    }
}
