//! The scene as MJCF, so that a second engine (MuJoCo) can run it: the hand with its cables as spatial tendons through the
//! same guide points, springs, covers as convex meshes, props, and the arm where it is wanted.
//!
//! A tendon's length is the sum of the straight spans between the guide points at each joint, which is exactly
//! `hand_model::transmission`'s cable, so that moment arms agree by construction. A cable's control is its tension (N), the
//! opposition's the angle of its servo (rad), an arm joint's its set-point (rad).

mod urdf_hand;

use std::fmt::Write as _;

use hand_model::hand::{CoverShape, MassProperties};
use hand_model::kinematics::{Joint, JointKind};
use hand_model::transmission::{Crossing, Lever};
use hand_model::{Arm, ArmVector, Hand, HandVector};
use nalgebra::{Isometry3, Point3, Vector3};
use plant::ArmDefects;
use world::geometry::Shape;
use world::physics::Physics;

use crate::body::last_from_palm;
use crate::drive::OPPOSITION_STIFFNESS;
use crate::hand_scene::Pull;
use crate::hull::standing_hull;
use crate::stand::Prop;

pub use urdf_hand::{UrdfScene, write as write_urdf};

/// How every scene is read.
const COMPILER: &str = "  <compiler angle=\"radian\" autolimits=\"true\" balanceinertia=\"false\"/>\n";
/// The hand has no friction of its own: that of a pair is the prop's.
const DEFAULTS: &str =
    "  <default>\n    <geom condim=\"4\" friction=\"0.00001 0.00001 0.00001\" solref=\"0.004 1\"/>\n  </default>\n";
/// The least volume of a convex part, m3.
const LEAST_VOLUME: f64 = 1e-12;
/// Steps of a cover's rounding in its mesh.
const ROUNDING: usize = 4;

/// What is written.
pub struct Scene<'a> {
    /// The hand; its palm frame is the world where there is no arm.
    pub hand: &'a Hand,
    /// The arm on the world's origin with its posture (rad) and a table at z = 0.
    pub arm: Option<(&'a Arm, ArmVector)>,
    /// Loose things with their pose in the world.
    pub props: &'a [(Prop, Isometry3<f64>)],
    /// Angles of the hand's joints to begin with, and what is pulled then; rad, N.
    pub start: Option<(HandVector, Pull)>,
    /// m/s2, world.
    pub gravity: Vector3<f64>,
    /// Time step, s.
    pub dt: f64,
}

/// The scene as MJCF text.
pub fn write(scene: &Scene<'_>) -> String {
    let mut assets = String::new();
    let mut bodies = String::new();
    let hand = scene.hand;
    let names = &hand.tree.joints;
    mesh(&mut assets, "palm", &cover_points(&hand.palm_cover));
    for (joint, cover) in names.iter().zip(&hand.covers) {
        mesh(&mut assets, &joint.name, &cover_points(cover));
    }
    match &scene.arm {
        None => {
            let _ = writeln!(bodies, "    <body name=\"palm\" pos=\"0 0 0\">");
            bodies += &palm(hand);
            bodies += "    </body>\n";
        }
        Some((arm, _)) => {
            let _ = writeln!(
                bodies,
                "    <geom name=\"table\" type=\"plane\" size=\"1 1 0.1\" pos=\"0.5 0 0\" friction=\"{} 0.005 0.0001\" contype=\"2\" conaffinity=\"1\"/>",
                Physics::standard().table.friction
            );
            arm_bodies(&mut bodies, arm, hand);
        }
    }
    for (prop, pose) in scene.props {
        prop_body(&mut assets, &mut bodies, prop, pose);
    }
    let mut out = format!("<mujoco model=\"ftac\">\n{COMPILER}");
    out += &option(scene.dt, &scene.gravity);
    let _ = write!(out, "  <asset>\n{assets}  </asset>\n  <worldbody>\n{bodies}  </worldbody>\n");
    out += &contacts(hand);
    out += &tendons(hand);
    out += &actuators(hand, scene.arm.map(|(arm, _)| arm));
    if scene.arm.is_some() || scene.start.is_some() {
        out += &keyframe(scene);
    }
    out += "</mujoco>\n";
    out
}

/// How the engine runs, and what every shape is like.
fn option(dt: f64, gravity: &Vector3<f64>) -> String {
    format!(
        "  <option timestep=\"{dt}\" gravity=\"{}\" integrator=\"implicitfast\" cone=\"elliptic\" impratio=\"10\" noslip_iterations=\"5\"/>\n{DEFAULTS}",
        triple(gravity)
    )
}

fn triple(v: &Vector3<f64>) -> String {
    format!("{:.9} {:.9} {:.9}", v.x, v.y, v.z)
}

fn placed(pose: &Isometry3<f64>) -> String {
    let q = pose.rotation;
    format!("pos=\"{}\" quat=\"{:.12} {:.12} {:.12} {:.12}\"", triple(&pose.translation.vector), q.w, q.i, q.j, q.k)
}

/// Whether the hull of points is a body for the second engine, as for ours: MuJoCo refuses a whole scene for a part without vertices or volume.
fn is_solid(points: &[Point3<f64>]) -> bool {
    points.len() > 3 && standing_hull(points).is_some_and(|hull| hull.mass_properties(1.0).mass() > LEAST_VOLUME)
}

fn mesh(out: &mut String, name: &str, points: &[Point3<f64>]) {
    let vertices: Vec<String> = points.iter().map(|point| triple(&point.coords)).collect();
    let _ = writeln!(out, "    <mesh name=\"{name}\" inertia=\"convex\" vertex=\"{}\"/>", vertices.join(" "));
}

/// Points whose hull is the rounded box: an eighth of a ball at each corner. In the link's frame.
fn cover_points(cover: &CoverShape) -> Vec<Point3<f64>> {
    let inner = cover.half.add_scalar(-cover.radius);
    let mut points = Vec::new();
    for corner in 0..8 {
        let sign = Vector3::from_fn(|axis, _| if corner >> axis & 1 == 1 { 1.0 } else { -1.0 });
        for i in 0..=ROUNDING {
            for j in 0..=ROUNDING {
                let quarter = |n: usize| std::f64::consts::FRAC_PI_2 * n as f64 / ROUNDING as f64;
                let (tilt, turn) = (quarter(i), quarter(j));
                if i == 0 && j > 0 {
                    continue;
                }
                let out = Vector3::new(tilt.sin() * turn.cos(), tilt.sin() * turn.sin(), tilt.cos());
                let at = inner.component_mul(&sign) + cover.radius * out.component_mul(&sign);
                points.push(cover.link_from_cover * Point3::from(at));
            }
        }
    }
    points
}

fn inertial(out: &mut String, mass: &MassProperties) {
    let i = &mass.inertia;
    let _ = writeln!(
        out,
        "<inertial pos=\"{}\" mass=\"{:.9}\" fullinertia=\"{:.9e} {:.9e} {:.9e} {:.9e} {:.9e} {:.9e}\"/>",
        triple(&mass.com.coords),
        mass.mass,
        i[(0, 0)],
        i[(1, 1)],
        i[(2, 2)],
        i[(0, 1)],
        i[(0, 2)],
        i[(1, 2)]
    );
}

/// What is inside the palm's body: its cover, guide points and digits.
fn palm(hand: &Hand) -> String {
    let mut out = String::new();
    inertial(&mut out, &hand.palm_mass);
    out += "<geom name=\"palm\" type=\"mesh\" mesh=\"palm\"/>\n";
    guides_before(&mut out, hand, None);
    for (link, joint) in hand.tree.joints.iter().enumerate() {
        if joint.parent.is_none() {
            finger_link(&mut out, hand, link);
        }
    }
    out
}

fn finger_link(out: &mut String, hand: &Hand, link: usize) {
    let joint = &hand.tree.joints[link];
    let defaults = hand.parameters.joint_defaults;
    let _ = writeln!(out, "<body name=\"{}\" {}>", joint.name, placed(&joint.origin));
    inertial(out, &hand.masses[link]);
    let _ = writeln!(
        out,
        "<joint name=\"{}\" type=\"{}\" axis=\"{}\" range=\"{:.9} {:.9}\" damping=\"{}\" armature=\"{}\" stiffness=\"{}\"/>",
        joint.name,
        if joint.kind == JointKind::Slide { "slide" } else { "hinge" },
        triple(&joint.axis),
        joint.lower,
        joint.upper,
        defaults.damping,
        defaults.armature,
        hand.transmission.springs[link]
    );
    let _ = writeln!(out, "<geom name=\"{0}\" type=\"mesh\" mesh=\"{0}\"/>", joint.name);
    for path in &hand.transmission.cables {
        for crossing in path.joints.iter().filter(|crossing| crossing.joint == link) {
            let Lever::Guides(guides) = crossing.lever else { continue };
            let _ = writeln!(
                out,
                "<site name=\"{}_after\" pos=\"{} {} 0\"/>",
                joint.name, guides.after[0], guides.after[1]
            );
        }
    }
    guides_before(out, hand, Some(link));
    for (child, other) in hand.tree.joints.iter().enumerate() {
        if other.parent == Some(link) {
            finger_link(out, hand, child);
        }
    }
    out.push_str("</body>\n");
}

/// Guide points on `link` before the joints of its children.
fn guides_before(out: &mut String, hand: &Hand, link: Option<usize>) {
    for path in &hand.transmission.cables {
        for Crossing { joint: index, lever, .. } in &path.joints {
            let joint = &hand.tree.joints[*index];
            if let (Lever::Guides(guides), true) = (lever, joint.parent == link) {
                let at = joint.origin * Point3::new(guides.before[0], guides.before[1], 0.0);
                let _ = writeln!(out, "<site name=\"{}_before\" pos=\"{}\"/>", joint.name, triple(&at.coords));
            }
        }
    }
}

fn arm_bodies(out: &mut String, arm: &Arm, hand: &Hand) {
    for (i, joint) in arm.tree.joints.iter().enumerate() {
        let _ = writeln!(out, "<body name=\"{}\" gravcomp=\"1\" {}>", arm.links[i], placed(&joint.origin));
        inertial(out, &arm.masses[i]);
        arm_joint(out, joint, arm.armature);
    }
    let mount = last_from_palm(arm, hand, &ArmDefects::default());
    let _ = writeln!(out, "<body name=\"palm\" gravcomp=\"1\" {}>", placed(&mount));
    *out += &palm(hand);
    *out += &"</body>\n".repeat(arm.joints() + 1);
}

fn arm_joint(out: &mut String, joint: &Joint, armature: f64) {
    let range = range(joint);
    let axis = triple(&joint.axis);
    let _ = writeln!(
        out,
        "<joint name=\"{}\" type=\"hinge\" axis=\"{axis}\" {range} armature=\"{armature}\"/>",
        joint.name
    );
}

/// Limits of a joint, if it has any.
fn range(joint: &Joint) -> String {
    if joint.lower.is_finite() && joint.upper.is_finite() {
        format!("range=\"{:.9} {:.9}\"", joint.lower, joint.upper)
    } else {
        "limited=\"false\"".into()
    }
}

fn prop_body(assets: &mut String, out: &mut String, prop: &Prop, pose: &Isometry3<f64>) {
    let name = &prop.name;
    let _ = writeln!(out, "    <body name=\"{name}\" {}>\n<freejoint name=\"{name}\"/>", placed(pose));
    let (com, inertia) = prop.inertia();
    inertial(out, &MassProperties { mass: prop.mass, com, inertia });
    let friction = format!("friction=\"{} 0.0005 0.00001\"", prop.friction);
    for (n, (local, shape)) in prop.parts.iter().enumerate() {
        let geom = match shape {
            Shape::Sphere { radius } => format!("type=\"sphere\" size=\"{radius}\" {}", placed(local)),
            Shape::Cylinder { radius, half_height } => {
                format!("type=\"cylinder\" size=\"{radius} {half_height}\" {}", placed(local))
            }
            Shape::Cuboid { half, .. } => format!("type=\"box\" size=\"{}\" {}", triple(half), placed(local)),
            Shape::Mesh(_) => {
                for (part, points) in shape.convex_parts().iter().enumerate().filter(|(_, points)| is_solid(points)) {
                    let mesh_name = format!("{name}_{n}_{part}");
                    mesh(assets, &mesh_name, &points.iter().map(|point| local * point).collect::<Vec<_>>());
                    let _ = writeln!(out, "<geom type=\"mesh\" mesh=\"{mesh_name}\" {friction}/>");
                }
                continue;
            }
        };
        let _ = writeln!(out, "<geom {geom} {friction}/>");
    }
    out.push_str("    </body>\n");
}

/// Neighbouring links do not touch, as in our engine.
fn contacts(hand: &Hand) -> String {
    let mut out = String::from("  <contact>\n");
    for joint in &hand.tree.joints {
        let parent = joint.parent.map_or("palm", |parent| hand.tree.joints[parent].name.as_str());
        let _ = writeln!(out, "    <exclude body1=\"{parent}\" body2=\"{}\"/>", joint.name);
    }
    out + "  </contact>\n"
}

fn tendons(hand: &Hand) -> String {
    let mut out = String::from("  <tendon>\n");
    for (actuator, path) in hand.parameters.actuator.iter().zip(&hand.transmission.cables) {
        let fixed = path.joints.iter().any(|crossing| matches!(crossing.lever, Lever::Constant(_)));
        // The length of a tendon of constant arms grows with its joints, that of a spatial one is the cable's own.
        let kind = if fixed { "fixed" } else { "spatial" };
        let _ = writeln!(out, "    <{kind} name=\"{}\">", actuator.name);
        for Crossing { joint, lever, .. } in &path.joints {
            let name = &hand.tree.joints[*joint].name;
            let _ = match lever {
                Lever::Guides(_) => {
                    writeln!(out, "      <site site=\"{name}_before\"/><site site=\"{name}_after\"/>")
                }
                Lever::Constant(arm) => writeln!(out, "      <joint joint=\"{name}\" coef=\"-{arm}\"/>"),
            };
        }
        let _ = writeln!(out, "    </{kind}>");
    }
    out + "  </tendon>\n"
}

fn actuators(hand: &Hand, arm: Option<&Arm>) -> String {
    let mut out = String::from("  <actuator>\n");
    for actuator in hand.parameters.actuator.iter().take(hand.transmission.cables.len()) {
        let _ = writeln!(out, "    <motor name=\"{0}\" tendon=\"{0}\" gear=\"-1\"/>", actuator.name);
    }
    if let Some(joint) = hand.transmission.opposition {
        let thumb = &hand.tree.joints[joint].name;
        let _ = writeln!(out, "    <position name=\"opposition\" joint=\"{thumb}\" kp=\"{OPPOSITION_STIFFNESS}\"/>");
    }
    if let Some(arm) = arm {
        for (i, joint) in arm.tree.joints.iter().enumerate() {
            let _ = writeln!(
                out,
                "    <position name=\"{0}\" joint=\"{0}\" kp=\"{1}\" kv=\"{2}\" forcerange=\"-{3} {3}\"/>",
                joint.name, arm.stiffness[i], arm.damping[i], arm.effort_limits[i]
            );
        }
    }
    out + "  </actuator>\n"
}

/// Joints in the order of the bodies: arm, hand, props.
fn keyframe(scene: &Scene) -> String {
    let posture = scene.arm.as_ref().map_or(&[][..], |(_, posture)| posture);
    let open = || (scene.hand.open(), Pull::tensions(&scene.hand.slack()));
    let (joints, pull) = scene.start.clone().unwrap_or_else(open);
    key([posture, &joints].concat(), scene.props, &[&pull.tensions[..], &[pull.opposition], posture].concat())
}

/// The keyframe of joint angles (rad), props and controls, all in the order of the model.
fn key(mut qpos: Vec<f64>, props: &[(Prop, Isometry3<f64>)], ctrl: &[f64]) -> String {
    for (_, pose) in props {
        let (t, q) = (pose.translation.vector, pose.rotation);
        qpos.extend([t.x, t.y, t.z, q.w, q.i, q.j, q.k]);
    }
    let join = |values: &[f64]| values.iter().map(|v| format!("{v:.9}")).collect::<Vec<_>>().join(" ");
    format!("  <keyframe>\n    <key name=\"start\" qpos=\"{}\" ctrl=\"{}\"/>\n  </keyframe>\n", join(&qpos), join(ctrl))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A mesh point lies on the rounded box: no farther from its inner box than the rounding.
    #[test]
    fn cover_points_lie_on_the_cover() {
        let hand = Hand::ftac();
        let cover = &hand.covers[0];
        let inner = cover.half.add_scalar(-cover.radius);
        for point in cover_points(cover) {
            let local = cover.link_from_cover.inverse_transform_point(&point).coords;
            let core = local.zip_map(&inner, |a, b| a.clamp(-b, b));
            assert!(((local - core).norm() - cover.radius).abs() < 1e-12);
        }
    }

    /// What a decomposition leaves of a part that is empty, or flat, is not written.
    #[test]
    fn a_part_without_vertices_is_not_exported() {
        let at = |x: f64, y: f64, z: f64| Point3::new(x, y, z);
        let corners =
            |side: f64| (0..8).map(move |n| at(f64::from(n & 1), f64::from(n >> 1 & 1), f64::from(n >> 2)) * side);
        let block: Vec<Point3<f64>> = corners(0.03).collect();
        let flat = vec![at(0.0, 0.0, 0.0), at(0.01, 0.0, 0.0), at(0.01, 0.01, 0.0), at(0.0, 0.01, 0.0)];
        let mesh = world::geometry::hull_mesh(&block).expect("a block");
        let shape = Shape::Mesh(mesh.with_parts(vec![Vec::new(), block, flat, vec![at(0.0, 0.0, 0.0)]]).into());
        let props = [(Prop::new("thing", shape, 0.1, 0.6), Isometry3::identity())];
        let hand = Hand::ftac();
        let text =
            write(&Scene { hand: &hand, arm: None, props: &props, start: None, gravity: Vector3::zeros(), dt: 0.004 });
        let parts: Vec<&str> = text.lines().filter(|line| line.contains("<mesh name=\"thing_")).collect();
        assert!(parts.len() == 1 && text.matches("mesh=\"thing_").count() == 1, "{parts:?}");
        assert!(!text.contains("vertex=\"\""));
    }

    #[test]
    fn every_cable_joint_has_its_guides() {
        let hand = Hand::ftac();
        let scene = Scene { hand: &hand, arm: None, props: &[], start: None, gravity: Vector3::zeros(), dt: 0.004 };
        let text = write(&scene);
        for Crossing { joint, .. } in hand.transmission.cables.iter().flat_map(|path| &path.joints) {
            for end in ["before", "after"] {
                let name = format!("{}_{end}", hand.tree.joints[*joint].name);
                assert_eq!(text.matches(&format!("site name=\"{name}\"")).count(), 1, "{name}");
                assert_eq!(text.matches(&format!("site site=\"{name}\"")).count(), 1, "{name}");
            }
        }
        assert_eq!(text.matches("<body ").count(), text.matches("</body>").count());
    }
}
