//! Detection of pressing: joint torques of the arm beyond those that weight and motion explain.
//!
//! The arm's torque sensors measure the weight of arm and hand, the torque that accelerates them, the load in the hand,
//! and contact forces. The first two come from the model ([`GravityModel`]); the third may be any mass from zero up to
//! the stated payload. The remainder is an external wrench: from the table, from a rigid object, or from a person in
//! the arm's way.
//!
//! Accelerations are not measured. A generalised momentum observer (De Luca and Mattone, 2003) does without them: the
//! momentum `p = M(q) dq/dt` changes by the joint torque beyond weight, and the residual follows the remainder with a
//! time constant, `T dr/dt = tau - g(q) - dp/dt - r`. Coriolis terms are neglected.

use std::sync::Arc;

use hand_model::gravity::{ArmTorques, GravityModel, pack_torques};
use hand_model::robot::ArmState;
use hand_model::{Arm, ArmVector, RobotModel};

use super::state::StopCause;

/// Time constant of the residual, s.
const TIME_CONSTANT: f64 = 0.02;

/// Limits on the arm's joint torques, and on their duration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TorqueLimits {
    /// Maximum torque of each joint, N m.
    pub torque: ArmVector,
    /// Maximum residual of each joint, N m: torque that weight, motion and payload leave unexplained.
    pub residual: ArmVector,
    /// Heaviest load in the hand, kg.
    pub payload: f64,
    /// Duration of the longest jolt, s: a residual above its limit for longer counts as a push.
    pub jolt_time: f64,
    /// Duration of the longest passing load, s: a torque above its limit for longer stops the arm. The small joints
    /// reach their limit in a firm grasp.
    pub torque_time: f64,
}

/// Largest torques and residuals reached so far.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TorqueExtremes {
    /// Largest torque of each joint, N m.
    pub torque: ArmVector,
    /// Largest residual of each joint, N m.
    pub residual: ArmVector,
    /// Longest time above a limit, s.
    pub longest_excess: f64,
}

/// Monitor of the arm's joint torques.
#[derive(Debug, Clone)]
pub struct TorqueMonitor {
    arm: Arc<Arm>,
    model: GravityModel,
    limits: TorqueLimits,
    /// Time (s) and momentum (N m s) at the last measurement.
    last: Option<(f64, ArmTorques)>,
    /// Observer state: torques that weight and motion leave unexplained, N m.
    unexplained: ArmTorques,
    /// Time for which each joint's torque and residual have been above their limits, s.
    above: ArmVector<[f64; 2]>,
    extremes: TorqueExtremes,
}

impl TorqueMonitor {
    pub fn new(robot: &RobotModel, limits: TorqueLimits) -> Self {
        Self {
            arm: robot.arm.clone(),
            model: GravityModel::new(robot),
            limits,
            last: None,
            unexplained: ArmTorques::zeros(),
            above: robot.arm.each(|_| [0.0; 2]),
            extremes: TorqueExtremes {
                torque: robot.arm.each(|_| 0.0),
                residual: robot.arm.each(|_| 0.0),
                longest_excess: 0.0,
            },
        }
    }

    /// Returns the largest torques and residuals reached so far.
    pub fn extremes(&self) -> TorqueExtremes {
        self.extremes
    }

    /// Updates the observer with a measurement at `time` (s). Returns the residual, N m, that weight, motion and the
    /// best-fitting payload leave unexplained, and the time since the last measurement, s. The first measurement gives
    /// zero.
    fn observe(&mut self, state: &ArmState, time: f64) -> (ArmTorques, f64) {
        let poses = self.arm.tree.forward(&state.position);
        let weight = self.model.torques_at_acceleration(&poses, &self.arm.each(|_| 0.0));
        let momentum = self.model.torques_at_acceleration(&poses, &state.velocity) - weight;
        let (before, was) = self.last.replace((time, momentum)).unwrap_or((time, momentum));
        let dt = time - before;
        let push = pack_torques(&self.arm.true_torques(&state.torque)) - weight;
        self.unexplained += ((push - self.unexplained) * dt - (momentum - was)) / (TIME_CONSTANT + dt);
        let per_kilogram = self.model.torques_per_payload(&poses);
        let square = per_kilogram.norm_squared();
        let carried = if square > 0.0 {
            (per_kilogram.dot(&self.unexplained) / square).clamp(0.0, self.limits.payload)
        } else {
            0.0
        };
        (self.unexplained - per_kilogram * carried, dt)
    }

    /// Takes a measurement at `time` (s). Returns the joint that presses too hard for too long, if any. A measurement
    /// no newer than the last one is ignored.
    pub fn update(&mut self, state: &ArmState, time: f64) -> Option<StopCause> {
        if self.last.is_some_and(|(last, _)| time <= last) {
            return None;
        }
        let (residual, dt) = self.observe(state, time);
        let mut worst: Option<(f64, StopCause)> = None;
        for joint in 0..self.arm.joints() {
            let (torque, rest) = (state.torque[joint], residual[joint]);
            let (strain, jolt) = (self.limits.torque_time, self.limits.jolt_time);
            let of = [
                (torque, self.limits.torque[joint], strain, StopCause::ArmTorque(joint, torque)),
                (rest, self.limits.residual[joint], jolt, StopCause::ArmResidual(joint, rest)),
            ];
            for (above, (value, limit, time, cause)) in self.above[joint].iter_mut().zip(of) {
                // NaN counts as above every limit.
                let within = value.abs() <= limit;
                *above = if within { 0.0 } else { *above + dt };
                let share = value.abs() / limit;
                if *above > time && worst.is_none_or(|(most, _)| share > most) {
                    worst = Some((share, cause));
                }
            }
            let note = |most: &mut f64, value: f64| *most = most.max(value.abs());
            note(&mut self.extremes.torque[joint], torque);
            note(&mut self.extremes.residual[joint], rest);
            let longest = self.above[joint].iter().copied().fold(0.0, f64::max);
            note(&mut self.extremes.longest_excess, longest);
        }
        worst.map(|(_, cause)| cause)
    }

    /// Resets observer and timers, once the arm has yielded or while it brakes.
    pub fn reset(&mut self) {
        (self.last, self.unexplained) = (None, ArmTorques::zeros());
        self.above.iter_mut().for_each(|times| *times = [0.0; 2]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hand_model::gravity::point_force_torques;
    use nalgebra::{Point3, Vector3};

    fn limits() -> TorqueLimits {
        TorqueLimits {
            torque: [100.0; 7].into(),
            residual: [8.0, 8.0, 8.0, 8.0, 4.0, 4.0, 4.0].into(),
            payload: 3.0,
            jolt_time: 0.1,
            torque_time: 0.1,
        }
    }

    /// Torques that the sensors of an arm at rest measure while its palm bears a force (N).
    fn feeling(force: Vector3<f64>) -> (TorqueMonitor, ArmState) {
        let robot = RobotModel::ftac_gen3();
        let watch = TorqueMonitor::new(&robot, limits());
        let RobotModel { arm, hand, .. } = robot;
        let position = Arm::gen3().home;
        let poses = arm.tree.forward(&position);
        let palm = arm.tool_pose(&position) * hand.palm_from_flange.inverse() * Point3::origin();
        let torque = watch.model.torques_at_acceleration(&poses, &[0.0; 7])
            + point_force_torques(&arm, &poses, 6, &palm, &force);
        (watch, ArmState { position, velocity: [0.0; 7].into(), torque: torque.iter().copied().collect() })
    }

    fn seen(force: Vector3<f64>, cycles: usize) -> Option<StopCause> {
        let (mut watch, state) = feeling(force);
        (0..cycles).find_map(|cycle| watch.update(&state, 0.005 * cycle as f64))
    }

    /// A load up to the payload is no push. The same force upwards is one, but only after the residual has grown and
    /// the time of a jolt has passed.
    #[test]
    fn a_payload_is_explained_and_a_push_is_not() {
        let down = |kilograms: f64| Vector3::new(0.0, 0.0, -9.81 * kilograms);
        for kilograms in [0.0, 1.5, 2.9] {
            let (mut watch, state) = feeling(down(kilograms));
            for cycle in 0..100 {
                let (residual, _) = watch.observe(&state, 0.005 * f64::from(cycle));
                assert!(residual.norm() < 1e-9, "{kilograms} kg: {residual}");
            }
            assert_eq!(seen(down(kilograms), 100), None, "{kilograms} kg");
        }
        assert!(matches!(seen(down(9.0), 100), Some(StopCause::ArmResidual(..))), "more than the payload");
        let up = Vector3::new(0.0, 0.0, 40.0);
        assert_eq!(seen(up, 20), None, "a jolt");
        assert!(
            matches!(seen(up, 40), Some(StopCause::ArmResidual(1 | 3, torque)) if torque.abs() > 8.0),
            "{:?}",
            seen(up, 40)
        );
        let nothing = Vector3::new(f64::NAN, 0.0, 0.0);
        assert!(seen(nothing, 100).is_some(), "no number is no torque within limits");
    }

    /// In free motion, with measurements at uneven times, the accelerating torque is no push.
    #[test]
    fn a_motion_is_explained() {
        let robot = RobotModel::ftac_gen3();
        let mut watch = TorqueMonitor::new(&robot, limits());
        let (mut most, mut felt) = (0.0_f64, 0.0_f64);
        for cycle in 0..400 {
            // Late by up to 3 ms.
            let time = 0.005 * f64::from(cycle) + 0.003 * f64::from(cycle % 3) / 2.0;
            let (sine, cosine) = (8.0 * time).sin_cos();
            let position: ArmVector = Arm::gen3().home.iter().map(|angle| angle + 0.05 * (1.0 - cosine)).collect();
            let acceleration = [3.2 * cosine; 7];
            let torque = watch
                .model
                .torques_at_acceleration(&robot.arm.tree.forward(&position), &acceleration)
                .iter()
                .copied()
                .collect();
            let state = ArmState { position, velocity: [0.4 * sine; 7].into(), torque };
            let (residual, _) = watch.observe(&state, time);
            let weight = watch.model.torques_at_acceleration(&robot.arm.tree.forward(&position), &[0.0; 7]);
            if time > 0.2 {
                most = most.max(residual.amax());
                felt = felt.max((pack_torques(&state.torque) - weight).amax());
            }
        }
        assert!(felt > 2.0 && most < 0.1 * felt, "{most} of {felt} N m");
    }
}
