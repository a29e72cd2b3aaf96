//! `ftac hand close`: a hand read from files closes on a ball, with what each link feels and a picture.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use clap::Args;
use hand_model::any_hand::AnyHand;
use nalgebra::{Isometry3, Point3, Vector3};
use scenarios::Shape;
use serde_json::json;
use sim::engine::EngineSettings;
use sim::stand::{AnyStand, Prop};

use crate::terminal::{Outcome, Terminal};
use report::picture::{PROPS, Picture, View, save, tile};

/// Arguments of `hand close`.
#[derive(Debug, Args)]
pub struct CloseArgs {
    /// The hand: URDF with collision boxes, spheres, cylinders or OBJ/STL meshes.
    #[arg(long)]
    pub urdf: PathBuf,
    /// What pulls on its joints (TOML; hand-model/data/hands has two to start from).
    #[arg(long)]
    pub transmission: PathBuf,
    /// Where the ball's centre is held while the hand closes, in the root link's frame, m: x,y,z.
    #[arg(long, required = true, value_delimiter = ',', allow_hyphen_values = true)]
    pub at: Vec<f64>,
    /// The ball's diameter, mm.
    #[arg(long, default_value_t = 60.0)]
    pub ball_diameter_mm: f64,
    /// Tension of each actuator, N: one for all, or one each in the file's order.
    #[arg(long, value_delimiter = ',', default_value = "12", allow_hyphen_values = true)]
    pub tensions: Vec<f64>,
    /// Picture to write (PNG).
    #[arg(long)]
    pub out: Option<PathBuf>,
}

/// Times to close on the fixed ball, to settle after it is let go of, and under gravity from each side, s.
const CLOSE: f64 = 2.0;
const SETTLE: f64 = 1.0;
const PULL: f64 = 1.0;
/// The ball's mass, kg, and friction.
const MASS: f64 = 0.1;
const FRICTION: f64 = 0.8;
/// The ball is held if it moves less than this, m.
const STAYS: f64 = 0.01;
/// Forces below this are no touch, N.
const TOUCH: f64 = 0.05;
const STEEL: [f64; 3] = [176.0, 182.0, 192.0];

/// The command.
pub fn run(terminal: &Terminal, args: &CloseArgs) -> Outcome {
    let hand = Arc::new(AnyHand::read(&args.urdf, &args.transmission)?);
    let tensions = tensions(&hand, &args.tensions)?;
    let (at, radius) = ball(args)?;
    for note in &hand.notes {
        eprintln!("note: {note}");
    }
    let mut stand = AnyStand::new(hand.clone(), EngineSettings::default());
    let open = stand.clone();
    stand.put(&Prop::new("ball", Shape::Sphere { radius }, MASS, FRICTION), &Isometry3::translation(at.x, at.y, at.z));
    stand.run(&tensions, CLOSE);
    stand.release();
    stand.run(&tensions, SETTLE);
    let forces = stand.forces();
    let start = stand.poses()[0].translation.vector;
    let ways = [("+x", Vector3::x()), ("-x", -Vector3::x()), ("+y", Vector3::y()), ("-y", -Vector3::y())];
    let ways = ways.into_iter().chain([("+z", Vector3::z()), ("-z", -Vector3::z())]);
    let held: Vec<(&str, f64)> = ways
        .map(|(name, way)| {
            let mut branch = stand.clone();
            branch.set_gravity(&(way * 9.81));
            branch.run(&tensions, PULL);
            (name, (branch.poses()[0].translation.vector - start).norm())
        })
        .collect();
    let touching = forces.iter().filter(|force| **force > TOUCH).count();
    let kept: Vec<&str> = held.iter().filter(|(_, moved)| *moved < STAYS).map(|(name, _)| *name).collect();
    if let Some(path) = &args.out {
        draw(&open, &stand, radius, path)?;
    }
    let joints: Vec<_> = hand
        .tree
        .joints
        .iter()
        .zip(stand.angles().iter().zip(&forces))
        .map(|(joint, (angle, force))| json!({ "joint": joint.name, "angle_rad": angle, "force_n": force }))
        .collect();
    if terminal.json {
        let gravity: serde_json::Map<String, serde_json::Value> =
            held.iter().map(|(name, moved)| (name.to_string(), json!(moved * 1e3))).collect();
        println!(
            "{}",
            json!({
                "hand": hand.name, "joints": joints, "touching": touching, "held_directions": kept.len(),
                "moved_mm": gravity, "notes": hand.notes,
            })
        );
    } else {
        println!("{}: {} joints, {} actuators", hand.name, hand.tree.len(), hand.pulls.len());
        println!("{:40} {:>10} {:>12}", "joint", "angle deg", "its link N");
        for (joint, (angle, force)) in hand.tree.joints.iter().zip(stand.angles().iter().zip(&forces)) {
            println!("{:40} {:>10.1} {force:>12.2}", joint.name, angle.to_degrees());
        }
        println!("{touching} links touch; held against gravity towards: {}", kept.join(" "));
    }
    Ok((touching < 2).then(|| format!("{touching} links touch the ball; a grip needs two")))
}

fn tensions(hand: &AnyHand, given: &[f64]) -> Result<Vec<f64>> {
    let names: Vec<&str> = hand.pulls.iter().map(|pull| pull.name.as_str()).collect();
    let all = match given {
        [one] => vec![*one; names.len()],
        several => several.to_vec(),
    };
    if all.len() != names.len() {
        bail!("--tensions: found {} values, expected 1 or {} ({})", all.len(), names.len(), names.join(", "));
    }
    if let Some(bad) = all.iter().find(|tension| !(tension.is_finite() && **tension >= 0.0)) {
        bail!("--tensions: found {bad}, expected tensions of 0 N or more");
    }
    Ok(all)
}

fn ball(args: &CloseArgs) -> Result<(Point3<f64>, f64)> {
    let [x, y, z] = args.at[..] else { bail!("--at: found {} values, expected x,y,z in m", args.at.len()) };
    if !(x.is_finite() && y.is_finite() && z.is_finite()) {
        bail!("--at: found {x},{y},{z}, expected finite numbers in m");
    }
    let diameter = args.ball_diameter_mm;
    if !(1.0..=1000.0).contains(&diameter) {
        bail!("--ball-diameter-mm: found {diameter}, expected 1 to 1000");
    }
    Ok((Point3::new(x, y, z), 0.5e-3 * diameter))
}

/// Open and closed, from two sides.
fn draw(open: &AnyStand, closed: &AnyStand, radius: f64, path: &Path) -> Result<()> {
    let points: Vec<Point3<f64>> = open.triangles().into_iter().chain(closed.triangles()).flatten().collect();
    let corner = |pick: fn(f64, f64) -> f64, start: f64| {
        points.iter().fold(Vector3::repeat(start), |so_far, point| so_far.zip_map(&point.coords, pick))
    };
    let (low, high) = (corner(f64::min, f64::INFINITY), corner(f64::max, f64::NEG_INFINITY));
    let center = Point3::from(0.5 * (low + high));
    let width = 1.05 * (high - low).norm();
    let ball = Prop::new("ball", Shape::Sphere { radius }, MASS, FRICTION);
    let mut pictures = Vec::new();
    for (eye, up) in [(Vector3::new(1.0, 0.6, 0.4), Vector3::z()), (Vector3::new(0.5, -1.0, 0.5), Vector3::z())] {
        for (stand, caption) in [(open, "open"), (closed, "closed on the ball")] {
            let mut picture = Picture::new(420, View { eye: eye.normalize(), up, center, width });
            for [a, b, c] in stand.triangles() {
                let Some(normal) = (b - a).cross(&(c - a)).try_normalize(1e-15) else { continue };
                picture.triangles(&Isometry3::identity(), &[a, b, c], &[[0, 1, 2]], &[normal; 3], STEEL);
            }
            for pose in stand.poses() {
                picture.prop(&ball, &pose, PROPS[0]);
            }
            pictures.push(picture.finish(caption));
        }
    }
    if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    }
    save(&tile(&pictures, 2), path)
}
