//! `ftac optics eval`: evaluates a calibration on presses that it was not fitted to, the gel's response to the paper's
//! probe, forces from images, and the recovery of a known sensor by the fit.

use std::path::PathBuf;

use anyhow::{Context, bail};
use bench::builtin::robot_calibration;
use clap::Args;
use schemars::JsonSchema;
use sensor_calibration::calibration::figures::accuracy_table;
use sensor_calibration::evaluation::{self, GelResponse};
use sensor_calibration::pad_forces::{self, Agreement, PadForce};
use sensor_calibration::reconstruction::Accuracy;
use serde::Serialize;
use tactile_optics::calibration::Similarity;
use tactile_optics::calibration::recovery::RecoveryErrors;

use super::sensor_option::SensorOption;
use crate::options::robot::RobotArgs;
use crate::terminal::{Outcome, Terminal};

/// Arguments of `optics eval`.
#[derive(Debug, Args)]
pub struct EvalArgs {
    /// Folder or video of presses to render and compare (needs --sensor and --ball-diameter-mm).
    #[arg(requires = "sensor_file", requires = "ball_diameter_mm")]
    pub folder: Option<PathBuf>,
    #[command(flatten)]
    pub sensor: SensorOption,
    /// Image of the untouched gel in FOLDER, if it is not named `background.png`.
    #[arg(long, requires = "folder")]
    pub background: Option<PathBuf>,
    /// Diameter of the ball, mm (for presses whose label does not give it).
    #[arg(long)]
    pub ball_diameter_mm: Option<f64>,
    /// Evaluate the gel's response to the paper's probe.
    #[arg(long)]
    pub force: bool,
    #[command(flatten)]
    pub robot: RobotArgs,
    /// Compare the normal force that each pad's image gives with that of the physics engine, in simulated grips.
    #[arg(long)]
    pub pads: bool,
    /// Measure the errors of fits to synthetic presses of a known sensor over the number of presses, without and with
    /// images of single lamps.
    #[arg(long)]
    pub recovery: bool,
}

/// Forces from images, compared with those of the physics engine.
#[derive(Debug, Serialize, JsonSchema)]
struct PadForces {
    /// One entry per row of the table.
    rows: Vec<PadForce>,
    /// Agreement of the two forces.
    agreement: Agreement,
}

/// Errors of reconstructed surfaces, by method.
#[derive(Debug, Serialize, JsonSchema)]
struct SurfaceErrors {
    look_up: Accuracy,
    network: Accuracy,
}

/// JSON output of `optics eval`: the evaluations that were asked for.
#[derive(Debug, Default, Serialize, JsonSchema)]
pub struct OpticsEvalOutput {
    /// With --force: response of each gel to the paper's probe.
    #[serde(skip_serializing_if = "Option::is_none")]
    force: Option<Vec<GelResponse>>,
    /// With --pads: normal forces.
    #[serde(skip_serializing_if = "Option::is_none")]
    pads: Option<PadForces>,
    /// With --recovery: errors of fits.
    #[serde(skip_serializing_if = "Option::is_none")]
    recovery: Option<Vec<RecoveryErrors>>,
    /// With a folder: number of presses compared.
    #[serde(skip_serializing_if = "Option::is_none")]
    presses: Option<usize>,
    /// With a folder: similarity of rendered and real images.
    #[serde(skip_serializing_if = "Option::is_none")]
    full: Option<Similarity>,
    /// With a folder: errors of reconstructed surfaces.
    #[serde(skip_serializing_if = "Option::is_none")]
    reconstruction: Option<SurfaceErrors>,
}

/// Runs the evaluations asked for.
pub fn eval(terminal: &Terminal, args: &EvalArgs) -> Outcome {
    if args.folder.is_none() && !args.force && !args.recovery && !args.pads {
        bail!("found nothing to evaluate; expected a FOLDER with --sensor, or --force, --pads or --recovery");
    }
    let robot = args.robot.model()?;
    let mut result = OpticsEvalOutput::default();
    let mut short = None;
    let tell = |text: &str| {
        if !terminal.json {
            print!("{text}");
        }
    };
    if args.force {
        let rows = evaluation::gel_responses(&robot.hand);
        tell(&evaluation::response_table(&rows));
        if !evaluation::reproduces_paper(&rows) {
            short = Some("the gel's law does not reproduce the paper's probe".to_owned());
        }
        result.force = Some(rows);
    }
    if args.pads {
        let rows = pad_forces::grip_all(&robot.hand, robot_calibration(&robot)?)?;
        let all = pad_forces::agreement(&rows).context("--pads: no pad is loaded")?;
        tell(&pad_forces::table(&rows, &all));
        result.pads = Some(PadForces { rows, agreement: all });
    }
    if args.recovery {
        let rows = evaluation::recoveries(terminal.seed);
        tell(&evaluation::recovery_table(&rows));
        result.recovery = Some(rows);
    }
    if let (Some(folder), Some(file), Some(diameter)) =
        (&args.folder, args.sensor.file(terminal), args.ball_diameter_mm)
    {
        let found = evaluation::similarity_to_presses(file, folder, 1e-3 * diameter, args.background.as_deref())?;
        for image in &found.left_out {
            eprintln!("{} left out: {}", image.name, image.reason);
        }
        let (count, mean) = (found.presses, found.similarity);
        tell(&format!("{count} presses: L1 {:.4}, SSIM {:.4}, PSNR {:.2} dB\n", mean.l1, mean.ssim, mean.psnr));
        result.presses = Some(count);
        if let Some([look_up, network]) = found.surfaces {
            tell(&accuracy_table(&[&look_up, &network]));
            result.reconstruction = Some(SurfaceErrors { look_up, network });
        }
        result.full = Some(mean);
    }
    terminal.print(&result, "")?;
    Ok(short)
}
