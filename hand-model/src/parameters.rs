//! The parameter file of the hand: all its numbers, as TOML, and checks with helpful errors.

mod checks;
mod grasps;
mod hold_detection;

use std::fmt;
use std::path::Path;

use serde::Deserialize;

use crate::transmission::friction::CableFriction;
use ftac_platform::data::{DataError, parse_toml};

pub use self::grasps::{GraspRanges, Grasps, ThumbRanges};
pub use self::hold_detection::{HoldLimits, PalpationParameters};

/// The content of a hand's parameter file such as `ftac_hand.toml`. Field names are those of the file, which documents
/// them.
#[derive(Clone, Deserialize)]
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
    pub configuration: std::collections::BTreeMap<String, SensorConfiguration>,
    pub pad: Vec<PadParameters>,
    pub grasps: Option<Grasps>,
    pub hold: Option<HoldLimits>,
    pub palpation: Option<PalpationParameters>,
}

/// Prints everything that decides how the hand moves and touches, as [`crate::RobotModel::mechanics_text`] needs it. How the
/// hand is used is left out.
impl fmt::Debug for HandParameters {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.debug_struct("HandParameters")
            .field("version", &self.version)
            .field("name", &self.name)
            .field("handedness", &self.handedness)
            .field("palm", &self.palm)
            .field("gel", &self.gel)
            .field("servo", &self.servo)
            .field("cable", &self.cable)
            .field("joint_defaults", &self.joint_defaults)
            .field("joint", &self.joint)
            .field("actuator", &self.actuator)
            .field("configuration", &self.configuration)
            .field("pad", &self.pad)
            .finish()
    }
}

/// Handedness of the hand; `Right` mirrors the model in x.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
#[allow(missing_docs)]
pub enum Handedness {
    Left,
    Right,
}

/// A rounded box around a link: centre and half extents (m, including the rounding) in the link frame.
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

/// Servo data at 11.1 V, output side.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Servo {
    /// Output torque per input current, N m/A.
    pub torque_constant: f64,
    /// Stall torque, N m.
    pub stall_torque: f64,
    /// No-load speed, rad/s.
    pub no_load_speed: f64,
    /// Current limit, A.
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
    /// Radius of the spool, m.
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
    /// Constant moment arm of the cable, m; for a sliding joint, force over tension. Replaces the guides.
    pub arm: Option<f64>,
    /// True if the joint slides along its z axis; otherwise it turns about it.
    #[serde(default)]
    pub slide: bool,
    pub follows: Option<Follows>,
    /// Override of `joint_defaults`.
    pub damping: Option<f64>,
    pub armature: Option<f64>,
}

/// Coupling of a joint to the one it follows.
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

/// A sensor configuration from the paper's table.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorConfiguration {
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
    /// Parses and checks the text of a parameter file; `path` is only used in errors.
    pub fn parse(text: &str, path: &Path) -> Result<Self, DataError> {
        let parameters: Self = parse_toml(text, path)?;
        parameters.check(path)?;
        Ok(parameters)
    }

    /// Returns the parameters of the F-TAC Hand.
    ///
    /// # Panics
    /// Never in a tested build: the file is compiled in and a test reads it.
    pub fn ftac() -> Self {
        Self::parse(include_str!("../data/ftac_hand.toml"), Path::new("ftac_hand.toml"))
            .expect("the built-in hand is valid")
    }

    /// Scales the hand geometrically. Lengths scale with `factor`, masses with its cube. Spring stiffnesses scale with
    /// `factor` too, so that a given tension bends the digits as far as before. Servos, servo pack, spools, cables and
    /// the gel's thickness keep their values.
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
}
