//! Export of a scene as MJCF, so that a second engine (MuJoCo) can run it: the hand with its springs, collision shapes
//! and props, and optionally the arm. Cables become spatial tendons through the same guide points, or fixed tendons
//! with the same moment arms.
//!
//! A tendon's length is the sum of the straight spans between the guide points at each joint. That is exactly the cable
//! of `hand_model::transmission`, so that moment arms agree by construction. A cable's control is its tension (N), the
//! opposition's is the angle of its servo (rad), and an arm joint's is its set-point (rad).

use std::fmt::Write as _;

use hand_model::hand::{CoverShape, MassProperties};
use hand_model::hand_mechanism::{CableActuator as HandPull, HandMechanism, SolidShape};
use hand_model::kinematics::{Joint, JointKind};
use hand_model::transmission::{Follower, GuidePair, Lever};
use hand_model::{Arm, ArmVector, Hand};
use nalgebra::{Isometry3, Point3, Vector3};
use plant::ArmDefects;
use world::geometry::{ObjectShape, standing_hull};
use world::physics::Physics;

use crate::body::last_from_palm;
use crate::collision_model::{CollisionModel, hull};
use crate::drive::OPPOSITION_STIFFNESS;
use crate::hand_scene::TensionCommand;
use crate::test_stand::Prop;

/// Compiler options of every scene. Inertias of published models often violate the triangle inequality, which MuJoCo
/// requires.
const COMPILER_ELEMENT: &str = "  <compiler angle=\"radian\" autolimits=\"true\" balanceinertia=\"true\"/>\n";
/// Default contact properties. The hand has no friction: that of a pair is the prop's.
const DEFAULT_ELEMENT: &str =
    "  <default>\n    <geom condim=\"4\" friction=\"0.00001 0.00001 0.00001\" solref=\"0.004 1\"/>\n  </default>\n";
/// Smallest volume of a convex part, m3.
const MIN_VOLUME: f64 = 1e-12;
/// Number of subdivisions of a cover's rounding in its mesh.
const ROUNDING_SUBDIVISIONS: usize = 4;

/// The scene to export.
pub struct MjcfScene<'a> {
    /// The hand; its root frame is the world frame if there is no arm.
    pub hand: &'a CollisionModel,
    /// Optional arm at the world's origin with its posture (rad), carrying the hand, and a table at z = 0.
    pub arm: Option<(&'a Arm, ArmVector, &'a Hand)>,
    /// Loose props with their poses in the world.
    pub props: &'a [(Prop, Isometry3<f64>)],
    /// Initial coordinates of the hand's joints (rad or m), and the initial command.
    pub start: Option<(&'a [f64], &'a TensionCommand)>,
    /// Gravity, world, m/s2.
    pub gravity: Vector3<f64>,
    /// Time step, s.
    pub dt: f64,
}

/// Writes the scene as MJCF text.
pub fn write(scene: &MjcfScene<'_>) -> String {
    let hand = &**scene.hand.hand();
    let mut bodies = String::new();
    let mut inside = Links { hand, assets: String::new(), bodies: String::new(), order: Vec::new() };
    inside.root();
    let Links { mut assets, bodies: root, order, .. } = inside;
    let name = link_name(hand, None);
    match &scene.arm {
        None => bodies += &format!("    <body name=\"{name}\" pos=\"0 0 0\">\n{root}    </body>\n"),
        Some((arm, _, own)) => {
            let _ = writeln!(
                bodies,
                "    <geom name=\"table\" type=\"plane\" size=\"1 1 0.1\" pos=\"0.5 0 0\" friction=\"{} 0.005 0.0001\" contype=\"2\" conaffinity=\"1\"/>",
                Physics::standard().table.friction
            );
            arm_bodies(&mut bodies, arm);
            let mount = pose_attributes(&last_from_palm(arm, own, &ArmDefects::default()));
            let _ = writeln!(bodies, "<body name=\"{name}\" gravcomp=\"1\" {mount}>\n{root}");
            bodies += &"</body>\n".repeat(arm.joints() + 1);
        }
    }
    for (prop, pose) in scene.props {
        prop_body(&mut assets, &mut bodies, prop, pose);
    }
    let mut out = format!("<mujoco model=\"{}\">\n{COMPILER_ELEMENT}", escaped(&hand.name));
    out += &option(scene.dt, &scene.gravity);
    let _ = write!(out, "  <asset>\n{assets}  </asset>\n  <worldbody>\n{bodies}  </worldbody>\n");
    out += &contacts(scene.hand);
    out += &followers(hand);
    out += &tendons(hand);
    out += &actuators(hand, scene.arm.map(|(arm, ..)| arm));
    if scene.arm.is_some() || scene.start.is_some() {
        out += &keyframe(scene, &order);
    }
    out += "</mujoco>\n";
    out
}

/// Writes the simulation options and the default properties of shapes.
fn option(dt: f64, gravity: &Vector3<f64>) -> String {
    format!(
        "  <option timestep=\"{dt}\" gravity=\"{}\" integrator=\"implicitfast\" cone=\"elliptic\" impratio=\"10\" noslip_iterations=\"5\"/>\n{DEFAULT_ELEMENT}",
        vector_text(gravity)
    )
}

fn vector_text(v: &Vector3<f64>) -> String {
    format!("{:.9} {:.9} {:.9}", v.x, v.y, v.z)
}

fn pose_attributes(pose: &Isometry3<f64>) -> String {
    let q = pose.rotation;
    format!(
        "pos=\"{}\" quat=\"{:.12} {:.12} {:.12} {:.12}\"",
        vector_text(&pose.translation.vector),
        q.w,
        q.i,
        q.j,
        q.k
    )
}

/// True if the hull of the points is a valid solid. MuJoCo refuses a whole scene for one part without vertices or
/// volume.
fn is_solid(points: &[Point3<f64>]) -> bool {
    points.len() > 3 && standing_hull(points).is_some_and(|hull| hull.mass_properties(1.0).mass() > MIN_VOLUME)
}

fn mesh(out: &mut String, name: &str, points: &[Point3<f64>]) {
    let vertices: Vec<String> = points.iter().map(|point| vector_text(&point.coords)).collect();
    let _ = writeln!(out, "    <mesh name=\"{name}\" inertia=\"convex\" vertex=\"{}\"/>", vertices.join(" "));
}

/// Samples points whose hull is the rounded box, an eighth of a sphere at each corner, in the link frame.
fn cover_points(cover: &CoverShape) -> Vec<Point3<f64>> {
    let inner = cover.half.add_scalar(-cover.radius);
    let mut points = Vec::new();
    for corner in 0..8 {
        let sign = Vector3::from_fn(|axis, _| if corner >> axis & 1 == 1 { 1.0 } else { -1.0 });
        for i in 0..=ROUNDING_SUBDIVISIONS {
            for j in 0..=ROUNDING_SUBDIVISIONS {
                let quarter = |n: usize| std::f64::consts::FRAC_PI_2 * n as f64 / ROUNDING_SUBDIVISIONS as f64;
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
        vector_text(&mass.com.coords),
        mass.mass,
        i[(0, 0)],
        i[(1, 1)],
        i[(2, 2)],
        i[(0, 1)],
        i[(0, 2)],
        i[(1, 2)]
    );
}

/// Escapes a name for use as an attribute value.
fn escaped(name: &str) -> String {
    name.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}

/// Returns the name of a link's body, which is that of the joint that moves it.
fn link_name(hand: &HandMechanism, link: Option<usize>) -> String {
    escaped(link.map_or(&hand.root, |link| &hand.tree.joints[link].name))
}

/// Writer of the MJCF bodies of a hand's links.
struct Links<'a> {
    hand: &'a HandMechanism,
    assets: String,
    bodies: String,
    /// Joints in the order in which their bodies are written.
    order: Vec<usize>,
}

impl Links<'_> {
    /// Writes the content of the root's body: its shapes, guide points and digits.
    fn root(&mut self) {
        if let Some(mass) = &self.hand.root_mass {
            inertial(&mut self.bodies, mass);
        }
        self.link_contents(None);
    }

    fn link_contents(&mut self, link: Option<usize>) {
        self.solids(link);
        self.guides(link);
        let joints = self.hand.tree.joints.iter().enumerate();
        joints.filter(|(_, joint)| joint.parent == link).for_each(|(child, _)| self.link(child));
    }

    /// Writes a link with everything that it carries; its joint is appended to the order.
    fn link(&mut self, link: usize) {
        let (hand, out) = (self.hand, &mut self.bodies);
        let (joint, feel, rest) = (&hand.tree.joints[link], hand.joint_dynamics[link], hand.spring_rest[link]);
        let name = link_name(hand, Some(link));
        self.order.push(link);
        let _ = writeln!(out, "<body name=\"{name}\" {}>", pose_attributes(&joint.origin));
        inertial(out, &hand.masses[link]);
        let kind = if joint.kind == JointKind::Slide { "slide" } else { "hinge" };
        let reference = if rest == 0.0 { String::new() } else { format!(" springref=\"{rest}\"") };
        let _ = writeln!(
            out,
            "<joint name=\"{name}\" type=\"{kind}\" axis=\"{}\" {} damping=\"{}\" armature=\"{}\" stiffness=\"{}\"{reference}/>",
            vector_text(&joint.axis),
            range(joint),
            feel.damping,
            feel.armature,
            feel.spring
        );
        self.link_contents(Some(link));
        self.bodies.push_str("</body>\n");
    }

    /// Writes the collision shapes of a link.
    fn solids(&mut self, link: Option<usize>) {
        let (assets, out) = (&mut self.assets, &mut self.bodies);
        for (n, solid) in self.hand.solids.iter().enumerate().filter(|(_, solid)| solid.link == link) {
            let pose = pose_attributes(&solid.link_from_solid);
            let _ = match &solid.shape {
                SolidShape::Cuboid(half) => writeln!(out, "<geom type=\"box\" size=\"{}\" {pose}/>", vector_text(half)),
                SolidShape::RoundedCuboid(half, radius) => {
                    let cover = CoverShape { link_from_cover: solid.link_from_solid, half: *half, radius: *radius };
                    let name = escaped(&solid.link_name);
                    mesh(assets, &name, &cover_points(&cover));
                    writeln!(out, "<geom name=\"{name}\" type=\"mesh\" mesh=\"{name}\"/>")
                }
                SolidShape::Sphere(radius) => writeln!(out, "<geom type=\"sphere\" size=\"{radius}\" {pose}/>"),
                SolidShape::Cylinder(radius, half) => {
                    writeln!(out, "<geom type=\"cylinder\" size=\"{radius} {half}\" {pose}/>")
                }
                SolidShape::Capsule(radius, half) => {
                    writeln!(out, "<geom type=\"capsule\" size=\"{radius} {half}\" {pose}/>")
                }
                SolidShape::Hull(points) => {
                    let corners: Vec<_> = hull(points).iter().map(|point| solid.link_from_solid * point).collect();
                    if !is_solid(&corners) {
                        continue;
                    }
                    mesh(assets, &format!("solid_{n}"), &corners);
                    writeln!(out, "<geom type=\"mesh\" mesh=\"solid_{n}\"/>")
                }
            };
        }
    }

    /// Writes the guide points on `link`: the one after its joint, and those before the joints of its children.
    fn guides(&mut self, link: Option<usize>) {
        for (index, lever) in self.hand.actuators.iter().flat_map(|pull| &pull.levers) {
            let Lever::Guides(GuidePair { before, after }) = lever else { continue };
            let (joint, name) = (&self.hand.tree.joints[*index], link_name(self.hand, Some(*index)));
            if link == Some(*index) {
                let _ = writeln!(self.bodies, "<site name=\"{name}_after\" pos=\"{} {} 0\"/>", after[0], after[1]);
            }
            if joint.parent == link {
                let at = joint.origin * Point3::new(before[0], before[1], 0.0);
                let _ = writeln!(self.bodies, "<site name=\"{name}_before\" pos=\"{}\"/>", vector_text(&at.coords));
            }
        }
    }
}

fn arm_bodies(out: &mut String, arm: &Arm) {
    for (i, joint) in arm.tree.joints.iter().enumerate() {
        let _ = writeln!(out, "<body name=\"{}\" gravcomp=\"1\" {}>", arm.links[i], pose_attributes(&joint.origin));
        inertial(out, &arm.masses[i]);
        arm_joint(out, joint, arm.armature);
    }
}

fn arm_joint(out: &mut String, joint: &Joint, armature: f64) {
    let range = range(joint);
    let axis = vector_text(&joint.axis);
    let _ = writeln!(
        out,
        "<joint name=\"{}\" type=\"hinge\" axis=\"{axis}\" {range} armature=\"{armature}\"/>",
        joint.name
    );
}

/// Formats the limits of a joint, if it has any.
fn range(joint: &Joint) -> String {
    if joint.lower.is_finite() && joint.upper.is_finite() {
        format!("range=\"{:.9} {:.9}\"", joint.lower, joint.upper)
    } else {
        "limited=\"false\"".into()
    }
}

fn prop_body(assets: &mut String, out: &mut String, prop: &Prop, pose: &Isometry3<f64>) {
    let name = &prop.name;
    let _ = writeln!(out, "    <body name=\"{name}\" {}>\n<freejoint name=\"{name}\"/>", pose_attributes(pose));
    let (com, inertia) = prop.inertia();
    inertial(out, &MassProperties { mass: prop.mass, com, inertia });
    let friction = format!("friction=\"{} 0.0005 0.00001\"", prop.friction);
    for (n, (local, shape)) in prop.parts.iter().enumerate() {
        let geom = match shape {
            ObjectShape::Sphere { radius } => format!("type=\"sphere\" size=\"{radius}\" {}", pose_attributes(local)),
            ObjectShape::Cylinder { radius, half_height } => {
                format!("type=\"cylinder\" size=\"{radius} {half_height}\" {}", pose_attributes(local))
            }
            ObjectShape::Cuboid { half, .. } => {
                format!("type=\"box\" size=\"{}\" {}", vector_text(half), pose_attributes(local))
            }
            ObjectShape::Mesh(_) => {
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

/// Writes the pairs of links that may pass through each other, as in our engine.
fn contacts(model: &CollisionModel) -> String {
    let name = |link| link_name(model.hand(), link);
    let pairs = model.excluded_pairs().into_iter();
    let lines = pairs.map(|(a, b)| format!("    <exclude body1=\"{}\" body2=\"{}\"/>\n", name(a), name(b)));
    format!("  <contact>\n{}  </contact>\n", lines.collect::<String>())
}

/// Writes joints that follow others, as equality constraints.
fn followers(hand: &HandMechanism) -> String {
    let line = |Follower { joint, leader, multiplier, offset }: &Follower| {
        let (joint, leader) = (link_name(hand, Some(*joint)), link_name(hand, Some(*leader)));
        format!("    <joint joint1=\"{joint}\" joint2=\"{leader}\" polycoef=\"{offset} {multiplier} 0 0 0\"/>\n")
    };
    format!("  <equality>\n{}  </equality>\n", hand.followers.iter().map(line).collect::<String>())
}

/// True if a cable acts at constant moment arms (fixed tendon). The length of such a tendon grows with its joints; a
/// cable in guides has its own length.
fn is_fixed(pull: &HandPull) -> bool {
    pull.levers.iter().any(|(_, lever)| matches!(lever, Lever::Constant(_)))
}

fn tendons(hand: &HandMechanism) -> String {
    let mut out = String::from("  <tendon>\n");
    for pull in &hand.actuators {
        let kind = if is_fixed(pull) { "fixed" } else { "spatial" };
        let _ = writeln!(out, "    <{kind} name=\"{}\">", escaped(&pull.name));
        for (joint, lever) in &pull.levers {
            let name = link_name(hand, Some(*joint));
            let _ = match lever {
                Lever::Guides(_) => {
                    writeln!(out, "      <site site=\"{name}_before\"/><site site=\"{name}_after\"/>")
                }
                Lever::Constant(arm) => writeln!(out, "      <joint joint=\"{name}\" coef=\"{arm}\"/>"),
            };
        }
        let _ = writeln!(out, "    </{kind}>");
    }
    out + "  </tendon>\n"
}

fn actuators(hand: &HandMechanism, arm: Option<&Arm>) -> String {
    let mut out = String::from("  <actuator>\n");
    for pull in &hand.actuators {
        let gear = if is_fixed(pull) { "" } else { " gear=\"-1\"" };
        let _ = writeln!(out, "    <motor name=\"{0}\" tendon=\"{0}\"{gear}/>", escaped(&pull.name));
    }
    if let Some(servo) = hand.opposition {
        let thumb = link_name(hand, Some(servo.joint));
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

/// Writes the coordinates of joints (those of the hand in `order`) and props, and the controls, all in the order of the
/// model.
fn keyframe(scene: &MjcfScene<'_>, order: &[usize]) -> String {
    let hand = scene.hand.hand();
    let posture = scene.arm.as_ref().map_or(&[][..], |(_, posture, _)| posture);
    let (open, slack) = (vec![0.0; order.len()], TensionCommand::tensions(&vec![0.0; hand.actuators.len()]));
    let (joints, pull) = scene.start.unwrap_or((&open, &slack));
    let mut qpos: Vec<f64> = posture.iter().copied().chain(order.iter().map(|joint| joints[*joint])).collect();
    for (_, pose) in scene.props {
        let (t, q) = (pose.translation.vector, pose.rotation);
        qpos.extend([t.x, t.y, t.z, q.w, q.i, q.j, q.k]);
    }
    let opposition = hand.opposition.map(|_| pull.opposition);
    let ctrl = pull.tensions.iter().chain(&opposition).chain(posture);
    let join = |values: &mut dyn Iterator<Item = &f64>| values.map(|v| format!("{v:.9}")).collect::<Vec<_>>().join(" ");
    let (qpos, ctrl) = (join(&mut qpos.iter()), join(&mut { ctrl }));
    format!("  <keyframe>\n    <key name=\"start\" qpos=\"{qpos}\" ctrl=\"{ctrl}\"/>\n  </keyframe>\n")
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use hand_model::transmission::Crossing;

    use super::*;

    fn model(hand: &Hand) -> CollisionModel {
        CollisionModel::new(Arc::new(HandMechanism::from_hand(hand, "hand")))
    }

    /// A mesh point lies on the rounded box: its distance from the inner box is the rounding radius.
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

    /// Parts of a decomposition that are empty or flat are not written.
    #[test]
    fn a_part_without_vertices_is_not_exported() {
        let at = |x: f64, y: f64, z: f64| Point3::new(x, y, z);
        let corners =
            |side: f64| (0..8).map(move |n| at(f64::from(n & 1), f64::from(n >> 1 & 1), f64::from(n >> 2)) * side);
        let block: Vec<Point3<f64>> = corners(0.03).collect();
        let flat = vec![at(0.0, 0.0, 0.0), at(0.01, 0.0, 0.0), at(0.01, 0.01, 0.0), at(0.0, 0.01, 0.0)];
        let mesh = world::geometry::hull_mesh(&block).expect("a block");
        let shape = ObjectShape::Mesh(mesh.with_parts(vec![Vec::new(), block, flat, vec![at(0.0, 0.0, 0.0)]]).into());
        let props = [(Prop::new("thing", shape, 0.1, 0.6), Isometry3::identity())];
        let hand = model(&Hand::ftac());
        let text = write(&MjcfScene {
            hand: &hand,
            arm: None,
            props: &props,
            start: None,
            gravity: Vector3::zeros(),
            dt: 0.004,
        });
        let parts: Vec<&str> = text.lines().filter(|line| line.contains("<mesh name=\"thing_")).collect();
        assert!(parts.len() == 1 && text.matches("mesh=\"thing_").count() == 1, "{parts:?}");
        assert!(!text.contains("vertex=\"\""));
    }

    #[test]
    fn every_cable_joint_has_its_guides() {
        let hand = Hand::ftac();
        let model = model(&hand);
        let scene =
            MjcfScene { hand: &model, arm: None, props: &[], start: None, gravity: Vector3::zeros(), dt: 0.004 };
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
