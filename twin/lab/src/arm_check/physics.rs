//! Gravity compensation under torque control, and response to set-point jumps.

use std::f64::consts::PI;

use anyhow::{Result, anyhow};
use control::arm_clearance::ArmBodies;
use control::inverse_kinematics::Joints;
use grasp_verification::simulated_world::SimulatedWorld;
use hand_model::robot::RobotCommand;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde_json::json;
use sim::tactile::TactileBoard;
use sim::test_stand::tension_goals;
use sim::{SceneSetup, SimulatedRobot};

use crate::hand_check::{CheckRow, Verdict};

/// Number of random postures that are held, and time of each, s.
const POSTURE_COUNT: usize = 24;
const HOLD_TIME: f64 = 1.5;
/// Tolerances: steady-state error of a held joint, rad, and difference of its torque from the gravity torque, N m.
const SAG_TOLERANCE: f64 = 2e-3;
const TORQUE_TOLERANCE: f64 = 0.2;
/// Minimum clearance of the postures from the table, m. Self-collisions are only excluded, because the tubes of every
/// other link are never far apart.
const TABLE_CLEARANCE: f64 = 0.03;
/// Set-point jump of all joints, rad, and tolerance on overshoot, rad.
const SET_POINT_JUMP: f64 = 0.6;
const OVERSHOOT_TOLERANCE: f64 = 0.02;
/// Payload that the paper holds, kg.
const PAYLOAD_MASS: f64 = 2.5;

/// Computes the potential energy (J) of arm and open hand at `q`, with `load` (kg) in the palm.
fn potential(world: &SimulatedWorld, q: &Joints, load: f64) -> f64 {
    let kinematics = world.cell.kinematics();
    let links = kinematics.link_poses(q);
    let palm = kinematics.palm_pose(q);
    let fingers = world.cell.robot.hand.tree.forward(&world.cell.robot.hand.open_angles());
    let arm: f64 = links.iter().zip(&world.cell.robot.arm.masses).map(|(pose, m)| m.mass * (pose * m.com).z).sum();
    let hand: f64 =
        fingers.iter().zip(&world.cell.robot.hand.masses).map(|(pose, m)| m.mass * (palm * pose * m.com).z).sum();
    let body = &world.cell.robot.hand.palm_mass;
    let held = palm * nalgebra::Point3::new(0.0, -0.02, -0.03);
    9.81 * (arm + hand + body.mass * (palm * body.com).z + load * held.z)
}

/// Computes the gravity torques (N m) of arm, hand and `load` (kg): the gradient of the potential energy.
pub fn gravity_torques(world: &SimulatedWorld, q: &Joints, load: f64) -> Joints {
    let h = 1e-5;
    world.cell.robot.arm.each(|i| {
        let at = |shift: f64| {
            let mut moved = *q;
            moved[i] += shift;
            potential(world, &moved, load)
        };
        (at(h) - at(-h)) / (2.0 * h)
    })
}

fn robot(world: &SimulatedWorld, q: &Joints) -> SimulatedRobot {
    let setup = SceneSetup::ideal(world.cell.world_from_base, *q);
    SimulatedRobot::new(&world.cell.robot, &setup, TactileBoard::blank())
}

/// Draws random postures within the limits, free of collisions with themselves and with the table.
fn postures(world: &SimulatedWorld, seed: u64) -> Result<Vec<Joints>> {
    let kinematics = world.cell.kinematics();
    let bodies = ArmBodies::new(&kinematics, &world.cell.robot.hand)?;
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut found = Vec::new();
    for _ in 0..200 * POSTURE_COUNT {
        let q = world.cell.robot.arm.each(|i| {
            let joint = &world.cell.robot.arm.tree.joints[i];
            let within = |limit: f64, inside: f64| if limit.is_finite() { inside } else { PI.copysign(limit) };
            rng.random_range(within(joint.lower, joint.lower + 0.1)..within(joint.upper, joint.upper - 0.1))
        });
        let free = bodies.clearance(&kinematics, &q)?.distance > 0.0
            && bodies.lowest_point_height(&kinematics, &q)? > TABLE_CLEARANCE;
        if free {
            found.push(q);
        }
        if found.len() == POSTURE_COUNT {
            return Ok(found);
        }
    }
    Err(anyhow!("only {} of {POSTURE_COUNT} random postures of the arm are free", found.len()))
}

/// Holds `q`. Returns the largest sag (rad) and the largest difference of the torques from the gravity torques (N m).
fn hold(world: &SimulatedWorld, q: &Joints) -> (f64, f64) {
    let mut robot = robot(world, q);
    let servos = tension_goals(&world.cell.robot.hand, &[0.0; 5], 0.0);
    while robot.wait_for_tick().time < HOLD_TIME {
        robot.send(&RobotCommand { arm: *q, servos, capture: false });
    }
    let arm = robot.observe().arm;
    let expected = gravity_torques(world, &arm.position, 0.0);
    let sag = (0..q.len()).map(|i| (arm.position[i] - q[i]).abs()).fold(0.0, f64::max);
    (sag, (0..q.len()).map(|i| (arm.torque[i] - expected[i]).abs()).fold(0.0, f64::max))
}

/// Commands a jump of all joints at once. Returns the largest share of a joint's speed limit, the overshoot (rad) and
/// the settling time to within 0.01 rad, s.
fn jump(world: &SimulatedWorld) -> (f64, f64, f64) {
    let start = world.cell.ready_posture;
    // Towards the middle of each joint's range, so that no limit keeps a joint from its goal.
    let goal: Joints =
        start.iter().map(|angle| angle + if *angle > 0.0 { -SET_POINT_JUMP } else { SET_POINT_JUMP }).collect();
    let mut robot = robot(world, &start);
    let servos = tension_goals(&world.cell.robot.hand, &[0.0; 5], 0.0);
    let (mut fastest, mut past, mut there) = (0.0f64, 0.0f64, 0.0);
    while robot.observe().time < 3.0 {
        robot.send(&RobotCommand { arm: goal, servos, capture: false });
        let time = robot.wait_for_tick().time;
        let arm = robot.observe().arm;
        for i in 0..goal.len() {
            fastest = fastest.max(arm.velocity[i].abs() / world.cell.robot.arm.velocity_limits[i]);
            past = past.max((arm.position[i] - goal[i]) * (goal[i] - start[i]).signum());
            if (arm.position[i] - goal[i]).abs() > 0.01 {
                there = time;
            }
        }
    }
    (fastest, past, there)
}

pub fn rows(world: &SimulatedWorld, seed: u64) -> Result<Vec<CheckRow>> {
    let postures = postures(world, seed)?;
    let held: Vec<(f64, f64)> = postures.par_iter().map(|q| hold(world, q)).collect();
    let sag = held.iter().fold(0.0f64, |most, (sag, _)| most.max(*sag));
    let off = held.iter().fold(0.0f64, |most, (_, off)| most.max(*off));
    let share = |load: f64| {
        let of = |q: &Joints| {
            let torques = gravity_torques(world, q, load);
            (0..torques.len()).map(|i| torques[i].abs() / world.cell.robot.arm.effort_limits[i]).fold(0.0, f64::max)
        };
        (of(&world.cell.ready_posture), postures.iter().map(of).filter(|share| *share <= 1.0).count())
    };
    let ((empty, _), (loaded, carried)) = (share(0.0), share(PAYLOAD_MASS));
    let (fastest, past, there) = jump(world);
    Ok(vec![
        CheckRow::new(
            "held against gravity",
            format!("sag {:.3} deg, {off:.2} N m off", sag.to_degrees()),
            "gravity compensated",
            &format!(
                "{POSTURE_COUNT} random free postures held for {HOLD_TIME} s in physics, torques clamped at 39 and 9 N m; sag below {:.2} deg, \
                 torques within {TORQUE_TOLERANCE} N m of the slope of the potential energy",
                SAG_TOLERANCE.to_degrees()
            ),
            Verdict::from_good(sag < SAG_TOLERANCE && off < TORQUE_TOLERANCE),
        ),
        CheckRow::new(
            "torque with 2.5 kg in the hand",
            format!("{:.0} % of the limit", 100.0 * loaded),
            "payload 4 kg mid-range",
            &format!(
                "largest share of a joint's continuous torque at the start of a trial (empty: {:.0} %); {carried} of {POSTURE_COUNT} random \
                 postures can hold it permanently",
                100.0 * empty
            ),
            Verdict::from_good(loaded <= 1.0),
        )
        .with_details(json!({ "postures_that_carry": carried, "postures": POSTURE_COUNT })),
        CheckRow::new(
            "set-point jump of 34 deg",
            format!("{:.2} of the speed limit", fastest),
            "joint speed limits",
            &format!(
                "all joints at once, in physics: maximum speed over the limit at most 1.1, overshoot {:.2} deg (at most {:.1}), \
                 settled after {there:.2} s",
                past.to_degrees(),
                OVERSHOOT_TOLERANCE.to_degrees()
            ),
            Verdict::from_good(fastest < 1.1 && past < OVERSHOOT_TOLERANCE && there < 2.5),
        ),
    ])
}
