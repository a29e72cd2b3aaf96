//! Which robot a command is about, and whose pads it feels with.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use bench::builtin::{parse_pads, robot_of};
use bench::trial::Means;
use clap::Args;
use hand_model::{RobotModel, RobotSources};
use plant::identified::IdentifiedRobot;
use platform::reach::Reach;
use scenarios::record::Condition;

use super::body::Body;

/// Which robot it is.
#[derive(Debug, Clone, Default, Args)]
pub struct RobotArgs {
    /// The robot: a file with its arm, hand and pads; default: the F-TAC Hand on a Gen3.
    #[arg(long, value_name = "FILE")]
    pub robot_model: Option<PathBuf>,
}

impl RobotArgs {
    /// The robot's files, once they are known to be good; none for the built-in robot.
    pub fn sources(&self) -> Result<Option<RobotSources>> {
        let Some(path) = &self.robot_model else { return Ok(None) };
        let sources = RobotSources::read(path, Reach::Anywhere).context("--robot-model")?;
        RobotModel::parse(&sources, path).context("--robot-model")?;
        Ok(Some(sources))
    }

    /// The robot.
    pub fn model(&self) -> Result<RobotModel> {
        Ok(RobotModel::of(self.sources()?.as_ref())?)
    }
}

/// The text of the file that `--individual` names, once it is known to be good of the robot `nominal`, and the name for errors.
pub fn individual(path: Option<&Path>, nominal: &RobotModel) -> Result<(Option<String>, PathBuf)> {
    let named = PathBuf::from("--individual");
    let Some(path) = path else { return Ok((None, named)) };
    let text = platform::data::read_text(path).context("--individual")?;
    IdentifiedRobot::parse(&text, path, &nominal.hand).context("--individual")?;
    Ok((Some(text), named))
}

/// The robot that `--individual` names, one of those built like `nominal`; `nominal` itself where it names none.
pub fn individual_of(path: Option<&Path>, nominal: &RobotModel) -> Result<RobotModel> {
    let (text, _) = individual(path, nominal)?;
    robot_of(nominal.sources.as_ref(), text.as_deref(), path.unwrap_or(Path::new("")))
}

/// The text of the file that `--pads` names, once it is known to be a calibration of every pad of the robot.
pub fn pads(path: Option<&Path>, robot: &RobotModel) -> Result<Option<String>> {
    let Some(path) = path else { return Ok(None) };
    let text = platform::data::read_text(path).context("--pads")?;
    parse_pads(&robot.hand, &text, path).context("--pads")?;
    Ok(Some(text))
}

/// Says that a real hand is felt with as if its pads were those of the drawing, where images are looked at and no `pads` are its own.
pub fn say_whose_pads(robot: Body, conditions: &[Condition], pads: Option<&str>) {
    let sees = |condition: &Condition| Means::of(*condition).is_some_and(Means::see_images);
    if robot == Body::Hardware && pads.is_none() && conditions.iter().any(sees) {
        eprintln!(
            "warning: touch uses the designed pads' calibration, and takes objects to sink in as its scenario says: this hand's own pads have none (--pads)"
        );
    }
}
