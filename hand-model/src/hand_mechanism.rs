//! A hand as physics and grasp synthesis see it: collision shapes, joints and actuators.
//!
//! [`HandMechanism::from_hand`] builds it from a [`Hand`], [`HandMechanism::read`] from any URDF and an actuation file
//! ([`crate::urdf_hand`]).

use nalgebra::{Isometry3, Point3, Vector3};

use crate::Hand;
use crate::hand::{CoverShape, MassProperties};
use crate::kinematics::Tree;
use crate::transmission::{Follower, Lever};

/// Root link of a hand from a parameter file.
const PALM: &str = "palm";
/// Relative tolerance for a torque to be within an effort limit.
const EFFORT_TOLERANCE: f64 = 1e-9;

/// An actuator's cable.
#[derive(Debug, Clone)]
pub struct CableActuator {
    /// Name of the actuator, as in the hand's file.
    pub name: String,
    /// The joints on which the cable acts, with their levers.
    pub levers: Vec<(usize, Lever)>,
    /// Largest tension that the actuator can give and the joints can bear, N, and the source of the limit; none if no
    /// file states one.
    pub max_tension: Option<(f64, String)>,
}

/// Servo that turns the thumb's opposition joint.
#[derive(Debug, Clone, Copy)]
pub struct OppositionServo {
    /// Index of the opposition joint.
    pub joint: usize,
    /// Largest torque, N m.
    pub max_torque: f64,
}

/// Spring, damping and armature of a joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JointDynamics {
    /// Spring stiffness, N m/rad or N/m.
    pub spring: f64,
    /// Damping, N m s/rad or N s/m.
    pub damping: f64,
    /// Armature, kg m2 or kg.
    pub armature: f64,
}

/// A collision shape of a link.
#[derive(Debug, Clone)]
pub struct CollisionSolid {
    /// Joint whose link carries it; `None` for the root.
    pub link: Option<usize>,
    /// Name of its link in the hand's file.
    pub link_name: String,
    /// `link_from_solid`.
    pub link_from_solid: Isometry3<f64>,
    /// Shape, m.
    pub shape: SolidShape,
}

/// Collision shapes of links.
#[derive(Debug, Clone)]
pub enum SolidShape {
    /// Half extents.
    Cuboid(Vector3<f64>),
    /// Half extents including the rounding, and the rounding radius.
    RoundedCuboid(Vector3<f64>, f64),
    /// Radius.
    Sphere(f64),
    /// Radius and half length along z.
    Cylinder(f64, f64),
    /// Radius, and half length along z of the part between the caps.
    Capsule(f64, f64),
    /// The convex hull of these points.
    Hull(Vec<Point3<f64>>),
}

impl SolidShape {
    /// Computes the middle and the half extents of the bounding box, m.
    pub fn extent(&self) -> (Point3<f64>, Vector3<f64>) {
        match self {
            Self::Cuboid(half) | Self::RoundedCuboid(half, _) => (Point3::origin(), *half),
            Self::Sphere(radius) => (Point3::origin(), Vector3::repeat(*radius)),
            Self::Cylinder(radius, half) => (Point3::origin(), Vector3::new(*radius, *radius, *half)),
            Self::Capsule(radius, half) => (Point3::origin(), Vector3::new(*radius, *radius, half + radius)),
            Self::Hull(points) => {
                let bound = |pick: fn(f64, f64) -> f64, start: f64| {
                    points.iter().fold(Vector3::repeat(start), |bound, point| bound.zip_map(&point.coords, pick))
                };
                let (low, high) = (bound(f64::min, f64::INFINITY), bound(f64::max, f64::NEG_INFINITY));
                (Point3::from(0.5 * (low + high)), 0.5 * (high - low))
            }
        }
    }
}

/// Vertices and triangles.
pub type Triangles = (Vec<Point3<f64>>, Vec<[u32; 3]>);

/// The surface of a mesh that is represented by convex parts.
#[derive(Debug, Clone)]
pub struct MeshSurface {
    /// Joint whose link carries it; `None` for the root.
    pub link: Option<usize>,
    /// Name of its link in the URDF.
    pub link_name: String,
    /// `link_from_mesh`.
    pub link_from_mesh: Isometry3<f64>,
    /// Vertices (m) and triangles.
    pub triangles: Triangles,
    /// Largest distance by which the convex parts protrude from the surface, m.
    pub protrusion: f64,
}

/// The palm of a hand from a URDF.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PalmDescription {
    /// Links of the root that may support an object.
    pub links: Vec<String>,
    /// Unit vector out of the palm, root frame.
    pub facing: Option<Vector3<f64>>,
}

/// Joints, links and actuators of a hand.
///
/// ```
/// use hand_model::Hand;
/// use hand_model::hand_mechanism::HandMechanism;
///
/// let mechanism = HandMechanism::from_hand(&Hand::ftac(), "ftac");
/// // Efforts (N m) on the joints of the open hand if each of the five cables is pulled by 2 N.
/// let open = mechanism.rest_coordinates();
/// let efforts = mechanism.torques(&open, &[2.0; 5]);
/// let index = mechanism.tree.find("index_1").expect("a joint of this name");
/// assert!(efforts[index] > 0.01);
/// ```
#[derive(Debug, Clone)]
pub struct HandMechanism {
    /// Name of the hand.
    pub name: String,
    /// Name of the root link.
    pub root: String,
    /// Moving joints, parents first.
    pub tree: Tree,
    /// Mass of the root; none where it does not matter because the root never moves.
    pub root_mass: Option<MassProperties>,
    /// Mass of each moving link, including everything fixed to it.
    pub masses: Vec<MassProperties>,
    /// Collision shapes.
    pub solids: Vec<CollisionSolid>,
    /// Surfaces of the meshes that the solids represent.
    pub surfaces: Vec<MeshSurface>,
    /// Links (of the URDF) that have a mass or a visual shape but no collision shape.
    pub links_without_collision: Vec<String>,
    /// Joints that follow others (mimic joints).
    pub followers: Vec<Follower>,
    /// Actuators that pull cables.
    pub actuators: Vec<CableActuator>,
    /// Servo of the opposition; none in a hand without it.
    pub opposition: Option<OppositionServo>,
    /// Effort limit of each joint, N m or N; none if no file states one.
    pub effort_limits: Vec<Option<f64>>,
    /// Spring, damping and armature of each joint.
    pub joint_dynamics: Vec<JointDynamics>,
    /// Rest coordinate of each joint's spring, rad or m.
    pub spring_rest: Vec<f64>,
    /// True if digits interact through contact alone: neither a joint nor a link couples them, and the palm's solid
    /// collides with their first links.
    pub independent_digits: bool,
    /// Links of the palm and its direction.
    pub palm: PalmDescription,
    /// Joints held at a fixed coordinate (rad or m); the tree does not contain them.
    pub held_joints: Vec<(String, f64)>,
    /// Deviations from what the files say, a line each.
    pub notes: Vec<String>,
}

impl HandMechanism {
    /// Builds the mechanism of a hand from a parameter file.
    pub fn from_hand(hand: &Hand, name: &str) -> Self {
        let names = || hand.tree.joints.iter().map(|joint| joint.name.clone());
        let covers = std::iter::once((None, PALM.to_owned(), &hand.palm_cover))
            .chain(names().zip(&hand.covers).enumerate().map(|(link, (name, cover))| (Some(link), name, cover)));
        let solid = |(link, owner, cover): (Option<usize>, String, &CoverShape)| {
            let shape = SolidShape::RoundedCuboid(cover.half, cover.radius);
            CollisionSolid { link, link_name: owner, link_from_solid: cover.link_from_cover, shape }
        };
        let transmission = &hand.transmission;
        let pulls = hand.parameters.actuator.iter().zip(&transmission.cables).map(|(actuator, cable)| CableActuator {
            name: actuator.name.clone(),
            levers: cable.joints.iter().map(|crossing| (crossing.joint, crossing.lever)).collect(),
            max_tension: None,
        });
        let opposition = transmission.opposition.map(|joint| {
            let servo = &hand.servos[hand.cables.len()];
            OppositionServo { joint, max_torque: servo.stall_torque * servo.gear_ratio_opposition }
        });
        let feel = |joint| JointDynamics {
            spring: transmission.springs[joint],
            damping: hand.joint_damping(joint),
            armature: hand.joint_armature(joint),
        };
        Self {
            name: name.into(),
            root: PALM.into(),
            tree: hand.tree.clone(),
            root_mass: Some(hand.palm_mass),
            masses: hand.masses.clone(),
            solids: covers.map(solid).collect(),
            surfaces: Vec::new(),
            links_without_collision: Vec::new(),
            followers: transmission.followers.clone(),
            actuators: pulls.collect(),
            opposition,
            effort_limits: vec![None; hand.tree.len()],
            joint_dynamics: (0..hand.tree.len()).map(feel).collect(),
            spring_rest: transmission.spring_rests.to_vec(),
            independent_digits: transmission.followers.is_empty(),
            palm: PalmDescription::default(),
            held_joints: Vec::new(),
            notes: Vec::new(),
        }
    }

    /// Computes the rest coordinate of every joint, rad or m: that of its spring, clamped to its limits; for a
    /// follower, the one that its leader's rest implies.
    pub fn rest_coordinates(&self) -> Vec<f64> {
        let joints = self.tree.joints.iter().zip(&self.spring_rest);
        let mut rest: Vec<f64> = joints.map(|(joint, rest)| rest.clamp(joint.lower, joint.upper)).collect();
        for Follower { joint, leader, multiplier, offset } in &self.followers {
            let own = &self.tree.joints[*joint];
            rest[*joint] = (multiplier * rest[*leader] + offset).clamp(own.lower, own.upper);
        }
        rest
    }

    /// Computes the torque (N m) or force (N) with which the spring of a joint at `q` (rad or m) pulls it back.
    pub fn spring_effort(&self, joint: usize, q: f64) -> f64 {
        self.joint_dynamics[joint].spring * (q - self.spring_rest[joint])
    }

    /// Computes the joint efforts (N m or N) due to the actuators' `tensions` (N) and the springs at `q` (rad or m).
    pub fn torques(&self, q: &[f64], tensions: &[f64]) -> Vec<f64> {
        let mut torques: Vec<f64> = q.iter().enumerate().map(|(joint, q)| -self.spring_effort(joint, *q)).collect();
        for (pull, tension) in self.actuators.iter().zip(tensions) {
            for (joint, lever) in &pull.levers {
                torques[*joint] += lever.moment_arm(q[*joint]) * tension;
            }
        }
        torques
    }

    /// Limits `tensions` (N) to what each actuator can give and its joints can bear. Returns the limited tensions and
    /// the indices of the actuators that were reduced.
    pub fn limit_tensions(&self, tensions: &[f64]) -> (Vec<f64>, Vec<usize>) {
        let mut above = Vec::new();
        let within =
            self.actuators.iter().zip(tensions).enumerate().map(|(n, (pull, tension))| match &pull.max_tension {
                Some((most, _)) if tension > most => {
                    above.push(n);
                    *most
                }
                _ => *tension,
            });
        let mut within: Vec<f64> = within.collect();
        // The torques of several cables on one joint add up.
        for (joint, effort) in
            self.effort_limits.iter().enumerate().filter_map(|(joint, effort)| Some((joint, (*effort)?)))
        {
            let arm = |pull: &CableActuator| {
                pull.moment_arms().filter(|(own, _)| *own == joint).map(|(_, arm)| arm).sum::<f64>()
            };
            let total: f64 = self.actuators.iter().zip(&within).map(|(pull, tension)| arm(pull) * tension).sum();
            if total.abs() <= effort * (1.0 + EFFORT_TOLERANCE) {
                continue;
            }
            for (n, _) in self.actuators.iter().enumerate().filter(|(_, pull)| arm(pull) * total > 0.0) {
                within[n] *= effort / total.abs();
                if !above.contains(&n) {
                    above.push(n);
                }
            }
        }
        (within, above)
    }
}

impl CableActuator {
    /// Returns the joints with their moment arms at coordinate 0, m; for a sliding joint, force over tension.
    pub fn moment_arms(&self) -> impl Iterator<Item = (usize, f64)> {
        self.levers.iter().map(|(joint, lever)| (*joint, lever.moment_arm(0.0)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mechanism of a hand pulls exactly as the hand's transmission, bit for bit.
    #[test]
    fn a_mechanism_pulls_as_the_hand() {
        let hand = Hand::ftac();
        let mechanism = HandMechanism::from_hand(&hand, "hand");
        let q: Vec<f64> = (0..hand.tree.len()).map(|joint| 0.1 + 0.07 * joint as f64).collect();
        let tensions = [3.0, 0.0, 11.0, 25.0, 40.0];
        assert_eq!(mechanism.torques(&q, &tensions), hand.transmission.torques(&q, &tensions).to_vec());
        assert_eq!(mechanism.rest_coordinates(), hand.open_angles().to_vec());
        assert_eq!(mechanism.solids.len(), hand.tree.len() + 1);
    }
}
