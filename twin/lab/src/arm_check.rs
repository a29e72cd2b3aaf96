//! `ftac arm check`: validation of an arm under this project's control, row by row, with method, tolerance and
//! pictures. The Gen3 is also compared with its maker's published data.
//!
//! [`physics`] holds postures against gravity and commands set-point jumps. [`tracking`] lets the inverse kinematics
//! follow palm trajectories, as a reference only and in physics, and times it. [`edges`] leads it to singularities,
//! joint limits and out of reach. [`reach`] maps the workspace of the palm, free of self-collision of the arm.

mod edges;
mod physics;
mod reach;
mod tracking;

use std::path::Path;

use anyhow::{Context, Result};
use control::inverse_kinematics::Joints;
use grasp_verification::simulated_world::SimulatedWorld;
use hand_model::{Arm, RobotModel};
use nalgebra::Vector3;
use scenarios::Scenario;
use serde_json::json;

use crate::hand_check::{CheckRow, Verdict};

/// Name of the arm with published data.
const GEN3_NAME: &str = "gen3";
/// Tolerance on positions of the published kinematic chain, m.
const CHAIN_TOLERANCE: f64 = 1e-4;

/// Returns all rows of the check, in order; pictures go to `out`.
pub fn run(robot: &RobotModel, seed: u64, out: Option<&Path>, quiet: bool) -> Result<Vec<CheckRow>> {
    if let Some(folder) = out {
        std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    }
    let world = SimulatedWorld::new(robot, Scenario::benchmark())?;
    let arm = &world.cell.robot.arm;
    let mut rows = if arm.name == GEN3_NAME { vec![chain_row(arm), limits_row(arm)] } else { Vec::new() };
    rows.extend(physics::rows(&world, seed)?);
    rows.extend(tracking::rows(&world, out)?);
    rows.extend(edges::rows(&world, out)?);
    rows.push(reach::row(&world, out, quiet)?);
    Ok(rows)
}

/// Compares two postures whose tool poses are given in the maker's description.
fn chain_row(arm: &Arm) -> CheckRow {
    let known: [(Joints, Vector3<f64>); 2] =
        [([0.0; 7].into(), Vector3::new(0.0, -0.02485, 1.18739)), (arm.home, Vector3::new(0.45667, 0.00135, 0.43372))];
    let off = known.iter().map(|(q, at)| (arm.tool_pose(q).translation.vector - at).norm()).fold(0.0, f64::max);
    CheckRow::new(
        "joint frames",
        format!("{:.3} mm off", off * 1e3),
        "published chain",
        "tool position upright and at home against Kinova's description; within 0.1 mm",
        Verdict::from_good(off < CHAIN_TOLERANCE),
    )
}

fn limits_row(arm: &Arm) -> CheckRow {
    let published = ([1.3963, 1.3963, 1.3963, 1.3963, 1.2218, 1.2218, 1.2218], [39.0, 39.0, 39.0, 39.0, 9.0, 9.0, 9.0]);
    let ranges = [f64::INFINITY, 2.24, f64::INFINITY, 2.57, f64::INFINITY, 2.09, f64::INFINITY];
    let same = arm.velocity_limits[..] == published.0
        && arm.effort_limits[..] == published.1
        && arm.tree.joints.iter().zip(ranges).all(|(joint, range)| joint.upper == range && joint.lower == -range);
    let table: Vec<_> = (0..7)
        .map(|i| {
            json!({
                "joint": i + 1, "range_rad": ranges[i].is_finite().then_some(ranges[i]),
                "speed_rad_s": arm.velocity_limits[i], "torque_n_m": arm.effort_limits[i],
                "acceleration_rad_s2": arm.acceleration_limits[i],
            })
        })
        .collect();
    CheckRow::new(
        "limits of joints, speeds, torques",
        if same { "equal".into() } else { "differ".into() },
        "published table",
        "ranges, speeds and continuous torques of the parameter file against Kinova's table; exact",
        Verdict::from_good(same),
    )
    .with_details(json!(table))
}
