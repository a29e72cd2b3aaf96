//! A hand from a URDF as MJCF: its links from the URDF, its actuators as fixed tendons with the pulls' moment arms, joints that follow as
//! equality constraints.
//!
//! A control is an actuator's tension (N). Collision shapes are those of [`CollisionModel`], and so are the pairs that pass
//! through each other.

use std::fmt::Write as _;

use hand_model::kinematics::JointKind;
use hand_model::urdf_hand::{SolidShape, UrdfHand};
use nalgebra::{Isometry3, Vector3};

use super::{COMPILER, inertial, is_solid, key, mesh, option, placed, prop_body, range, triple};
use crate::collision_model::{CollisionModel, hull};
use crate::stand::Prop;

/// What is written, without gravity.
pub struct UrdfScene<'a> {
    /// The hand; the frame of its root link is the world.
    pub body: &'a CollisionModel,
    /// Loose things with their pose in the world.
    pub props: &'a [(Prop, Isometry3<f64>)],
    /// Angles of the joints (rad) and tensions (N) to begin with.
    pub start: (&'a [f64], &'a [f64]),
    /// Time step, s.
    pub dt: f64,
}

/// The scene as MJCF text.
pub fn write(scene: &UrdfScene<'_>) -> String {
    let hand = &**scene.body.hand();
    let (mut assets, mut bodies, mut order) = (String::new(), String::new(), Vec::new());
    bodies += "    <body name=\"root\" pos=\"0 0 0\">\n";
    solids(&mut assets, &mut bodies, hand, None);
    for link in children(hand, None) {
        link_body(&mut assets, &mut bodies, hand, link, &mut order);
    }
    bodies += "    </body>\n";
    for (prop, pose) in scene.props {
        prop_body(&mut assets, &mut bodies, prop, pose);
    }
    // Inertias of published models often break the triangle inequality, which MuJoCo insists on.
    let compiler = COMPILER.replace("balanceinertia=\"false\"", "balanceinertia=\"true\"");
    let mut out = format!("<mujoco model=\"{}\">\n{compiler}", escaped(&hand.name));
    out += &option(scene.dt, &Vector3::zeros());
    let _ = write!(out, "  <asset>\n{assets}  </asset>\n  <worldbody>\n{bodies}  </worldbody>\n");
    out += "  <contact>\n";
    for (a, b) in scene.body.excluded() {
        let _ = writeln!(out, "    <exclude body1=\"{}\" body2=\"{}\"/>", body(hand, a), body(hand, b));
    }
    out += "  </contact>\n  <equality>\n";
    for follower in &hand.followers {
        let _ = writeln!(
            out,
            "    <joint joint1=\"{}\" joint2=\"{}\" polycoef=\"{} {} 0 0 0\"/>",
            body(hand, Some(follower.joint)),
            body(hand, Some(follower.leader)),
            follower.offset,
            follower.multiplier
        );
    }
    out += "  </equality>\n  <tendon>\n";
    for (n, pull) in hand.pulls.iter().enumerate() {
        let _ = writeln!(out, "    <fixed name=\"tendon_{n}\">");
        for (joint, arm) in &pull.arms {
            let _ = writeln!(out, "      <joint joint=\"{}\" coef=\"{arm}\"/>", body(hand, Some(*joint)));
        }
        out += "    </fixed>\n";
    }
    out += "  </tendon>\n  <actuator>\n";
    for (n, pull) in hand.pulls.iter().enumerate() {
        let _ = writeln!(out, "    <motor name=\"{}\" tendon=\"tendon_{n}\"/>", escaped(&pull.name));
    }
    let qpos = order.iter().map(|joint| scene.start.0[*joint]).collect();
    out + "  </actuator>\n" + &key(qpos, scene.props, scene.start.1) + "</mujoco>\n"
}

/// A name as an attribute's value.
fn escaped(name: &str) -> String {
    name.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}

/// The body of a link, which has the name of the joint that moves it.
fn body(hand: &UrdfHand, link: Option<usize>) -> String {
    link.map_or("root".into(), |link| escaped(&hand.tree.joints[link].name))
}

fn children(hand: &UrdfHand, link: Option<usize>) -> impl Iterator<Item = usize> {
    hand.tree.joints.iter().enumerate().filter(move |(_, joint)| joint.parent == link).map(|(child, _)| child)
}

/// A link with all that it carries; its joint goes to the end of `order`.
fn link_body(assets: &mut String, out: &mut String, hand: &UrdfHand, link: usize, order: &mut Vec<usize>) {
    let joint = &hand.tree.joints[link];
    let name = body(hand, Some(link));
    order.push(link);
    let _ = writeln!(out, "<body name=\"{name}\" {}>", placed(&joint.origin));
    inertial(out, &hand.masses[link]);
    let (feel, rest) = (hand.feel(link), hand.spring_rest[link]);
    let kind = match joint.kind {
        JointKind::Turn => "hinge",
        JointKind::Slide => "slide",
    };
    let reference = if rest == 0.0 { String::new() } else { format!(" springref=\"{rest}\"") };
    let _ = writeln!(
        out,
        "<joint name=\"{name}\" type=\"{kind}\" axis=\"{}\" {} damping=\"{}\" armature=\"{}\" stiffness=\"{}\"{reference}/>",
        triple(&joint.axis),
        range(joint),
        feel.damping,
        feel.armature,
        feel.spring
    );
    solids(assets, out, hand, Some(link));
    for child in children(hand, Some(link)) {
        link_body(assets, out, hand, child, order);
    }
    out.push_str("</body>\n");
}

/// The collision shapes of a link.
fn solids(assets: &mut String, out: &mut String, hand: &UrdfHand, link: Option<usize>) {
    for (n, solid) in hand.solids.iter().enumerate().filter(|(_, solid)| solid.link == link) {
        let pose = placed(&solid.link_from_solid);
        let _ = match &solid.shape {
            SolidShape::Cuboid(half) => writeln!(out, "<geom type=\"box\" size=\"{}\" {pose}/>", triple(half)),
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
