//! Any hand: a URDF for the mechanism and a small file for what pulls on its joints.
//!
//! The pulls file is TOML. An actuator's cable acts on each of its joints with a constant moment arm (m; negative where
//! a positive angle lengthens the cable), springs are torsion springs with rest at 0:
//!
//! ```toml
//! version = 1
//! damping = 0.02      # N m s/rad, every joint
//! armature = 1e-4     # kg m2, every joint
//! spring = 0.01       # N m/rad, every joint
//! [[actuator]]
//! name = "close"
//! arms = { knuckle_1 = 0.01, knuckle_2 = 0.008 }
//! [held]                # optional: angles of joints that no actuator pulls, rad
//! spread = 0.3
//! ```
//!
//! Links on fixed joints become part of the link that carries them, frames without mass too. A link with
//! mass and no inertia is a point mass ([`AnyHand::notes`] names it). A joint that mimics another follows
//! it. A joint that nothing pulls is held where `[held]` says, otherwise at rest: 0, or the nearest within its limits. Its link
//! becomes part of the link that carries it. Collision meshes
//! stand for the convex hull of their points, so that they need not be watertight; [`AnyHand::notes`] names those that are not.

mod held;
mod points;

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::Path;

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use serde::Deserialize;
use urdf_rs::{Geometry, JointType, Robot};

use crate::data::{DataError, parse_toml, read_text};
use crate::hand::MassProperties;
use crate::kinematics::{Tree, pose_from_xyz_rpy};
use crate::urdf::{fault, frames, parse_robot};

/// No cable of a hand has a longer moment arm, m.
const LONGEST_ARM: f64 = 1.0;
/// Least principal moment as a share of the largest: point masses on a line have less, up to rounding.
const LEAST_MOMENT_RATIO: f64 = 1e-9;

/// A collision shape of a link.
#[derive(Debug, Clone)]
pub struct Solid {
    /// Joint whose link carries it; `None` is the root.
    pub link: Option<usize>,
    /// `link_from_solid`.
    pub link_from_solid: Isometry3<f64>,
    /// Its shape, m.
    pub shape: SolidShape,
}

/// Shapes a URDF knows.
#[derive(Debug, Clone)]
pub enum SolidShape {
    /// Half extents.
    Cuboid(Vector3<f64>),
    /// Radius.
    Sphere(f64),
    /// Radius and half length along z.
    Cylinder(f64, f64),
    /// The convex hull of these points.
    Hull(Vec<Point3<f64>>),
}

/// A joint that follows another: q = multiplier * q_leader + offset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Follower {
    pub joint: usize,
    pub leader: usize,
    /// Turns a turn of the leader.
    pub multiplier: f64,
    /// rad.
    pub offset: f64,
}

/// An actuator's cable.
#[derive(Debug, Clone)]
pub struct Pull {
    pub name: String,
    /// Joints with their moment arm, m.
    pub arms: Vec<(usize, f64)>,
}

/// A hand read from files.
#[derive(Debug, Clone)]
pub struct AnyHand {
    /// Name of the URDF's robot.
    pub name: String,
    /// Moving joints, parents first.
    pub tree: Tree,
    /// Mass of each moving link with what is fixed to it.
    pub masses: Vec<MassProperties>,
    /// Collision shapes.
    pub solids: Vec<Solid>,
    /// Joints that follow others.
    pub followers: Vec<Follower>,
    /// Actuators.
    pub pulls: Vec<Pull>,
    /// Torsion spring of every joint, N m/rad.
    pub spring: f64,
    /// Damping of every joint, N m s/rad.
    pub damping: f64,
    /// Armature of every joint, kg m2.
    pub armature: f64,
    /// Joints that are held at an angle (rad), which the tree does not have.
    pub held: Vec<(String, f64)>,
    /// What was taken otherwise than the files say, a line each.
    pub notes: Vec<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PullsFile {
    version: u32,
    damping: f64,
    armature: f64,
    spring: f64,
    actuator: Vec<PullFile>,
    #[serde(default)]
    held: BTreeMap<String, f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PullFile {
    name: String,
    arms: BTreeMap<String, f64>,
}

impl AnyHand {
    /// Reads a hand from its URDF and its pulls file.
    pub fn read(urdf: &Path, pulls: &Path) -> Result<Self, DataError> {
        Self::parse(&read_text(urdf)?, urdf, &read_text(pulls)?, pulls)
    }

    /// As [`Self::read`], from text; meshes are looked for beside `urdf_path`.
    pub fn parse(urdf: &str, urdf_path: &Path, pulls: &str, pulls_path: &Path) -> Result<Self, DataError> {
        let mut robot = parse_robot(urdf, urdf_path)?;
        let file: PullsFile = parse_toml(pulls, pulls_path)?;
        let pulled: BTreeSet<&str> =
            file.actuator.iter().flat_map(|actuator| actuator.arms.keys().map(String::as_str)).collect();
        check_leaders(&robot, urdf_path)?;
        let held = held::fix(&mut robot, &pulled, &file.held, pulls_path)?;
        let tree = frames(&robot, urdf_path, &[])?;
        let carried = carriers(&robot, &tree);
        let mut notes = Vec::new();
        let masses = masses(&robot, &tree, &carried, urdf_path, &mut notes)?;
        check_masses(&robot, &tree, &masses, urdf_path)?;
        let mut hand = Self {
            name: robot.name.clone(),
            masses,
            solids: solids(&robot, &carried, urdf_path, &mut notes)?,
            followers: followers(&robot, &tree),
            tree,
            pulls: Vec::new(),
            spring: 0.0,
            damping: 0.0,
            armature: 0.0,
            held,
            notes,
        };
        hand.read_pulls(file, pulls_path)?;
        Ok(hand)
    }

    /// Rest angle of every joint, rad: 0, clamped to its limits; of a joint that follows, what its leader's makes it.
    pub fn rest(&self) -> Vec<f64> {
        let mut rest: Vec<f64> = self.tree.joints.iter().map(|joint| 0f64.clamp(joint.lower, joint.upper)).collect();
        for Follower { joint, leader, multiplier, offset } in &self.followers {
            let own = &self.tree.joints[*joint];
            rest[*joint] = (multiplier * rest[*leader] + offset).clamp(own.lower, own.upper);
        }
        rest
    }

    /// Joint torques (N m) of the actuators' `tensions` (N) and the springs at `q` (rad).
    pub fn torques(&self, q: &[f64], tensions: &[f64]) -> Vec<f64> {
        let mut torques: Vec<f64> = q.iter().map(|angle| -self.spring * angle).collect();
        for (pull, tension) in self.pulls.iter().zip(tensions) {
            for (joint, arm) in &pull.arms {
                torques[*joint] += arm * tension;
            }
        }
        torques
    }

    fn read_pulls(&mut self, file: PullsFile, path: &Path) -> Result<(), DataError> {
        if file.version != 1 {
            return Err(DataError::field(path, "version", file.version, "1"));
        }
        for (field, value) in [("damping", file.damping), ("armature", file.armature), ("spring", file.spring)] {
            if !(value.is_finite() && value > 0.0) {
                return Err(DataError::field(path, field, value, "a positive number"));
            }
        }
        (self.damping, self.armature, self.spring) = (file.damping, file.armature, file.spring);
        for actuator in file.actuator {
            if actuator.arms.is_empty() {
                let element = format!("actuator[{}]", actuator.name);
                return Err(fault(path, element, "arms", "none".into(), "at least one joint with its moment arm in m"));
            }
            let mut arms = Vec::new();
            for (name, arm) in &actuator.arms {
                let element = format!("actuator[{}].arms", actuator.name);
                let Some(joint) = self.tree.find(name) else {
                    let known: Vec<&str> = self.tree.joints.iter().map(|joint| joint.name.as_str()).collect();
                    let expected = format!("a joint of the URDF: {}", known.join(", "));
                    return Err(fault(path, element, name, "no such joint".into(), &expected));
                };
                if self.followers.iter().any(|follower| follower.joint == joint) {
                    return Err(fault(
                        path,
                        element,
                        name,
                        "a joint that mimics another".into(),
                        "the joint it mimics",
                    ));
                }
                if !(arm.abs() > 0.0 && arm.abs() <= LONGEST_ARM) {
                    let expected = format!("a moment arm in m, not 0 and at most {LONGEST_ARM} either way");
                    return Err(fault(path, element, name, arm.to_string(), &expected));
                }
                arms.push((joint, *arm));
            }
            self.pulls.push(Pull { name: actuator.name, arms });
        }
        Ok(())
    }
}

/// For each link the moving joint that carries it (`None`: the root) and its pose in that joint's frame.
fn carriers(robot: &Robot, tree: &Tree) -> BTreeMap<String, (Option<usize>, Isometry3<f64>)> {
    let roots = robot.links.iter().filter(|link| !robot.joints.iter().any(|joint| joint.child.link == link.name));
    let mut open: VecDeque<_> = roots.map(|link| (link.name.clone(), None, Isometry3::identity())).collect();
    let mut carried = BTreeMap::new();
    while let Some((name, carrier, pose)) = open.pop_front() {
        for joint in robot.joints.iter().filter(|joint| joint.parent.link == name) {
            let next = if joint.joint_type == JointType::Fixed {
                (carrier, pose * pose_from_xyz_rpy(joint.origin.xyz.0, joint.origin.rpy.0))
            } else {
                (tree.find(&joint.name), Isometry3::identity())
            };
            open.push_back((joint.child.link.clone(), next.0, next.1));
        }
        carried.insert(name, (carrier, pose));
    }
    carried
}

/// Every link that a joint moves has mass and inertia, its own or of what is fixed to it.
fn check_masses(robot: &Robot, tree: &Tree, masses: &[MassProperties], path: &Path) -> Result<(), DataError> {
    for (joint, mass) in tree.joints.iter().zip(masses) {
        let link = robot.joints.iter().find(|own| own.name == joint.name).map_or("", |own| &own.child.link);
        let element = format!("link[{link}]");
        if mass.mass <= 0.0 {
            let expected = "a positive mass in kg on a link that a joint moves, or on what is fixed to it";
            return Err(fault(path, element, "inertial.mass", "0".into(), expected));
        }
        let moments = mass.inertia.symmetric_eigenvalues();
        if moments.min() <= LEAST_MOMENT_RATIO * moments.max() {
            let found = format!("principal moments {:?}", [moments.x, moments.y, moments.z]);
            let expected =
                "a positive definite inertia in kg m2 on a link that a joint moves, or on what is fixed to it";
            return Err(fault(path, element, "inertial.inertia", found, expected));
        }
    }
    Ok(())
}

fn masses(
    robot: &Robot,
    tree: &Tree,
    carried: &BTreeMap<String, (Option<usize>, Isometry3<f64>)>,
    path: &Path,
    notes: &mut Vec<String>,
) -> Result<Vec<MassProperties>, DataError> {
    let nothing = MassProperties { mass: 0.0, com: Point3::origin(), inertia: Matrix3::zeros() };
    let mut masses = vec![nothing; tree.len()];
    for link in &robot.links {
        let Some((Some(carrier), pose)) = carried.get(&link.name) else { continue };
        let inertial = &link.inertial;
        let mass = inertial.mass.value;
        if mass <= 0.0 {
            // A frame without mass, fixed to a link that has some.
            continue;
        }
        let place = pose * pose_from_xyz_rpy(inertial.origin.xyz.0, inertial.origin.rpy.0);
        let i = &inertial.inertia;
        let turn = place.rotation.to_rotation_matrix();
        let inertia =
            turn * Matrix3::new(i.ixx, i.ixy, i.ixz, i.ixy, i.iyy, i.iyz, i.ixz, i.iyz, i.izz) * turn.transpose();
        if inertia == Matrix3::zeros() {
            let (file, link) = (path.display(), &link.name);
            notes.push(format!("{file}: link[{link}].inertial: {mass} kg without inertia; taken as a point mass"));
        } else if inertia.symmetric_eigenvalues().min() <= 0.0 {
            let found = format!("{:?}", [i.ixx, i.iyy, i.izz]);
            let expected = "a positive definite inertia in kg m2";
            return Err(fault(path, format!("link[{}]", link.name), "inertial.inertia", found, expected));
        }
        let at = place * Point3::origin();
        masses[*carrier] = joined(&masses[*carrier], &MassProperties { mass, com: at, inertia });
    }
    Ok(masses)
}

/// Two bodies in the same frame as one.
fn joined(a: &MassProperties, b: &MassProperties) -> MassProperties {
    let mass = a.mass + b.mass;
    let com = (a.com.coords * a.mass + b.com.coords * b.mass) / mass;
    let moved = |part: &MassProperties| {
        let d = part.com.coords - com;
        part.inertia + (Matrix3::identity() * d.norm_squared() - d * d.transpose()) * part.mass
    };
    MassProperties { mass, com: com.into(), inertia: moved(a) + moved(b) }
}

fn solids(
    robot: &Robot,
    carried: &BTreeMap<String, (Option<usize>, Isometry3<f64>)>,
    path: &Path,
    notes: &mut Vec<String>,
) -> Result<Vec<Solid>, DataError> {
    let mut solids = Vec::new();
    for link in &robot.links {
        let Some((carrier, pose)) = carried.get(&link.name) else { continue };
        for (n, collision) in link.collision.iter().enumerate() {
            let element = format!("link[{}].collision[{n}]", link.name);
            let shape = match &collision.geometry {
                Geometry::Box { size } => SolidShape::Cuboid(0.5 * Vector3::from(size.0)),
                Geometry::Sphere { radius } => SolidShape::Sphere(*radius),
                Geometry::Cylinder { radius, length } => SolidShape::Cylinder(*radius, 0.5 * length),
                Geometry::Mesh { filename, scale } => {
                    let scale = scale.as_ref().map_or(Vector3::repeat(1.0), |scale| Vector3::from(scale.0));
                    let points = points::read(filename, &scale, path, &element)?;
                    if points.open_edges > 0 {
                        let (file, open) = (path.display(), points.open_edges);
                        notes.push(format!(
                            "{file}: {element}.mesh: `{filename}` is not watertight ({open} open edges); its convex hull stands for it"
                        ));
                    }
                    SolidShape::Hull(points.vertices)
                }
                other => {
                    let expected = "box, sphere, cylinder or mesh";
                    return Err(fault(path, element, "geometry", format!("{other:?}"), expected));
                }
            };
            let place = pose * pose_from_xyz_rpy(collision.origin.xyz.0, collision.origin.rpy.0);
            solids.push(Solid { link: *carrier, link_from_solid: place, shape });
        }
    }
    Ok(solids)
}

/// A joint that nothing pulls loses its mimic when it is held, so that this comes first.
fn check_leaders(robot: &Robot, path: &Path) -> Result<(), DataError> {
    let moving = |name: &str| robot.joints.iter().any(|own| own.name == name && own.joint_type != JointType::Fixed);
    for joint in robot.joints.iter().filter(|joint| joint.joint_type != JointType::Fixed) {
        if let Some(mimic) = joint.mimic.as_ref().filter(|mimic| !moving(&mimic.joint)) {
            let element = format!("joint[{}].mimic", joint.name);
            return Err(fault(path, element, "joint", format!("`{}`", mimic.joint), "the name of a moving joint"));
        }
    }
    Ok(())
}

/// The joints that follow another; [`check_leaders`] has found the leaders.
fn followers(robot: &Robot, tree: &Tree) -> Vec<Follower> {
    let follower = |joint: &urdf_rs::Joint| {
        let mimic = joint.mimic.as_ref()?;
        Some(Follower {
            joint: tree.find(&joint.name)?,
            leader: tree.find(&mimic.joint)?,
            multiplier: mimic.multiplier.unwrap_or(1.0),
            offset: mimic.offset.unwrap_or(0.0),
        })
    };
    robot.joints.iter().filter_map(follower).collect()
}

#[cfg(test)]
mod tests;
