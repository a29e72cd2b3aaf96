//! Writing and reading of URDF.
//!
//! [`hand_urdf`] and [`arm_urdf`] write a model as URDF; those of the built-in hand and arm are in `data/*.urdf`.
//! [`robot_urdf`] writes arm and hand as one. Any URDF can be read into a [`Tree`], with errors that name file, element
//! and field.
//!
//! ```
//! use std::path::Path;
//!
//! use hand_model::Arm;
//! use hand_model::urdf::{arm_urdf, parse_tree};
//!
//! let text = arm_urdf(&Arm::gen3());
//! let tree = parse_tree(text.as_bytes(), Path::new("gen3.urdf"), &["joint_1", "joint_7"])?;
//! assert_eq!(tree.len(), 7);
//! # Ok::<(), hand_model::DataError>(())
//! ```

pub(crate) mod numbers;
mod robot;
mod screen;
mod write;

use std::io::Read as _;
use std::path::Path;

use nalgebra::{Isometry3, Unit, Vector3};

use crate::kinematics::{Joint, JointKind, Tree, pose_from_xyz_rpy};
use ftac_platform::data::DataError;

pub use robot::{CAMERA_DISTANCE, camera_pose, robot_urdf};
pub use write::{arm_urdf, hand_urdf};

/// Reads the movable joints of a URDF into a tree; fixed joints are folded into the frames. `expected` names joints
/// that must exist. Link inertias are checked, because a moving link without mass breaks any dynamics engine.
///
/// # Errors
/// [`DataError`] with the element and field at fault.
pub fn read_tree(path: &Path, expected: &[&str]) -> Result<Tree, DataError> {
    parse_tree(&read_bytes(path)?, path, expected)
}

/// Like [`read_tree`], from text; `path` is used in errors.
///
/// # Errors
/// [`DataError`] with the element and field at fault.
pub fn parse_tree(text: &[u8], path: &Path, expected: &[&str]) -> Result<Tree, DataError> {
    let (robot, _) = parse_robot(text, path)?;
    check_masses(&robot, path)?;
    frames(&robot, path, expected)
}

/// Reads the joints' frames only, to inspect a file whose links need no mass.
///
/// # Errors
/// [`DataError`] with the element and field at fault.
pub fn read_frames(path: &Path, expected: &[&str]) -> Result<Tree, DataError> {
    frames(&parse_robot(&read_bytes(path)?, path)?.0, path, expected)
}

/// Reads the bytes of a URDF, a file of bounded size.
pub(crate) fn read_bytes(path: &Path) -> Result<Vec<u8>, DataError> {
    let io = |source| DataError::Io { path: path.into(), source };
    if !std::fs::metadata(path).map_err(io)?.is_file() {
        return Err(DataError::field(path, "name", "a folder or a device", "a URDF file"));
    }
    let mut bytes = Vec::new();
    // One byte more than allowed, so that the screening detects a file that is too large.
    let file = std::fs::File::open(path).map_err(io)?;
    file.take(screen::MAX_FILE_SIZE + 1).read_to_end(&mut bytes).map_err(io)?;
    Ok(bytes)
}

/// Parses the robot of a URDF. Also returns the deviations from what the file says, a line each.
pub(crate) fn parse_robot(bytes: &[u8], path: &Path) -> Result<(urdf_rs::Robot, Vec<String>), DataError> {
    let screened = screen::screen(bytes, path)?;
    let mut robot = urdf_rs::read_from_string(&screened.text)
        .map_err(|error| DataError::field(path, "robot", error, "a well-formed URDF with a <robot> element"))?;
    let mut notes = Vec::new();
    for joint in robot.joints.iter_mut().filter(|joint| screened.unlimited.contains(&joint.name)) {
        if joint.joint_type == urdf_rs::JointType::Prismatic {
            let expected = "lower and upper in m of a joint that slides";
            return Err(urdf_error(path, format!("joint[{}]", joint.name), "limit", "none".into(), expected));
        }
        joint.joint_type = urdf_rs::JointType::Continuous;
        let file = path.display();
        notes.push(format!(
            "{file}: joint[{}].limit: no lower and upper of a revolute joint; it turns without limits",
            joint.name
        ));
    }
    numbers::check(&robot, path)?;
    Ok((robot, notes))
}

/// Builds an error of `path` at an element's field.
pub(crate) fn urdf_error(path: &Path, element: String, field: &str, found: String, expected: &str) -> DataError {
    DataError::field(path, format!("{element}.{field}"), found, expected)
}

pub(crate) fn check_masses(robot: &urdf_rs::Robot, path: &Path) -> Result<(), DataError> {
    for joint in robot.joints.iter().filter(|joint| joint.joint_type != urdf_rs::JointType::Fixed) {
        let link = robot.links.iter().find(|link| link.name == joint.child.link);
        if link.is_some_and(|link| link.inertial.mass.value <= 0.0) {
            return Err(urdf_error(
                path,
                format!("link[{}]", joint.child.link),
                "inertial.mass",
                "0".into(),
                "a positive mass in kg on a link that a joint moves",
            ));
        }
    }
    Ok(())
}

pub(crate) fn frames(robot: &urdf_rs::Robot, path: &Path, expected: &[&str]) -> Result<Tree, DataError> {
    let fault =
        |element: String, field: &str, found: String, expected: &str| urdf_error(path, element, field, found, expected);
    for name in expected {
        if !robot.joints.iter().any(|joint| joint.name == *name) {
            return Err(fault(
                "robot".into(),
                "joint",
                format!("no joint `{name}`"),
                &format!("a joint named `{name}`"),
            ));
        }
    }
    check_links(robot, &fault)?;
    let mut roots = robot.links.iter().filter(|link| !robot.joints.iter().any(|joint| joint.child.link == link.name));
    let Some(root) = roots.next() else {
        return Err(fault("robot".into(), "joint", "a loop: every link is some joint's child".into(), "one root link"));
    };
    let joints = joints_from(robot, &root.name, &fault)?;
    let movable = robot.joints.iter().filter(|joint| joint.joint_type != urdf_rs::JointType::Fixed).count();
    if joints.len() != movable {
        let loose: Vec<String> = roots.map(|link| format!("`{}`", link.name)).collect();
        let loose = if loose.is_empty() { String::new() } else { format!("; no joint carries {}", loose.join(", ")) };
        return Err(fault(
            "robot".into(),
            "joint",
            format!("{} of {movable} joints reachable from `{}`{loose}", joints.len(), root.name),
            "one connected tree without loops",
        ));
    }
    Ok(Tree { joints })
}

/// Error constructor for an element of the file: element, field, found, expected.
type ErrorFn<'a> = &'a dyn Fn(String, &str, String, &str) -> DataError;

/// Checks that every joint names links of the file, and that no link is carried by two joints.
fn check_links(robot: &urdf_rs::Robot, fault: ErrorFn) -> Result<(), DataError> {
    let linked = |name: &str| robot.links.iter().find(|link| link.name == name);
    for joint in &robot.joints {
        for (field, name) in [("parent", &joint.parent.link), ("child", &joint.child.link)] {
            if linked(name).is_none() {
                return Err(fault(
                    format!("joint[{}]", joint.name),
                    field,
                    format!("`{name}`"),
                    "the name of a <link> in this file",
                ));
            }
        }
    }
    let doubled = |names: &[&str]| {
        names.iter().enumerate().find(|(n, name)| names[..*n].contains(name)).map(|(_, name)| (*name).to_owned())
    };
    let links: Vec<&str> = robot.links.iter().map(|link| link.name.as_str()).collect();
    let joints: Vec<&str> = robot.joints.iter().map(|joint| joint.name.as_str()).collect();
    for (element, name) in [("link", doubled(&links)), ("joint", doubled(&joints))] {
        if let Some(name) = name {
            return Err(fault(format!("{element}[{name}]"), "name", "it twice".into(), "each name once"));
        }
    }
    for (n, joint) in robot.joints.iter().enumerate() {
        let child = &joint.child.link;
        if let Some(first) = robot.joints[..n].iter().find(|other| other.child.link == *child) {
            let found = format!("`{child}`, which joint `{}` carries already", first.name);
            return Err(fault(
                format!("joint[{}]", joint.name),
                "child",
                found,
                "a link of its own: a tree without loops",
            ));
        }
    }
    Ok(())
}

/// Collects the movable joints of the tree below link `root`, parents first.
fn joints_from(robot: &urdf_rs::Robot, root: &str, fault: ErrorFn) -> Result<Vec<Joint>, DataError> {
    let mut joints = Vec::new();
    // Breadth first from the root; each entry is (link, index of the last movable joint, pose of the link in that joint).
    let mut open = std::collections::VecDeque::from([(root.to_owned(), None::<usize>, Isometry3::identity())]);
    while let Some((name, parent, pose)) = open.pop_front() {
        for joint in robot.joints.iter().filter(|joint| joint.parent.link == name) {
            let origin = pose * pose_from_xyz_rpy(joint.origin.xyz.0, joint.origin.rpy.0);
            match joint.joint_type {
                urdf_rs::JointType::Fixed => open.push_back((joint.child.link.clone(), parent, origin)),
                urdf_rs::JointType::Revolute | urdf_rs::JointType::Continuous | urdf_rs::JointType::Prismatic => {
                    let continuous = joint.joint_type == urdf_rs::JointType::Continuous;
                    let slides = joint.joint_type == urdf_rs::JointType::Prismatic;
                    joints.push(Joint {
                        name: joint.name.clone(),
                        parent,
                        kind: if slides { JointKind::Slide } else { JointKind::Turn },
                        origin,
                        axis: Unit::new_normalize(Vector3::from(joint.axis.xyz.0)),
                        lower: if continuous { f64::NEG_INFINITY } else { joint.limit.lower },
                        upper: if continuous { f64::INFINITY } else { joint.limit.upper },
                    });
                    open.push_back((joint.child.link.clone(), Some(joints.len() - 1), Isometry3::identity()));
                }
                ref other => {
                    return Err(fault(
                        format!("joint[{}]", joint.name),
                        "type",
                        format!("{other:?}"),
                        "revolute, continuous, prismatic or fixed",
                    ));
                }
            }
        }
    }
    Ok(joints)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Arm, Hand};

    /// Path of a checked-in file: Cargo runs a crate's tests in the crate's folder.
    fn data(name: &str) -> std::path::PathBuf {
        Path::new("data").join(name)
    }

    /// The checked-in URDFs equal the generated ones. Run with `FTAC_UPDATE_URDF=1` to regenerate them.
    #[test]
    fn checked_in_urdfs_are_current() {
        for (name, text) in [("ftac_hand.urdf", hand_urdf(&Hand::ftac())), ("gen3.urdf", arm_urdf(&Arm::gen3()))] {
            if std::env::var_os("FTAC_UPDATE_URDF").is_some() {
                std::fs::write(data(name), &text).expect("write the URDF");
            }
            assert_eq!(std::fs::read_to_string(data(name)).expect("checked-in URDF"), text, "{name} is out of date");
        }
    }

    /// Read back, both URDFs give the same forward kinematics as the parameter files.
    #[test]
    fn urdf_round_trip() {
        let hand = Hand::ftac();
        let read = read_tree(&data("ftac_hand.urdf"), &["thumb_1_joint", "little_3_joint"]).expect("readable");
        assert_eq!(read.len(), 15);
        let q: Vec<f64> = (0..15).map(|j| 0.05 + 0.09 * j as f64).collect();
        // The file is read breadth first: match the joints by name.
        let by_name: Vec<usize> = read
            .joints
            .iter()
            .map(|joint| hand.tree.find(joint.name.trim_end_matches("_joint")).expect("known joint"))
            .collect();
        let reordered: Vec<f64> = by_name.iter().map(|&j| q[j]).collect();
        let (ours, theirs) = (hand.tree.forward(&q), read.forward(&reordered));
        for (i, &j) in by_name.iter().enumerate() {
            assert!((ours[j].translation.vector - theirs[i].translation.vector).norm() < 1e-7);
        }
        let arm = read_tree(&data("gen3.urdf"), &[]).expect("readable");
        let home = Arm::gen3().home;
        let difference =
            arm.forward(&home)[6].translation.vector - Arm::gen3().tree.forward(&home)[6].translation.vector;
        assert!(difference.norm() < 1e-6);
    }

    #[test]
    fn a_missing_joint_is_named() {
        let text = hand_urdf(&Hand::ftac());
        let error =
            parse_tree(text.as_bytes(), Path::new("hand.urdf"), &["sixth_finger"]).expect_err("missing").to_string();
        assert_eq!(
            error,
            "hand.urdf: robot.joint: found no joint `sixth_finger`, expected a joint named `sixth_finger`"
        );
    }

    #[test]
    fn a_massless_link_is_named() {
        let text = hand_urdf(&Hand::ftac()).replacen("<mass value=\"0.030207000\"/>", "<mass value=\"0\"/>", 1);
        let error = parse_tree(text.as_bytes(), Path::new("hand.urdf"), &[]).expect_err("zero mass").to_string();
        assert!(error.starts_with("hand.urdf: link[thumb_1].inertial.mass: found 0"), "{error}");
    }
}
