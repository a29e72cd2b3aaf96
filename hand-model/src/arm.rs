//! The Kinova Gen3 arm, 7 joints: frames, limits, inertias, control gains and outer sizes of `data/gen3.toml`.

use std::f64::consts::{FRAC_PI_2, PI};
use std::path::Path;

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use serde::Deserialize;

use crate::ARM_JOINTS;
use crate::hand::MassProperties;
use crate::kinematics::{Joint, JointKind, Tree, pose_from_xyz_rpy};
use platform::data::{DataError, parse_toml};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ArmFile {
    version: u32,
    #[allow(dead_code)]
    name: String,
    base_mass: f64,
    base_radius: f64,
    armature: f64,
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
        if self.version != 1 {
            return Err(DataError::field(path, "version", self.version, "1"));
        }
        if self.joint.len() != ARM_JOINTS {
            let expected = format!("{ARM_JOINTS} joints: arms with another number cannot be driven yet");
            return Err(DataError::field(path, "joint", format!("{} joints", self.joint.len()), expected));
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
            if !joint.continuous && (joint.lower.is_nan() || joint.upper.is_nan() || joint.lower >= joint.upper) {
                return fault("lower", joint.lower, "less than `upper`");
            }
        }
        Ok(())
    }
}

/// A capsule from a link's origin along its axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WristCapsule {
    /// Index of the link, 0 to 6.
    pub link: usize,
    /// Far end, link frame, m.
    pub end: Vector3<f64>,
    /// m.
    pub radius: f64,
}

/// The arm; its root is `arm_base`.
#[derive(Debug, Clone)]
pub struct Arm {
    /// Seven joints in a row.
    pub tree: Tree,
    /// Names of the seven links.
    pub links: Vec<String>,
    /// Speed limits, rad/s.
    pub velocity_limits: [f64; ARM_JOINTS],
    /// Acceleration limits, rad/s2.
    pub acceleration_limits: [f64; ARM_JOINTS],
    /// Continuous torque limits, N m.
    pub effort_limits: [f64; ARM_JOINTS],
    /// Mass properties of the seven moving links.
    pub masses: Vec<MassProperties>,
    /// Mass of the base, kg.
    pub base_mass: f64,
    /// What the joints' torque sensors show over what the joints bear: 1 as drawn.
    pub torque_gains: [f64; ARM_JOINTS],
    /// Stiffness of the joints' position control, N m/rad.
    pub stiffness: [f64; ARM_JOINTS],
    /// Damping of the joints' position control, N m s/rad.
    pub damping: [f64; ARM_JOINTS],
    /// Inertia of the drives as felt at their joints, kg m2.
    pub armature: f64,
    /// Radii of the tubes around base and links, m.
    pub radii: [f64; ARM_JOINTS + 1],
    /// What stands for the wrist against table and objects.
    pub wrist: Vec<WristCapsule>,
    /// Tool frame (where the hand is mounted) in the last link.
    pub last_from_tool: Isometry3<f64>,
}

impl Arm {
    /// The Gen3 as published.
    ///
    /// # Panics
    /// Never in a tested build: the file is compiled in and a test reads it.
    pub fn gen3() -> Self {
        Self::parse(include_str!("../data/gen3.toml"), Path::new("gen3.toml")).expect("the built-in arm is valid")
    }

    /// Builds an arm from a parameter file's text; `path` is used in errors.
    ///
    /// # Errors
    /// [`DataError`] with the field at fault.
    pub fn parse(text: &str, path: &Path) -> Result<Self, DataError> {
        let file: ArmFile = parse_toml(text, path)?;
        file.check(path)?;
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
            links: file.joint.iter().map(|joint| joint.link.clone()).collect(),
            velocity_limits: std::array::from_fn(|i| file.joint[i].velocity),
            acceleration_limits: std::array::from_fn(|i| file.joint[i].acceleration),
            effort_limits: std::array::from_fn(|i| file.joint[i].effort),
            masses,
            base_mass: file.base_mass,
            torque_gains: [1.0; ARM_JOINTS],
            stiffness: std::array::from_fn(|i| file.joint[i].stiffness),
            damping: std::array::from_fn(|i| file.joint[i].damping),
            armature: file.armature,
            radii: std::array::from_fn(|i| i.checked_sub(1).map_or(file.base_radius, |link| file.joint[link].radius)),
            wrist: wrist.collect(),
            last_from_tool: pose_from_xyz_rpy(file.tool_xyz, file.tool_rpy),
        })
    }

    /// `base_from_tool` at joint angles `q` (rad).
    pub fn tool_pose(&self, q: &[f64; ARM_JOINTS]) -> Isometry3<f64> {
        self.tree.forward(q)[ARM_JOINTS - 1] * self.last_from_tool
    }

    /// Far ends of the tubes around base and links ([`Self::radii`]), m, each in its own link's frame, in which the tube begins at the origin.
    pub fn tube_ends(&self) -> [Vector3<f64>; ARM_JOINTS + 1] {
        std::array::from_fn(|link| match self.tree.joints.get(link) {
            Some(next) => next.origin.translation.vector,
            None => self.last_from_tool.translation.vector,
        })
    }

    /// What the joints bear, N m, where their sensors show `torque`.
    pub fn borne(&self, torque: &[f64; ARM_JOINTS]) -> [f64; ARM_JOINTS] {
        std::array::from_fn(|joint| torque[joint] / self.torque_gains[joint])
    }

    /// The published "home" posture: tool horizontal, 0.43 m over the base plane.
    pub fn home() -> [f64; ARM_JOINTS] {
        [0.0, 0.26179939, PI, -2.26892803, 0.0, 0.95993109, FRAC_PI_2]
    }
}
