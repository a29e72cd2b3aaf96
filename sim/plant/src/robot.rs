//! One instance of a nominal robot: its deviations, sampled or identified, and the resulting hand and arm.

use std::sync::Arc;

use hand_model::arm::MAX_ARM_JOINTS;
use hand_model::{Arm, Hand, RobotModel};
use nalgebra::{UnitQuaternion, Vector3};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

use crate::arm::ArmDefects;
use crate::draws::truncated_gaussian;
use crate::prior::{PlantParameter, PriorKind, Quantity, parameters};

/// Random stream from which robots are sampled; no trial uses it.
const RNG_STREAM: u64 = 1 << 20;
/// Serial number of the tactile cameras before those of the first instance, among the units of [`optics`]; lower
/// numbers belong to benchmark and calibration.
///
/// [`optics`]: https://docs.rs/optics
const CAMERA_SERIAL_OFFSET: u64 = 1000;

/// Deviations of one robot from its nominal model.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotInstance {
    parameters: Vec<PlantParameter>,
    /// Deviation of each parameter, in the order of [`parameters`].
    deviations: Vec<f64>,
}

/// A parameter of an instance, as written to the truth file.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct NamedDeviation {
    pub parameter: String,
    pub kind: PriorKind,
    pub unit: &'static str,
    pub deviation: f64,
}

impl RobotInstance {
    /// Returns the nominal robot.
    pub fn nominal(robot: &RobotModel) -> Self {
        let parameters = parameters(robot);
        Self { deviations: vec![0.0; parameters.len()], parameters }
    }

    /// Samples instance `number`: the same number gives the same robot. Number 0 is the nominal robot.
    pub fn sample(robot: &RobotModel, number: u64) -> Self {
        let mut own = Self::nominal(robot);
        if number == 0 {
            return own;
        }
        let mut rng = ChaCha8Rng::seed_from_u64(number);
        rng.set_stream(RNG_STREAM);
        for (deviation, parameter) in own.deviations.iter_mut().zip(&own.parameters) {
            *deviation = parameter.prior.mean + parameter.prior.sigma * truncated_gaussian(&mut rng);
        }
        own
    }

    /// Returns the serial number of the tactile cameras of instance `number`, if it has its own.
    pub fn camera_serial(number: u64) -> Option<u64> {
        (number > 0).then_some(CAMERA_SERIAL_OFFSET + number)
    }

    /// Returns the parameters in which instances differ.
    pub fn parameters(&self) -> &[PlantParameter] {
        &self.parameters
    }

    /// Returns all deviations, in the order of [`Self::parameters`].
    pub fn deviations(&self) -> &[f64] {
        &self.deviations
    }

    /// Returns the index of the parameter called `name`.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.parameters.iter().position(|parameter| parameter.name == name)
    }

    /// Returns the parameter index of a quantity of one owner.
    pub fn parameter_index(&self, quantity: Quantity, index: usize) -> Option<usize> {
        self.parameters.iter().position(|parameter| parameter.quantity == quantity && parameter.index == index)
    }

    /// Returns the deviation of a quantity of one owner; 0 if there is no such owner.
    pub fn deviation(&self, quantity: Quantity, index: usize) -> f64 {
        self.parameter_index(quantity, index).map_or(0.0, |place| self.deviations[place])
    }

    /// Sets the deviation with parameter index `place`.
    pub fn set(&mut self, place: usize, deviation: f64) {
        self.deviations[place] = deviation;
    }

    /// Lists all deviations by name.
    pub fn named_deviations(&self) -> Vec<NamedDeviation> {
        let describe = |(parameter, deviation): (&PlantParameter, &f64)| NamedDeviation {
            parameter: parameter.name.clone(),
            kind: parameter.prior.kind,
            unit: parameter.quantity.unit(),
            deviation: *deviation,
        };
        self.parameters.iter().zip(&self.deviations).map(describe).collect()
    }

    /// Applies the deviations to the nominal hand `drawn`, including its rotation on the flange.
    pub fn apply_to_hand(&self, drawn: &Hand) -> Hand {
        let mut hand = drawn.clone();
        for (parameter, &deviation) in self.parameters.iter().zip(&self.deviations) {
            if deviation != 0.0 {
                apply_hand_deviation(&mut hand, parameter, deviation);
            }
        }
        let arm = self.arm_defects();
        if [arm.mount_position, arm.mount_rotation] != [Vector3::zeros(); 2] {
            hand.palm_from_flange *= arm.mount().inverse();
        }
        hand
    }

    /// Applies the deviations to the nominal arm `drawn`: encoder offsets move its joint origins, so that its readings
    /// can be used as joint angles, and torque gains scale its torque readings.
    pub fn apply_to_arm(&self, drawn: &Arm) -> Arm {
        let mut arm = drawn.clone();
        for (n, joint) in arm.tree.joints.iter_mut().enumerate() {
            let shown = self.deviation(Quantity::ArmEncoder, n);
            if shown != 0.0 {
                joint.origin *= UnitQuaternion::from_axis_angle(&joint.axis, -shown);
            }
        }
        for (n, gain) in arm.torque_gains.iter_mut().enumerate() {
            *gain *= self.deviation(Quantity::ArmTorqueGain, n).exp();
        }
        arm
    }

    /// Applies the deviations to the `nominal` robot.
    pub fn apply_to_robot(&self, nominal: &RobotModel) -> RobotModel {
        let (hand, arm) = (self.apply_to_hand(&nominal.hand), self.apply_to_arm(&nominal.arm));
        RobotModel { hand: Arc::new(hand), arm: Arc::new(arm), ..nominal.clone() }
    }

    /// Returns encoder and mount deviations as defects of a simulated arm, without a payload.
    pub fn arm_defects(&self) -> ArmDefects {
        let axes = |quantity| Vector3::from_fn(|axis, _| self.deviation(quantity, axis));
        ArmDefects {
            encoders: (0..MAX_ARM_JOINTS).map(|joint| self.deviation(Quantity::ArmEncoder, joint)).collect(),
            mount_position: axes(Quantity::MountPosition),
            mount_rotation: axes(Quantity::MountTurn),
            payload: 0.0,
        }
    }

    /// Returns the ratio of its pads' friction on any object to the nominal friction.
    pub fn pad_friction(&self) -> f64 {
        self.deviation(Quantity::PadFriction, 0).exp()
    }
}

fn apply_hand_deviation(hand: &mut Hand, parameter: &PlantParameter, deviation: f64) {
    let n = parameter.index;
    let value = match parameter.quantity {
        Quantity::Spring => &mut hand.transmission.springs[n],
        Quantity::SpringRest => &mut hand.transmission.spring_rests[n],
        Quantity::SpoolRadius => &mut hand.cables[n].spool_radius,
        Quantity::CableStiffness => &mut hand.cables[n].stiffness,
        Quantity::GuideFriction => &mut hand.cables[n].friction.coefficient,
        Quantity::GuideTurn => &mut hand.cables[n].friction.routing,
        Quantity::TorqueConstant => &mut hand.servos[n].torque_constant,
        Quantity::ServoFriction => &mut hand.servos[n].friction,
        Quantity::ServoDamping => &mut hand.servos[n].damping,
        Quantity::GelStiffness => &mut hand.parameters.gel.stiffness,
        Quantity::GelThickness => &mut hand.parameters.gel.thickness,
        Quantity::JointZero => {
            let joint = &mut hand.tree.joints[n];
            joint.origin *= UnitQuaternion::from_axis_angle(&joint.axis, deviation);
            return;
        }
        // Applied elsewhere, to the scene, the arm and the mount: see `pad_friction`, `apply_to_arm`, `apply_to_hand`.
        Quantity::PadFriction
        | Quantity::ArmEncoder
        | Quantity::MountPosition
        | Quantity::MountTurn
        | Quantity::ArmTorqueGain => return,
    };
    match parameter.prior.kind {
        PriorKind::Factor => *value *= deviation.exp(),
        PriorKind::Offset => *value += deviation,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawn() -> RobotModel {
        RobotModel::ftac_gen3()
    }

    #[test]
    fn one_number_is_one_robot_and_another_is_another() {
        let drawn = drawn();
        let robot = RobotInstance::sample(&drawn, 3);
        assert_eq!(robot, RobotInstance::sample(&drawn, 3));
        let other = RobotInstance::sample(&drawn, 4);
        assert!(robot.deviations().iter().zip(other.deviations()).all(|(a, b)| a != b));
    }

    /// Quantities that were added later leave earlier samples unchanged, to the last bit.
    #[test]
    fn what_was_drawn_stays() {
        let drawn = drawn();
        for (number, values) in [
            (
                1,
                [
                    -0.126_033_701_871_569_1,
                    0.119_315_638_679_151_47,
                    -0.046_850_226_987_972_03,
                    0.007_909_367_740_810_578,
                ],
            ),
            (
                103,
                [
                    0.002_322_185_563_571_736,
                    -0.155_256_554_134_939_6,
                    0.053_005_435_418_221_15,
                    0.003_501_963_613_274_089_4,
                ],
            ),
        ] {
            let robot = RobotInstance::sample(&drawn, number);
            let names = ["thumb_1.spring", "thumb.cable_stiffness", "pad_friction", "mount_z.turn"];
            let found = names.map(|name| robot.deviations()[robot.find(name).expect("a parameter")]);
            assert_eq!(found.map(f64::to_bits), values.map(f64::to_bits), "{number}: {found:?}");
        }
    }

    /// Instance 0 equals the nominal robot to the last bit.
    #[test]
    fn number_0_is_the_drawing() {
        let drawn = drawn();
        let RobotModel { hand, arm, .. } = &drawn;
        let robot = RobotInstance::sample(&drawn, 0);
        assert_eq!(format!("{:?}", robot.apply_to_hand(hand)), format!("{hand:?}"));
        assert_eq!(format!("{:?}", robot.apply_to_arm(arm)), format!("{arm:?}"));
    }

    /// Each parameter changes the robot, and only what it names: applying a deviation and its inverse restores the
    /// nominal robot.
    #[test]
    fn every_parameter_changes_something() {
        let drawn = drawn();
        let RobotModel { hand, arm, .. } = &drawn;
        let (text, arm_text) = (format!("{hand:?}"), format!("{arm:?}"));
        for place in 0..RobotInstance::nominal(&drawn).parameters().len() {
            let mut robot = RobotInstance::nominal(&drawn);
            robot.set(place, 0.01);
            let changed = format!("{:?}", robot.apply_to_hand(hand)) != text
                || format!("{:?}", robot.apply_to_arm(arm)) != arm_text
                || robot.pad_friction() != 1.0;
            assert!(changed, "{}", robot.parameters()[place].name);
        }
    }

    /// A robot with the errors in its model has the same pose as one with the errors in its hardware.
    #[test]
    fn its_arm_is_the_one_with_these_defects() {
        let drawn = drawn();
        let RobotModel { hand, arm, .. } = &drawn;
        let robot = RobotInstance::sample(&drawn, 5);
        let shown = arm.home;
        let defects = robot.arm_defects();
        let body = arm.tool_pose(&defects.true_angles(&shown)) * defects.mount() * hand.palm_from_flange.inverse();
        let model = robot.apply_to_arm(arm).tool_pose(&shown) * robot.apply_to_hand(hand).palm_from_flange.inverse();
        let off = body.inv_mul(&model);
        assert!(off.translation.vector.norm() < 1e-12 && off.rotation.angle() < 1e-9, "{off}");
    }

    /// In a sample of 400 robots each quantity has the prior of its data file, to within 5 standard errors.
    #[test]
    fn deviations_spread_as_stated() {
        let drawn = drawn();
        let robots: Vec<_> = (1..=400).map(|number| RobotInstance::sample(&drawn, number)).collect();
        for (place, parameter) in robots[0].parameters().iter().enumerate() {
            let spread = &parameter.prior;
            let scaled = robots.iter().map(|robot| (robot.deviations()[place] - spread.mean) / spread.sigma);
            let (sum, squares) = scaled.fold((0.0, 0.0), |(sum, squares), z| (sum + z, squares + z * z));
            // A Gaussian truncated at three standard deviations has 0.9733 of its variance.
            assert!((sum / 400.0_f64).abs() < 0.25, "{}: {}", parameter.name, sum / 400.0);
            assert!((squares / 400.0 / 0.9733 - 1.0).abs() < 0.36, "{}: {}", parameter.name, squares / 400.0);
        }
    }
}
