//! The parameter file of a hand: all its numbers, as TOML, with checks that name file and field.
//!
//! `data/ftac_hand.toml`, `data/robots/allegro.toml` and `data/robots/franka_hand.toml` are complete files with
//! comments: a hand driven by cables, one with motors in its joints, and a parallel gripper. All values are in SI
//! units, except for angles of [`GraspRanges`], in degrees.

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

/// The content of a hand's parameter file such as `ftac_hand.toml`. Field names are those of the file.
///
/// ```
/// use std::path::Path;
///
/// use hand_model::parameters::HandParameters;
///
/// # const TEXT: &str = include_str!("../data/robots/franka_hand.toml");
/// let gripper = HandParameters::parse(TEXT, Path::new("franka_hand.toml"))?;
/// assert!(gripper.joint.iter().all(|joint| joint.slide));
///
/// // A fault is reported with file, field, value and expectation.
/// let error = HandParameters::parse(&TEXT.replacen("mass = 0.05", "mass = 0.0", 1), Path::new("mine.toml"));
/// let message = error.expect_err("a link without mass").to_string();
/// assert_eq!(message, "mine.toml: joint[thumb_1].mass: found 0, expected a positive mass in kg");
/// # Ok::<(), hand_model::DataError>(())
/// ```
#[derive(Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HandParameters {
    /// Version of the file format, 1.
    pub version: u32,
    /// Name of the hand.
    pub name: String,
    /// Handedness; all numbers of the file are those of the left hand.
    pub handedness: Handedness,
    /// The palm, root of all digits.
    pub palm: Palm,
    /// Elastomer of the pads.
    pub gel: Gel,
    /// Servos, all alike.
    pub servo: Servo,
    /// Cables, all alike.
    pub cable: Cable,
    /// Values of the joints that state none of their own.
    pub joint_defaults: JointDefaults,
    /// Joints with their links, parents first, digit by digit.
    pub joint: Vec<JointParameters>,
    /// Actuators: one for each digit in the order of [`crate::Digit`], then that of the opposition, if there is one.
    pub actuator: Vec<ActuatorParameters>,
    /// Sensor configurations by their letter.
    pub configuration: std::collections::BTreeMap<String, SensorConfiguration>,
    /// Pads; at least one.
    pub pad: Vec<PadParameters>,
    /// Sets of digits that take objects; default: those of the F-TAC Hand.
    pub grasps: Option<Grasps>,
    /// Thresholds for detecting a hold, for controllers that decide by them.
    pub hold: Option<HoldLimits>,
    /// Palpation; none for a hand that does not palpate.
    pub palpation: Option<PalpationParameters>,
}

/// Prints everything that decides how the hand moves and touches, as [`crate::RobotModel::mechanics_text`] needs it.
/// The use of the hand is left out.
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
pub enum Handedness {
    /// Left hand, as in the file.
    Left,
    /// Right hand: the mirror image.
    Right,
}

impl fmt::Display for Handedness {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Left => "left",
            Self::Right => "right",
        })
    }
}

/// A rounded box around a link, in the link's frame.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cover {
    /// Centre, m.
    pub center: [f64; 3],
    /// Orientation: fixed-axis roll, pitch, yaw, rad.
    #[serde(default)]
    pub rpy: [f64; 3],
    /// Half extents including the rounding, m.
    pub half: [f64; 3],
    /// Rounding radius, m.
    pub radius: f64,
}

/// The palm.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Palm {
    /// Mass without the servo pack, kg.
    pub mass: f64,
    /// Centre of mass without the servo pack, palm frame, m.
    pub com: [f64; 3],
    /// Origin of the arm's flange in the palm frame, m. The flange's z axis points along y of the palm.
    pub flange_xyz: [f64; 3],
    /// Mass of servos and electronics that move with the palm, kg.
    pub servo_pack_mass: f64,
    /// Centre of mass of the servo pack, palm frame, m.
    pub servo_pack_com: [f64; 3],
    /// Collision shape.
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

/// Damping and armature of joints that state none of their own.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointDefaults {
    /// Damping, N m s/rad or N s/m.
    pub damping: f64,
    /// Armature (reflected inertia of the drive), kg m2 or kg.
    pub armature: f64,
}

/// A joint and its link. The joint turns about, or slides along, the z axis of its frame.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointParameters {
    /// Name of the joint and of its link.
    pub name: String,
    /// Parent link: `palm`, or the name of an earlier joint.
    pub parent: String,
    /// Origin of the joint frame in the parent frame, m.
    pub xyz: [f64; 3],
    /// Orientation of the joint frame: fixed-axis roll, pitch, yaw, rad.
    pub rpy: [f64; 3],
    /// Lower limit, rad or m.
    pub lower: f64,
    /// Upper limit, rad or m.
    pub upper: f64,
    /// Mass of the link, kg.
    pub mass: f64,
    /// Collision shape of the link; its mass is distributed over this box.
    pub cover: Cover,
    /// Stiffness of the opening spring, N m/rad or N/m; its rest coordinate is 0.
    pub spring: f64,
    /// Guide point of the cable on the parent link: along the link and towards the palm side, m.
    pub guide_before: Option<[f64; 2]>,
    /// Guide point of the cable on the joint's own link, m.
    pub guide_after: Option<[f64; 2]>,
    /// Constant moment arm of the cable, m; for a sliding joint, force over tension. Replaces the guides.
    pub arm: Option<f64>,
    /// True if the joint slides along its z axis; otherwise it turns about it.
    #[serde(default)]
    pub slide: bool,
    /// Coupling to another joint.
    pub follows: Option<Follows>,
    /// Override of the default damping, N m s/rad or N s/m.
    pub damping: Option<f64>,
    /// Override of the default armature, kg m2 or kg.
    pub armature: Option<f64>,
}

/// Coupling of a joint to the one it follows.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Follows {
    /// Name of the joint that is followed.
    pub joint: String,
    /// Motion of the joint over that of the followed one; default: 1.
    #[serde(default = "one")]
    pub multiplier: f64,
}

fn one() -> f64 {
    1.0
}

/// An actuator: it pulls the cable of a digit, or turns the opposition joint.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActuatorParameters {
    /// Name, for a cable that of the digit.
    pub name: String,
    /// Names of the joints that the cable crosses, proximal first.
    #[serde(default)]
    pub cable: Vec<String>,
    /// Name of the opposition joint, for the actuator that turns it instead of pulling a cable.
    pub drives: Option<String>,
}

/// A sensor configuration: size of the pads of one kind, and their number of cameras.
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

/// A tactile pad on a link.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PadParameters {
    /// Name of the pad.
    pub name: String,
    /// Link that carries it: `palm`, or the name of a joint.
    pub link: String,
    /// Letter of its sensor configuration.
    pub configuration: String,
    /// Centre of the sensing surface, link frame, m.
    pub center: [f64; 3],
    /// Direction of the pad's y axis (along the digit), link frame.
    pub y: [f64; 3],
    /// Direction out of the surface, link frame.
    pub z: [f64; 3],
}

impl HandParameters {
    /// Parses and checks the text of a parameter file; `path` is only used in errors.
    ///
    /// # Errors
    /// [`DataError`] with the field at fault.
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
