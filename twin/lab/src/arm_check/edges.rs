//! Behaviour of the inverse kinematics for infeasible targets: out of reach, at singularities, at joint limits, and
//! when the target jumps. It must slow down, report it, and never jump.

use std::path::Path;

use anyhow::Result;
use control::Twist;
use control::inverse_kinematics::{ArmServo, QpMethod};
use control::trajectory::{PathLimits, PosePath};
use grasp_verification::simulated_world::SimulatedWorld;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use report::picture::{save, tile};
use report::plot::Plot;
use serde_json::json;

use crate::hand_check::{CheckRow, Verdict};

/// Control period, s.
const TICK: f64 = 1.0 / 120.0;
/// Settling time after the target has come to rest, s.
const SETTLING_TIME: f64 = 2.0;
/// Tolerance on limits, as a share: rounding only.
const LIMIT_TOLERANCE: f64 = 1e-6;
/// Tracking error that has to be reported, m and rad.
const REPORTED_TRACKING_ERROR: (f64, f64) = (0.02, 0.1);

struct Edge {
    name: &'static str,
    /// True if the target is finally reachable.
    reachable: bool,
    path: PosePath,
}

fn edges(start: Isometry3<f64>) -> Result<Vec<Edge>> {
    let limits = PathLimits::default();
    let shifted = |x: f64, y: f64, z: f64| Translation3::new(x, y, z) * start;
    let turned = |axis: Vector3<f64>| {
        Isometry3::from_parts(start.translation, UnitQuaternion::from_scaled_axis(axis) * start.rotation)
    };
    let above = |x: f64| Isometry3::from_parts(Translation3::new(x, 0.0, 0.75), start.rotation);
    let jump = vec![(0.0, start), (TICK, shifted(0.0, 0.3, 0.2))];
    Ok(vec![
        Edge {
            name: "0.6 m past full reach",
            reachable: false,
            path: PosePath::fastest(&[start, shifted(0.9, 0.0, 0.1)], limits)?,
        },
        Edge {
            name: "over the shoulder's axis",
            reachable: false,
            path: PosePath::fastest(&[start, above(0.45), above(-0.3)], limits)?,
        },
        Edge {
            name: "wrist past its limits",
            reachable: false,
            path: PosePath::fastest(&[start, turned(Vector3::y() * 1.5), turned(Vector3::y() * 3.0)], limits)?,
        },
        Edge { name: "target jumps by 0.36 m", reachable: true, path: PosePath::new(jump)? },
    ])
}

struct EdgeResult {
    name: &'static str,
    /// Largest shares of the speed and of the acceleration limits that were used.
    speed: f64,
    acceleration: f64,
    /// Smallest distance to a position limit, rad.
    limit_margin: f64,
    slowest: f64,
    held_back: usize,
    unreported: usize,
    failed: usize,
    ticks: usize,
    final_error: f64,
    good: bool,
    lines: [Vec<[f64; 2]>; 3],
}

fn follow_edge(world: &SimulatedWorld, edge: &Edge) -> Result<EdgeResult> {
    let mut servo: ArmServo = world.cell.arm_servo(world.cell.ready_posture)?;
    let arm = &world.cell.robot.arm;
    let mut seen = EdgeResult {
        name: edge.name,
        speed: 0.0,
        acceleration: 0.0,
        limit_margin: f64::INFINITY,
        slowest: 1.0,
        held_back: 0,
        unreported: 0,
        failed: 0,
        ticks: ((edge.path.duration() + SETTLING_TIME) / TICK) as usize,
        final_error: 0.0,
        good: false,
        lines: [Vec::new(), Vec::new(), Vec::new()],
    };
    for n in 1..=seen.ticks {
        let time = n as f64 * TICK;
        let (target, twist): (_, Twist) = edge.path.sample(time);
        let before = *servo.qd();
        let step = servo.step(&target, &twist, TICK)?;
        let mut used = 0.0f64;
        for (i, before) in before.iter().enumerate() {
            used = used.max(step.qd[i].abs() / arm.velocity_limits[i]);
            let change = (step.qd[i] - before).abs() / TICK / arm.acceleration_limits[i];
            seen.acceleration = seen.acceleration.max(change);
            let joint = &arm.tree.joints[i];
            seen.limit_margin = seen.limit_margin.min(joint.upper - step.q[i]).min(step.q[i] - joint.lower);
        }
        seen.speed = seen.speed.max(used);
        seen.slowest = seen.slowest.min(step.speed_scale);
        seen.held_back += usize::from(step.saturated);
        seen.failed += usize::from(step.method == QpMethod::Failed);
        // Unreported lag: neither slowed down nor held back, at rest, and yet behind the target.
        let behind = step.position_error > REPORTED_TRACKING_ERROR.0 || step.rotation_error > REPORTED_TRACKING_ERROR.1;
        let moving = step.qd.iter().any(|speed| speed.abs() > 0.02);
        seen.unreported += usize::from(behind && !step.saturated && step.speed_scale > 0.98 && !moving);
        seen.final_error = step.position_error;
        seen.lines[0].push([time, used]);
        seen.lines[1].push([time, step.speed_scale]);
        seen.lines[2].push([time, step.position_error]);
    }
    let kept = seen.speed <= 1.0 + LIMIT_TOLERANCE
        && seen.acceleration <= 1.0 + LIMIT_TOLERANCE
        && seen.limit_margin >= -LIMIT_TOLERANCE;
    let told = if edge.reachable { seen.final_error < 1e-3 } else { seen.held_back > 0 };
    seen.good = kept && told && seen.unreported == 0 && seen.failed == 0;
    Ok(seen)
}

pub fn rows(world: &SimulatedWorld, out: Option<&Path>) -> Result<Vec<CheckRow>> {
    let start = world.cell.kinematics().palm_pose(&world.cell.ready_posture);
    let mut seen = Vec::new();
    for edge in edges(start)? {
        seen.push(follow_edge(world, &edge)?);
    }
    let picture = out.is_some().then(|| "edges.png".to_string());
    let rows = seen
        .iter()
        .map(|s| {
            let mut row = CheckRow::new(
                s.name,
                format!("slowed to {:.2}, reported {} of {}", s.slowest, s.held_back, s.ticks),
                "slows, reports, never jumps",
                &format!(
                    "inverse kinematics at {:.0} Hz: maximum joint speed {:.3} and acceleration {:.3} of the limits (at most 1), {:.3} rad \
                     left to the nearest position limit, {:.0} mm from the target in the end; unreported ticks at rest behind the target: \
                     {}, failed solves: {}",
                    1.0 / TICK,
                    s.speed,
                    s.acceleration,
                    s.limit_margin,
                    s.final_error * 1e3,
                    s.unreported,
                    s.failed
                ),
                Verdict::from_good(s.good),
            )
            .with_details(json!({
                "speed_share": s.speed, "acceleration_share": s.acceleration, "room_rad": s.limit_margin,
                "least_speed_scale": s.slowest, "held_back_ticks": s.held_back, "ticks": s.ticks,
                "unreported_ticks": s.unreported, "failed": s.failed, "left_mm": s.final_error * 1e3,
            }));
            row.picture = picture.clone();
            row
        })
        .collect();
    if let Some(folder) = out {
        let plots: Vec<_> = seen
            .into_iter()
            .map(|s| {
                let [used, scale, left] = s.lines;
                Plot {
                    title: s.name.into(),
                    x: "time [s]".into(),
                    y: "shares of 1; m".into(),
                    lines: vec![("joint speed".into(), used), ("speed scale".into(), scale), ("left [m]".into(), left)],
                }
                .draw()
            })
            .collect();
        save(&tile(&plots, 2), &folder.join("edges.png"))?;
    }
    Ok(rows)
}
