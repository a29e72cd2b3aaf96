//! `ftac optics render` and `ftac optics shapes`: what a pad sees of a mesh, or of twenty known shapes.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::Args;
use hand_model::Hand;
use hand_model::pads::{Camera, IMAGE_SIZE};
use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use optics::pads::PadOptics;
use optics::{Cover, CurvedSensor, Foundation, IndentationMap, Sensor, SensorModel, press};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use scenarios::geometry::Mesh;
use serde_json::json;

use super::{exr, npy};
use crate::terminal::Outcome;
use crate::terminal::Terminal;

/// Where rays start, m under the pad's plane: below everything, since the mesh's lowest point is put on the plane.
const RAY_START: f64 = 1e-3;

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
    let pad_index = find_pad(&hand, &args.pad)?;
    let pad_from_mesh = placed(&mesh, &args.pose)?;
    let mesh_from_pad = pad_from_mesh.inverse();
    let up = Unit::new_unchecked(mesh_from_pad * Vector3::z());
    let lowest = |x: f64, y: f64| {
        mesh.ray(&(mesh_from_pad * Point3::new(x, y, -RAY_START)), &up).map(|distance| distance - RAY_START)
    };
    let pad = &hand.pads[pad_index];
    let cameras: Vec<&Camera> = pad.cameras.iter().map(|&camera| &hand.cameras[camera]).collect();
    let cover = match args.cover_radius_mm {
        Some(mm) => Cover::cylinder(1e-3 * mm).and_then(|cover| cover.check(pad).map(|()| cover)),
        None => Ok(Cover::FLAT),
    };
    let cover = cover.context("--cover-radius-mm")?;
    let sensors = sensors(&hand, pad_index, &cameras, cover, args, terminal.seed)?;
    let pressed = cover.press(pad, &cameras, &Foundation::winkler(&hand.gel()), args.force, lowest)?;
    if pressed.maps.iter().all(|map| map.contact().is_none()) {
        bail!("--pose: nothing touches pad `{}`; expected the mesh over it and a force above 0", args.pad);
    }
    let mut rows = Vec::new();
    for (n, camera) in cameras.iter().enumerate() {
        let out = if cameras.len() == 1 { args.out.clone() } else { beside(&args.out, &format!("{n}.png")) };
        write_views(&hand, &sensors[n], &pressed.maps[n], terminal.seed, &out)?;
        let gel = sensors[n].flat().model().elastomer.deform(camera, &pressed.maps[n]);
        rows.push(json!({
            "camera": camera.name,
            "image": out,
            "contact_pixels": pressed.maps[n].contact_pixels(),
            "deepest_mm": 1e3 * f64::from(pressed.maps[n].deepest()),
            "rectangle": gel.map(|gel| [gel.rectangle.left, gel.rectangle.top, gel.rectangle.right, gel.rectangle.bottom]),
        }));
    }
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

/// Renders the twenty shapes onto one sheet, five a row.
pub fn shapes(terminal: &Terminal, args: &ShapesArgs) -> Outcome {
    const COLUMNS: usize = 5;
    const GAP: usize = 4;
    let hand = Hand::ftac();
    let pad = &hand.pads[find_pad(&hand, &args.pad)?];
    let camera = &hand.cameras[pad.cameras[0]];
    let sensor = Sensor::unit(pad, camera, serial(&hand, args.unit, camera));
    let cell = IMAGE_SIZE + GAP;
    let rows = optics::shapes::SHAPES.len().div_ceil(COLUMNS);
    let mut sheet = image::RgbImage::new((COLUMNS * cell) as u32, (rows * cell) as u32);
    let mut rng = ChaCha8Rng::seed_from_u64(terminal.seed);
    let mut list = Vec::new();
    for (n, (name, shape)) in optics::shapes::SHAPES.iter().enumerate() {
        let pressed = press(pad, &[camera], &hand.gel(), args.force, |x, y| shape(x, y - camera.center_y))?;
        let rgb = sensor.render(&pressed.maps[0], &mut rng).rgb;
        let picture =
            image::RgbImage::from_raw(IMAGE_SIZE as u32, IMAGE_SIZE as u32, rgb).context("an image's size")?;
        image::imageops::replace(&mut sheet, &picture, (n % COLUMNS * cell) as i64, (n / COLUMNS * cell) as i64);
        list.push(
            json!({"shape": name, "force": pressed.force, "deepest_mm": 1e3 * f64::from(pressed.maps[0].deepest())}),
        );
    }
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

/// A camera's serial number, as the tactile board numbers those of a hand.
fn serial(hand: &Hand, unit: u64, camera: &Camera) -> u64 {
    let index = hand.cameras.iter().position(|other| other.name == camera.name).unwrap_or(0);
    unit.wrapping_mul(1000).wrapping_add(index as u64)
}

/// `pad_from_mesh`: turned, its middle at the wanted place, its lowest point on the pad's plane.
fn placed(mesh: &Mesh, pose: &[f64]) -> Result<Isometry3<f64>> {
    let [x, y, roll, pitch, yaw] = *pose else {
        bail!("--pose: found {} numbers, expected 5: x,y (mm), roll,pitch,yaw (degrees)", pose.len());
    };
    if pose.iter().any(|value| !value.is_finite()) {
        bail!("--pose: found {pose:?}, expected finite numbers");
    }
    let turn = UnitQuaternion::from_euler_angles(roll.to_radians(), pitch.to_radians(), yaw.to_radians());
    let turned: Vec<Point3<f64>> = mesh.vertices().iter().map(|vertex| turn * vertex).collect();
    let range = |axis: usize| {
        let all = turned.iter().map(|vertex| vertex[axis]);
        (all.clone().fold(f64::INFINITY, f64::min), all.fold(f64::NEG_INFINITY, f64::max))
    };
    let (wide, long, tall) = (range(0), range(1), range(2));
    let shift = Translation3::new(1e-3 * x - 0.5 * (wide.0 + wide.1), 1e-3 * y - 0.5 * (long.0 + long.1), -tall.0);
    Ok(Isometry3::from_parts(shift, turn))
}

fn beside(path: &Path, ending: &str) -> PathBuf {
    path.with_extension(ending)
}

/// The pad's sensors: of the calibration file given, or the hand's own units.
fn sensors(
    hand: &Hand,
    pad: usize,
    cameras: &[&Camera],
    cover: Cover,
    args: &RenderArgs,
    seed: u64,
) -> Result<Vec<CurvedSensor>> {
    let pad = &hand.pads[pad];
    let Some(path) = &args.calibration else {
        let unit = |camera: &&Camera| {
            let serial = serial(hand, args.unit, camera);
            CurvedSensor::new(pad, camera, SensorModel::unit(pad, camera, serial), cover, serial)
        };
        return Ok(cameras.iter().map(unit).collect::<Result<_, _>>()?);
    };
    let name = || format!("--calibration {}", path.display());
    let text = std::fs::read_to_string(path).with_context(name)?;
    let models = PadOptics::parse(&text).and_then(|file| file.models(hand, pad)).with_context(name)?;
    let sensor = |(camera, model)| CurvedSensor::new(pad, camera, model, cover, seed).with_context(name);
    cameras.iter().copied().zip(models).map(sensor).collect()
}

/// Writes image, height (m below the surface, along its normals) and normals (pad frame, out of the gel) of one camera.
fn write_views(hand: &Hand, sensor: &CurvedSensor, map: &IndentationMap, seed: u64, out: &Path) -> Result<()> {
    let camera = sensor.flat().camera();
    let image = sensor.render(map, &mut ChaCha8Rng::seed_from_u64(seed));
    let side = IMAGE_SIZE as u32;
    let save = |path: &Path, bytes: &[u8], color| {
        image::save_buffer(path, bytes, side, side, color).with_context(|| format!("--out {}", path.display()))
    };
    save(out, &image.rgb, image::ColorType::Rgb8)?;
    let depths = sensor.gel(map);
    let relief = sensor.relief(&depths);
    let depth = |column: usize, row: usize| relief[row * IMAGE_SIZE + column];
    let pixels = || (0..IMAGE_SIZE * IMAGE_SIZE).map(|at| (at % IMAGE_SIZE, at / IMAGE_SIZE));
    let (dx, dy) = camera.pixel_size();
    let last = IMAGE_SIZE - 1;
    let normals: Vec<Vector3<f32>> = pixels()
        .map(|(column, row)| {
            let (left, right) = (column.saturating_sub(1), (column + 1).min(last));
            let (above, below) = (row.saturating_sub(1), (row + 1).min(last));
            // The surface is at z = -depth, rows run against y; the normal points out of the gel.
            let zx = (depth(left, row) - depth(right, row)) / ((right - left) as f32 * dx as f32);
            let zy = (depth(column, below) - depth(column, above)) / ((below - above) as f32 * dy as f32);
            Vector3::new(-zx, -zy, 1.0).normalize()
        })
        .collect();
    npy::write(&beside(out, "height.npy"), &depths, &[IMAGE_SIZE, IMAGE_SIZE])?;
    let flat: Vec<f32> = normals.iter().flat_map(|normal| [normal.x, normal.y, normal.z]).collect();
    npy::write(&beside(out, "normals.npy"), &flat, &[IMAGE_SIZE, IMAGE_SIZE, 3])?;
    let greys: Vec<f32> = image.rgb.iter().map(|&value| f32::from(value) / 255.0).collect();
    npy::write(&beside(out, "npy"), &greys, &[IMAGE_SIZE, IMAGE_SIZE, 3])?;
    let channel = |values: &[f32], c: usize| values.iter().skip(c).step_by(3).copied().collect::<Vec<f32>>();
    let colors = |values: &[f32]| [("R", channel(values, 0)), ("G", channel(values, 1)), ("B", channel(values, 2))];
    exr::write(&beside(out, "exr"), IMAGE_SIZE, &colors(&greys))?;
    exr::write(&beside(out, "normals.exr"), IMAGE_SIZE, &colors(&flat))?;
    exr::write(&beside(out, "height.exr"), IMAGE_SIZE, &[("Y", depths.clone())])?;
    let thickness = hand.gel().thickness as f32;
    let grey: Vec<u8> = depths.iter().map(|depth| (255.0 * depth / thickness).clamp(0.0, 255.0) as u8).collect();
    save(&beside(out, "height.png"), &grey, image::ColorType::L8)?;
    let color: Vec<u8> = flat.iter().map(|value| (127.5 * (value + 1.0)) as u8).collect();
    save(&beside(out, "normals.png"), &color, image::ColorType::Rgb8)
}
