//! Elements of a URDF.

use std::fmt::Write as _;

use nalgebra::{Isometry3, Vector3};

use crate::hand::MassProperties;
use crate::kinematics::Joint;
use crate::{Arm, Hand};

/// Writes the hand as URDF text. The root link is `palm`; covers are boxes.
pub fn hand_urdf(hand: &Hand) -> String {
    let mut out = header(&hand.parameters.name);
    hand_elements(&mut out, hand);
    out.push_str("</robot>\n");
    out
}

/// Appends links and joints of a hand.
pub(super) fn hand_elements(out: &mut String, hand: &Hand) {
    link(out, "palm", Some(&hand.palm_mass), Some((&hand.palm_cover.link_from_cover, hand.palm_cover.half)));
    for (i, joint) in hand.tree.joints.iter().enumerate() {
        let cover = &hand.covers[i];
        link(out, &joint.name, Some(&hand.masses[i]), Some((&cover.link_from_cover, cover.half)));
        let parent = joint.parent.map_or("palm", |parent| hand.tree.joints[parent].name.as_str());
        joint_element(out, &format!("{}_joint", joint.name), joint, parent, &joint.name, (5.0, 6.8));
    }
    for pad in &hand.pads {
        let parent = pad.link.map_or("palm", |link| hand.tree.joints[link].name.as_str());
        link(out, &format!("pad_{}", pad.name), None, None);
        fixed(out, &format!("pad_{}_joint", pad.name), &pad.link_from_pad, parent, &format!("pad_{}", pad.name));
    }
}

/// Writes the arm as URDF text. The root link is `base_link`, the tool frame `end_effector_link`.
pub fn arm_urdf(arm: &Arm) -> String {
    let mut out = header(&arm.name);
    arm_elements(&mut out, arm);
    out.push_str("</robot>\n");
    out
}

/// Appends links and joints of an arm.
pub(super) fn arm_elements(out: &mut String, arm: &Arm) {
    link(out, "base_link", None, None);
    for (i, joint) in arm.tree.joints.iter().enumerate() {
        link(out, &arm.links[i], Some(&arm.masses[i]), None);
        let parent = i.checked_sub(1).map_or("base_link", |parent| arm.links[parent].as_str());
        joint_element(out, &joint.name, joint, parent, &arm.links[i], (arm.effort_limits[i], arm.velocity_limits[i]));
    }
    link(out, "end_effector_link", None, None);
    fixed(out, "end_effector", &arm.last_from_tool, &arm.links[arm.last_link()], "end_effector_link");
}

fn header(name: &str) -> String {
    format!(
        "<?xml version=\"1.0\"?>\n<!-- Generated from the parameter file by `cargo test -p hand-model`; do not edit. -->\n<robot name=\"{name}\">\n"
    )
}

pub(super) fn origin(pose: &Isometry3<f64>) -> String {
    let t = pose.translation.vector;
    let (r, p, y) = pose.rotation.euler_angles();
    format!("<origin xyz=\"{:.9} {:.9} {:.9}\" rpy=\"{r:.9} {p:.9} {y:.9}\"/>", t.x, t.y, t.z)
}

pub(super) fn link(
    out: &mut String,
    name: &str,
    mass: Option<&MassProperties>,
    cover: Option<(&Isometry3<f64>, Vector3<f64>)>,
) {
    let _ = writeln!(out, "  <link name=\"{name}\">");
    if let Some(m) = mass {
        let i = &m.inertia;
        let _ = writeln!(
            out,
            "    <inertial><origin xyz=\"{:.9} {:.9} {:.9}\" rpy=\"0 0 0\"/><mass value=\"{:.9}\"/><inertia ixx=\"{:.6e}\" ixy=\"{:.6e}\" ixz=\"{:.6e}\" iyy=\"{:.6e}\" iyz=\"{:.6e}\" izz=\"{:.6e}\"/></inertial>",
            m.com.x,
            m.com.y,
            m.com.z,
            m.mass,
            i[(0, 0)],
            i[(0, 1)],
            i[(0, 2)],
            i[(1, 1)],
            i[(1, 2)],
            i[(2, 2)]
        );
    }
    if let Some((pose, half)) = cover {
        for tag in ["visual", "collision"] {
            let _ = writeln!(
                out,
                "    <{tag}>{}<geometry><box size=\"{:.6} {:.6} {:.6}\"/></geometry></{tag}>",
                origin(pose),
                2.0 * half.x,
                2.0 * half.y,
                2.0 * half.z
            );
        }
    }
    out.push_str("  </link>\n");
}

fn joint_element(
    out: &mut String,
    name: &str,
    joint: &Joint,
    parent: &str,
    child: &str,
    (effort, velocity): (f64, f64),
) {
    let continuous = joint.lower.is_infinite();
    let kind = if continuous { "continuous" } else { "revolute" };
    let range =
        if continuous { String::new() } else { format!("lower=\"{:.9}\" upper=\"{:.9}\" ", joint.lower, joint.upper) };
    let _ = writeln!(
        out,
        "  <joint name=\"{name}\" type=\"{kind}\">{}<parent link=\"{parent}\"/><child link=\"{child}\"/><axis xyz=\"0 0 1\"/><limit {range}effort=\"{effort}\" velocity=\"{velocity}\"/></joint>",
        origin(&joint.origin)
    );
}

pub(super) fn fixed(out: &mut String, name: &str, pose: &Isometry3<f64>, parent: &str, child: &str) {
    let _ = writeln!(
        out,
        "  <joint name=\"{name}\" type=\"fixed\">{}<parent link=\"{parent}\"/><child link=\"{child}\"/></joint>",
        origin(pose)
    );
}
