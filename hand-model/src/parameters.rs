//! The parameter file: every number of the hand and the arm, as TOML, and the checks that make its errors helpful.

use std::path::Path;

use nalgebra::{Point3, Vector3};
use serde::Deserialize;

use crate::digit::Digit;
use crate::hand::{CoverShape, MOST_DIGITS, MOST_HAND_JOINTS};
use crate::transmission::SPANS;
use crate::transmission::friction::CableFriction;
use platform::data::{DataError, parse_toml};

/// Farthest that a pad's centre may be from the surface of its link's cover, m.
const OFF_COVER: f64 = 3e-3;
/// The link that is the root of all digits.
const PALM: &str = "palm";
/// Largest constant moment arm, m; of a slide, largest force over tension.
const LARGEST_ARM: [f64; 2] = [0.1, 10.0];
/// Sizes of a pad, m.
const PAD_SIZES: std::ops::RangeInclusive<f64> = 0.005..=0.1;

/// The whole of a hand's parameter file such as `ftac_hand.toml`. Field names are those of the file, which documents them.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct HandParameters {
    pub version: u32,
    pub name: String,
    pub handedness: Handedness,
    pub palm: Palm,
    pub gel: Gel,
    pub servo: Servo,
    pub cable: Cable,
    pub joint_defaults: JointDefaults,
    pub joint: Vec<JointParameters>,
    pub actuator: Vec<ActuatorParameters>,
    pub configuration: std::collections::BTreeMap<String, Configuration>,
    pub pad: Vec<PadParameters>,
}

/// Which hand it is; `Right` mirrors the model in x.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs)]
pub enum Handedness {
    Left,
    Right,
}

/// A rounded box around a link: centre and half extents (m, the rounding included) in the link frame.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct Cover {
    pub center: [f64; 3],
    #[serde(default)]
    pub rpy: [f64; 3],
    pub half: [f64; 3],
    pub radius: f64,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct Palm {
    pub mass: f64,
    pub com: [f64; 3],
    pub flange_xyz: [f64; 3],
    pub servo_pack_mass: f64,
    pub servo_pack_com: [f64; 3],
    pub cover: Cover,
}

/// The elastomer of every pad.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gel {
    /// Thickness, m.
    pub thickness: f64,
    /// Pressure per indentation (Winkler foundation), Pa/m.
    pub stiffness: f64,
}

/// Servo figures at 11.1 V, output side.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Servo {
    /// Output torque per input current, N m/A.
    pub torque_constant: f64,
    /// N m.
    pub stall_torque: f64,
    /// rad/s.
    pub no_load_speed: f64,
    /// A.
    pub current_limit: f64,
    /// Encoder counts per turn.
    pub encoder_counts: u32,
    /// Rotor and gear inertia reflected to the output, kg m2.
    pub rotor_inertia: f64,
    /// Viscous loss at the output, N m s/rad.
    pub damping: f64,
    /// Dry friction of motor and gear at the output, N m.
    #[serde(default)]
    pub friction: f64,
    /// Servo turns per turn of the thumb's CMC joint.
    pub gear_ratio_opposition: f64,
}

/// Cable and spool.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cable {
    /// m.
    pub spool_radius: f64,
    /// Tension per stretch, N/m.
    pub stiffness: f64,
    /// Friction in the guides.
    pub friction: CableFriction,
}

#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct JointDefaults {
    pub damping: f64,
    pub armature: f64,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct JointParameters {
    pub name: String,
    pub parent: String,
    pub xyz: [f64; 3],
    pub rpy: [f64; 3],
    pub lower: f64,
    pub upper: f64,
    pub mass: f64,
    pub cover: Cover,
    pub spring: f64,
    pub guide_before: Option<[f64; 2]>,
    pub guide_after: Option<[f64; 2]>,
    /// Constant moment arm of the cable, m; of a joint that slides, force over tension. In the place of guides.
    pub arm: Option<f64>,
    /// The joint slides along its z axis; it turns about it otherwise.
    #[serde(default)]
    pub slide: bool,
    pub follows: Option<Follows>,
    /// In the place of `joint_defaults`.
    pub damping: Option<f64>,
    pub armature: Option<f64>,
}

/// The joint that another follows, and by how much.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct Follows {
    pub joint: String,
    #[serde(default = "one")]
    pub multiplier: f64,
}

fn one() -> f64 {
    1.0
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct ActuatorParameters {
    pub name: String,
    #[serde(default)]
    pub cable: Vec<String>,
    pub drives: Option<String>,
}

/// A sensor configuration of the paper's table.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Configuration {
    /// Size along the digit, m.
    pub h: f64,
    /// Size across, m.
    pub w: f64,
    /// Number of cameras behind the pad.
    pub cameras: usize,
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(missing_docs)]
pub struct PadParameters {
    pub name: String,
    pub link: String,
    pub configuration: String,
    pub center: [f64; 3],
    pub y: [f64; 3],
    pub z: [f64; 3],
}

impl HandParameters {
    /// Parses and checks a parameter file's text; `path` is only used in errors.
    pub fn parse(text: &str, path: &Path) -> Result<Self, DataError> {
        let parameters: Self = parse_toml(text, path)?;
        parameters.check(path)?;
        Ok(parameters)
    }

    /// Parameters of the F-TAC Hand.
    ///
    /// # Panics
    /// Never in a tested build: the file is compiled in and a test reads it.
    pub fn ftac() -> Self {
        Self::parse(include_str!("../data/ftac_hand.toml"), Path::new("ftac_hand.toml"))
            .expect("the built-in hand is valid")
    }

    /// A geometrically similar hand. Lengths go with `factor`, masses with its cube. Springs go with it as well, so that a tension bends
    /// the digits as far as before. Servos, servo pack, spools, cables and the gel's thickness stay.
    pub(crate) fn scale(&mut self, factor: f64) {
        let scaled = |values: &mut [f64]| values.iter_mut().for_each(|value| *value *= factor);
        let cover = |cover: &mut Cover| {
            scaled(&mut cover.center);
            scaled(&mut cover.half);
            cover.radius *= factor;
        };
        self.palm.mass *= factor.powi(3);
        scaled(&mut self.palm.com);
        scaled(&mut self.palm.flange_xyz);
        scaled(&mut self.palm.servo_pack_com);
        cover(&mut self.palm.cover);
        for joint in &mut self.joint {
            scaled(&mut joint.xyz);
            cover(&mut joint.cover);
            joint.guide_before.iter_mut().chain(&mut joint.guide_after).for_each(|guide| scaled(guide));
            joint.mass *= factor.powi(3);
            if joint.slide {
                (joint.lower, joint.upper) = (joint.lower * factor, joint.upper * factor);
            } else {
                joint.arm = joint.arm.map(|arm| arm * factor);
                joint.spring *= factor;
            }
        }
        for configuration in self.configuration.values_mut() {
            configuration.h *= factor;
            configuration.w *= factor;
        }
        self.pad.iter_mut().for_each(|pad| scaled(&mut pad.center));
    }

    pub(crate) fn check(&self, path: &Path) -> Result<(), DataError> {
        let fault = |field: &str, found: String, expected: &str| Err(DataError::field(path, field, found, expected));
        if self.version != 1 {
            return fault("version", self.version.to_string(), "1");
        }
        if !(1..=MOST_HAND_JOINTS).contains(&self.joint.len()) {
            let expected = format!("1 to {MOST_HAND_JOINTS} joints");
            return fault("joint", format!("{} joints", self.joint.len()), &expected);
        }
        if self.pad.is_empty() {
            return fault("pad", "none".into(), "at least one pad");
        }
        for (letter, configuration) in &self.configuration {
            configuration.check(letter, path)?;
        }
        self.check_cable(path)?;
        let mut links = vec![PALM];
        for joint in &self.joint {
            joint.check(&links, path)?;
            links.push(&joint.name);
        }
        self.check_actuators(path)?;
        let mut names = std::collections::BTreeSet::new();
        for pad in &self.pad {
            if !names.insert(&pad.name) {
                return fault(&format!("pad[{}].name", pad.name), format!("`{}` twice", pad.name), "a name of its own");
            }
            self.check_pad(pad, &links, path)?;
        }
        Ok(())
    }

    fn check_cable(&self, path: &Path) -> Result<(), DataError> {
        let positive = [
            ("cable.spool_radius", self.cable.spool_radius),
            ("cable.stiffness", self.cable.stiffness),
            ("cable.friction.presliding", self.cable.friction.presliding),
        ];
        for (field, value) in positive {
            if !(value.is_finite() && value > 0.0) {
                return Err(DataError::field(path, field, value, "a positive number"));
            }
        }
        let least = [
            ("cable.friction.coefficient", self.cable.friction.coefficient),
            ("cable.friction.routing", self.cable.friction.routing),
        ];
        for (field, value) in least {
            if !(value.is_finite() && value >= 0.0) {
                return Err(DataError::field(path, field, value, "zero or a positive number"));
            }
        }
        Ok(())
    }

    /// An actuator for each digit, named and ordered as digits are and pulling on joints of its own alone, then at most one that
    /// drives the opposition.
    fn check_actuators(&self, path: &Path) -> Result<(), DataError> {
        let (pulling, driving): (Vec<_>, Vec<_>) = self.actuator.iter().partition(|own| own.drives.is_none());
        let fault = |field: String, found: String, expected: &str| Err(DataError::field(path, field, found, expected));
        if !(1..=MOST_DIGITS).contains(&pulling.len()) || driving.len() > 1 {
            let found = format!("{} with a cable, {} that drive a joint", pulling.len(), driving.len());
            return fault("actuator".into(), found, "1 to 5 with a cable and at most one that drives a joint");
        }
        if self.actuator[..pulling.len()].iter().any(|own| own.drives.is_some()) {
            return fault("actuator".into(), "one that drives a joint before others".into(), "it behind all others");
        }
        let roots: Vec<usize> = (0..self.joint.len()).filter(|n| self.joint[*n].parent == PALM).collect();
        if roots.len() != pulling.len() {
            let found = format!("{} digits, by the joints whose parent is the palm", roots.len());
            return fault("actuator".into(), found, &format!("{}, one for each cable", pulling.len()));
        }
        for (n, (own, digit)) in pulling.iter().zip(Digit::ALL).enumerate() {
            if own.name != digit.name() {
                return fault(format!("actuator[{n}].name"), format!("`{}`", own.name), &format!("`{}`", digit.name()));
            }
            self.check_actuator(own, path)?;
            let last = roots.get(n + 1).copied().unwrap_or(self.joint.len());
            let chain = &self.joint[roots[n]..last];
            if let Some(other) = own.cable.iter().find(|name| !chain.iter().any(|joint| joint.name == **name)) {
                let field = format!("actuator[{}].cable", own.name);
                return fault(
                    field,
                    format!("`{other}`"),
                    &format!("joints of digit {} in the order of [[joint]]", n + 1),
                );
            }
        }
        driving.iter().try_for_each(|own| self.check_actuator(own, path))
    }

    /// The cable or shaft of an actuator: the joints that it names exist, and those that a cable crosses have guides or an arm.
    fn check_actuator(&self, actuator: &ActuatorParameters, path: &Path) -> Result<(), DataError> {
        let field = || format!("actuator[{}].cable", actuator.name);
        if actuator.cable.len() > SPANS {
            return Err(DataError::field(
                path,
                field(),
                format!("{} joints", actuator.cable.len()),
                "at most 3 joints",
            ));
        }
        if actuator.cable.is_empty() && actuator.drives.is_none() {
            return Err(DataError::field(path, field(), "no joint", "a cable's joints, or the joint that it `drives`"));
        }
        for name in actuator.cable.iter().chain(&actuator.drives) {
            let Some(joint) = self.joint.iter().find(|joint| &joint.name == name) else {
                return Err(DataError::field(path, field(), format!("`{name}`"), "the name of a joint"));
            };
            let guides = [joint.guide_before, joint.guide_after].iter().flatten().count();
            if actuator.drives.is_none() && !matches!((guides, joint.arm), (2, None) | (0, Some(_))) {
                return Err(DataError::field(
                    path,
                    format!("joint[{name}].guide_before/guide_after/arm"),
                    format!("{guides} guide points and {} arm", if joint.arm.is_some() { "an" } else { "no" }),
                    "two guide points or an arm, because a cable crosses this joint",
                ));
            }
        }
        Ok(())
    }

    fn check_pad(&self, pad: &PadParameters, links: &[&str], path: &Path) -> Result<(), DataError> {
        let fault = |field: &str, found: &str, expected: &str| {
            Err(DataError::field(path, format!("pad[{}].{field}", pad.name), format!("`{found}`"), expected))
        };
        if !links.contains(&pad.link.as_str()) {
            return fault("link", &pad.link, "the palm or a joint's link");
        }
        if !self.configuration.contains_key(&pad.configuration) {
            return fault("configuration", &pad.configuration, "one of the [configuration] table");
        }
        let long = |v: &[f64; 3]| v.iter().all(|x| x.is_finite()) && Vector3::from(*v).norm() > 1e-6;
        for (field, direction) in [("y", &pad.y), ("z", &pad.z)] {
            if !long(direction) {
                return Err(DataError::field(
                    path,
                    format!("pad[{}].{field}", pad.name),
                    format!("{direction:?}"),
                    "a direction",
                ));
            }
        }
        let joint = self.joint.iter().find(|joint| joint.name == pad.link);
        let cover = CoverShape::of(joint.map_or(&self.palm.cover, |joint| &joint.cover));
        let (distance, _) = cover.signed_distance(&Point3::from(Vector3::from(pad.center)));
        if distance.is_nan() || distance.abs() > OFF_COVER {
            let side = if distance > 0.0 { "outside" } else { "inside" };
            let found = format!("{:.1} mm {side} of its link's cover", 1e3 * distance.abs());
            return Err(DataError::field(
                path,
                format!("pad[{}].center", pad.name),
                found,
                format!("at most {:.0} mm from its surface", 1e3 * OFF_COVER),
            ));
        }
        Ok(())
    }
}

impl Configuration {
    fn check(&self, letter: &str, path: &Path) -> Result<(), DataError> {
        let field = |name: &str| format!("configuration.{letter}{name}");
        if letter.chars().count() != 1 {
            return Err(DataError::field(path, field(""), format!("`{letter}`"), "a name of one letter"));
        }
        for (name, size) in [(".h", self.h), (".w", self.w)] {
            if !PAD_SIZES.contains(&size) {
                let expected = format!("{} to {} m", PAD_SIZES.start(), PAD_SIZES.end());
                return Err(DataError::field(path, field(name), size, expected));
            }
        }
        if !(1..=4).contains(&self.cameras) {
            return Err(DataError::field(path, field(".cameras"), self.cameras, "1 to 4"));
        }
        Ok(())
    }
}

impl JointParameters {
    /// `links` are the palm and the joints above this one in the file.
    fn check(&self, links: &[&str], path: &Path) -> Result<(), DataError> {
        let fault = |field: &str, found: String, expected: &str| {
            Err(DataError::field(path, format!("joint[{}].{field}", self.name), found, expected))
        };
        if !links.contains(&self.parent.as_str()) {
            return fault("parent", format!("`{}`", self.parent), "the palm or a joint defined above");
        }
        if self.mass.is_nan() || self.mass <= 0.0 {
            return fault("mass", self.mass.to_string(), "a positive mass in kg");
        }
        if self.lower.is_nan() || self.upper.is_nan() || self.lower >= self.upper {
            return fault("lower", self.lower.to_string(), "less than `upper`");
        }
        if self.spring.is_nan() || self.spring <= 0.0 {
            return fault("spring", self.spring.to_string(), "a positive stiffness in N m/rad, of a slide in N/m");
        }
        for (field, value) in [("damping", self.damping), ("armature", self.armature)] {
            if let Some(found) = value.filter(|value| !(value.is_finite() && *value > 0.0)) {
                return fault(field, found.to_string(), "a positive number");
            }
        }
        let most = LARGEST_ARM[usize::from(self.slide)];
        if let Some(arm) = self.arm.filter(|arm| !(*arm > 0.0 && *arm <= most)) {
            return fault("arm", arm.to_string(), &format!("a positive number of at most {most}"));
        }
        if self.slide && (self.guide_before.is_some() || self.guide_after.is_some()) {
            return fault("slide", "guides".into(), "an arm: a cable between guides turns its joint");
        }
        if let Some(follows) = &self.follows {
            if !links.contains(&follows.joint.as_str()) || follows.joint == PALM {
                return fault("follows.joint", format!("`{}`", follows.joint), "a joint defined above");
            }
            if !(follows.multiplier.is_finite() && follows.multiplier != 0.0) {
                return fault("follows.multiplier", follows.multiplier.to_string(), "a number that is not 0");
            }
        }
        Ok(())
    }
}
