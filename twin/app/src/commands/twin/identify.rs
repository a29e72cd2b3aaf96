//! `ftac twin identify`: from sessions of an excitation to `individual.toml` and a page about it.

use std::path::PathBuf;

use anyhow::{Result, bail};
use clap::Args;
use identification::identify::own_pads;
use identification::{Identification, Trace, identify};
use plant::identified::Source;
use report::identified::{ActuatorRow, ParameterRow};
use schemars::JsonSchema;
use serde::Serialize;
use touch::ball_press::OwnCalibrationReport;
use touch::{PhotometricCalibration, TouchError};

use super::Drawing;
use crate::commands::sessions::sessions_in;
use crate::options::robot::RobotArgs;
use crate::terminal::{Outcome, Terminal};

/// A servo that the twin leaves unexplained by more than this (rad, root mean square) is not the drawing's.
const MOST_RESIDUAL: f64 = 0.0175;

/// Arguments of `twin identify`.
#[derive(Debug, Args)]
pub struct IdentifyArgs {
    #[command(flatten)]
    pub model: RobotArgs,
    /// Sessions of `ftac twin excite`, or its folders.
    #[arg(required = true)]
    pub sessions: Vec<PathBuf>,
    /// Where the parameters go.
    #[arg(long, default_value = "individual.toml")]
    pub out: PathBuf,
    /// Where the pads' own photometric calibration goes, if the sessions press pads on a ball; default: beside --out, with the ending pads.json.
    #[arg(long)]
    pub pads: Option<PathBuf>,
    /// Where the page goes; default: beside --out, with the ending html.
    #[arg(long)]
    pub report: Option<PathBuf>,
}

/// Printed once the parameters are found.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Identified<'a> {
    /// Touches of the ball that push every link onto its stop.
    touches: usize,
    /// Their distance from one ball, root mean square, m: as drawn, identified; null without touches.
    touches_rms_m: Option<[f64; 2]>,
    /// Postures in which a weighed object was in the hand.
    weighed_postures: usize,
    /// Difference of the arm's torques from its weight, root mean square, N m: as drawn, identified; null where nothing was weighed.
    weight_rms_nm: Option<[f64; 2]>,
    /// File with the pads' own calibration; null where there is none.
    pads: Option<String>,
    /// File with the parameters.
    individual: String,
    /// Page about them.
    page: String,
    /// Sessions that they were identified from.
    sessions: &'a [Source],
    /// One entry an actuator.
    actuators: &'a [ActuatorRow],
    /// Every parameter.
    parameters: &'a [ParameterRow],
}

pub fn run(terminal: &Terminal, args: &IdentifyArgs) -> Outcome {
    let drawing = Drawing::new(args.model.model()?)?;
    let mut traces = Vec::new();
    for path in files(&args.sessions)? {
        let trace = Trace::read(&path, &drawing.robot)?;
        if !trace.whole {
            eprintln!("{}: the file is cut short; {:.0} s of it are used", path.display(), trace.source.seconds);
        }
        traces.push(trace);
    }
    let found = identify(&drawing.robot, drawing.losses, &drawing.pads, &traces)?;
    let program = format!("ftac {}", env!("CARGO_PKG_VERSION"));
    let text = found.robot.to_toml(&drawing.robot, &program)?;
    platform::data::write_whole(&args.out, text.as_bytes())?;
    let page = args.report.clone().unwrap_or_else(|| args.out.with_extension("html"));
    let (actuators, parameters) = rows(&drawing, &found);
    platform::data::write_whole(
        &page,
        report::identified::page(&actuators, &parameters, &found.robot.sessions).as_bytes(),
    )?;
    let (pads, told) = keep_pads(args, own_pads(&drawing.robot.hand, &drawing.pads, &traces))?;
    let kinematics = &found.kinematics;
    let identified = Identified {
        touches: kinematics.touches,
        touches_rms_m: (kinematics.touches > 0).then_some(kinematics.residuals),
        weighed_postures: found.gains.postures,
        weight_rms_nm: (found.gains.postures > 0).then_some(found.gains.residuals),
        pads: pads.map(|path| path.display().to_string()),
        individual: args.out.display().to_string(),
        page: page.display().to_string(),
        sessions: &found.robot.sessions,
        actuators: &actuators,
        parameters: &parameters,
    };
    let mut words = report::identified::text(&actuators, &parameters);
    if kinematics.touches > 0 {
        let [drawn, identified] = kinematics.residuals.map(|residual| 1e3 * residual);
        words += &format!(
            "\n{} touches stay {identified:.2} mm from one ball (root mean square), {drawn:.2} mm as drawn\n",
            kinematics.touches
        );
    }
    let gains = &found.gains;
    if gains.postures > 0 {
        let [drawn, identified] = gains.residuals.map(|residual| 1e3 * residual);
        words += &format!(
            "\n{} postures with the weighed object: the arm's torques are {identified:.1} mN m off its weight (root mean square), {drawn:.1} mN m as drawn\n",
            gains.postures
        );
    }
    words += &told;
    words += &format!("{} and {} written\n", args.out.display(), page.display());
    terminal.print(&identified, &words)?;
    let off: Vec<String> = actuators
        .iter()
        .filter(|row| row.residual_after > MOST_RESIDUAL)
        .map(|row| format!("{} by {:.1} deg", row.actuator, row.residual_after.to_degrees()))
        .collect();
    Ok((!off.is_empty()).then(|| format!("the twin does not move as the sessions show: {}", off.join(", "))))
}

/// A calibration of the pads' own, or why there is none.
type OwnPads = Result<(PhotometricCalibration, OwnCalibrationReport), TouchError>;

/// Writes the pads' own calibration where there is one: its file, and what is to be said.
fn keep_pads(args: &IdentifyArgs, found: Option<OwnPads>) -> Result<(Option<PathBuf>, String)> {
    Ok(match found {
        None => (None, String::new()),
        Some(Err(error)) => (None, format!("no calibration of the pads' own: {error}\n")),
        Some(Ok((calibration, told))) => {
            let path = args.pads.clone().unwrap_or_else(|| args.out.with_extension("pads.json"));
            calibration.write(&path)?;
            let words = format!(
                "{}: the pads' own calibration, of {} images; normals of held-out ones err by {:.2} deg, {:.2} with the designed pads'\n",
                path.display(),
                told.located,
                told.after.mean,
                told.before.mean
            );
            (Some(path), words)
        }
    })
}

/// The sessions that were named, those of folders in their order.
fn files(named: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for path in named {
        if !path.is_dir() {
            files.push(path.clone());
            continue;
        }
        let mut own = sessions_in(path)?;
        if own.is_empty() {
            bail!("{}: sessions: found none, expected part_1.mcap of `ftac twin excite`", path.display());
        }
        files.append(&mut own);
    }
    Ok(files)
}

/// What was found, as pages and terminals show it.
fn rows(drawing: &Drawing, found: &Identification) -> (Vec<ActuatorRow>, Vec<ParameterRow>) {
    let names = drawing.robot.hand.parameters.actuator.iter().map(|actuator| actuator.name.clone());
    let actuators = names
        .zip(&found.fits)
        .map(|(actuator, fit)| ActuatorRow {
            actuator,
            motions: fit.motions,
            samples: fit.samples,
            residual_before: fit.residuals[0],
            residual_after: fit.residuals[1],
            alike: fit.correlated,
            delay: fit.delay,
        })
        .collect();
    let individual = &found.robot.individual;
    let parameters = individual
        .parameters()
        .iter()
        .zip(&found.robot.estimates)
        .map(|(parameter, estimate)| ParameterRow {
            parameter: estimate.name.clone(),
            unit: parameter.quantity.unit().to_owned(),
            deviation: estimate.deviation,
            sigma: estimate.sigma,
            spread: parameter.spread.sigma,
            identified: estimate.identified,
        })
        .collect();
    (actuators, parameters)
}
