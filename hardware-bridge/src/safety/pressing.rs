//! What the arm presses: torques of its joints over what weight and motion explain.
//!
//! The arm's torque sensors feel the weight of arm and hand, the torque that accelerates them, what the hand carries, and what pushes against them.
//! The first two come from the model ([`LoadModel`]), the third is any mass from nothing up to the stated payload. What remains is a push, from the
//! table, an object that cannot give way, or somebody in the arm's way.

use hand_model::load::{LoadModel, Torques};
use hand_model::robot::ArmState;
use hand_model::{ARM_JOINTS, Arm, Hand};

use super::state::Cause;

/// How much the arm may press, and for how long.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PressLimits {
    /// Greatest torque of each joint, N m.
    pub torque: [f64; ARM_JOINTS],
    /// Greatest torque of each joint that weight, motion and payload leave unexplained, N m.
    pub residual: [f64; ARM_JOINTS],
    /// Heaviest load in the hand, kg.
    pub payload: f64,
    /// A residual above its limit for longer than this is no jolt, s.
    pub jolt: f64,
    /// A torque above its limit for longer than this is no passing load, s: the small joints reach their limit in a firm grasp.
    pub torque_time: f64,
}

/// How near to its limits the arm has come.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pressed {
    /// Largest torques, N m.
    pub torque: [f64; ARM_JOINTS],
    /// Largest residuals, N m.
    pub residual: [f64; ARM_JOINTS],
    /// Longest time above a limit, s.
    pub longest: f64,
}

/// Watches the arm's torques.
#[derive(Debug, Clone)]
pub struct PressWatch {
    arm: Arm,
    model: LoadModel,
    limits: PressLimits,
    /// For how long each joint's torque and residual have been above their limits, s.
    above: [[f64; 2]; ARM_JOINTS],
    pressed: Pressed,
}

impl PressWatch {
    pub fn new(hand: &Hand, arm: &Arm, limits: PressLimits) -> Self {
        let (model, above) = (LoadModel::new(hand, arm), [[0.0; 2]; ARM_JOINTS]);
        Self { arm: arm.clone(), model, limits, above, pressed: Pressed::default() }
    }

    /// How near to its limits the arm has come so far.
    pub fn pressed(&self) -> Pressed {
        self.pressed
    }

    /// Torques that weight, motion and the payload that fits best leave unexplained, N m.
    pub fn residual(&self, state: &ArmState, acceleration: &[f64; ARM_JOINTS]) -> Torques {
        let poses = self.arm.tree.forward(&state.position);
        let rest = Torques::from(self.arm.borne(&state.torque)) - self.model.moving(&poses, acceleration);
        let per_kilogram = self.model.per_payload(&poses);
        let square = per_kilogram.norm_squared();
        let carried =
            if square > 0.0 { (per_kilogram.dot(&rest) / square).clamp(0.0, self.limits.payload) } else { 0.0 };
        rest - per_kilogram * carried
    }

    /// Takes note of a measurement, `dt` (s) after the last one, of an arm whose set-points have this `acceleration` (rad/s2); the joint that presses
    /// too hard for too long, if one does.
    pub fn see(&mut self, state: &ArmState, acceleration: &[f64; ARM_JOINTS], dt: f64) -> Option<Cause> {
        let residual = self.residual(state, acceleration);
        let mut worst: Option<(f64, Cause)> = None;
        for joint in 0..ARM_JOINTS {
            let (torque, rest) = (state.torque[joint], residual[joint]);
            let (strain, jolt) = (self.limits.torque_time, self.limits.jolt);
            let of = [
                (torque, self.limits.torque[joint], strain, Cause::ArmTorque(joint, torque)),
                (rest, self.limits.residual[joint], jolt, Cause::ArmPress(joint, rest)),
            ];
            for (above, (value, limit, time, cause)) in self.above[joint].iter_mut().zip(of) {
                // What is no number is above every limit.
                let within = value.abs() <= limit;
                *above = if within { 0.0 } else { *above + dt };
                let share = value.abs() / limit;
                if *above > time && worst.is_none_or(|(most, _)| share > most) {
                    worst = Some((share, cause));
                }
            }
            let note = |most: &mut f64, value: f64| *most = most.max(value.abs());
            note(&mut self.pressed.torque[joint], torque);
            note(&mut self.pressed.residual[joint], rest);
            let longest = self.above[joint].iter().copied().fold(0.0, f64::max);
            note(&mut self.pressed.longest, longest);
        }
        worst.map(|(_, cause)| cause)
    }

    /// Counts anew, once the arm has given way.
    pub fn forget(&mut self) {
        self.above = [[0.0; 2]; ARM_JOINTS];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hand_model::load::held;
    use nalgebra::{Point3, Vector3};

    const LIMITS: PressLimits = PressLimits {
        torque: [60.0; ARM_JOINTS],
        residual: [8.0, 8.0, 8.0, 8.0, 4.0, 4.0, 4.0],
        payload: 3.0,
        jolt: 0.1,
        torque_time: 0.1,
    };

    /// An arm at rest whose palm bears a force (N), as its sensors feel it.
    fn feeling(force: Vector3<f64>) -> (PressWatch, ArmState) {
        let (hand, arm) = (Hand::ftac(), Arm::gen3());
        let watch = PressWatch::new(&hand, &arm, LIMITS);
        let position = Arm::home();
        let poses = arm.tree.forward(&position);
        let palm = arm.tool_pose(&position) * hand.palm_from_flange.inverse() * Point3::origin();
        let torque = watch.model.moving(&poses, &[0.0; ARM_JOINTS]) + held(&arm, &poses, ARM_JOINTS - 1, &palm, &force);
        (watch, ArmState { position, velocity: [0.0; ARM_JOINTS], torque: torque.into() })
    }

    fn seen(force: Vector3<f64>, cycles: usize) -> Option<Cause> {
        let (mut watch, state) = feeling(force);
        (0..cycles).find_map(|_| watch.see(&state, &[0.0; ARM_JOINTS], 0.005))
    }

    /// A load up to the payload is no push; the same force upwards is, after a jolt's time and not before.
    #[test]
    fn a_payload_is_explained_and_a_push_is_not() {
        let down = |kilograms: f64| Vector3::new(0.0, 0.0, -9.81 * kilograms);
        for kilograms in [0.0, 1.5, 2.9] {
            let (watch, state) = feeling(down(kilograms));
            let residual = watch.residual(&state, &[0.0; ARM_JOINTS]);
            assert!(residual.norm() < 1e-9, "{kilograms} kg: {residual}");
            assert_eq!(seen(down(kilograms), 100), None, "{kilograms} kg");
        }
        assert!(matches!(seen(down(9.0), 100), Some(Cause::ArmPress(..))), "more than the payload");
        let up = Vector3::new(0.0, 0.0, 40.0);
        assert_eq!(seen(up, 19), None, "a jolt");
        assert!(
            matches!(seen(up, 22), Some(Cause::ArmPress(1 | 3, torque)) if torque.abs() > 8.0),
            "{:?}",
            seen(up, 22)
        );
        let nothing = Vector3::new(f64::NAN, 0.0, 0.0);
        assert!(seen(nothing, 100).is_some(), "no number is no torque within limits");
    }
}
