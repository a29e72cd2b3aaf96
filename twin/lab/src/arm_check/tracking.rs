//! Accuracy of path following: the reference of the inverse kinematics, and the arm in physics.

use std::path::Path;
use std::time::Instant;

use anyhow::Result;
use control::Twist;
use control::trajectory::{PathLimits, PosePath, displacement};
use grasp_verification::simulated_world::SimulatedWorld;
use hand_model::robot::RobotCommand;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use report::picture::{save, tile};
use report::plot::Plot;
use serde_json::json;
use sim::tactile::TactileBoard;
use sim::test_stand::tension_goals;
use sim::{SceneSetup, SimulatedRobot};

use crate::hand_check::{CheckRow, Verdict};

/// Tolerances on the distance from a path within the arm's limits, m: of the reference, and of the palm in physics.
const REFERENCE_TOLERANCE: f64 = 1e-3;
const PALM_TOLERANCE: f64 = 5e-3;
/// Limit on the 99th percentile of the solve time, s.
const SOLVE_TIME_LIMIT: f64 = 1e-3;
/// Radius of the circle, m. The speed along it rises and falls smoothly.
const CIRCLE_RADIUS: f64 = 0.10;
/// Time per turn, s. At the top of the circle, with the palm level, joint 5 turns fastest and allows a turn in 8 s. In
/// half of [`TURN_TIME`] it cannot follow, and the reference has to cut the corner.
const TURN_TIME: f64 = 10.0;
const FAST_TURN_TIME: f64 = 5.0;

/// A trajectory of the palm: pose and twist as functions of time, and duration.
struct PalmTrajectory<'a> {
    name: &'static str,
    /// True if it is within a Gen3's limits.
    possible: bool,
    duration: f64,
    at: Box<dyn Fn(f64) -> (Isometry3<f64>, Twist) + 'a>,
}

fn motions(start: Isometry3<f64>) -> Result<Vec<PalmTrajectory<'static>>> {
    let limits = PathLimits::default().scaled(0.5);
    let shifted = |x: f64, y: f64, z: f64| Translation3::new(x, y, z) * start;
    let turned = |axis: Vector3<f64>| {
        let turn = UnitQuaternion::from_scaled_axis(axis);
        Isometry3::from_parts(start.translation, turn * start.rotation)
    };
    let path = |name, through: &[Isometry3<f64>]| -> Result<PalmTrajectory<'static>> {
        let path = PosePath::fastest(through, limits)?;
        Ok(PalmTrajectory {
            name,
            possible: true,
            duration: path.duration(),
            at: Box::new(move |time| path.sample(time)),
        })
    };
    let circle = move |turn: f64, time: f64| {
        let tau = (time / turn).clamp(0.0, 1.0);
        let angle = std::f64::consts::TAU * tau * tau * tau * (10.0 + tau * (6.0 * tau - 15.0));
        let rate = std::f64::consts::TAU * 30.0 * (tau * (1.0 - tau)).powi(2) / turn;
        let at = Translation3::new(0.0, CIRCLE_RADIUS * angle.sin(), CIRCLE_RADIUS * (1.0 - angle.cos())) * start;
        let v = Vector3::new(0.0, angle.cos(), angle.sin()) * CIRCLE_RADIUS * rate;
        (at, Twist::new(v.x, v.y, v.z, 0.0, 0.0, 0.0))
    };
    Ok(vec![
        path("sideways and back", &[start, shifted(0.0, 0.25, 0.0), shifted(0.0, -0.25, 0.0), start])?,
        path("down, out, up", &[start, shifted(0.0, 0.0, -0.15), shifted(0.15, 0.0, -0.15), shifted(0.15, 0.0, 0.1)])?,
        path("turning over", &[start, turned(Vector3::x() * 1.2), turned(Vector3::y() * 0.6), start])?,
        PalmTrajectory {
            name: "circle",
            possible: true,
            duration: TURN_TIME,
            at: Box::new(move |time| circle(TURN_TIME, time)),
        },
        PalmTrajectory {
            name: "circle, too fast",
            possible: false,
            duration: FAST_TURN_TIME,
            at: Box::new(move |time| circle(FAST_TURN_TIME, time)),
        },
    ])
}

struct TrackingResult {
    name: &'static str,
    possible: bool,
    /// Deviation from the path over time (s, mm): of the reference, and of the palm.
    reference: Vec<[f64; 2]>,
    palm: Vec<[f64; 2]>,
    turn: f64,
    saturated: usize,
    solves: Vec<f64>,
}

fn track(world: &SimulatedWorld, motion: &PalmTrajectory<'_>) -> Result<TrackingResult> {
    let mut servo = world.cell.arm_servo(world.cell.ready_posture)?;
    let setup = SceneSetup::ideal(world.cell.world_from_base, world.cell.ready_posture);
    let mut robot = SimulatedRobot::new(&world.cell.robot, &setup, TactileBoard::blank());
    let servos = tension_goals(&world.cell.robot.hand, &[0.0; 5], 0.0);
    let tick = robot.tick_length();
    let mut out = TrackingResult {
        name: motion.name,
        possible: motion.possible,
        reference: Vec::new(),
        palm: Vec::new(),
        turn: 0.0,
        saturated: 0,
        solves: Vec::new(),
    };
    for n in 1..=((motion.duration + 0.5) / tick) as usize {
        let time = n as f64 * tick;
        let (target, twist) = (motion.at)(time);
        let clock = Instant::now();
        let step = servo.step(&target, &twist, tick)?;
        out.solves.push(clock.elapsed().as_secs_f64());
        out.saturated += usize::from(step.saturated);
        robot.send(&RobotCommand { arm: step.q, servos, capture: false });
        robot.wait_for_tick();
        let (shift, turn) = displacement(&world.cell.kinematics().palm_pose(&robot.observe().arm.position), &target);
        out.turn = out.turn.max(turn.norm());
        out.reference.push([time, step.position_error * 1e3]);
        out.palm.push([time, shift.norm() * 1e3]);
    }
    Ok(out)
}

/// Returns the quantile: the value below which `share` of the sorted values lie.
pub fn quantile(sorted: &[f64], share: f64) -> f64 {
    sorted.get(((sorted.len() as f64 - 1.0) * share).round() as usize).copied().unwrap_or(f64::NAN)
}

pub fn rows(world: &SimulatedWorld, out: Option<&Path>) -> Result<Vec<CheckRow>> {
    let start = world.cell.kinematics().palm_pose(&world.cell.ready_posture);
    let mut followed = Vec::new();
    for motion in motions(start)? {
        followed.push(track(world, &motion)?);
    }
    let most = |line: &[[f64; 2]]| line.iter().fold(0.0f64, |most, p| most.max(p[1]));
    let possible = || followed.iter().filter(|f| f.possible);
    let worst = |of: fn(&TrackingResult) -> &[[f64; 2]]| possible().map(|f| most(of(f))).fold(0.0, f64::max) * 1e-3;
    let (reference, palm) = (worst(|f| &f.reference), worst(|f| &f.palm));
    let turn = possible().map(|f| f.turn).fold(0.0, f64::max);
    let said =
        followed.iter().all(|f| f.possible || f.saturated > 0 || most(&f.reference) * 1e-3 < REFERENCE_TOLERANCE);
    let hasty: Vec<String> = followed
        .iter()
        .filter(|f| !f.possible)
        .map(|f| format!("{:.1} mm off, held back in {} of {} ticks", most(&f.reference), f.saturated, f.solves.len()))
        .collect();
    let mut solves: Vec<f64> = followed.iter().flat_map(|f| f.solves.iter().copied()).collect();
    solves.sort_by(f64::total_cmp);
    let [p50, p99] = [0.5, 0.99].map(|share| quantile(&solves, share));
    let details: Vec<_> = followed
        .iter()
        .map(|f| {
            json!({
                "path": f.name, "possible": f.possible, "reference_mm": most(&f.reference), "palm_mm": most(&f.palm),
                "palm_deg": f.turn.to_degrees(), "held_back_ticks": f.saturated, "ticks": f.solves.len(),
            })
        })
        .collect();
    let mut rows = vec![
        CheckRow::new(
            "palm paths, reference / arm",
            format!("{:.2} / {:.1} mm, {:.2} deg", reference * 1e3, palm * 1e3, turn.to_degrees()),
            "-",
            &format!(
                "maximum distance from four palm paths within the arm's limits: the quadratic program's reference (at \
                 most 1 mm) and the palm in physics under torque control (at most 5 mm); a circle that would exceed the speed limit of a Gen3's \
                 joint 5 is cut short and reported, or followed: {}",
                hasty.join(", ")
            ),
            Verdict::from_good(reference < REFERENCE_TOLERANCE && palm < PALM_TOLERANCE && said),
        )
        .with_details(json!(details)),
        CheckRow::new(
            "time of a solve, p50 / p99",
            format!("{:.0} / {:.0} us", p50 * 1e6, p99 * 1e6),
            "a tick is 8333 us",
            &format!("wall time of {} solves on one thread, this machine as it is now; p99 below 1 ms", solves.len()),
            Verdict::from_good(p99 < SOLVE_TIME_LIMIT),
        )
        .with_details(json!({ "p50_us": p50 * 1e6, "p99_us": p99 * 1e6, "solves": solves.len() })),
    ];
    if let Some(folder) = out {
        let plots: Vec<_> = followed
            .into_iter()
            .map(|f| {
                Plot {
                    title: format!("{}: distance from the path", f.name),
                    x: "time [s]".into(),
                    y: "[mm]".into(),
                    lines: vec![("reference".into(), f.reference), ("arm".into(), f.palm)],
                }
                .draw()
            })
            .collect();
        save(&tile(&plots, 2), &folder.join("tracking.png"))?;
        rows[0].picture = Some("tracking.png".into());
    }
    Ok(rows)
}
