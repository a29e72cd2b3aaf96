//! A hand as physics and grasp synthesis know it: links that collide, joints, and what pulls on them.
//!
//! [`HandMechanism::of`] makes it of a [`Hand`], [`crate::urdf_hand`] of any URDF.

use nalgebra::{Isometry3, Point3, Vector3};

use crate::Hand;
use crate::hand::{CoverShape, MassProperties};
use crate::kinematics::Tree;
use crate::transmission::{Follower, Lever};

/// Root link of a hand from a parameter file.
const PALM: &str = "palm";
/// A torque is within an effort up to this share.
const ROUNDING: f64 = 1e-9;

/// An actuator's cable.
#[derive(Debug, Clone)]
pub struct Pull {
    pub name: String,
    /// Joints with their levers.
    pub arms: Vec<(usize, Lever)>,
    /// Largest tension that the actuator gives and its joints bear, N, and what sets it; none where no file says.
    pub most: Option<(f64, String)>,
}

/// Servo that turns the joint of the thumb's opposition.
#[derive(Debug, Clone, Copy)]
pub struct OppositionServo {
    pub joint: usize,
    /// Largest torque, N m.
    pub limit: f64,
}

/// Spring, damping and armature of a joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Feel {
    /// N m/rad or N/m.
    pub spring: f64,
    /// N m s/rad or N s/m.
    pub damping: f64,
    /// kg m2 or kg.
    pub armature: f64,
}

/// A collision shape of a link.
#[derive(Debug, Clone)]
pub struct Solid {
    /// Joint whose link carries it; `None` is the root.
    pub link: Option<usize>,
    /// Name of its link in the hand's file.
    pub owner: String,
    /// `link_from_solid`.
    pub link_from_solid: Isometry3<f64>,
    /// Its shape, m.
    pub shape: SolidShape,
}

/// Shapes of links.
#[derive(Debug, Clone)]
pub enum SolidShape {
    /// Half extents.
    Cuboid(Vector3<f64>),
    /// Half extents with the rounding, and its radius.
    RoundedCuboid(Vector3<f64>, f64),
    /// Radius.
    Sphere(f64),
    /// Radius and half length along z.
    Cylinder(f64, f64),
    /// Radius and half length along z of the part between its caps.
    Capsule(f64, f64),
    /// The convex hull of these points.
    Hull(Vec<Point3<f64>>),
}

impl SolidShape {
    /// Middle and half extents of the box around it, m.
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

/// The surface of a mesh for which convex parts stand.
#[derive(Debug, Clone)]
pub struct MeshSurface {
    /// Joint whose link carries it; `None` is the root.
    pub link: Option<usize>,
    /// Name of its link in the URDF.
    pub owner: String,
    /// `link_from_mesh`.
    pub link_from_mesh: Isometry3<f64>,
    /// In metres.
    pub triangles: Triangles,
    /// Largest distance by which its parts stand out of it, m.
    pub excess: f64,
}

/// Place of the palm of a hand from a URDF.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Palm {
    /// Links of the root that may bear an object.
    pub links: Vec<String>,
    /// Unit vector out of the palm, root frame.
    pub facing: Option<Vector3<f64>>,
}

/// Joints, links and actuators of a hand.
#[derive(Debug, Clone)]
pub struct HandMechanism {
    pub name: String,
    /// Name of the root link.
    pub root: String,
    /// Moving joints, parents first.
    pub tree: Tree,
    /// Mass of the root; none where it does not matter, as it never moves.
    pub root_mass: Option<MassProperties>,
    /// Mass of each moving link with what is fixed to it.
    pub masses: Vec<MassProperties>,
    /// Collision shapes.
    pub solids: Vec<Solid>,
    /// Surfaces of the meshes that solids stand for.
    pub surfaces: Vec<MeshSurface>,
    /// Links (of the URDF) without any collision shape, that carry a mass or a visual shape.
    pub bare: Vec<String>,
    /// Joints that follow others.
    pub followers: Vec<Follower>,
    /// Actuators that pull.
    pub pulls: Vec<Pull>,
    /// None in a hand without it.
    pub opposition: Option<OppositionServo>,
    /// Effort that each joint bears, N m or N; none where no file says.
    pub efforts: Vec<Option<f64>>,
    /// Of each joint.
    pub feel: Vec<Feel>,
    /// Coordinate of each joint at which its spring rests, rad or m.
    pub spring_rest: Vec<f64>,
    /// True if digits feel each other through contact alone: neither a joint nor a link couples them, and the palm's solid meets their
    /// first links.
    pub digits_apart: bool,
    pub palm: Palm,
    /// Joints that are held at a coordinate (rad or m), which the tree does not have.
    pub held: Vec<(String, f64)>,
    /// Departures from what the files say, a line each.
    pub notes: Vec<String>,
}

impl HandMechanism {
    /// Of a hand from a parameter file.
    pub fn of(hand: &Hand, name: &str) -> Self {
        let names = || hand.tree.joints.iter().map(|joint| joint.name.clone());
        let covers = std::iter::once((None, PALM.to_owned(), &hand.palm_cover))
            .chain(names().zip(&hand.covers).enumerate().map(|(link, (name, cover))| (Some(link), name, cover)));
        let solid = |(link, owner, cover): (Option<usize>, String, &CoverShape)| {
            let shape = SolidShape::RoundedCuboid(cover.half, cover.radius);
            Solid { link, owner, link_from_solid: cover.link_from_cover, shape }
        };
        let transmission = &hand.transmission;
        let pulls = hand.parameters.actuator.iter().zip(&transmission.cables).map(|(actuator, cable)| Pull {
            name: actuator.name.clone(),
            arms: cable.joints.iter().map(|crossing| (crossing.joint, crossing.lever)).collect(),
            most: None,
        });
        let opposition = transmission.opposition.map(|joint| {
            let servo = &hand.servos[hand.cables.len()];
            OppositionServo { joint, limit: servo.stall_torque * servo.gear_ratio_opposition }
        });
        let feel = |joint| Feel {
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
            bare: Vec::new(),
            followers: transmission.followers.clone(),
            pulls: pulls.collect(),
            opposition,
            efforts: vec![None; hand.tree.len()],
            feel: (0..hand.tree.len()).map(feel).collect(),
            spring_rest: transmission.rests.to_vec(),
            digits_apart: transmission.followers.is_empty(),
            palm: Palm::default(),
            held: Vec::new(),
            notes: Vec::new(),
        }
    }

    /// Rest coordinate of every joint, rad or m: its spring's, clamped to its limits; of a joint that follows, what its leader's makes it.
    pub fn rest(&self) -> Vec<f64> {
        let joints = self.tree.joints.iter().zip(&self.spring_rest);
        let mut rest: Vec<f64> = joints.map(|(joint, rest)| rest.clamp(joint.lower, joint.upper)).collect();
        for Follower { joint, leader, multiplier, offset } in &self.followers {
            let own = &self.tree.joints[*joint];
            rest[*joint] = (multiplier * rest[*leader] + offset).clamp(own.lower, own.upper);
        }
        rest
    }

    /// Torque (N m) or force (N) with which the spring of a joint at `q` (rad or m) draws it back.
    pub fn spring_effort(&self, joint: usize, q: f64) -> f64 {
        self.feel[joint].spring * (q - self.spring_rest[joint])
    }

    /// Joint efforts (N m or N) of the actuators' `tensions` (N) and the springs at `q` (rad or m).
    pub fn torques(&self, q: &[f64], tensions: &[f64]) -> Vec<f64> {
        let mut torques: Vec<f64> = q.iter().enumerate().map(|(joint, q)| -self.spring_effort(joint, *q)).collect();
        for (pull, tension) in self.pulls.iter().zip(tensions) {
            for (joint, lever) in &pull.arms {
                torques[*joint] += lever.moment_arm(q[*joint]) * tension;
            }
        }
        torques
    }

    /// `tensions` (N), none above what its actuator gives and its joints bear; those that were, by the actuator's number.
    pub fn within_efforts(&self, tensions: &[f64]) -> (Vec<f64>, Vec<usize>) {
        let mut above = Vec::new();
        let within = self.pulls.iter().zip(tensions).enumerate().map(|(n, (pull, tension))| match &pull.most {
            Some((most, _)) if tension > most => {
                above.push(n);
                *most
            }
            _ => *tension,
        });
        let mut within: Vec<f64> = within.collect();
        // What several cables do to a joint adds up.
        for (joint, effort) in self.efforts.iter().enumerate().filter_map(|(joint, effort)| Some((joint, (*effort)?))) {
            let arm =
                |pull: &Pull| pull.constant_arms().filter(|(own, _)| *own == joint).map(|(_, arm)| arm).sum::<f64>();
            let total: f64 = self.pulls.iter().zip(&within).map(|(pull, tension)| arm(pull) * tension).sum();
            if total.abs() <= effort * (1.0 + ROUNDING) {
                continue;
            }
            for (n, _) in self.pulls.iter().enumerate().filter(|(_, pull)| arm(pull) * total > 0.0) {
                within[n] *= effort / total.abs();
                if !above.contains(&n) {
                    above.push(n);
                }
            }
        }
        (within, above)
    }
}

impl Pull {
    /// Joints with their moment arms at coordinate 0, m; force over tension of a slide.
    pub fn constant_arms(&self) -> impl Iterator<Item = (usize, f64)> {
        self.arms.iter().map(|(joint, lever)| (*joint, lever.moment_arm(0.0)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mechanism of a hand pulls as its transmission does, to the last bit.
    #[test]
    fn a_mechanism_pulls_as_the_hand() {
        let hand = Hand::ftac();
        let mechanism = HandMechanism::of(&hand, "hand");
        let q: Vec<f64> = (0..hand.tree.len()).map(|joint| 0.1 + 0.07 * joint as f64).collect();
        let tensions = [3.0, 0.0, 11.0, 25.0, 40.0];
        assert_eq!(mechanism.torques(&q, &tensions), hand.transmission.torques(&q, &tensions).to_vec());
        assert_eq!(mechanism.rest(), hand.open().to_vec());
        assert_eq!(mechanism.solids.len(), hand.tree.len() + 1);
    }
}
