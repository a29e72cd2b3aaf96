//! Joints that no actuator pulls. They are held at a coordinate and become fixed joints.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use nalgebra::{Isometry3, Translation3, Unit, UnitQuaternion, Vector3};
use urdf_rs::{JointType, Robot};

use crate::kinematics::pose_from_xyz_rpy;
use crate::urdf::urdf_error;
use ftac_platform::data::DataError;

/// Fixes every joint that neither is `actuated_joints` nor follows a pulled one, at its coordinate in `given` (rad or
/// m) or at rest. Returns their names and coordinates.
pub(crate) fn fix(
    robot: &mut Robot,
    pulled: &BTreeSet<&str>,
    given: &BTreeMap<String, f64>,
    path: &Path,
) -> Result<Vec<(String, f64)>, DataError> {
    check(robot, pulled, given, path)?;
    let moving = |joint: &urdf_rs::Joint| joint.joint_type != JointType::Fixed;
    let held: Vec<(usize, f64)> = (0..robot.joints.len())
        .filter(|n| moving(&robot.joints[*n]) && !pulled.contains(leader(robot, *n).0))
        .map(|n| (n, held_coordinate(robot, n, given)))
        .collect();
    for (n, angle) in &held {
        let joint = &mut robot.joints[*n];
        let axis = Unit::new_normalize(Vector3::from(joint.axis.xyz.0));
        let moved = match joint.joint_type {
            JointType::Prismatic => {
                Isometry3::from_parts(Translation3::from(axis.into_inner() * *angle), UnitQuaternion::identity())
            }
            _ => Isometry3::from_parts(Translation3::identity(), UnitQuaternion::from_axis_angle(&axis, *angle)),
        };
        let pose = pose_from_xyz_rpy(joint.origin.xyz.0, joint.origin.rpy.0) * moved;
        let (roll, pitch, yaw) = pose.rotation.euler_angles();
        joint.origin.xyz.0 = pose.translation.vector.into();
        joint.origin.rpy.0 = [roll, pitch, yaw];
        joint.joint_type = JointType::Fixed;
        joint.mimic = None;
    }
    Ok(held.into_iter().map(|(n, angle)| (robot.joints[n].name.clone(), angle)).collect())
}

/// Resolves the joint that joint `n` ultimately follows, and the multiplier and offset of its angle relative to that
/// joint's.
fn leader(robot: &Robot, n: usize) -> (&str, f64, f64) {
    let joint = &robot.joints[n];
    let (mut name, mut multiplier, mut offset) = (joint.name.as_str(), 1.0, 0.0);
    let mut mimic = joint.mimic.as_ref();
    // The check of the numbers has refused loops.
    while let Some(next) = mimic {
        offset += multiplier * next.offset.unwrap_or(0.0);
        multiplier *= next.multiplier.unwrap_or(1.0);
        name = &next.joint;
        mimic = robot.joints.iter().find(|other| other.name == next.joint).and_then(|other| other.mimic.as_ref());
    }
    (name, multiplier, offset)
}

fn held_coordinate(robot: &Robot, n: usize, given: &BTreeMap<String, f64>) -> f64 {
    let (name, multiplier, offset) = leader(robot, n);
    let leads = robot.joints.iter().find(|other| other.name == name);
    let rest = leads.map_or(0.0, |joint| clamp_to_limits(joint, 0.0));
    let led = given.get(name).copied().unwrap_or(rest);
    clamp_to_limits(&robot.joints[n], multiplier * led + offset)
}

fn clamp_to_limits(joint: &urdf_rs::Joint, angle: f64) -> f64 {
    match joint.joint_type {
        JointType::Revolute | JointType::Prismatic => angle.clamp(joint.limit.lower, joint.limit.upper),
        _ => angle,
    }
}

fn check(robot: &Robot, pulled: &BTreeSet<&str>, given: &BTreeMap<String, f64>, path: &Path) -> Result<(), DataError> {
    for (name, angle) in given {
        let wrong = |found: &str, expected: &str| Err(urdf_error(path, "held".into(), name, found.into(), expected));
        let Some(joint) = robot.joints.iter().find(|joint| joint.name == *name) else {
            return wrong("no such joint", "a joint of the URDF");
        };
        if joint.joint_type == JointType::Fixed || joint.mimic.is_some() || pulled.contains(name.as_str()) {
            return wrong("a joint that is fixed, mimics another or is pulled", "a joint that nothing moves");
        }
        if !angle.is_finite() || clamp_to_limits(joint, *angle) != *angle {
            let (lower, upper) = (joint.limit.lower, joint.limit.upper);
            return wrong(
                &angle.to_string(),
                &format!("a coordinate within the joint's limits, {lower} to {upper} rad or m"),
            );
        }
    }
    Ok(())
}
