//! Options for a robot behind a driver of its owner.

use std::path::Path;

use anyhow::{Result, bail};
use bench::trial::PolicyCapabilities;
use clap::Args;
use hand_model::RobotModel;
use python_process::{PythonClass, Role};
use robot_backends::driver::{DrivenRobot, RobotDriver};
use scenarios::record::Condition;

use crate::options::backend::RobotOption;

/// Options for the driver of `--robot FILE.py:CLASS`.
#[derive(Debug, Clone, Default, Args)]
pub struct DriverArgs {
    /// Argument for the constructor of the robot's class, for --robot FILE.py:CLASS (repeatable). A value that parses as
    /// JSON is passed as such (0.5, true, [1, 2]), any other as text.
    #[arg(long, value_name = "KEY=VALUE")]
    pub robot_arg: Vec<String>,
    /// Time limit for each answer of the robot's class, s; default: 1, or 60 if it runs in lock-step. If it is exceeded,
    /// the trial stops and the process of the class is killed.
    #[arg(long, value_name = "SECONDS", value_parser = clap::value_parser!(u32).range(1..=86_400))]
    pub robot_timeout: Option<u32>,
}

impl DriverArgs {
    /// Starts the driver that `robot` names, if it names one, for a robot of this `model` with the limits of the file
    /// `config`. Checks that it has everything that the `conditions` need.
    pub fn introduce(
        &self,
        robot: &RobotOption,
        model: &RobotModel,
        config: Option<&Path>,
        conditions: &[Condition],
    ) -> Result<Option<DrivenRobot>> {
        let RobotOption::Driver(text) = robot else {
            let option = if self.robot_arg.is_empty() { "--robot-timeout" } else { "--robot-arg" };
            if !self.robot_arg.is_empty() || self.robot_timeout.is_some() {
                bail!("{option}: found --robot {}, expected --robot FILE.py:CLASS", robot.name());
            }
            return Ok(None);
        };
        let class = PythonClass::parse(Role::Robot, text, &self.robot_arg)?;
        let driven = DrivenRobot::introduce(class, self.robot_timeout, model, config)?;
        check_cameras(&driven, conditions)?;
        Ok(Some(driven))
    }
}

/// Starts the driver of a run that is resumed, which the command line must name again: the folder may be of unknown
/// origin, and its files must not choose the program that runs.
pub fn introduce_again(
    kept: &RobotDriver,
    named: Option<&RobotOption>,
    (model, config): (&RobotModel, Option<&Path>),
    (folder, conditions): (&Path, &[Condition]),
) -> Result<DrivenRobot> {
    let expected = kept.class.name();
    if !matches!(named, Some(RobotOption::Driver(named)) if *named == expected) {
        bail!(
            "--resume {}: found {}, expected --robot {expected}, which the run was begun with: a folder does not choose what runs",
            folder.display(),
            named.map_or("no --robot".to_owned(), |found| format!("--robot {found}"))
        );
    }
    kept.class.check(Role::Robot)?;
    let driven = DrivenRobot::introduce(kept.class.clone(), Some(kept.timeout), model, config)?;
    check_cameras(&driven, conditions)?;
    Ok(driven)
}

/// Checks that the robot has cameras if a condition uses tactile images.
fn check_cameras(driven: &DrivenRobot, conditions: &[Condition]) -> Result<()> {
    let sees = |condition: &&Condition| {
        PolicyCapabilities::for_condition(**condition).is_some_and(PolicyCapabilities::use_images)
    };
    match conditions.iter().find(sees) {
        Some(condition) if driven.description.cameras.is_empty() => bail!(
            "--robot {}: describe: cameras: found none, expected those of the hand for the condition {condition}; blind and reflex need none",
            driven.driver.class.name()
        ),
        _ => Ok(()),
    }
}
