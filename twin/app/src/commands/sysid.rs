//! `ftac sysid`: system identification of a robot instance.

pub mod evaluate;
pub mod excite;
pub mod identify;

use std::path::Path;

use anyhow::{Context as _, Result, bail};
use bench::builtin::{HAND_UNIT, robot_calibration};
use clap::Subcommand;
use dexterous_grasping::{Grasp, Repertoire};
use grasp_verification::simulated_world::SimulatedWorld;
use hand_model::RobotModel;
use hand_model::transmission::friction::CableLosses;
use identification::ExcitationScript;
use identification::evaluation::{Surroundings, TrueBall, TruePayload, excited_robot};
use identification::excitation_setup::ExcitationSetup;
use plant::GelViscoelasticity;
use plant::RobotInstance;
use scenarios::Scenario;
use sim::SimulatedRobot;
use sim::tactile::TactileBoard;
use tactile_perception::PhotometricCalibration;

use crate::terminal::{Outcome, Terminal};

/// `sysid` commands.
#[derive(Debug, Subcommand)]
pub enum SysidCommand {
    /// Excite the robot with motions that reveal its parameters, and record them.
    Excite(excite::ExciteArgs),
    /// Identify the parameters of the recorded robot.
    Identify(identify::IdentifyArgs),
    /// Identify robots with hidden random parameters, and compare the estimates with the truth.
    Evaluate(evaluate::EvaluateArgs),
}

pub fn run(terminal: &Terminal, command: &SysidCommand) -> Outcome {
    match command {
        SysidCommand::Excite(args) => excite::run(terminal, args),
        SysidCommand::Identify(args) => identify::run(terminal, args),
        SysidCommand::Evaluate(args) => evaluate::run(terminal, args),
    }
}

/// Writes the true parameters of instance `number`, for evaluation only.
pub fn write_truth(path: &Path, nominal: &RobotModel, number: u64) -> Result<()> {
    let truth = RobotInstance::sample(nominal, number);
    let text = serde_json::json!({
        "instance": number,
        "cameras": RobotInstance::camera_serial(number),
        "parameters": truth.named_deviations(),
    });
    Ok(ftac_platform::data::write_atomically(path, serde_json::to_string_pretty(&text)?.as_bytes())?)
}

/// The nominal model of the robot, the friction losses of its cables and gears, and the calibration of its pads.
pub struct NominalModel {
    pub robot: RobotModel,
    pub losses: CableLosses,
    pub pads: PhotometricCalibration,
    gel: Option<GelViscoelasticity>,
    repertoire: Repertoire,
}

impl NominalModel {
    /// Builds the nominal model of `robot` with the losses and gel of the benchmark.
    pub fn new(robot: RobotModel) -> Result<Self> {
        let world = SimulatedWorld::new(&robot, Scenario::benchmark())?;
        let (losses, gel) = (world.known_cable_losses(), world.scenario.effects.gel);
        let known = grasp_verification::builtin::fits_robot(&robot)?;
        let repertoire = if known { grasp_verification::builtin::repertoire()? } else { Repertoire::default() };
        let pads = robot_calibration(&robot)?;
        Ok(Self { robot, losses, pads, gel, repertoire })
    }

    /// Reads the excitation script in `file`, or the built-in one.
    ///
    /// # Errors
    /// If the script names something that the hand lacks, or an object without known grasps.
    pub fn script(&self, file: Option<&Path>) -> Result<ExcitationScript> {
        let script = match file {
            None => ExcitationScript::standard(&self.robot)?,
            Some(path) => {
                let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
                ExcitationScript::parse(&text, path, &self.robot)?
            }
        };
        if let Some(weight) = script.payload.as_ref().filter(|_| self.grasps(&script).is_empty()) {
            bail!(
                "{}: weight.object: found `{}`, expected an object of which grasps by {} are known",
                file.unwrap_or(Path::new("excitation.toml")).display(),
                weight.object,
                self.robot.name
            );
        }
        Ok(script)
    }

    /// Returns the inputs of an excitation by `script`.
    pub fn excitation_inputs<'a>(&'a self, script: &'a ExcitationScript) -> ExcitationSetup<'a> {
        let Self { robot, pads, losses, .. } = self;
        let grasps = self.grasps(script);
        ExcitationSetup { robot, pads, script, grasps, friction: losses.friction, ready: robot.arm.home }
    }

    /// Returns the known grasps of the object for a script's payload calibration, best first; empty if it has none.
    pub fn grasps(&self, script: &ExcitationScript) -> &[Grasp] {
        let known = |name: &String| self.repertoire.grasps.get(name).map(Vec::as_slice);
        script.payload.as_ref().and_then(|weight| known(&weight.object)).unwrap_or_default()
    }

    /// Builds the simulated robot of instance `number`, with the surroundings that an excitation by `script` needs;
    /// `seed` draws the noise of its cameras.
    pub fn simulated_robot(&self, number: u64, seed: u64, script: &ExcitationScript) -> Result<SimulatedRobot> {
        let Self { robot, losses, gel, .. } = self;
        let truth = RobotInstance::sample(robot, number);
        let own = truth.apply_to_hand(&robot.hand);
        let board =
            TactileBoard::unit(&own, RobotInstance::camera_serial(number).unwrap_or(HAND_UNIT)).with_noise(seed);
        let ball = script.ball.as_ref().map(|ball| TrueBall::draw(ball, number));
        let weight = script.payload.as_ref().and_then(|weight| TruePayload::draw(weight, number));
        let surroundings = Surroundings { cameras: board, gel: *gel, ball, payload: weight };
        Ok(excited_robot(&truth, robot, *losses, robot.arm.home, &surroundings)?)
    }
}
