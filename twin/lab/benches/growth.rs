//! Scaling of run time with the number of objects in the scene, of pads and pixels rendered, of candidates evaluated,
//! and of scenes on threads.
//!
//!     cargo bench -p ftac-lab --bench growth -- DIR
//!
//! Each cost is the median of [`REPEATS`] runs, with the range beside it. The exponent is the slope of a straight line
//! through the logarithms, once over all counts and once over their upper half, where fixed costs weigh less. Tables go
//! to stdout, one picture each to DIR.

use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result};
use control::outcome_model::AimPosterior;
use control::score::GraspCandidate;
use control::strategy::best_candidate_score;
use control::uncertainty::Uncertainty;
use hand_model::robot::{RobotCommand, ServoGoal};
use hand_model::{Arm, Hand, RobotModel};
use nalgebra::{Isometry3, Vector3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;
use report::plot::Plot;
use sim::tactile::TactileBoard;
use sim::{ObjectPlacement, SceneSetup, SimulatedRobot};
use tactile_optics::indentation::press_rasters;
use tactile_optics::{GelFoundation, IndentationMap, ReducedSensor, Sensor, press};
use world::objects::ObjectSet;

/// Number of runs of each count.
const REPEATS: usize = 7;
/// Timed ticks of a scene; as many untimed ones before let the objects come to rest.
const TIMED_TICKS: usize = 60;
/// Force on each pad, N.
const PAD_FORCE: f64 = 2.0;
/// Distance between objects on the table, m, and number of objects in a row.
const SPACING: f64 = 0.14;
const OBJECTS_PER_ROW: usize = 7;

/// Measured growth: cost against count.
struct Growth {
    name: &'static str,
    /// Labels of the axes: the counted quantity, and the cost with its unit.
    axes: [&'static str; 2],
    /// Count with the least, median and greatest cost.
    points: Vec<(usize, [f64; 3])>,
}

/// Computes the slope of a straight line through the logarithms of counts and median costs.
fn exponent(points: &[(usize, [f64; 3])]) -> f64 {
    let logs: Vec<[f64; 2]> = points.iter().map(|(count, cost)| [(*count as f64).ln(), cost[1].ln()]).collect();
    let mean = |axis: usize| logs.iter().map(|log| log[axis]).sum::<f64>() / logs.len() as f64;
    let (x, y) = (mean(0), mean(1));
    let sum = |f: &dyn Fn(&[f64; 2]) -> f64| logs.iter().map(f).sum::<f64>();
    sum(&|log| (log[0] - x) * (log[1] - y)) / sum(&|log| (log[0] - x).powi(2))
}

impl Growth {
    /// Times `cost` (s, stored in thousandths of the table's unit) of each count, cycling through the counts so that a
    /// slow moment of the machine affects all equally.
    fn measure(
        name: &'static str,
        axes: [&'static str; 2],
        counts: &[usize],
        mut cost: impl FnMut(usize) -> Result<f64>,
    ) -> Result<Self> {
        let mut costs = vec![Vec::new(); counts.len()];
        for _ in 0..REPEATS {
            for (costs, count) in costs.iter_mut().zip(counts) {
                costs.push(1e3 * cost(*count)?);
            }
        }
        let points = counts.iter().zip(costs).map(|(count, mut costs)| {
            costs.sort_by(f64::total_cmp);
            (*count, [costs[0], costs[REPEATS / 2], costs[REPEATS - 1]])
        });
        Ok(Self { name, axes, points: points.collect() })
    }

    fn print(&self) {
        println!("\n{}: {} against {}", self.name, self.axes[1], self.axes[0]);
        println!("| {} | median | min | max |\n|---|---|---|---|", self.axes[0]);
        for (count, [least, median, most]) in &self.points {
            println!("| {count} | {median:.3} | {least:.3} | {most:.3} |");
        }
        let upper = &self.points[self.points.len() / 2..];
        let of_upper =
            if upper.len() > 1 { format!("; of the upper half {:.2}", exponent(upper)) } else { String::new() };
        println!("Exponent {:.2}{of_upper}.", exponent(&self.points));
    }

    /// Draws the costs on logarithmic axes.
    fn draw(&self, folder: &Path) -> Result<()> {
        let line =
            |at: usize| self.points.iter().map(|(count, cost)| [(*count as f64).log10(), cost[at].log10()]).collect();
        let plot = Plot {
            title: self.name.to_owned(),
            x: format!("{}, power of ten", self.axes[0]),
            y: format!("{}, power of ten", self.axes[1]),
            lines: vec![("median".to_owned(), line(1)), ("min".to_owned(), line(0)), ("max".to_owned(), line(2))],
        };
        let path = folder.join(format!("{}.png", self.name.replace(' ', "_")));
        plot.draw().save(&path).with_context(|| path.display().to_string())
    }
}

fn timed(work: impl FnOnce()) -> f64 {
    let begun = Instant::now();
    work();
    begun.elapsed().as_secs_f64()
}

/// Sets up arm and hand at rest above a table with `count` objects in rows.
fn scene(count: usize) -> SimulatedRobot {
    let objects = ObjectSet::standard();
    let models: Vec<_> = objects.iter().cloned().collect();
    let placed = (0..count).map(|n| {
        let model = models[n % models.len()].clone();
        let (row, column) = (n / OBJECTS_PER_ROW, n % OBJECTS_PER_ROW);
        let at = Vector3::new(0.4 + SPACING * row as f64, SPACING * (column as f64 - 3.0), model.rest_height());
        ObjectPlacement { pose: Isometry3::from_parts(at.into(), model.rest), model }
    });
    let setup = SceneSetup { objects: placed.collect(), ..SceneSetup::ideal(Isometry3::identity(), Arm::gen3().home) };
    let mut robot = SimulatedRobot::new(&RobotModel::ftac_gen3(), &setup, TactileBoard::blank());
    run_ticks(&mut robot);
    robot
}

/// Lets the robot stand still for [`TIMED_TICKS`].
fn run_ticks(robot: &mut SimulatedRobot) {
    for _ in 0..TIMED_TICKS {
        robot.send(&RobotCommand {
            arm: Arm::gen3().home,
            servos: [ServoGoal::Current(0.0); 6].into(),
            capture: false,
        });
        robot.wait_for_tick();
    }
}

/// Returns the height of the underside of a ball of 40 mm diameter, m.
fn ball(x: f64, y: f64) -> Option<f64> {
    let inside = 0.02f64.powi(2) - x * x - y * y;
    (inside > 0.0).then(|| 0.02 - inside.sqrt())
}

/// Presses a ball into each pad and returns the sensor of the pad's first camera with its indentation map.
fn pads(hand: &Hand) -> Result<Vec<(Sensor, IndentationMap)>> {
    let mut all = Vec::new();
    for (n, pad) in hand.pads.iter().enumerate() {
        let camera = &hand.cameras[pad.cameras[0]];
        let mut pressed = press(pad, &[camera], &hand.gel(), PAD_FORCE, |x, y| ball(x, y - camera.center_y))?;
        all.push((Sensor::unit(pad, camera, n as u64), pressed.maps.remove(0)));
    }
    Ok(all)
}

fn render(pads: &[(Sensor, IndentationMap)]) {
    for (sensor, map) in pads {
        black_box(sensor.render(map, &mut ChaCha8Rng::seed_from_u64(1)));
    }
}

/// Returns the time for one image of a ball in a pad, at `side` x `side` pixels, s.
fn small_image(hand: &Hand, sensor: &Sensor, side: usize) -> Result<f64> {
    let small = ReducedSensor::new(sensor, side)?;
    let camera = sensor.camera();
    let gel = GelFoundation::winkler(&hand.gel());
    let rasters = [*small.raster()];
    let pressed =
        press_rasters(&hand.pads[camera.pad], &rasters, &gel, PAD_FORCE, |x, y| ball(x, y - camera.center_y))?;
    Ok(timed(|| {
        drop(black_box(small.render_with_brightness(sensor, &pressed.maps[0], 1.0, &mut ChaCha8Rng::seed_from_u64(1))))
    }))
}

/// Returns `count` second grasps of the built-in grasp pairs, repeating them as needed.
fn candidates(count: usize, known: &[GraspCandidate]) -> Vec<GraspCandidate> {
    known.iter().cycle().take(count).cloned().collect()
}

fn main() -> Result<()> {
    // Cargo adds `--bench`.
    let folder = std::env::args().skip(1).find(|word| !word.starts_with("--")).map(PathBuf::from);
    let folder = folder.context("DIR: found none, expected a folder for the pictures")?;
    std::fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    let hand = Hand::ftac();
    let all = pads(&hand)?;
    let (repertoire, plans) = (grasp_verification::builtin::repertoire()?, grasp_verification::builtin::grasp_pairs()?);
    let mut known = Vec::new();
    for plan in &plans.pairs {
        known.extend(
            plan.grasps(&hand, &repertoire)?
                .second_candidates
                .into_iter()
                .filter(|candidate| !candidate.rollouts.is_empty()),
        );
    }
    let posterior = AimPosterior::new(&Uncertainty::standard());
    let pool = |threads: usize| rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let threads: Vec<usize> = (0..).map(|n| 1 << n).take_while(|count| *count <= cores).collect();
    let grown = [
        Growth::measure(
            "objects",
            ["objects on the table", "ms a second of simulated time"],
            &[2, 5, 10, 20, 50],
            |count| {
                let mut robot = scene(count);
                let before = robot.time();
                let wall = timed(|| run_ticks(&mut robot));
                Ok(wall / (robot.time() - before))
            },
        )?,
        Growth::measure("pads", ["pads rendered, 240 x 240", "ms"], &[1, 2, 4, 8, 17], |count| {
            Ok(timed(|| render(&all[..count])))
        })?,
        Growth::measure("resolution", ["pixels along a side", "ms"], &[60, 120, 240], |side| {
            small_image(&hand, &all[0].0, side)
        })?,
        Growth::measure("candidates", ["candidates evaluated", "ms"], &[1, 3, 10, 30, 100, 300, 1000], |count| {
            let judged = candidates(count, &known);
            Ok(timed(|| {
                black_box(best_candidate_score(&judged, &posterior));
            }))
        })?,
        Growth::measure("threads", ["threads, 8 scenes of two objects", "ms"], &threads, |count| {
            let mut scenes: Vec<_> = (0..8).map(|_| scene(2)).collect();
            let pool = pool(count)?;
            Ok(timed(|| pool.install(|| scenes.par_iter_mut().with_max_len(1).for_each(run_ticks))))
        })?,
    ];
    for growth in &grown {
        growth.print();
        growth.draw(&folder)?;
    }
    Ok(())
}
