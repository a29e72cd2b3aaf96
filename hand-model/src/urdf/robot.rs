//! Arm and hand as one URDF, as a `robot_description` for RViz.

use std::f64::consts::PI;
use std::fmt::Write as _;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::write::{arm_elements, fixed, hand_elements, link, origin};
use crate::pads::PadCamera;
use crate::{Arm, RobotModel};

/// Distance of a camera's frame from its pad's plane, m.
pub const CAMERA_DISTANCE: f64 = 0.03;

/// Returns `pad_from_camera` of the frame in which a pad's rectified image is a picture: z along the view, x to the right
/// and y down.
///
/// The rectified image shows the surface as seen from outside the hand, so the frame lies [`CAMERA_DISTANCE`] in front of
/// the pad and looks at it. It is not the place of the lens, which is behind the gel.
pub fn camera_pose(camera: &PadCamera) -> Isometry3<f64> {
    let place = Translation3::new(0.0, camera.center_y, CAMERA_DISTANCE);
    Isometry3::from_parts(place, UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI))
}

/// Writes the robot as URDF text: the link `world`, the arm, the hand, and a link `camera_<name>` for each camera. The
/// arm's links are drawn as the tubes of its collision model, the hand's as their covers.
pub fn robot_urdf(robot: &RobotModel, world_from_base: &Isometry3<f64>) -> String {
    let RobotModel { arm, hand, .. } = robot;
    let mut out = format!("<?xml version=\"1.0\"?>\n<robot name=\"{}\">\n", robot.name);
    link(&mut out, "world", None, None);
    fixed(&mut out, "base", world_from_base, "world", "base_link");
    arm_elements(&mut out, arm);
    draw_tubes(&mut out, arm);
    fixed(&mut out, "mount", &hand.palm_from_flange.inverse(), "end_effector_link", "palm");
    hand_elements(&mut out, hand);
    for camera in &hand.cameras {
        let (name, pad) = (format!("camera_{}", camera.name), format!("pad_{}", hand.pads[camera.pad].name));
        link(&mut out, &name, None, None);
        fixed(&mut out, &format!("{name}_joint"), &camera_pose(camera), &pad, &name);
    }
    out.push_str("</robot>\n");
    out
}

/// Appends a link with a drawn cylinder for each tube of the arm, fixed to the link that it belongs to.
fn draw_tubes(out: &mut String, arm: &Arm) {
    let links = std::iter::once("base_link").chain(arm.links.iter().map(String::as_str));
    for ((link, end), radius) in links.zip(arm.tube_ends()).zip(&arm.radii) {
        let length = end.norm();
        let rotation = UnitQuaternion::rotation_between(&Vector3::z(), &end)
            .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI));
        let pose = Isometry3::from_parts(Translation3::from(0.5 * end), rotation);
        let name = format!("{link}_tube");
        let _ = writeln!(
            out,
            "  <link name=\"{name}\">\n    <visual>{}<geometry><cylinder length=\"{length:.6}\" radius=\"{radius:.6}\"/></geometry></visual>\n  </link>",
            origin(&pose)
        );
        fixed(out, &format!("{name}_joint"), &Isometry3::identity(), link, &name);
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use nalgebra::Point3;

    use super::*;
    use crate::pads::IMAGE_SIZE;
    use crate::urdf::parse_tree;

    /// Read back, the palm is at the place that the model gives it.
    #[test]
    fn arm_and_hand_are_one_tree() {
        let robot = RobotModel::ftac_gen3();
        let base = Isometry3::translation(0.1, 0.2, 0.3);
        let text = robot_urdf(&robot, &base);
        let tree = parse_tree(text.as_bytes(), Path::new("robot.urdf"), &["joint_7", "little_3_joint"]).expect("read");
        assert_eq!(tree.len(), robot.arm.joints() + robot.hand.tree.len());
        let angle = |name: &str| {
            let arm = robot.arm.tree.find(name).map(|joint| robot.arm.home[joint]);
            arm.unwrap_or_else(|| 0.02 * robot.hand.tree.find(name.trim_end_matches("_joint")).expect("known") as f64)
        };
        let q: Vec<f64> = tree.joints.iter().map(|joint| angle(&joint.name)).collect();
        let found = tree.forward(&q)[tree.find("little_3_joint").expect("a joint")];
        let hand: Vec<f64> = (0..robot.hand.tree.len()).map(|joint| 0.02 * joint as f64).collect();
        let palm = base * robot.arm.tool_pose(&robot.arm.home) * robot.hand.palm_from_flange.inverse();
        let little = palm * robot.hand.tree.forward(&hand)[robot.hand.tree.find("little_3").expect("a joint")];
        assert!((found.translation.vector - little.translation.vector).norm() < 1e-6, "{found} {little}");
    }

    /// A pixel lies on the ray that the pinhole camera of [`CAMERA_DISTANCE`] gives it.
    #[test]
    fn a_camera_frame_sees_the_pad_as_its_image() {
        let hand = crate::Hand::ftac();
        for camera in &hand.cameras {
            let (column, row) = (30, 200);
            let (x, y) = camera.pixel_center(column, row);
            let seen = camera_pose(camera).inverse() * Point3::new(x, y, 0.0);
            let center = 0.5 * (IMAGE_SIZE as f64 - 1.0);
            let (dx, dy) = camera.pixel_size();
            assert!((seen.z - CAMERA_DISTANCE).abs() < 1e-12, "{seen}");
            assert!((seen.x - (column as f64 - center) * dx).abs() < 1e-9, "{seen}");
            assert!((seen.y - (row as f64 - center) * dy).abs() < 1e-9, "{seen}");
        }
    }
}
