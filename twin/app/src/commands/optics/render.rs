//! `ftac optics render` and `ftac optics shapes`: render the image of a pad pressed by a mesh, or by twenty known
//! shapes.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use hand_model::Hand;
use schemars::JsonSchema;
use sensor_calibration::render::{CameraRender, MeshPose, PadView, SensorSource, real_sensor};
use sensor_calibration::shape_sheet::{PressedShape, shape_sheet};
use serde::Serialize;
use tactile_optics::PadCover;
use tactile_optics::calibration::CalibratedSensor;
use world::geometry::Mesh;

use super::sensor_option::SensorOption;
use crate::options::robot::{RobotArgs, instance_model};
use crate::terminal::{Outcome, Terminal};

/// Default depth of a mesh pressed into a real sensor, mm.
const SENSOR_DEPTH_MM: f64 = 0.5;

/// Arguments of `optics render`.
#[derive(Debug, Args)]
pub struct RenderArgs {
    /// Mesh file (OBJ), in metres.
    pub mesh: PathBuf,
    /// Name of the pad.
    #[arg(long, default_value = "index_distal")]
    pub pad: String,
    /// Pose of the mesh over the pad: x,y (mm) of its centre, then roll,pitch,yaw (degrees) about the pad's axes. Its
    /// lowest point is put on the pad's surface.
    #[arg(long, value_delimiter = ',', num_args = 1, default_value = "0,0,0,0,0", allow_hyphen_values = true)]
    pub pose: Vec<f64>,
    /// Normal force, N.
    #[arg(long, default_value_t = 2.0)]
    pub force: f64,
    /// Serial number of the hand.
    #[arg(long, default_value_t = 7, conflicts_with = "sensor_file")]
    pub unit: u64,
    #[command(flatten)]
    pub sensor: SensorOption,
    /// For a real sensor: depth of the mesh's lowest point below the untouched gel, mm. The force is not part of a
    /// calibration [default: 0.5].
    #[arg(long, requires = "sensor_file", conflicts_with = "force")]
    pub depth_mm: Option<f64>,
    /// For a real sensor: thickness of its gel, mm, which limits the indentation.
    #[arg(long, requires = "sensor_file", conflicts_with = "force")]
    pub gel_mm: Option<f64>,
    /// Radius of the pad's cover across the digit, mm, for a cylindrical pad; default: flat.
    #[arg(long)]
    pub cover_radius_mm: Option<f64>,
    /// Robot instance (a file of `ftac sysid identify`) that gives the stiffness and thickness of the gel; these keep
    /// the nominal values unless a session identifies them.
    #[arg(long, conflicts_with = "sensor_file")]
    pub instance: Option<PathBuf>,
    #[command(flatten)]
    pub robot: RobotArgs,
    /// PNG file to write; image, height map (m, along the normals of the cover) and normals go beside it, as PNG, EXR
    /// and NPY.
    #[arg(long)]
    pub out: PathBuf,
}

/// Arguments of `optics shapes`.
#[derive(Debug, Args)]
pub struct ShapesArgs {
    /// Name of the pad.
    #[arg(long, default_value = "index_distal")]
    pub pad: String,
    /// Normal force, N.
    #[arg(long, default_value_t = 1.5)]
    pub force: f64,
    /// Serial number of the hand.
    #[arg(long, default_value_t = 7)]
    pub unit: u64,
    #[command(flatten)]
    pub robot: RobotArgs,
    /// Contact sheet (PNG) to write.
    #[arg(long)]
    pub out: PathBuf,
}

/// JSON output of `optics render` for a pad.
#[derive(Debug, Serialize, JsonSchema)]
pub struct PadRenderOutput<'a> {
    pad: &'a str,
    /// Normal force, N.
    force: f64,
    /// Indentation of the object, mm.
    shift_mm: f64,
    /// One entry per camera of the pad.
    cameras: Vec<CameraRender>,
}

/// JSON output of `optics shapes`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct ShapesOutput {
    shapes: Vec<PressedShape>,
}

/// Refuses an output file that is not a PNG, before any work is done.
fn expect_png(out: &Path) -> Result<()> {
    let is_png = out.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("png"));
    ensure!(is_png, "--out: found {}, expected a file that ends in .png", out.display());
    Ok(())
}

/// Runs `ftac optics render`.
pub fn render(terminal: &Terminal, args: &RenderArgs) -> Outcome {
    expect_png(&args.out)?;
    let hand = instance_model(args.instance.as_deref(), &args.robot.model()?)?.hand;
    let (mesh, repair) = Mesh::load(&args.mesh).context("MESH")?;
    if !repair.is_none() {
        eprintln!("{}: {repair}", args.mesh.display());
    }
    let pose = mesh_pose(&args.pose)?;
    let sensor = args.sensor.file(terminal);
    if let Some(path) = sensor
        && real_sensor::is_sensor(path)?
    {
        return render_real(terminal, args, path, (&mesh, &pose));
    }
    if args.depth_mm.is_some() || args.gel_mm.is_some() {
        bail!("--depth-mm, --gel-mm: found a pad, which is pressed with a force; expected a real sensor (--sensor)");
    }
    let pad = find_pad(&hand, &args.pad)?;
    let cover = match args.cover_radius_mm {
        Some(mm) => PadCover::cylinder(1e-3 * mm).and_then(|cover| cover.check(&hand.pads[pad]).map(|()| cover)),
        None => Ok(PadCover::FLAT),
    };
    let source = sensor.map_or(SensorSource::Hand(args.unit), |path| SensorSource::Calibration(path));
    let view = PadView::new(&hand, pad, cover.context("--cover-radius-mm")?, &source, terminal.seed)?;
    let pressed = view.press(&mesh, &pose, args.force)?;
    let rows = view.write(&pressed, terminal.seed, &args.out)?;
    if !terminal.json && !terminal.quiet {
        let time: f64 = rows.iter().map(|row| row.render_ms).sum();
        eprintln!("{:.2} N on {}: {} camera(s) rendered in {time:.1} ms", pressed.force, args.pad, rows.len());
    }
    let text: String = rows.iter().map(CameraRender::text).collect();
    let rendered =
        PadRenderOutput { pad: &args.pad, force: pressed.force, shift_mm: 1e3 * pressed.shift, cameras: rows };
    terminal.print(&rendered, &text)?;
    let short = (pressed.force - args.force).abs() > 0.01 * args.force;
    Ok(short.then(|| format!("the gel is pressed flat: it bears {:.2} N of {} N", pressed.force, args.force)))
}

/// Renders a mesh pressed into a real sensor.
fn render_real(terminal: &Terminal, args: &RenderArgs, path: &Path, pressed: (&Mesh, &MeshPose)) -> Outcome {
    let positive = |name: &str, mm: f64| {
        if mm > 0.0 && mm.is_finite() {
            return Ok(1e-3 * mm);
        }
        bail!("{name}: found {mm}, expected a positive number")
    };
    let depth = positive("--depth-mm", args.depth_mm.unwrap_or(SENSOR_DEPTH_MM))?;
    let thickness = args.gel_mm.map(|mm| positive("--gel-mm", mm)).transpose()?;
    let sensor = CalibratedSensor::read(path)?;
    let found = real_sensor::render(&sensor, pressed, depth, thickness, &args.out)?;
    if !terminal.json && !terminal.quiet {
        eprintln!("{:.2} mm deep, rendered in {:.1} ms", found.depth_mm, found.render_ms);
    }
    terminal.print(&found, &found.text())?;
    let short = || format!("the gel is pressed flat: it yields {} of {} mm", found.depth_mm, 1e3 * depth);
    Ok(found.bottomed_out.then(short))
}

/// Runs `ftac optics shapes`: renders the twenty shapes onto one sheet.
pub fn shapes(terminal: &Terminal, args: &ShapesArgs) -> Outcome {
    expect_png(&args.out)?;
    let hand = args.robot.model()?.hand;
    let pad = find_pad(&hand, &args.pad)?;
    let (sheet, list) = shape_sheet(&hand, pad, args.force, args.unit, terminal.seed)?;
    sheet.save(&args.out).with_context(|| format!("--out {}", args.out.display()))?;
    let text = format!("{} shapes on one sheet: {}\n", list.len(), args.out.display());
    terminal.print(&ShapesOutput { shapes: list }, &text)?;
    Ok(None)
}

fn find_pad(hand: &Hand, name: &str) -> Result<usize> {
    hand.find_pad(name).with_context(|| {
        let known: Vec<&str> = hand.pads.iter().map(|pad| pad.name.as_str()).collect();
        format!("--pad: found `{name}`; expected one of {}", known.join(", "))
    })
}

fn mesh_pose(pose: &[f64]) -> Result<MeshPose> {
    let [x, y, roll, pitch, yaw] = *pose else {
        bail!("--pose: found {} numbers, expected 5: x,y (mm), roll,pitch,yaw (degrees)", pose.len());
    };
    if pose.iter().any(|value| !value.is_finite()) {
        bail!("--pose: found {pose:?}, expected finite numbers");
    }
    Ok(MeshPose { middle: [1e-3 * x, 1e-3 * y], turn: [roll, pitch, yaw].map(f64::to_radians) })
}
