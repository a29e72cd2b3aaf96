//! Parameters in which instances of a nominal model differ, and their priors: `data/priors.toml`.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::LazyLock;

use ftac_platform::data::{DataError, parse_toml};
use hand_model::RobotModel;
use serde::{Deserialize, Serialize};

/// A physical quantity that varies between instances.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Stiffness of a joint's spring.
    Spring,
    /// Rest angle of a joint's spring.
    SpringRest,
    /// Angle of a link at its open stop.
    JointZero,
    /// Radius of a cable's spool.
    SpoolRadius,
    /// Tensile stiffness of a cable.
    CableStiffness,
    /// Friction coefficient of a cable in its guides.
    GuideFriction,
    /// Wrap angle of a cable in the palm.
    GuideTurn,
    /// Torque constant of a servo.
    TorqueConstant,
    /// Dry friction of a servo.
    ServoFriction,
    /// Viscous friction of a servo.
    ServoDamping,
    /// Stiffness of the gel of all pads.
    GelStiffness,
    /// Thickness of the gel of all pads.
    GelThickness,
    /// Friction of all pads on any object.
    PadFriction,
    /// Encoder offset of an arm joint: reading - true angle.
    ArmEncoder,
    /// Position of the hand on its flange.
    MountPosition,
    /// Rotation of the hand on its flange.
    MountTurn,
    /// Gain of an arm joint's torque sensor: reading over true torque.
    ArmTorqueGain,
}

/// Effect of a deviation on the nominal value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PriorKind {
    /// Nominal value times exp(deviation).
    Factor,
    /// Nominal value plus the deviation, SI.
    Offset,
}

/// A Gaussian prior of a deviation, truncated at three standard deviations.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Prior {
    pub kind: PriorKind,
    #[serde(default)]
    pub mean: f64,
    pub sigma: f64,
    /// Source of the figures.
    pub source: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PriorFile {
    version: u32,
    prior: BTreeMap<Quantity, Prior>,
}

/// One scalar parameter in which instances differ.
#[derive(Debug, Clone, PartialEq)]
pub struct PlantParameter {
    /// Name, `<owner>.<quantity>`, such as `index_1.spring`; the quantity alone if it belongs to the whole hand.
    pub name: String,
    pub quantity: Quantity,
    /// Index of the joint, cable, servo, arm joint or axis.
    pub index: usize,
    pub prior: Prior,
}

impl Quantity {
    /// All quantities, in the order in which they are sampled. A new one comes last, so that the samples of all others
    /// stay the same.
    pub const ALL: [Self; 17] = [
        Self::Spring,
        Self::SpringRest,
        Self::JointZero,
        Self::SpoolRadius,
        Self::CableStiffness,
        Self::GuideFriction,
        Self::GuideTurn,
        Self::TorqueConstant,
        Self::ServoFriction,
        Self::ServoDamping,
        Self::GelStiffness,
        Self::GelThickness,
        Self::PadFriction,
        Self::ArmEncoder,
        Self::MountPosition,
        Self::MountTurn,
        Self::ArmTorqueGain,
    ];

    /// Returns the name used in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Spring => "spring",
            Self::SpringRest => "spring_rest",
            Self::JointZero => "joint_zero",
            Self::SpoolRadius => "spool_radius",
            Self::CableStiffness => "cable_stiffness",
            Self::GuideFriction => "guide_friction",
            Self::GuideTurn => "guide_turn",
            Self::TorqueConstant => "torque_constant",
            Self::ServoFriction => "servo_friction",
            Self::ServoDamping => "servo_damping",
            Self::GelStiffness => "gel_stiffness",
            Self::GelThickness => "gel_thickness",
            Self::PadFriction => "pad_friction",
            Self::ArmEncoder => "encoder",
            Self::MountPosition => "position",
            Self::MountTurn => "turn",
            Self::ArmTorqueGain => "torque_gain",
        }
    }

    /// Returns the unit of the deviation.
    pub fn unit(self) -> &'static str {
        match self {
            Self::SpringRest | Self::JointZero | Self::ArmEncoder | Self::MountTurn => "rad",
            Self::ServoFriction => "N m",
            Self::MountPosition => "m",
            _ => "log",
        }
    }

    /// Lists the owners of the quantity by name; one empty name if it belongs to the whole hand.
    fn owners(self, RobotModel { hand, arm, .. }: &RobotModel) -> Vec<String> {
        let actuators = || hand.parameters.actuator.iter().map(|actuator| actuator.name.clone());
        match self {
            Self::Spring | Self::SpringRest | Self::JointZero => {
                hand.tree.joints.iter().map(|joint| joint.name.clone()).collect()
            }
            Self::SpoolRadius | Self::CableStiffness | Self::GuideFriction | Self::GuideTurn => {
                actuators().take(hand.cables.len()).collect()
            }
            Self::TorqueConstant | Self::ServoFriction | Self::ServoDamping => actuators().collect(),
            Self::GelStiffness | Self::GelThickness | Self::PadFriction => vec![String::new()],
            Self::ArmEncoder | Self::ArmTorqueGain => (1..=arm.joints()).map(|joint| format!("arm_{joint}")).collect(),
            Self::MountPosition | Self::MountTurn => ["x", "y", "z"].map(|axis| format!("mount_{axis}")).to_vec(),
        }
    }
}

static PRIORS: LazyLock<BTreeMap<Quantity, Prior>> = LazyLock::new(|| {
    let path = Path::new("priors.toml");
    parse_priors(include_str!("../data/priors.toml"), path).expect("the built-in priors are valid")
});

fn parse_priors(text: &str, path: &Path) -> Result<BTreeMap<Quantity, Prior>, DataError> {
    let file: PriorFile = parse_toml(text, path)?;
    if file.version != 1 {
        return Err(DataError::field(path, "version", file.version, "1"));
    }
    for (quantity, spread) in &file.prior {
        if !(spread.sigma.is_finite() && spread.sigma > 0.0 && spread.mean.is_finite()) {
            let field = format!("prior.{}.sigma", quantity.name());
            return Err(DataError::field(path, field, spread.sigma, "a positive number, and a finite mean"));
        }
    }
    Ok(file.prior)
}

/// Lists every parameter in which instances of `robot` differ, in the order in which they are sampled.
///
/// # Panics
/// Never in a tested build: the priors are compiled in and a test reads them.
pub fn parameters(robot: &RobotModel) -> Vec<PlantParameter> {
    let of = |quantity: Quantity| {
        let spread = &PRIORS[&quantity];
        quantity.owners(robot).into_iter().enumerate().map(move |(index, owner)| {
            let name =
                if owner.is_empty() { quantity.name().to_owned() } else { format!("{owner}.{}", quantity.name()) };
            PlantParameter { name, quantity, index, prior: spread.clone() }
        })
    };
    Quantity::ALL.into_iter().flat_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_quantity_has_a_spread_with_a_source_and_names_are_unique() {
        let all = parameters(&RobotModel::ftac_gen3());
        assert_eq!(all.len(), 3 * 15 + 4 * 5 + 3 * 6 + 3 + 7 + 6 + 7);
        assert!(all.iter().all(|parameter| parameter.prior.source.len() > 10));
        let names: std::collections::BTreeSet<_> = all.iter().map(|parameter| &parameter.name).collect();
        assert_eq!(names.len(), all.len());
    }

    #[test]
    fn a_spread_that_is_none_is_named() {
        let text = "version = 1\n[prior.spring]\nkind = \"factor\"\nsigma = -0.1\nsource = \"a guess\"\n";
        let error = parse_priors(text, Path::new("mine.toml")).unwrap_err().to_string();
        assert!(error.starts_with("mine.toml: prior.spring.sigma: found -0.1"), "{error}");
    }
}
