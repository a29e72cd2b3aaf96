//! A hand from a URDF, which gives the mechanism, and an actuation file, which gives the actuators and springs.
//!
//! The actuation file is TOML; `data/hands` has those of the Ability, Allegro, Barrett, LEAP and Shadow hands and of
//! the EZGripper. An actuator's cable acts on each of its joints with a constant moment arm (m; negative where a
//! positive angle lengthens the cable; for a sliding joint, force over tension). Springs are torsion springs with rest
//! at 0, or at the angle of `[open]`:
//!
//! ```toml
//! version = 1
//! damping = 0.02      # N m s/rad, every joint that turns
//! armature = 1e-4     # kg m2
//! spring = 0.01       # N m/rad
//! [[actuator]]
//! name = "close"
//! arms = { knuckle_1 = 0.01, knuckle_2 = 0.008 }
//! max_tension = 60    # optional, N; the URDF's efforts hold besides
//! [held]                # optional: coordinates of joints that no actuator pulls, rad or m
//! spread = 0.3
//! [open]                # optional: coordinates of pulled joints in the open hand, rad or m
//! knuckle_1 = -0.1
//! [slide]               # optional: every joint that slides, N s/m, kg, N/m
//! damping = 200.0
//! armature = 1.0
//! spring = 200.0
//! [palm]                # optional: where the palm is
//! links = ["palm"]      # links of the root that may bear an object
//! facing = [0, 0, -1]   # out of the palm, root link's frame
//! ```
//!
//! `visuals = true` uses the visual shapes of links that have no collision shape. This is always done for a hand
//! without any collision shape.
//!
//! Links on fixed joints become part of the link that carries them, including frames without mass. A link with mass and
//! no inertia is a point mass, and a moving link without mass gets an estimated one ([`HandMechanism::notes`] reports
//! both). A joint that mimics another follows it. A joint that nothing pulls is held at its coordinate in `[held]`,
//! otherwise at rest: 0, or the nearest value within its limits. Its link becomes part of the link that carries it.
//! Collision meshes are decomposed into convex parts ([`MeshTools`]); they need not be watertight.

mod actuation;
mod held;
pub(crate) mod masses;
mod meshes;
mod shapes;

use std::collections::{BTreeMap, VecDeque};
use std::path::Path;

use nalgebra::Isometry3;
use urdf_rs::{JointType, Robot};

use crate::hand_mechanism::HandMechanism;
use crate::kinematics::{JointKind, Tree, pose_from_xyz_rpy};
use crate::transmission::Follower;
use crate::urdf::{frames, parse_robot, read_bytes, urdf_error};
use ftac_platform::data::{DataError, parse_toml, read_text};

pub use meshes::{ConvexDecomposition, MeshTools};

use actuation::ActuationFile;

/// Radius of the pinion that is assumed to drive a sliding joint if `[slide]` is not given, m. It converts the damping,
/// armature and spring of a revolute joint to those of a sliding one.
const PINION_RADIUS: f64 = 0.01;

impl HandMechanism {
    /// Reads a hand from its URDF and its actuation file (`pulls`).
    ///
    /// # Errors
    /// [`DataError`] with the element and field at fault.
    pub fn read(urdf: &Path, pulls: &Path, meshes: MeshTools) -> Result<Self, DataError> {
        let robot = read_bytes(urdf)?;
        Self::from_files(&robot, urdf, parse_toml(&read_text(pulls)?, pulls)?, pulls, meshes)
    }

    /// Like [`Self::read`], from text; meshes are looked for beside `urdf_path`.
    ///
    /// # Errors
    /// [`DataError`] with the element and field at fault.
    ///
    /// ```
    /// use std::path::Path;
    ///
    /// use hand_model::hand_mechanism::HandMechanism;
    /// use hand_model::urdf_hand::MeshTools;
    ///
    /// let urdf = r#"<robot name="clamp"><link name="base"/>
    ///   <link name="jaw"><inertial><mass value="0.1"/><inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-5" iyz="0" izz="1e-5"/></inertial>
    ///     <collision><geometry><box size="0.04 0.01 0.02"/></geometry></collision></link>
    ///   <joint name="hinge" type="revolute"><parent link="base"/><child link="jaw"/><axis xyz="0 1 0"/>
    ///     <limit lower="0" upper="1" effort="1" velocity="1"/></joint></robot>"#;
    /// let actuation = r#"
    /// version = 1
    /// damping = 0.01
    /// armature = 1e-4
    /// spring = 0.02
    /// [[actuator]]
    /// name = "close"
    /// arms = { hinge = 0.01 }
    /// "#;
    /// let files = [Path::new("clamp.urdf"), Path::new("clamp.toml")];
    /// let clamp = HandMechanism::parse(urdf, files[0], actuation, files[1], MeshTools::NONE)?;
    /// // 1 N m at an arm of 10 mm: the URDF's effort allows 100 N.
    /// assert_eq!(clamp.limit_tensions(&[250.0]), (vec![100.0], vec![0]));
    /// # Ok::<(), hand_model::DataError>(())
    /// ```
    pub fn parse(
        urdf: &str,
        urdf_path: &Path,
        pulls: &str,
        pulls_path: &Path,
        meshes: MeshTools,
    ) -> Result<Self, DataError> {
        Self::from_files(urdf.as_bytes(), urdf_path, parse_toml(pulls, pulls_path)?, pulls_path, meshes)
    }

    /// Reads a hand from its URDF alone: every joint that does not follow another moves, and nothing pulls.
    ///
    /// # Errors
    /// [`DataError`] with the element and field at fault.
    pub fn read_unactuated(urdf: &Path, meshes: MeshTools) -> Result<Self, DataError> {
        let bytes = read_bytes(urdf)?;
        let (robot, _) = parse_robot(&bytes, urdf)?;
        let moving = robot.joints.iter().filter(|joint| joint.joint_type != JointType::Fixed);
        let names = moving.filter(|joint| joint.mimic.is_none()).map(|joint| joint.name.clone());
        Self::from_files(&bytes, urdf, ActuationFile::without_actuators(names.collect()), urdf, meshes)
    }

    fn from_files(
        bytes: &[u8],
        path: &Path,
        file: ActuationFile,
        pulls_path: &Path,
        meshes: MeshTools,
    ) -> Result<Self, DataError> {
        let (mut robot, mut notes) = parse_robot(bytes, path)?;
        check_leaders(&robot, path)?;
        file.check(&robot, pulls_path)?;
        let held = held::fix(&mut robot, &file.actuated_joints(), &file.held, pulls_path)?;
        let tree = frames(&robot, path, &[])?;
        let carried = carrying_joints(&robot, &tree);
        let shapes = shapes::read(&robot, &carried, path, file.visuals, meshes, &mut notes)?;
        let masses = masses::link_masses(&robot, &tree, &carried, &shapes.solids, path, &mut notes)?;
        let efforts = effort_limits(&robot, &tree, path, &mut notes);
        let feel = |kind| match kind {
            JointKind::Turn => file.revolute_dynamics(),
            JointKind::Slide => file.prismatic_dynamics(),
        };
        let mut hand = Self {
            name: robot.name.clone(),
            root: "root".into(),
            root_mass: None,
            masses,
            solids: shapes.solids,
            surfaces: shapes.surfaces,
            links_without_collision: shapes.links_without_collision,
            followers: followers(&robot, &tree),
            actuators: Vec::new(),
            opposition: None,
            effort_limits: efforts,
            joint_dynamics: tree.joints.iter().map(|joint| feel(joint.kind)).collect(),
            spring_rest: vec![0.0; tree.len()],
            independent_digits: false,
            palm: file.palm_description(),
            tree,
            held_joints: held,
            notes,
        };
        actuation::add_actuators(&mut hand, file, pulls_path)?;
        Ok(hand)
    }
}

/// Returns the effort limit of each joint from the URDF. A limit of 0 counts as unknown, because exporters write it
/// when they know none.
fn effort_limits(robot: &Robot, tree: &Tree, path: &Path, notes: &mut Vec<String>) -> Vec<Option<f64>> {
    let mut unknown = Vec::new();
    let efforts = tree.joints.iter().map(|joint| {
        let own = robot.joints.iter().find(|own| own.name == joint.name)?;
        let effort = own.limit.effort;
        let known = effort > 0.0 && effort.is_finite();
        // A follower is driven by its leader's motor.
        if !known && own.mimic.is_none() {
            unknown.push(joint.name.as_str());
        }
        known.then_some(effort)
    });
    let efforts = efforts.collect();
    if !unknown.is_empty() {
        let file = path.display();
        notes.push(format!(
            "{file}: joint.limit.effort: none of {}; only max_tension bounds what pulls them",
            unknown.join(", ")
        ));
    }
    efforts
}

/// Maps each link to the moving joint that carries it (`None`: the root) and its pose in that joint's frame.
pub(crate) fn carrying_joints(robot: &Robot, tree: &Tree) -> BTreeMap<String, (Option<usize>, Isometry3<f64>)> {
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

/// Checks that the leader of every mimic joint moves. This comes before unpulled joints are held, because a held joint
/// loses its mimic.
fn check_leaders(robot: &Robot, path: &Path) -> Result<(), DataError> {
    let moving = |name: &str| robot.joints.iter().any(|own| own.name == name && own.joint_type != JointType::Fixed);
    for joint in robot.joints.iter().filter(|joint| joint.joint_type != JointType::Fixed) {
        if let Some(mimic) = joint.mimic.as_ref().filter(|mimic| !moving(&mimic.joint)) {
            let element = format!("joint[{}].mimic", joint.name);
            return Err(urdf_error(path, element, "joint", format!("`{}`", mimic.joint), "the name of a moving joint"));
        }
    }
    Ok(())
}

/// Collects the joints that follow another. [`check_leaders`] has verified the leaders.
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
