//! `ftac optics render` and `ftac optics shapes`: what a pad sees of a mesh, or of twenty known shapes.

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use clap::Args;
use hand_model::Hand;
use lab::optics::render::{MeshPose, PadView, SensorSource};
use lab::optics::shape_sheet::shape_sheet;
use optics::Cover;
use scenarios::geometry::Mesh;
use serde_json::json;

use crate::terminal::{Outcome, Terminal};

/// Arguments of `optics render`.
#[derive(Debug, Args)]
pub struct RenderArgs {
    /// The mesh, OBJ, in metres.
    pub mesh: PathBuf,
    /// Pad.
    #[arg(long, default_value = "index_distal")]
    pub pad: String,
    /// Where the mesh is, over the pad: x,y (mm) of its middle, then roll,pitch,yaw (degrees) about the pad's axes.
    /// Its lowest point is put on the pad's surface.
    #[arg(long, value_delimiter = ',', num_args = 1, default_value = "0,0,0,0,0", allow_hyphen_values = true)]
    pub pose: Vec<f64>,
    /// Normal force, N.
    #[arg(long, default_value_t = 2.0)]
    pub force: f64,
    /// Serial number of the hand.
    #[arg(long, default_value_t = 7)]
    pub unit: u64,
    /// Calibration file of the pad (see `optics pads`) instead of the hand's own units.
    #[arg(long, conflicts_with = "unit")]
    pub calibration: Option<PathBuf>,
    /// Radius of the pad's cover across the digit, mm, for a pad that is part of a cylinder; default: flat.
    #[arg(long)]
    pub cover_radius_mm: Option<f64>,
    /// The PNG to write; image, height map (m, along the cover's normals) and normals go beside it, as PNG, EXR and NPY.
    #[arg(long)]
    pub out: PathBuf,
}

/// Arguments of `optics shapes`.
#[derive(Debug, Args)]
pub struct ShapesArgs {
    /// Pad.
    #[arg(long, default_value = "index_distal")]
    pub pad: String,
    /// Normal force, N.
    #[arg(long, default_value_t = 1.5)]
    pub force: f64,
    /// Serial number of the hand.
    #[arg(long, default_value_t = 7)]
    pub unit: u64,
    /// The contact sheet (PNG) to write.
    #[arg(long)]
    pub out: PathBuf,
}

/// Renders a mesh.
pub fn render(terminal: &Terminal, args: &RenderArgs) -> Outcome {
    let hand = Hand::ftac();
    let mesh = Mesh::read_obj(&args.mesh)?;
    let pad = find_pad(&hand, &args.pad)?;
    let pose = mesh_pose(&args.pose)?;
    let cover = match args.cover_radius_mm {
        Some(mm) => Cover::cylinder(1e-3 * mm).and_then(|cover| cover.check(&hand.pads[pad]).map(|()| cover)),
        None => Ok(Cover::FLAT),
    };
    let source = args.calibration.as_deref().map_or(SensorSource::Hand(args.unit), SensorSource::Calibration);
    let view = PadView::new(&hand, pad, cover.context("--cover-radius-mm")?, &source, terminal.seed)?;
    let pressed = view.press(&mesh, &pose, args.force)?;
    let rows = view.write(&pressed, terminal.seed, &args.out)?;
    if terminal.json {
        println!(
            "{}",
            json!({"pad": args.pad, "force": pressed.force, "shift_mm": 1e3 * pressed.shift, "cameras": rows})
        );
    } else if !terminal.quiet {
        eprintln!("{} N on {}: {} camera(s) rendered", pressed.force, args.pad, rows.len());
    }
    let short = (pressed.force - args.force).abs() > 0.01 * args.force;
    Ok(short.then(|| format!("the gel is pressed flat: it bears {:.2} N of {} N", pressed.force, args.force)))
}

/// Renders the twenty shapes onto one sheet.
pub fn shapes(terminal: &Terminal, args: &ShapesArgs) -> Outcome {
    let hand = Hand::ftac();
    let pad = find_pad(&hand, &args.pad)?;
    let (sheet, list) = shape_sheet(&hand, pad, args.force, args.unit, terminal.seed)?;
    sheet.save(&args.out).with_context(|| format!("--out {}", args.out.display()))?;
    if terminal.json {
        println!("{}", json!({ "shapes": list }));
    }
    Ok(None)
}

fn find_pad(hand: &Hand, name: &str) -> Result<usize> {
    hand.pad(name).with_context(|| {
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
