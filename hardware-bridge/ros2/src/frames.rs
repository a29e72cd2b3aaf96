//! Frames of a robot as transforms, with the names of its description ([`robot_urdf`](hand_model::urdf::robot_urdf)).

use std::time::Duration;

use hand_model::RobotModel;
use hand_model::nalgebra::Isometry3;
use hand_model::urdf::camera_pose;
use robot_ros2_messages::{Header, StampedTransform};

/// Frame that does not move.
pub const WORLD_FRAME: &str = "world";
/// Frame of the hand.
const PALM_FRAME: &str = "palm";
/// Frames of the arm's base and of its tool.
const BASE_FRAME: &str = "base_link";
const TOOL_FRAME: &str = "end_effector_link";

/// Returns the frame of a camera's images.
pub fn camera_frame(name: &str) -> String {
    format!("camera_{name}")
}

fn transform(at: Duration, parent: &str, child: &str, pose: &Isometry3<f64>) -> StampedTransform {
    let (position, rotation) = (pose.translation.vector, pose.rotation.coords);
    StampedTransform {
        header: Header::new(at, parent),
        child_frame_id: child.to_owned(),
        translation: position.into(),
        rotation: [rotation.x, rotation.y, rotation.z, rotation.w],
    }
}

/// Returns the frames that are fixed to others: base, tool, palm, pads and cameras.
pub fn fixed_frames(robot: &RobotModel, world_from_base: &Isometry3<f64>, at: Duration) -> Vec<StampedTransform> {
    let RobotModel { arm, hand, .. } = robot;
    let mut frames = vec![
        transform(at, WORLD_FRAME, BASE_FRAME, world_from_base),
        transform(at, &arm.links[arm.last_link()], TOOL_FRAME, &arm.last_from_tool),
        transform(at, TOOL_FRAME, PALM_FRAME, &hand.palm_from_flange.inverse()),
    ];
    for pad in &hand.pads {
        let link = pad.link.map_or(PALM_FRAME, |link| &hand.tree.joints[link].name);
        frames.push(transform(at, link, &format!("pad_{}", pad.name), &pad.link_from_pad));
    }
    for camera in &hand.cameras {
        let pad = format!("pad_{}", hand.pads[camera.pad].name);
        frames.push(transform(at, &pad, &camera_frame(&camera.name), &camera_pose(camera)));
    }
    frames
}

/// Returns the frames of the arm's links at joint angles `q`, rad.
pub fn arm_frames(robot: &RobotModel, q: &[f64], at: Duration) -> Vec<StampedTransform> {
    let arm = &robot.arm;
    let parents = std::iter::once(BASE_FRAME).chain(arm.links.iter().map(String::as_str));
    let joints = arm.tree.joints.iter().zip(q).zip(parents.zip(&arm.links));
    joints.map(|((joint, angle), (parent, child))| transform(at, parent, child, &joint.pose(*angle))).collect()
}

/// Returns the frames of the hand's links at joint angles `q`, rad.
pub fn hand_frames(robot: &RobotModel, q: &[f64], at: Duration) -> Vec<StampedTransform> {
    let joints = &robot.hand.tree.joints;
    let frame = |(joint, angle): (&hand_model::kinematics::Joint, &f64)| {
        let parent = joint.parent.map_or(PALM_FRAME, |parent| &joints[parent].name);
        transform(at, parent, &joint.name, &joint.pose(*angle))
    };
    joints.iter().zip(q).map(frame).collect()
}

/// Returns the name of a hand's joint in the robot's description, by the name of its link.
pub fn hand_joint(link: &str) -> String {
    format!("{link}_joint")
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use hand_model::urdf::robot_urdf;

    use super::*;

    /// The transforms have exactly the frames of the description, each with the same parent.
    #[test]
    fn frames_are_those_of_the_description() {
        let robot = RobotModel::ftac_gen3();
        let base = Isometry3::identity();
        let text = robot_urdf(&robot, &base);
        let named = |line: &str, element: &str| {
            let value = line.split(&format!("<{element} link=\"")).nth(1)?;
            value.split('"').next().map(str::to_owned)
        };
        let described: BTreeSet<(String, String)> = text
            .lines()
            .filter_map(|line| Some((named(line, "parent")?, named(line, "child")?)))
            // The arm's drawn tubes are links of the description alone.
            .filter(|(_, child)| !child.ends_with("_tube"))
            .collect();
        let mut frames = fixed_frames(&robot, &base, Duration::ZERO);
        frames.extend(arm_frames(&robot, &robot.arm.home, Duration::ZERO));
        frames.extend(hand_frames(&robot, &robot.hand.open_angles(), Duration::ZERO));
        let sent: BTreeSet<(String, String)> =
            frames.into_iter().map(|frame| (frame.header.frame_id, frame.child_frame_id)).collect();
        assert_eq!(sent, described);
        assert_eq!(sent.len(), 3 + 17 + 18 + 7 + 15);
    }
}
