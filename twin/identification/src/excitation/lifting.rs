//! Payload calibration: standing with an empty hand, and with the payload in it.

use control::inverse_kinematics::Joints;
use control::motion::CLOSING_TIME;
use control::motion::tension::{closing_tension, friction_compensated, ramp_tension};
use dexterous_grasping::Grasp;
use hand_model::robot::{ArmState, RobotBackend};
use hand_model::{ArmVector, DigitVector, RobotModel};

use super::{ExcitationSetup, ScriptPlayer};
use crate::arm_load::{bears_load, force_on_palm};
use crate::payload::{Payload, PayloadStep, PickUpPath};
use crate::pressing::PressAim;

/// Current limit of the opposition servo while it holds, A.
const OPPOSITION_CURRENT: f64 = 0.6;
/// Share of the script's speed at which the hand moves to the object and rises with it.
const SPEED_SHARE: f64 = 0.3;
/// Time for which the digits open after the object was put down, s.
const RELEASE_TIME: f64 = 1.0;
/// Maximum number of grasps that are tried.
const MAX_GRASP_TRIES: usize = 3;
/// Force on the hand at which its path to the object is abandoned, N: the arm's errors may bring the hand onto the
/// table.
const MAX_PUSH_FORCE: f64 = 30.0;
/// Deviation of the encoders from a posture beyond which the arm counts as obstructed, rad.
const POSTURE_TOLERANCE: f64 = 0.008;

/// Posture in which the arm stands, and the waypoints to it.
struct Stand {
    waypoints: Vec<Joints>,
    posture: Joints,
}

/// Outcome of payload calibration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LiftOutcome {
    Done,
    /// The arm bears no weight in the hand.
    NotLifted,
    /// The arm cannot reach the posture with everything clear.
    OutOfReach,
    /// Stopped by an operator, or by the robot.
    Stopped,
}

/// True if the arm is in the requested posture.
fn is_at_posture(shown: &ArmState, at: &[f64]) -> bool {
    shown.position.iter().zip(at).all(|(shown, at)| (shown - at).abs() < POSTURE_TOLERANCE)
}

impl<R: RobotBackend> ScriptPlayer<'_, R> {
    /// Performs one part of payload calibration, according to the robot model of `aim` and clear of its ball, if there
    /// are presses.
    pub(super) fn calibrate_payload(
        &mut self,
        means: &ExcitationSetup,
        aim: Option<&PressAim>,
        (weight, part): (&Payload, PayloadStep),
        goes_on: &mut impl FnMut(&mut R) -> bool,
    ) -> LiftOutcome {
        let numbers: Vec<usize> = match part {
            PayloadStep::Empty(posture) => vec![posture],
            // The object is put down from the first posture.
            PayloadStep::Lifted => (0..weight.posture.len()).chain([0]).collect(),
        };
        let postures: Vec<Joints> = numbers.into_iter().map(|n| weight.posture_joints(n, &means.ready)).collect();
        let paths = match aim {
            Some(aim) => aim.plan_paths(&self.arm, &postures),
            None => Some(vec![Vec::new(); postures.len()]),
        };
        let Some(paths) = paths else { return LiftOutcome::OutOfReach };
        let stands: Vec<Stand> =
            paths.into_iter().zip(postures).map(|(waypoints, posture)| Stand { waypoints, posture }).collect();
        match part {
            PayloadStep::Empty(_) => {
                self.stand_at(&stands[0], weight.hold, goes_on).map_or(LiftOutcome::Stopped, |shown| {
                    if is_at_posture(&shown, &stands[0].posture) { LiftOutcome::Done } else { LiftOutcome::OutOfReach }
                })
            }
            PayloadStep::Lifted => {
                let own = aim.map_or(means.robot, PressAim::robot_model);
                self.lift(means, own, (weight, &stands), goes_on)
            }
        }
    }

    /// Lifts the object and holds it in all of `stands` but the last, which is the first one again.
    fn lift(
        &mut self,
        means: &ExcitationSetup,
        own: &RobotModel,
        (weight, stands): (&Payload, &[Stand]),
        goes_on: &mut impl FnMut(&mut R) -> bool,
    ) -> LiftOutcome {
        let (Some(object), [first, others @ .., back]) = (weight.model(), stands) else {
            return LiftOutcome::OutOfReach;
        };
        let Some(clear) = self.stand_at(first, weight.hold, goes_on) else { return LiftOutcome::Stopped };
        if !is_at_posture(&clear, &first.posture) {
            return LiftOutcome::OutOfReach;
        }
        let loaded_stand = Stand { waypoints: Vec::new(), posture: first.posture };
        let mut ended = LiftOutcome::OutOfReach;
        for way in weight.plan_pick_ups(own, &object, means.grasps, &first.posture).take(MAX_GRASP_TRIES) {
            match self.pick_up(means, own, &way, goes_on) {
                LiftOutcome::Done => {}
                LiftOutcome::NotLifted => {
                    ended = LiftOutcome::NotLifted;
                    continue;
                }
                other => return other,
            }
            let Some(loaded) = self.stand_at(&loaded_stand, weight.hold, goes_on) else {
                return LiftOutcome::Stopped;
            };
            if bears_load(own, [&clear, &loaded], weight.mass) {
                let held = others.iter().all(|stand| self.stand_at(stand, weight.hold, goes_on).is_some());
                return if held && self.put_down(&way, back, goes_on) {
                    LiftOutcome::Done
                } else {
                    LiftOutcome::Stopped
                };
            }
            ended = LiftOutcome::NotLifted;
            self.grip = None;
            if !self.hold_hand(RELEASE_TIME, goes_on) {
                return LiftOutcome::Stopped;
            }
        }
        ended
    }

    fn move_to_stand(&mut self, stand: &Stand, goes_on: &mut impl FnMut(&mut R) -> bool) -> bool {
        stand.waypoints.iter().chain([&stand.posture]).all(|at| self.move_to(at, goes_on))
    }

    /// Moves to a posture and stands there for `time` (s). Returns the mean state of the arm in the second half of that
    /// time.
    fn stand_at(&mut self, stand: &Stand, time: f64, goes_on: &mut impl FnMut(&mut R) -> bool) -> Option<ArmState> {
        if !self.move_to_stand(stand, goes_on) || !self.hold_hand(0.5 * time, goes_on) {
            return None;
        }
        let mut sum = ArmState::at_rest(self.arm_state.position.iter().map(|_| 0.0).collect());
        let (end, mut ticks) = (self.time + 0.5 * time, 0.0);
        while self.time < end {
            if !self.tick(goes_on) {
                return None;
            }
            ticks += 1.0;
            for joint in 0..sum.position.len() {
                sum.position[joint] += self.arm_state.position[joint];
                sum.torque[joint] += self.arm_state.torque[joint];
            }
        }
        let mean = |sum: ArmVector| sum.iter().map(|sum| sum / f64::max(ticks, 1.0)).collect();
        Some(ArmState { position: mean(sum.position), torque: mean(sum.torque), ..sum })
    }

    /// Moves to the object, closes the digits on it and lifts it. If the hand pushes hard against something before
    /// that, it returns with nothing lifted.
    fn pick_up(
        &mut self,
        means: &ExcitationSetup,
        own: &RobotModel,
        way: &PickUpPath,
        goes_on: &mut impl FnMut(&mut R) -> bool,
    ) -> LiftOutcome {
        let Some((begin, on)) = way.approach.split_first() else { return LiftOutcome::OutOfReach };
        let (grasp, mut pull) = (&way.grasp, own.hand.slack_tensions());
        let begun = self.move_to(begin, goes_on);
        // The digits take their pre-grasp shape.
        if !begun || !self.pull_for(means, grasp, &mut pull, -CLOSING_TIME, goes_on) {
            return LiftOutcome::Stopped;
        }
        let (slow, clear) = (SPEED_SHARE * self.script.arm_speed, self.arm_state);
        for (n, at) in on.iter().enumerate() {
            if !self.move_at_speed(at, slow, goes_on) {
                return LiftOutcome::Stopped;
            }
            if force_on_palm(own, [&clear, &self.arm_state]).is_some_and(|pushed| pushed.norm() > MAX_PUSH_FORCE) {
                self.grip = None;
                let back = on[..n].iter().rev().chain([begin]).all(|at| self.move_at_speed(at, slow, goes_on));
                return if back { LiftOutcome::NotLifted } else { LiftOutcome::Stopped };
            }
        }
        let closed = self.pull_for(means, grasp, &mut pull, 0.0, goes_on);
        if closed && way.raise.iter().chain(&way.lift).all(|at| self.move_at_speed(at, slow, goes_on)) {
            LiftOutcome::Done
        } else {
            LiftOutcome::Stopped
        }
    }

    /// Pulls the cables for [`CLOSING_TIME`] according to `grasp`, from `time` (s) after the start of closing; at
    /// negative times, with the pre-grasp tensions.
    fn pull_for(
        &mut self,
        means: &ExcitationSetup,
        grasp: &Grasp,
        pull: &mut DigitVector,
        mut time: f64,
        goes_on: &mut impl FnMut(&mut R) -> bool,
    ) -> bool {
        let (tick, end) = (self.robot.tick_length(), time + CLOSING_TIME);
        while time < end {
            let wanted = means.robot.hand.each_digit(|digit| {
                if time < 0.0 { grasp.pre_tension[digit] } else { closing_tension(grasp, digit, time) }
            });
            let wanted = friction_compensated(&means.robot.hand, &means.friction, &self.servos, &wanted);
            ramp_tension(pull, &wanted, tick);
            self.grip = Some(means.robot.hand.servo_goals(pull, grasp.opposition, OPPOSITION_CURRENT));
            if !self.tick(goes_on) {
                return false;
            }
            time += tick;
        }
        true
    }

    /// Puts the object down where it was picked up, and returns to `stand`.
    fn put_down(&mut self, way: &PickUpPath, stand: &Stand, goes_on: &mut impl FnMut(&mut R) -> bool) -> bool {
        let slow = SPEED_SHARE * self.script.arm_speed;
        let Some((above, down)) = way.lift.split_last() else { return false };
        let down = down.iter().rev().chain(way.raise.iter().rev()).chain(way.approach.last());
        if !self.move_to_stand(stand, goes_on) || !self.move_to(above, goes_on) {
            return false;
        }
        if !down.into_iter().all(|at| self.move_at_speed(at, slow, goes_on)) {
            return false;
        }
        self.grip = None;
        self.hold_hand(RELEASE_TIME, goes_on)
            && way.approach.iter().rev().all(|at| self.move_at_speed(at, slow, goes_on))
            && self.move_to(&stand.posture, goes_on)
    }
}
