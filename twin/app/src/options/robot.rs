//! Options for the robot of a command and for the calibration of its pads.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use bench::builtin::parse_calibration;
use bench::trial::PolicyCapabilities;
use clap::Args;
use hand_model::RobotModel;
use plant::identified::IdentifiedRobot;
use scenarios::record::Condition;

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

/// Returns the text of the file that `--instance` names, validated against the robot `nominal`, and the name to use
/// in errors.
pub fn instance_text(path: Option<&Path>, nominal: &RobotModel) -> Result<(Option<String>, PathBuf)> {
    let text = read_identified_robot(path, nominal)?.map(|(text, _)| text);
    Ok((text, PathBuf::from("--instance")))
}

/// Reads the file that `--instance` names: its text, and the robot that it describes.
fn read_identified_robot(path: Option<&Path>, nominal: &RobotModel) -> Result<Option<(String, IdentifiedRobot)>> {
    let Some(path) = path else { return Ok(None) };
    let text = ftac_platform::data::read_text(path).context("--instance")?;
    let own = IdentifiedRobot::parse(&text, path, nominal).context("--instance")?;
    Ok(Some((text, own)))
}

/// Returns the robot that `--instance` names, an instance of `nominal`; `nominal` itself if it names none.
pub fn instance_model(path: Option<&Path>, nominal: &RobotModel) -> Result<RobotModel> {
    Ok(read_identified_robot(path, nominal)?
        .map_or_else(|| nominal.clone(), |(_, own)| own.instance.apply_to_robot(nominal)))
}

/// Returns the text of the file that `--pads` names, validated as a calibration of every pad of the robot.
pub fn pad_calibration_text(path: Option<&Path>, robot: &RobotModel) -> Result<Option<String>> {
    let Some(path) = path else { return Ok(None) };
    let text = ftac_platform::data::read_text(path).context("--pads")?;
    parse_calibration(&robot.hand, &text, path).context("--pads")?;
    Ok(Some(text))
}

/// Warns that the pads of a hand are treated as nominal if it is `real`, tactile images are used and `pads` gives no
/// calibration of its own.
pub fn warn_nominal_pads(real: bool, conditions: &[Condition], pads: Option<&str>) {
    let sees = |condition: &Condition| {
        PolicyCapabilities::for_condition(*condition).is_some_and(PolicyCapabilities::use_images)
    };
    if real && pads.is_none() && conditions.iter().any(sees) {
        eprintln!(
            "warning: touch uses the calibration of the nominal pads and the scenario's indentation of the gel: this hand's pads have no calibration (--pads)"
        );
    }
}
