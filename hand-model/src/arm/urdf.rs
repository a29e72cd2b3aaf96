//! An arm whose frames, limits and masses come from a URDF. The parameter file supplies the rest:
//!
//! ```toml
//! version = 1
//! name = "ur5e"
//! urdf = "ur5e.urdf"       # beside this file
//! flange = "tool0"         # link that carries the hand, z out of it; what the URDF has below it is left out
//! base_mass = 4.0
//! base_radius = 0.075
//! armature = 0.1
//! home = [0.0, -1.57, 1.57, -1.57, -1.57, 0.0]
//!
//! [[joint]]                # of each joint, from the base outwards
//! name = "shoulder_pan_joint"
//! acceleration = 5.0
//! stiffness = 4000.0
//! damping = 200.0
//! radius = 0.06
//! ```

use std::collections::BTreeSet;
use std::path::Path;

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use serde::Deserialize;
use urdf_rs::Robot;

use super::{ArmFile, ArmJointFile};
use crate::hand::MassProperties;
use crate::kinematics::{JointKind, Tree};
use crate::urdf::{check_masses, frames, parse_robot, urdf_error};
use crate::urdf_hand::{carrying_joints, masses};
use ftac_platform::data::{DataError, parse_toml};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct UrdfArmFile {
    version: u32,
    name: String,
    /// Read by [`name`].
    #[allow(dead_code)]
    urdf: String,
    flange: String,
    base_mass: f64,
    base_radius: f64,
    armature: f64,
    home: Vec<f64>,
    joint: Vec<DriveFile>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DriveFile {
    name: String,
    acceleration: f64,
    stiffness: f64,
    damping: f64,
    radius: f64,
    wrist_capsule: Option<[f64; 3]>,
}

/// Returns the name of the URDF that an arm's parameter file refers to.
pub(crate) fn name(text: &str, path: &Path) -> Result<Option<String>, DataError> {
    #[derive(Deserialize)]
    struct UrdfName {
        urdf: Option<String>,
    }
    Ok(parse_toml::<UrdfName>(text, path)?.urdf)
}

/// Merges the parameter file (`text`, `path`) with the URDF (`bytes`, `urdf`).
pub(crate) fn merge_with_urdf(
    (text, path): (&str, &Path),
    (bytes, urdf): (&[u8], &Path),
) -> Result<ArmFile, DataError> {
    let file: UrdfArmFile = parse_toml(text, path)?;
    let (mut robot, _) = parse_robot(bytes, urdf)?;
    if !robot.links.iter().any(|link| link.name == file.flange) {
        return Err(DataError::field(path, "flange", &file.flange, format!("a link of {}", urdf.display())));
    }
    remove_below(&mut robot, &file.flange);
    check_masses(&robot, urdf)?;
    let tree = frames(&robot, urdf, &[])?;
    let carried = carrying_joints(&robot, &tree);
    let last_from_flange = match carried.get(&file.flange) {
        Some((Some(carrier), pose)) if carrier + 1 == tree.len() => *pose,
        _ => return Err(DataError::field(path, "flange", &file.flange, "a link that the last joint moves")),
    };
    check_chain(&tree, &file, path, urdf)?;
    let masses = masses::link_masses(&robot, &tree, &carried, &[], urdf, &mut Vec::new())?;
    // Joints turn about z here, so each link frame is rotated until its joint axis is z.
    let turns: Vec<UnitQuaternion<f64>> = tree.joints.iter().map(|joint| rotation_from_z(&joint.axis)).collect();
    let mut joints = Vec::new();
    for (n, (joint, drive)) in tree.joints.iter().zip(file.joint).enumerate() {
        let of_urdf = robot.joints.iter().find(|other| other.name == joint.name);
        let Some((of_urdf, own)) = of_urdf.zip(turns.get(n)) else { continue };
        for (field, value) in [("velocity", of_urdf.limit.velocity), ("effort", of_urdf.limit.effort)] {
            if !(value.is_finite() && value > 0.0) {
                let element = format!("joint[{}]", joint.name);
                return Err(urdf_error(
                    urdf,
                    element,
                    &format!("limit.{field}"),
                    value.to_string(),
                    "a positive number",
                ));
            }
        }
        let before = n.checked_sub(1).map_or(UnitQuaternion::identity(), |parent| turns[parent]);
        let (xyz, rpy) = xyz_rpy(&(before.inverse() * joint.origin * *own));
        let MassProperties { mass, com, inertia } = masses[n];
        let turn = own.inverse().to_rotation_matrix();
        let i = turn * inertia * turn.transpose();
        let continuous = joint.lower.is_infinite();
        joints.push(ArmJointFile {
            name: drive.name,
            link: of_urdf.child.link.clone(),
            xyz,
            rpy,
            continuous,
            lower: if continuous { 0.0 } else { joint.lower },
            upper: if continuous { 0.0 } else { joint.upper },
            velocity: of_urdf.limit.velocity,
            effort: of_urdf.limit.effort,
            acceleration: drive.acceleration,
            mass,
            com: (turn * com).coords.into(),
            inertia: [i[(0, 0)], i[(0, 1)], i[(0, 2)], i[(1, 1)], i[(1, 2)], i[(2, 2)]],
            stiffness: drive.stiffness,
            damping: drive.damping,
            radius: drive.radius,
            wrist_capsule: drive.wrist_capsule.map(|end| (own.inverse() * Vector3::from(end)).into()),
        });
    }
    let last = turns.last().copied().unwrap_or_default();
    let (tool_xyz, tool_rpy) = xyz_rpy(&(last.inverse() * last_from_flange));
    let UrdfArmFile { version, name, base_mass, base_radius, armature, home, .. } = file;
    Ok(ArmFile { version, name, base_mass, base_radius, armature, home, tool_xyz, tool_rpy, joint: joints })
}

/// Removes every joint and link below `flange`.
fn remove_below(robot: &mut Robot, flange: &str) {
    let mut below = BTreeSet::new();
    let mut open = vec![flange.to_owned()];
    while let Some(parent) = open.pop() {
        for joint in robot.joints.iter().filter(|joint| joint.parent.link == parent) {
            if below.insert(joint.child.link.clone()) {
                open.push(joint.child.link.clone());
            }
        }
    }
    robot.joints.retain(|joint| !below.contains(&joint.child.link));
    robot.links.retain(|link| link.name == flange || !below.contains(&link.name));
}

/// Refuses joints that are not revolute, do not form a serial chain, or are not those of the parameter file.
fn check_chain(tree: &Tree, file: &UrdfArmFile, path: &Path, urdf: &Path) -> Result<(), DataError> {
    for (n, joint) in tree.joints.iter().enumerate() {
        if joint.kind != JointKind::Turn {
            let element = format!("joint[{}]", joint.name);
            return Err(urdf_error(urdf, element, "type", "prismatic".into(), "an arm whose joints all turn"));
        }
        if joint.parent != n.checked_sub(1) {
            let element = format!("joint[{}]", joint.name);
            return Err(urdf_error(
                urdf,
                element,
                "parent",
                "a branch".into(),
                "joints in a row from the base to the flange",
            ));
        }
    }
    let (own, given): (Vec<&str>, Vec<&str>) = (
        tree.joints.iter().map(|joint| joint.name.as_str()).collect(),
        file.joint.iter().map(|joint| joint.name.as_str()).collect(),
    );
    if own != given {
        return Err(DataError::field(
            path,
            "joint",
            given.join(", "),
            format!("the joints of the URDF, {}", own.join(", ")),
        ));
    }
    Ok(())
}

/// Returns the shortest rotation that takes z to `axis`.
fn rotation_from_z(axis: &Vector3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::rotation_between(&Vector3::z(), axis)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI))
}

/// Converts a pose to the file's numbers: translation (m) and roll, pitch, yaw (rad).
fn xyz_rpy(pose: &Isometry3<f64>) -> ([f64; 3], [f64; 3]) {
    let (roll, pitch, yaw) = pose.rotation.euler_angles();
    (pose.translation.vector.into(), [roll, pitch, yaw])
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::Arm;
    use crate::urdf::{arm_urdf, parse_tree};

    /// Three joints about three different axes, none of them z, then a gripper, which is cut off.
    const ODD_AXES_URDF: &str = r#"<robot name="odd">
  <link name="world"/>
  <link name="base"/>
  <link name="a"><inertial><origin xyz="0.01 0.02 0.1" rpy="0.3 0 0"/><mass value="2"/><inertia ixx="0.02" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.01"/></inertial></link>
  <link name="b"><inertial><origin xyz="0.2 0 0.01"/><mass value="1"/><inertia ixx="0.01" ixy="0" ixz="0.001" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
  <link name="c"><inertial><origin xyz="0 0.1 0"/><mass value="0.5"/><inertia ixx="0.002" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.002"/></inertial></link>
  <link name="cover"><inertial><origin xyz="0 0.02 0"/><mass value="0.1"/><inertia ixx="0.0001" ixy="0" ixz="0" iyy="0.0001" iyz="0" izz="0.0001"/></inertial></link>
  <link name="flange"/>
  <link name="finger"/>
  <joint name="fixed" type="fixed"><parent link="world"/><child link="base"/><origin xyz="0 0 0.1" rpy="0 0 0.2"/></joint>
  <joint name="one" type="continuous"><parent link="base"/><child link="a"/><origin xyz="0 0 0.2" rpy="0.1 0 0"/><axis xyz="0 1 0"/><limit velocity="1" effort="50"/></joint>
  <joint name="two" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0.05 0 0.3" rpy="0 0.4 0"/><axis xyz="-1 0 0"/><limit lower="-2" upper="1.5" velocity="1" effort="40"/></joint>
  <joint name="three" type="revolute"><parent link="b"/><child link="c"/><origin xyz="0.4 0 0" rpy="0 0 -0.7"/><axis xyz="0 0 -1"/><limit lower="-1" upper="1" velocity="2" effort="20"/></joint>
  <joint name="covered" type="fixed"><parent link="c"/><child link="cover"/><origin xyz="0 0.05 0.01"/></joint>
  <joint name="flanged" type="fixed"><parent link="c"/><child link="flange"/><origin xyz="0 0.2 0" rpy="-1.5 0 0"/></joint>
  <joint name="grip" type="prismatic"><parent link="flange"/><child link="finger"/><axis xyz="1 0 0"/><limit lower="0" upper="0.1" velocity="1" effort="1"/></joint>
</robot>"#;

    fn drives(names: &[&str], home: &[f64], flange: &str) -> String {
        let joint = |name: &&str| {
            format!(
                "[[joint]]\nname = \"{name}\"\nacceleration = 5.0\nstiffness = 900.0\ndamping = 60.0\nradius = 0.04\n"
            )
        };
        let joints: String = names.iter().map(joint).collect();
        format!(
            "version = 1\nname = \"odd\"\nurdf = \"odd.urdf\"\nflange = \"{flange}\"\nbase_mass = 1.0\nbase_radius = 0.05\n\
             armature = 0.1\nhome = {home:?}\n{joints}"
        )
    }

    fn parse(urdf: &str, drives: &str) -> Result<Arm, DataError> {
        Arm::parse(drives, Path::new("odd.toml"), Some((urdf, Path::new("odd.urdf"))))
    }

    fn odd() -> Arm {
        parse(ODD_AXES_URDF, &drives(&["one", "two", "three"], &[0.0, 0.3, -0.2], "flange")).expect("valid")
    }

    /// Flange and centres of mass are where the URDF places them, whatever its axes are, and every joint turns about z.
    #[test]
    fn a_urdf_with_other_axes_moves_alike() {
        let arm = odd();
        let urdf = parse_tree(
            ODD_AXES_URDF
                .replace("<link name=\"finger\"/>", "")
                .split("  <joint name=\"grip\"")
                .next()
                .map(|text| format!("{text}</robot>"))
                .expect("text")
                .as_bytes(),
            Path::new("odd.urdf"),
            &[],
        )
        .expect("readable");
        let q = [0.7, -0.4, 0.9];
        let (ours, theirs) = (arm.tree.forward(&q), urdf.forward(&q));
        let flange = theirs[2] * crate::kinematics::pose_from_xyz_rpy([0.0, 0.2, 0.0], [-1.5, 0.0, 0.0]);
        let off = arm.tool_pose(&q).inv_mul(&flange);
        assert!(off.translation.vector.norm() < 1e-12 && off.rotation.angle() < 1e-9, "{off}");
        // The last link carries its cover: 0.5 kg at y = 0.1 and 0.1 kg at y = 0.07.
        let middle = Point3::new(0.0, (0.5 * 0.1 + 0.1 * 0.07) / 0.6, 0.1 * 0.01 / 0.6);
        for (n, com) in [Point3::new(0.01, 0.02, 0.1), Point3::new(0.2, 0.0, 0.01), middle].iter().enumerate() {
            assert!((ours[n] * arm.masses[n].com - theirs[n] * com).norm() < 1e-12, "link {n}");
            // The inertia turns with the frame.
            let turn = (ours[n].rotation.inverse() * theirs[n].rotation).to_rotation_matrix();
            let back = turn.transpose() * arm.masses[n].inertia * turn;
            assert!(n != 1 || (back[(0, 2)] - 0.001).abs() < 1e-12, "{back}");
        }
        assert!(arm.tree.joints.iter().all(|joint| joint.axis == Vector3::z_axis()));
        assert_eq!((arm.joints(), arm.tree.joints[0].lower, arm.tree.joints[1].upper), (3, f64::NEG_INFINITY, 1.5));
        assert_eq!(arm.effort_limits[..], [50.0, 40.0, 20.0]);
    }

    /// The Gen3 read from its URDF equals the Gen3 read from its parameter file.
    #[test]
    fn the_gen3_by_its_urdf_is_the_gen3() {
        let own = Arm::gen3();
        let names: Vec<&str> = own.tree.joints.iter().map(|joint| joint.name.as_str()).collect();
        let read = parse(&arm_urdf(&own), &drives(&names, &own.home, "end_effector_link")).expect("valid");
        let off = own.tool_pose(&own.home).inv_mul(&read.tool_pose(&own.home));
        assert!(off.translation.vector.norm() < 1e-7 && off.rotation.angle() < 1e-7, "{off}");
        for (own, read) in own.masses.iter().zip(&read.masses) {
            assert!((own.mass - read.mass).abs() < 1e-6 && (own.com - read.com).norm() < 1e-7);
            assert!((own.inertia - read.inertia).norm() < 1e-6);
        }
        assert_eq!((&own.links, own.velocity_limits), (&read.links, read.velocity_limits));
    }

    #[test]
    fn faults_name_file_and_field() {
        let good = drives(&["one", "two", "three"], &[0.0, 0.3, -0.2], "flange");
        let said = |urdf: &str, drives: &str| parse(urdf, drives).expect_err("refused").to_string();
        for (words, found) in [
            (
                "odd.toml: flange: found nowhere, expected a link of odd.urdf",
                said(ODD_AXES_URDF, &good.replace("\"flange\"", "\"nowhere\"")),
            ),
            (
                "odd.toml: flange: found base, expected a link that the last joint moves",
                said(ODD_AXES_URDF, &good.replace("\"flange\"", "\"base\"")),
            ),
            (
                "odd.toml: joint: found one, three, two, expected the joints of the URDF, one, two, three",
                said(ODD_AXES_URDF, &drives(&["one", "three", "two"], &[0.0; 3], "flange")),
            ),
            (
                "odd.toml: home: found 2 angles, expected 3, one for each joint",
                said(ODD_AXES_URDF, &good.replace("[0.0, 0.3, -0.2]", "[0.0, 0.3]")),
            ),
            (
                "odd.toml: home[1]: found 1.7, expected an angle within the limits of `two`, rad",
                said(ODD_AXES_URDF, &good.replace("0.3", "1.7")),
            ),
            (
                "odd.urdf: joint[two].limit.effort: found 0, expected a positive number",
                said(&ODD_AXES_URDF.replace("effort=\"40\"", "effort=\"0\""), &good),
            ),
            (
                "odd.urdf: joint[three].type: found prismatic, expected an arm whose joints all turn",
                said(
                    &ODD_AXES_URDF.replace("name=\"three\" type=\"revolute\"", "name=\"three\" type=\"prismatic\""),
                    &good,
                ),
            ),
            (
                "odd.urdf: joint[three].parent: found a branch",
                said(
                    &ODD_AXES_URDF
                        .replace("<parent link=\"b\"/><child link=\"c\"/>", "<parent link=\"a\"/><child link=\"c\"/>"),
                    &good,
                ),
            ),
            (
                "odd.toml: base_mass: found 0, expected a positive number",
                said(ODD_AXES_URDF, &good.replace("base_mass = 1.0", "base_mass = 0.0")),
            ),
        ] {
            assert!(found.contains(words), "{words}\n{found}");
        }
    }
}
