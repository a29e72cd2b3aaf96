//! `ftac sysid identify`: identifies parameters from sessions of an excitation; writes `instance.toml` and a page about
//! it.

use std::path::PathBuf;

use anyhow::{Result, bail};
use clap::Args;
use identification::identify::calibrate_pads;
use identification::{Identification, Trace, identify};
use plant::identified::SessionSource;
use report::identified::{ActuatorRow, ParameterRow};
use schemars::JsonSchema;
use serde::Serialize;
use tactile_perception::ball_press::SelfCalibrationReport;
use tactile_perception::{PhotometricCalibration, TouchError};

use super::NominalModel;
use crate::commands::sessions::sessions_in;
use crate::options::robot::RobotArgs;
use crate::terminal::{Outcome, Terminal};

/// Threshold for the RMS residual of a servo angle, rad: above it, the model does not fit the servo.
const MAX_RESIDUAL: f64 = 0.0175;

/// Arguments of `sysid identify`.
#[derive(Debug, Args)]
pub struct IdentifyArgs {
    #[command(flatten)]
    pub model: RobotArgs,
    /// Sessions of `ftac sysid excite`, or folders of them.
    #[arg(required = true)]
    pub sessions: Vec<PathBuf>,
    /// File for the parameters.
    #[arg(long, default_value = "instance.toml")]
    pub out: PathBuf,
    /// File for the photometric calibration of the robot's own pads, if the sessions press pads on a ball; default:
    /// beside --out, with the ending pads.json.
    #[arg(long)]
    pub pads: Option<PathBuf>,
    /// File for the page; default: beside --out, with the ending html.
    #[arg(long)]
    pub report: Option<PathBuf>,
}

/// JSON output of `sysid identify`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct IdentifyOutput<'a> {
    /// Number of touches of the ball that push every link onto its stop.
    touches: usize,
    /// RMS distance of the touches from one ball, m: nominal, identified; null without touches.
    touches_rms_m: Option<[f64; 2]>,
    /// Number of postures with the payload in the hand.
    payload_postures: usize,
    /// RMS difference between the arm's torques and those of the payload, N m: nominal, identified; null without
    /// payload calibration.
    payload_rms_nm: Option<[f64; 2]>,
    /// File with the calibration of the robot's own pads; null if there is none.
    pads: Option<String>,
    /// File with the parameters.
    instance: String,
    /// Page about the parameters.
    page: String,
    /// Sessions used for the identification.
    sessions: &'a [SessionSource],
    /// One entry per actuator.
    actuators: &'a [ActuatorRow],
    /// One entry per parameter.
    parameters: &'a [ParameterRow],
}

pub fn run(terminal: &Terminal, args: &IdentifyArgs) -> Outcome {
    let nominal = NominalModel::new(args.model.model()?)?;
    let mut traces = Vec::new();
    for path in session_files(&args.sessions)? {
        let trace = Trace::read(&path, &nominal.robot)?;
        if !trace.is_complete {
            eprintln!("{}: the file is cut short; {:.0} s of it are used", path.display(), trace.source.seconds);
        }
        traces.push(trace);
    }
    let found = identify(&nominal.robot, nominal.losses, &nominal.pads, &traces)?;
    let program = format!("ftac {}", env!("CARGO_PKG_VERSION"));
    let text = found.robot.to_toml(&nominal.robot, &program)?;
    ftac_platform::data::write_atomically(&args.out, text.as_bytes())?;
    let page = args.report.clone().unwrap_or_else(|| args.out.with_extension("html"));
    let (actuators, parameters) = result_rows(&nominal, &found);
    ftac_platform::data::write_atomically(
        &page,
        report::identified::page(&actuators, &parameters, &found.robot.sessions).as_bytes(),
    )?;
    let (pads, told) = write_pad_calibration(args, calibrate_pads(&nominal.robot.hand, &nominal.pads, &traces))?;
    let kinematics = &found.kinematics;
    let identified = IdentifyOutput {
        touches: kinematics.touches,
        touches_rms_m: (kinematics.touches > 0).then_some(kinematics.residuals),
        payload_postures: found.gains.postures,
        payload_rms_nm: (found.gains.postures > 0).then_some(found.gains.residuals),
        pads: pads.map(|path| path.display().to_string()),
        instance: args.out.display().to_string(),
        page: page.display().to_string(),
        sessions: &found.robot.sessions,
        actuators: &actuators,
        parameters: &parameters,
    };
    let mut words = report::identified::text(&actuators, &parameters);
    if kinematics.touches > 0 {
        let [drawn, identified] = kinematics.residuals.map(|residual| 1e3 * residual);
        words += &format!(
            "\n{} touches: {identified:.2} mm from one ball (root mean square), {drawn:.2} mm by the nominal model\n",
            kinematics.touches
        );
    }
    let gains = &found.gains;
    if gains.postures > 0 {
        let [drawn, identified] = gains.residuals.map(|residual| 1e3 * residual);
        words += &format!(
            "\n{} postures with the payload: the arm's torques differ from its weight by {identified:.1} mN m (root mean square), {drawn:.1} mN m by the nominal model\n",
            gains.postures
        );
    }
    words += &told;
    words += &format!("{} and {} written\n", args.out.display(), page.display());
    terminal.print(&identified, &words)?;
    let off: Vec<String> = actuators
        .iter()
        .filter(|row| row.residual_after > MAX_RESIDUAL)
        .map(|row| format!("{} by {:.1} deg", row.actuator, row.residual_after.to_degrees()))
        .collect();
    Ok((!off.is_empty()).then(|| format!("the identified model does not reproduce the sessions: {}", off.join(", "))))
}

/// Calibration of the robot's own pads, or the reason why there is none.
type PadCalibrationResult = Result<(PhotometricCalibration, SelfCalibrationReport), TouchError>;

/// Writes the calibration of the robot's own pads, if there is one. Returns its file, and the message to print.
fn write_pad_calibration(
    args: &IdentifyArgs,
    found: Option<PadCalibrationResult>,
) -> Result<(Option<PathBuf>, String)> {
    Ok(match found {
        None => (None, String::new()),
        Some(Err(error)) => (None, format!("no calibration of the robot's own pads: {error}\n")),
        Some(Ok((calibration, told))) => {
            let path = args.pads.clone().unwrap_or_else(|| args.out.with_extension("pads.json"));
            calibration.write(&path)?;
            let words = format!(
                "{}: calibration of the robot's own pads, from {} images; normals of held-out ones err by {:.2} deg, {:.2} with the nominal pads'\n",
                path.display(),
                told.located,
                told.after.mean,
                told.before.mean
            );
            (Some(path), words)
        }
    })
}

/// Resolves the named sessions and folders to session files; those of a folder are sorted.
fn session_files(named: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for path in named {
        if !path.is_dir() {
            files.push(path.clone());
            continue;
        }
        let mut own = sessions_in(path)?;
        if own.is_empty() {
            bail!("{}: sessions: found none, expected part_1.mcap of `ftac sysid excite`", path.display());
        }
        files.append(&mut own);
    }
    Ok(files)
}

/// Returns the result as rows for pages and terminal: actuators and parameters.
fn result_rows(nominal: &NominalModel, found: &Identification) -> (Vec<ActuatorRow>, Vec<ParameterRow>) {
    let names = nominal.robot.hand.parameters.actuator.iter().map(|actuator| actuator.name.clone());
    let actuators = names
        .zip(&found.fits)
        .map(|(actuator, fit)| ActuatorRow {
            actuator,
            motions: fit.motions,
            samples: fit.samples,
            residual_before: fit.residuals[0],
            residual_after: fit.residuals[1],
            correlation_length: fit.correlation_length,
            delay: fit.delay,
        })
        .collect();
    let individual = &found.robot.instance;
    let parameters = individual
        .parameters()
        .iter()
        .zip(&found.robot.estimates)
        .map(|(parameter, estimate)| ParameterRow {
            parameter: estimate.name.clone(),
            unit: parameter.quantity.unit().to_owned(),
            deviation: estimate.deviation,
            sigma: estimate.sigma,
            prior_sigma: parameter.prior.sigma,
            identified: estimate.identified,
        })
        .collect();
    (actuators, parameters)
}
