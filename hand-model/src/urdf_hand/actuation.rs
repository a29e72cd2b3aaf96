//! The actuation file: actuators, springs and everything else that a URDF lacks.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use nalgebra::Vector3;
use serde::Deserialize;
use urdf_rs::{JointType, Robot};

use super::PINION_RADIUS;
use crate::hand_mechanism::{CableActuator, HandMechanism, JointDynamics, PalmDescription};
use crate::transmission::Lever;
use crate::urdf::urdf_error;
use ftac_platform::data::DataError;

/// Largest moment arm of a cable, m, and largest force over tension for a sliding joint.
const MAX_MOMENT_ARM: f64 = 1.0;
const MAX_FORCE_RATIO: f64 = 100.0;
/// Smallest share of a joint's range that must remain in the direction of the pull.
const MIN_PULL_RANGE: f64 = 0.02;
/// Ratio of the range in the direction of the pull to the range on the other side. Below it, the arm's sign is probably
/// wrong.
const SUSPECT_RANGE_RATIO: f64 = 0.25;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ActuationFile {
    version: u32,
    damping: f64,
    armature: f64,
    spring: f64,
    actuator: Vec<ActuatorFile>,
    #[serde(default)]
    pub held: BTreeMap<String, f64>,
    #[serde(default)]
    open: BTreeMap<String, f64>,
    slide: Option<SlideFile>,
    #[serde(default)]
    palm: PalmFile,
    #[serde(default)]
    pub visuals: bool,
    /// Joints that move although nothing pulls them; only for a URDF without an actuation file.
    #[serde(skip)]
    free: Vec<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ActuatorFile {
    name: String,
    arms: BTreeMap<String, f64>,
    max_tension: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SlideFile {
    damping: f64,
    armature: f64,
    spring: f64,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct PalmFile {
    #[serde(default)]
    links: Vec<String>,
    facing: Option<[f64; 3]>,
}

impl ActuationFile {
    /// Builds the file of a hand whose joints `free` move and which nothing pulls.
    pub(crate) fn without_actuators(free: Vec<String>) -> Self {
        Self {
            version: 1,
            damping: 0.02,
            armature: 1e-4,
            spring: 0.02,
            actuator: Vec::new(),
            held: BTreeMap::new(),
            open: BTreeMap::new(),
            slide: None,
            palm: PalmFile::default(),
            visuals: false,
            free,
        }
    }

    /// Returns the names of the independently moving joints.
    pub(crate) fn actuated_joints(&self) -> BTreeSet<&str> {
        let arms = self.actuator.iter().flat_map(|actuator| actuator.arms.keys());
        arms.chain(&self.free).map(String::as_str).collect()
    }

    pub(crate) fn revolute_dynamics(&self) -> JointDynamics {
        JointDynamics { spring: self.spring, damping: self.damping, armature: self.armature }
    }

    pub(crate) fn prismatic_dynamics(&self) -> JointDynamics {
        let over = |turn: f64| turn / (PINION_RADIUS * PINION_RADIUS);
        match &self.slide {
            Some(SlideFile { damping, armature, spring }) => {
                JointDynamics { spring: *spring, damping: *damping, armature: *armature }
            }
            None => {
                JointDynamics { spring: over(self.spring), damping: over(self.damping), armature: over(self.armature) }
            }
        }
    }

    pub(crate) fn palm_description(&self) -> PalmDescription {
        let facing = self.palm.facing.and_then(|facing| Vector3::from(facing).try_normalize(f64::MIN_POSITIVE));
        PalmDescription { links: self.palm.links.clone(), facing }
    }

    /// Checks everything that can be checked without the mechanism.
    pub(crate) fn check(&self, robot: &Robot, path: &Path) -> Result<(), DataError> {
        if self.version != 1 {
            return Err(DataError::field(path, "version", self.version, "1"));
        }
        let slide = self.slide.iter().flat_map(|slide| {
            [("slide.damping", slide.damping), ("slide.armature", slide.armature), ("slide.spring", slide.spring)]
        });
        let all = [("damping", self.damping), ("armature", self.armature), ("spring", self.spring)];
        for (field, value) in all.into_iter().chain(slide) {
            if !(value.is_finite() && value > 0.0) {
                return Err(DataError::field(path, field, value, "a positive number"));
            }
        }
        if let Some(facing) = self.palm.facing {
            let length = Vector3::from(facing).norm();
            if !(length.is_finite() && length > 1e-6) {
                return Err(DataError::field(
                    path,
                    "palm.facing",
                    format!("{facing:?}"),
                    "a direction: three numbers, not all zero",
                ));
            }
        }
        for link in &self.palm.links {
            if !robot.links.iter().any(|own| own.name == *link) {
                let known: Vec<&str> = robot.links.iter().map(|own| own.name.as_str()).collect();
                let expected = format!("links of the URDF: {}", known.join(", "));
                return Err(DataError::field(path, "palm.links", format!("`{link}`"), expected));
            }
        }
        for (n, actuator) in self.actuator.iter().enumerate() {
            let element = format!("actuator[{}]", actuator.name);
            if self.actuator[..n].iter().any(|other| other.name == actuator.name) {
                return Err(urdf_error(
                    path,
                    element,
                    "name",
                    "it twice".into(),
                    "each actuator to have a name of its own",
                ));
            }
            if let Some(most) = actuator.max_tension.filter(|most| !(most.is_finite() && *most > 0.0)) {
                return Err(urdf_error(path, element, "max_tension", most.to_string(), "a positive tension in N"));
            }
            self.check_moment_arms(actuator, robot, path)?;
        }
        Ok(())
    }

    fn check_moment_arms(&self, actuator: &ActuatorFile, robot: &Robot, path: &Path) -> Result<(), DataError> {
        if actuator.arms.is_empty() {
            let element = format!("actuator[{}]", actuator.name);
            return Err(urdf_error(
                path,
                element,
                "arms",
                "none".into(),
                "at least one joint with its moment arm in m",
            ));
        }
        for (name, arm) in &actuator.arms {
            let element = format!("actuator[{}].arms", actuator.name);
            let own = robot.joints.iter().find(|joint| joint.name == *name && joint.joint_type != JointType::Fixed);
            let Some(own) = own else {
                let moving =
                    robot.joints.iter().filter(|joint| joint.joint_type != JointType::Fixed && joint.mimic.is_none());
                let known: Vec<&str> = moving.map(|joint| joint.name.as_str()).collect();
                let found = if robot.joints.iter().any(|joint| joint.name == *name) {
                    "a fixed joint"
                } else {
                    "no such joint"
                };
                let expected = format!("a joint of the URDF that moves: {}", known.join(", "));
                return Err(urdf_error(path, element, name, found.into(), &expected));
            };
            if let Some(mimic) = &own.mimic {
                let expected = format!("the joint that it mimics, `{}`", mimic.joint);
                return Err(urdf_error(path, element, name, "a joint that mimics another".into(), &expected));
            }
            let (most, unit) = match own.joint_type {
                JointType::Prismatic => (MAX_FORCE_RATIO, "a force over the tension"),
                _ => (MAX_MOMENT_ARM, "a moment arm in m"),
            };
            if !(arm.abs() > 0.0 && arm.abs() <= most) {
                let expected = format!("{unit}, not 0 and at most {most} either way");
                return Err(urdf_error(path, element, name, arm.to_string(), &expected));
            }
        }
        Ok(())
    }
}

/// Adds actuators and open coordinates to the hand.
pub(crate) fn add_actuators(hand: &mut HandMechanism, file: ActuationFile, path: &Path) -> Result<(), DataError> {
    for (name, open) in &file.open {
        let wrong = |found: &str, expected: &str| Err(urdf_error(path, "open".into(), name, found.into(), expected));
        let pulled = file.actuator.iter().any(|actuator| actuator.arms.contains_key(name));
        let Some(joint) = hand.tree.find(name).filter(|_| pulled) else {
            return wrong("no joint that an actuator pulls", "one of the actuators' joints");
        };
        let own = &hand.tree.joints[joint];
        if !(own.lower..=own.upper).contains(open) {
            let expected = format!("within the joint's limits, {} to {} {}", own.lower, own.upper, own.kind.unit());
            return wrong(&open.to_string(), &expected);
        }
        hand.spring_rest[joint] = *open;
    }
    let rest = hand.rest_coordinates();
    // If two cables pull a joint in opposite directions (antagonists), one of them opens it.
    let ways: Vec<(String, bool)> =
        file.actuator.iter().flat_map(|own| own.arms.iter().map(|(name, arm)| (name.clone(), *arm > 0.0))).collect();
    for actuator in file.actuator {
        let mut arms = Vec::new();
        for (name, arm) in &actuator.arms {
            let element = format!("actuator[{}].arms", actuator.name);
            // `check` has verified that the joint moves.
            let Some(joint) = hand.tree.find(name) else { continue };
            arms.push((joint, Lever::Constant(*arm)));
            if ways.contains(&(name.clone(), *arm <= 0.0)) {
                continue;
            }
            check_pull_range(hand, (joint, *arm), rest[joint], path, &element)?
                .into_iter()
                .for_each(|note| hand.notes.push(note));
        }
        let mut pull = CableActuator { name: actuator.name, levers: arms, max_tension: None };
        pull.max_tension = max_tension(hand, &pull, actuator.max_tension);
        hand.actuators.push(pull);
    }
    Ok(())
}

/// Checks that a pulled joint can move in the direction of the pull. Returns a note if its range there is much smaller
/// than on the other side.
fn check_pull_range(
    hand: &HandMechanism,
    (joint, arm): (usize, f64),
    rest: f64,
    path: &Path,
    element: &str,
) -> Result<Option<String>, DataError> {
    let own = &hand.tree.joints[joint];
    let (room, other) =
        if arm > 0.0 { (own.upper - rest, rest - own.lower) } else { (rest - own.lower, own.upper - rest) };
    let unit = own.kind.unit();
    if own.upper <= own.lower {
        let expected = format!("a joint that can move; its limits are {} and {} {unit}", own.lower, own.upper);
        return Err(urdf_error(path, element.into(), &own.name, "a pull".into(), &expected));
    }
    if room.is_finite() && room <= MIN_PULL_RANGE * (own.upper - own.lower) {
        let (sign, limit) = if arm > 0.0 { ("negative", own.upper) } else { ("positive", own.lower) };
        let found = format!("{arm}, which pulls the joint against its limit {limit} {unit}, where it rests");
        let expected = format!("a {sign} arm, or the joint's open coordinate in [open]");
        return Err(urdf_error(path, element.into(), &own.name, found, &expected));
    }
    Ok((room < SUSPECT_RANGE_RATIO * other && other.is_finite()).then(|| {
        format!(
            "{}: {element}.{}: {arm} pulls towards a limit {room:.3} {unit} away, and {other:.3} {unit} are on the other side; is its sign right?",
            path.display(),
            own.name
        )
    }))
}

/// Computes the largest tension of a cable with these arms: the actuator's own limit, or the tension at which a joint's
/// effort limit is reached.
fn max_tension(hand: &HandMechanism, pull: &CableActuator, own: Option<f64>) -> Option<(f64, String)> {
    let of_joint = |(joint, arm): (usize, f64)| {
        let effort = hand.effort_limits[joint]?;
        let own = &hand.tree.joints[joint];
        Some((effort / arm.abs(), format!("the effort of {}, {effort} {}", own.name, own.kind.effort_unit())))
    };
    let own = own.map(|most| (most, "max_tension".to_owned()));
    pull.moment_arms().filter_map(of_joint).chain(own).min_by(|a, b| a.0.total_cmp(&b.0))
}
