//! A serial arm: frames, limits, inertias, control gains and collision radii.
//!
//! It is read from a parameter file such as `data/gen3.toml` (Kinova Gen3), or from a URDF and a parameter file with
//! what a URDF lacks, such as `data/robots/panda.toml` (Franka Panda): accelerations, gains of the position control,
//! collision radii and a home posture.

use std::path::Path;

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use serde::Deserialize;
use tinyvec::ArrayVec;

use crate::hand::MassProperties;
use crate::kinematics::{Joint, JointKind, Tree, pose_from_xyz_rpy};
use ftac_platform::data::{DataError, parse_toml};

mod urdf;

/// Largest number of joints of an arm.
pub const MAX_ARM_JOINTS: usize = 7;
/// A value for each joint of an arm, from the base outwards.
pub type ArmVector<T = f64> = ArrayVec<[T; MAX_ARM_JOINTS]>;

/// Version of the file format.
const VERSION: u32 = 1;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ArmFile {
    version: u32,
    name: String,
    base_mass: f64,
    base_radius: f64,
    armature: f64,
    home: Vec<f64>,
    tool_xyz: [f64; 3],
    tool_rpy: [f64; 3],
    joint: Vec<ArmJointFile>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ArmJointFile {
    name: String,
    link: String,
    xyz: [f64; 3],
    rpy: [f64; 3],
    continuous: bool,
    #[serde(default)]
    lower: f64,
    #[serde(default)]
    upper: f64,
    velocity: f64,
    effort: f64,
    acceleration: f64,
    mass: f64,
    com: [f64; 3],
    inertia: [f64; 6],
    stiffness: f64,
    damping: f64,
    radius: f64,
    wrist_capsule: Option<[f64; 3]>,
}

impl ArmFile {
    fn check(&self, path: &Path) -> Result<(), DataError> {
        if self.version != VERSION {
            return Err(DataError::field(path, "version", self.version, VERSION.to_string()));
        }
        if !(1..=MAX_ARM_JOINTS).contains(&self.joint.len()) {
            let found = format!("{} joints", self.joint.len());
            return Err(DataError::field(path, "joint", found, format!("1 to {MAX_ARM_JOINTS} joints")));
        }
        if self.home.len() != self.joint.len() {
            let found = format!("{} angles", self.home.len());
            return Err(DataError::field(path, "home", found, format!("{}, one for each joint", self.joint.len())));
        }
        for (field, value) in [("base_mass", self.base_mass), ("base_radius", self.base_radius)] {
            if !(value.is_finite() && value > 0.0) {
                return Err(DataError::field(path, field, value, "a positive number"));
            }
        }
        if !(self.armature.is_finite() && self.armature >= 0.0) {
            return Err(DataError::field(path, "armature", self.armature, "0 or more"));
        }
        for joint in &self.joint {
            let fault = |field: &str, found: f64, expected: &str| {
                Err(DataError::field(path, format!("joint[{}].{field}", joint.name), found, expected))
            };
            let positive = [
                ("velocity", joint.velocity),
                ("effort", joint.effort),
                ("acceleration", joint.acceleration),
                ("mass", joint.mass),
                ("stiffness", joint.stiffness),
                ("damping", joint.damping),
                ("radius", joint.radius),
            ];
            for (field, value) in positive {
                if !(value.is_finite() && value > 0.0) {
                    return fault(field, value, "a positive number");
                }
            }
            if joint.velocity > MAX_VELOCITY {
                return fault("velocity", joint.velocity, &format!("at most {MAX_VELOCITY} rad/s"));
            }
            for (field, angle) in [("lower", joint.lower), ("upper", joint.upper)] {
                if !joint.continuous && angle.abs() > MAX_ANGLE {
                    return fault(field, angle, "two turns at most, rad; is it in degrees?");
                }
            }
            if !joint.continuous && (joint.lower.is_nan() || joint.upper.is_nan() || joint.lower >= joint.upper) {
                return fault("lower", joint.lower, "less than `upper`");
            }
        }
        for (n, (joint, &angle)) in self.joint.iter().zip(&self.home).enumerate() {
            let within = joint.continuous || (joint.lower..=joint.upper).contains(&angle);
            if !(angle.is_finite() && within) {
                let expected = format!("an angle within the limits of `{}`, rad", joint.name);
                return Err(DataError::field(path, format!("home[{n}]"), angle, expected));
            }
        }
        Ok(())
    }
}

/// Greatest speed of a joint, rad/s: no arm is faster.
const MAX_VELOCITY: f64 = 20.0;
/// Greatest angle of a joint with a range, rad.
const MAX_ANGLE: f64 = 4.0 * std::f64::consts::PI;

/// A capsule from a link's origin along its axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WristCapsule {
    /// Index of the link.
    pub link: usize,
    /// Far end, link frame, m.
    pub end: Vector3<f64>,
    /// Radius, m.
    pub radius: f64,
}

/// The arm; its root is `arm_base`. Every joint turns about the z axis of its own frame.
///
/// ```
/// use hand_model::Arm;
///
/// let arm = Arm::gen3();
/// let base_from_tool = arm.tool_pose(&arm.home);
/// println!("{} joints, tool at {:.3?} m", arm.joints(), base_from_tool.translation.vector.as_slice());
/// assert_eq!(arm.joints(), arm.effort_limits.len());
/// ```
#[derive(Debug, Clone)]
pub struct Arm {
    /// Name of the arm, as in its parameter file.
    pub name: String,
    /// Serial chain of the joints.
    pub tree: Tree,
    /// Home posture, rad. Searches for other postures start from it.
    pub home: ArmVector,
    /// Names of the moving links.
    pub links: Vec<String>,
    /// Speed limits, rad/s.
    pub velocity_limits: ArmVector,
    /// Acceleration limits, rad/s2.
    pub acceleration_limits: ArmVector,
    /// Continuous torque limits, N m.
    pub effort_limits: ArmVector,
    /// Mass properties of the moving links.
    pub masses: Vec<MassProperties>,
    /// Mass of the base, kg.
    pub base_mass: f64,
    /// Gains of the joint torque sensors, reading over true torque: 1 in the nominal arm.
    pub torque_gains: ArmVector,
    /// Stiffness of the joints' position control, N m/rad.
    pub stiffness: ArmVector,
    /// Damping of the joints' position control, N m s/rad.
    pub damping: ArmVector,
    /// Armature: inertia of a drive reflected to its joint, kg m2.
    pub armature: f64,
    /// Collision radii of the tubes around base and links, m.
    pub radii: Vec<f64>,
    /// Collision shape of the wrist against table and objects.
    pub wrist: Vec<WristCapsule>,
    /// Tool frame (where the hand is mounted) in the last link.
    pub last_from_tool: Isometry3<f64>,
}

impl Arm {
    /// Returns the Gen3 with its published parameters.
    ///
    /// # Panics
    /// Never in a tested build: the file is compiled in and a test reads it.
    pub fn gen3() -> Self {
        Self::parse(include_str!("../data/gen3.toml"), Path::new("gen3.toml"), None).expect("the built-in arm is valid")
    }

    /// Returns the name of the URDF that a parameter file refers to for frames, limits and masses.
    ///
    /// # Errors
    /// [`DataError`] for a text that is not TOML.
    pub fn urdf_name(text: &str, path: &Path) -> Result<Option<String>, DataError> {
        urdf::name(text, path)
    }

    /// Builds an arm from the text of a parameter file and that of the [URDF it names](Self::urdf_name); `path` is used
    /// in errors.
    ///
    /// # Errors
    /// [`DataError`] with the field at fault.
    pub fn parse(text: &str, path: &Path, urdf: Option<(&str, &Path)>) -> Result<Self, DataError> {
        let file = match urdf {
            Some((urdf, its_path)) => urdf::merge_with_urdf((text, path), (urdf.as_bytes(), its_path))?,
            None => parse_toml(text, path)?,
        };
        Self::build(file, path)
    }

    fn build(file: ArmFile, path: &Path) -> Result<Self, DataError> {
        file.check(path)?;
        let each = |value: fn(&ArmJointFile) -> f64| file.joint.iter().map(value).collect();
        let joints = file
            .joint
            .iter()
            .enumerate()
            .map(|(i, joint)| Joint {
                name: joint.name.clone(),
                parent: i.checked_sub(1),
                kind: JointKind::Turn,
                origin: pose_from_xyz_rpy(joint.xyz, joint.rpy),
                axis: Vector3::z_axis(),
                lower: if joint.continuous { f64::NEG_INFINITY } else { joint.lower },
                upper: if joint.continuous { f64::INFINITY } else { joint.upper },
            })
            .collect();
        let wrist = file.joint.iter().enumerate().filter_map(|(link, joint)| {
            Some(WristCapsule { link, end: Vector3::from(joint.wrist_capsule?), radius: joint.radius })
        });
        let masses = file
            .joint
            .iter()
            .map(|joint| {
                let [xx, xy, xz, yy, yz, zz] = joint.inertia;
                MassProperties {
                    mass: joint.mass,
                    com: Point3::from(Vector3::from(joint.com)),
                    inertia: Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz),
                }
            })
            .collect();
        Ok(Self {
            tree: Tree { joints },
            home: file.home.iter().copied().collect(),
            links: file.joint.iter().map(|joint| joint.link.clone()).collect(),
            velocity_limits: each(|joint| joint.velocity),
            acceleration_limits: each(|joint| joint.acceleration),
            effort_limits: each(|joint| joint.effort),
            masses,
            base_mass: file.base_mass,
            torque_gains: each(|_| 1.0),
            stiffness: each(|joint| joint.stiffness),
            damping: each(|joint| joint.damping),
            armature: file.armature,
            radii: std::iter::once(file.base_radius).chain(file.joint.iter().map(|joint| joint.radius)).collect(),
            wrist: wrist.collect(),
            last_from_tool: pose_from_xyz_rpy(file.tool_xyz, file.tool_rpy),
            name: file.name,
        })
    }

    /// Returns the number of joints.
    pub fn joints(&self) -> usize {
        self.tree.len()
    }

    /// Returns the index of the link that carries the tool.
    pub fn last_link(&self) -> usize {
        self.tree.len() - 1
    }

    /// Collects `value(joint)` over the joint indices.
    pub fn each<T: Default>(&self, value: impl FnMut(usize) -> T) -> ArmVector<T> {
        (0..self.joints()).map(value).collect()
    }

    /// Computes `base_from_tool` at joint angles `q` (rad).
    pub fn tool_pose(&self, q: &[f64]) -> Isometry3<f64> {
        self.tree.forward(q)[self.last_link()] * self.last_from_tool
    }

    /// Returns the far ends of the tubes around base and links ([`Self::radii`]), m. Each is in the frame of its own
    /// link, at whose origin the tube begins.
    pub fn tube_ends(&self) -> Vec<Vector3<f64>> {
        let next = self.tree.joints.iter().map(|joint| joint.origin.translation.vector);
        next.chain([self.last_from_tool.translation.vector]).collect()
    }

    /// Converts readings of the joint torque sensors, `torque`, to true joint torques, N m.
    pub fn true_torques(&self, torque: &[f64]) -> ArmVector {
        self.each(|joint| torque[joint] / self.torque_gains[joint])
    }
}
