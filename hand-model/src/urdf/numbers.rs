//! Checks of a URDF's numbers, from which frames, inertias and collision shapes are built.

use std::path::Path;

use nalgebra::Vector3;
use urdf_rs::{Geometry, Joint, JointType, Link, Robot};

use super::urdf_error;
use ftac_platform::data::DataError;

/// Largest permitted length of a hand or an arm, m.
const MAX_LENGTH: f64 = 10.0;
/// Smallest norm of an axis with a defined direction.
const MIN_AXIS_NORM: f64 = 1e-6;

/// Refuses values from which no mechanism can be built: numbers that are not finite, axes without direction, limits in
/// the wrong order, shapes without extent, joints that mimic themselves.
pub(crate) fn check(robot: &Robot, path: &Path) -> Result<(), DataError> {
    for joint in &robot.joints {
        check_joint(robot, joint, path)?;
    }
    robot.links.iter().try_for_each(|link| check_link(link, path))
}

fn check_joint(robot: &Robot, joint: &Joint, path: &Path) -> Result<(), DataError> {
    let element = || format!("joint[{}]", joint.name);
    let wrong = |field: &str, found: String, expected: &str| Err(urdf_error(path, element(), field, found, expected));
    check_origin(&joint.origin, &element(), path)?;
    if joint.joint_type == JointType::Fixed {
        return Ok(());
    }
    let axis = Vector3::from(joint.axis.xyz.0);
    if !(axis.iter().all(|part| part.is_finite()) && (MIN_AXIS_NORM..=1.0 / MIN_AXIS_NORM).contains(&axis.norm())) {
        return wrong("axis.xyz", format!("{:?}", joint.axis.xyz.0), "three finite numbers, not all zero");
    }
    let (lower, upper) = (joint.limit.lower, joint.limit.upper);
    let bounded = lower.is_finite() && upper.is_finite() && lower <= upper;
    let expected = match joint.joint_type {
        JointType::Revolute => "finite angles in rad, lower at most upper",
        JointType::Prismatic => "finite lengths in m, lower at most upper",
        _ => "",
    };
    if !(bounded || expected.is_empty()) {
        return wrong("limit", format!("lower {lower} and upper {upper}"), expected);
    }
    if joint.joint_type == JointType::Prismatic && lower.abs().max(upper.abs()) > MAX_LENGTH {
        let expected = format!("lengths of at most {MAX_LENGTH} m");
        return wrong("limit", format!("lower {lower} and upper {upper}"), &expected);
    }
    if let Some(mimic) = &joint.mimic {
        for (field, value) in [("mimic.multiplier", mimic.multiplier), ("mimic.offset", mimic.offset)] {
            if value.is_some_and(|value| !value.is_finite()) {
                return wrong(field, format!("{}", value.unwrap_or_default()), "a finite number");
            }
        }
        // A chain of mimics with more links than there are joints is a loop.
        let leader = |name: &str| robot.joints.iter().find(|other| other.name == name)?.mimic.as_ref();
        let chain = std::iter::successors(Some(mimic), |mimic| leader(&mimic.joint));
        if chain.take(robot.joints.len() + 1).count() > robot.joints.len() {
            return wrong("mimic.joint", format!("`{}`, a loop", mimic.joint), "a joint that does not follow this one");
        }
    }
    Ok(())
}

fn check_link(link: &Link, path: &Path) -> Result<(), DataError> {
    let element = format!("link[{}]", link.name);
    let inertial = &link.inertial;
    check_origin(&inertial.origin, &format!("{element}.inertial"), path)?;
    let mass = inertial.mass.value;
    if !(mass.is_finite() && mass >= 0.0) {
        return Err(urdf_error(path, element, "inertial.mass", mass.to_string(), "a finite mass in kg, 0 or more"));
    }
    let i = &inertial.inertia;
    let moments = [i.ixx, i.ixy, i.ixz, i.iyy, i.iyz, i.izz];
    if moments.iter().any(|moment| !moment.is_finite()) {
        return Err(urdf_error(
            path,
            element,
            "inertial.inertia",
            format!("{moments:?}"),
            "six finite numbers in kg m2",
        ));
    }
    for (n, collision) in link.collision.iter().enumerate() {
        check_shape(&collision.geometry, &collision.origin, format!("{element}.collision[{n}]"), path)?;
    }
    Ok(())
}

/// Refuses a shape without extent, or with an invalid origin.
pub(crate) fn check_shape(
    geometry: &Geometry,
    origin: &urdf_rs::Pose,
    element: String,
    path: &Path,
) -> Result<(), DataError> {
    check_origin(origin, &element, path)?;
    let (field, lengths) = match geometry {
        Geometry::Box { size } => ("box.size", size.0.to_vec()),
        Geometry::Sphere { radius } => ("sphere.radius", vec![*radius]),
        Geometry::Cylinder { radius, length } => ("cylinder", vec![*radius, *length]),
        // A capsule without length is a sphere.
        Geometry::Capsule { radius, length } => ("capsule", vec![*radius, length + f64::MIN_POSITIVE]),
        // The mesh reader checks its scale.
        Geometry::Mesh { .. } => return Ok(()),
    };
    if !lengths.iter().all(|length| *length > 0.0 && *length <= MAX_LENGTH) {
        let expected = format!("more than 0 and at most {MAX_LENGTH} m");
        return Err(urdf_error(path, element, field, format!("{lengths:?}"), &expected));
    }
    Ok(())
}

fn check_origin(origin: &urdf_rs::Pose, element: &str, path: &Path) -> Result<(), DataError> {
    for (field, values, most) in [("origin.xyz", origin.xyz.0, MAX_LENGTH), ("origin.rpy", origin.rpy.0, f64::MAX)] {
        if !values.iter().all(|value| value.abs() <= most) {
            let expected = if most == MAX_LENGTH {
                format!("finite lengths, at most {MAX_LENGTH} m")
            } else {
                "finite angles in rad".into()
            };
            return Err(urdf_error(path, element.into(), field, format!("{values:?}"), &expected));
        }
    }
    Ok(())
}
