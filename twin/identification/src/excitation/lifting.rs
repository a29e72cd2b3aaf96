//! Weighing: standing with an empty hand, and with the weighed object in it.

use control::motion::CLOSING_TIME;
use control::motion::tension::{against_friction, approach_tension, closing_tension};
use dexterous_grasping::Grasp;
use hand_model::robot::{ArmState, RobotBackend};
use hand_model::{ArmVector, DigitVector, RobotModel};

use super::{Means, Player};
use crate::arm_load::{bears, force_on_palm};
use crate::weight::{Part, PickUp, Weight};

/// Current limit of the opposition servo while it holds, A.
const OPPOSITION_CURRENT: f64 = 0.6;
/// Share of the script's speed at which the hand moves to the object and rises with it.
const SLOW: f64 = 0.3;
/// Time for which the digits open after the object was put down, s.
const LETTING_GO: f64 = 1.0;
/// Greatest number of grasps that are tried.
const TRIES: usize = 3;
/// Force on the hand at which its way to the object is abandoned, N: the arm's errors may bring the hand onto the
/// table.
const MOST_PUSH: f64 = 30.0;
/// Deviation of the encoders from a posture beyond which something is in the arm's way, rad.
const OFF: f64 = 0.008;

/// Outcome of weighing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Ended {
    Done,
    /// No weight is felt in the hand.
    NotLifted,
    /// The arm cannot reach the posture with everything clear.
    OutOfReach,
    /// An operator, or the robot, has stopped it.
    Stopped,
}

/// True if the arm is in the requested posture.
fn is_there(shown: &ArmState, at: &[f64]) -> bool {
    shown.position.iter().zip(at).all(|(shown, at)| (shown - at).abs() < OFF)
}

impl<R: RobotBackend> Player<'_, R> {
    /// Performs one part of weighing, according to the robot model `own`.
    pub(super) fn weigh(
        &mut self,
        means: &Means,
        own: &RobotModel,
        (weight, part): (&Weight, Part),
        goes_on: &mut impl FnMut(&mut R) -> bool,
    ) -> Ended {
        match part {
            Part::Empty(posture) => {
                let at = weight.stand(posture, &means.ready);
                self.stand(&at, weight.hold, goes_on)
                    .map_or(Ended::Stopped, |shown| if is_there(&shown, &at) { Ended::Done } else { Ended::OutOfReach })
            }
            Part::Lifted => self.lift(means, own, weight, goes_on),
        }
    }

    fn lift(
        &mut self,
        means: &Means,
        own: &RobotModel,
        weight: &Weight,
        goes_on: &mut impl FnMut(&mut R) -> bool,
    ) -> Ended {
        let Some(object) = weight.model() else { return Ended::OutOfReach };
        let stands: Vec<ArmVector> = (0..weight.posture.len()).map(|n| weight.stand(n, &means.ready)).collect();
        let Some(clear) = self.stand(&stands[0], weight.hold, goes_on) else { return Ended::Stopped };
        if !is_there(&clear, &stands[0]) {
            return Ended::OutOfReach;
        }
        let mut ended = Ended::OutOfReach;
        for way in weight.pick_ups(own, &object, means.grasps, &stands[0]).take(TRIES) {
            match self.pick_up(means, own, &way, goes_on) {
                Ended::Done => {}
                Ended::NotLifted => {
                    ended = Ended::NotLifted;
                    continue;
                }
                other => return other,
            }
            let Some(loaded) = self.stand(&stands[0], weight.hold, goes_on) else { return Ended::Stopped };
            if bears(own, [&clear, &loaded], weight.mass) {
                let held = stands[1..].iter().all(|at| self.stand(at, weight.hold, goes_on).is_some());
                return if held && self.put_down(&way, &stands[0], goes_on) { Ended::Done } else { Ended::Stopped };
            }
            ended = Ended::NotLifted;
            self.grip = None;
            if !self.open(LETTING_GO, goes_on) {
                return Ended::Stopped;
            }
        }
        ended
    }

    /// Moves to a posture and stands there for `time` (s). Returns the mean state of the arm in the second half of that
    /// time.
    fn stand(&mut self, at: &[f64], time: f64, goes_on: &mut impl FnMut(&mut R) -> bool) -> Option<ArmState> {
        if !self.go(at, goes_on) || !self.open(0.5 * time, goes_on) {
            return None;
        }
        let mut sum = ArmState::still(self.felt.position.iter().map(|_| 0.0).collect());
        let (end, mut ticks) = (self.time + 0.5 * time, 0.0);
        while self.time < end {
            if !self.tick(goes_on) {
                return None;
            }
            ticks += 1.0;
            for joint in 0..sum.position.len() {
                sum.position[joint] += self.felt.position[joint];
                sum.torque[joint] += self.felt.torque[joint];
            }
        }
        let mean = |sum: ArmVector| sum.iter().map(|sum| sum / f64::max(ticks, 1.0)).collect();
        Some(ArmState { position: mean(sum.position), torque: mean(sum.torque), ..sum })
    }

    /// Moves to the object, closes the digits on it and lifts it. If the hand pushes hard against something before
    /// that, it returns with nothing lifted.
    fn pick_up(
        &mut self,
        means: &Means,
        own: &RobotModel,
        way: &PickUp,
        goes_on: &mut impl FnMut(&mut R) -> bool,
    ) -> Ended {
        let Some((begin, on)) = way.approach.split_first() else { return Ended::OutOfReach };
        let (grasp, mut pull) = (&way.grasp, own.hand.slack());
        let begun = self.go(begin, goes_on);
        // The digits take their pre-grasp shape.
        if !begun || !self.pull_for(means, grasp, &mut pull, -CLOSING_TIME, goes_on) {
            return Ended::Stopped;
        }
        let (slow, clear) = (SLOW * self.script.arm_speed, self.felt);
        for (n, at) in on.iter().enumerate() {
            if !self.go_at(at, slow, goes_on) {
                return Ended::Stopped;
            }
            if force_on_palm(own, [&clear, &self.felt]).is_some_and(|pushed| pushed.norm() > MOST_PUSH) {
                self.grip = None;
                let back = on[..n].iter().rev().chain([begin]).all(|at| self.go_at(at, slow, goes_on));
                return if back { Ended::NotLifted } else { Ended::Stopped };
            }
        }
        let closed = self.pull_for(means, grasp, &mut pull, 0.0, goes_on);
        if closed && way.raise.iter().chain(&way.lift).all(|at| self.go_at(at, slow, goes_on)) {
            Ended::Done
        } else {
            Ended::Stopped
        }
    }

    /// Pulls the cables for [`CLOSING_TIME`] according to `grasp`, from `time` (s) after it has begun to close; at
    /// negative times, with the pre-grasp tensions.
    fn pull_for(
        &mut self,
        means: &Means,
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
            let wanted = against_friction(&means.robot.hand, &means.friction, &self.servos, &wanted);
            approach_tension(pull, &wanted, tick);
            self.grip = Some(means.robot.hand.servo_goals(pull, grasp.opposition, OPPOSITION_CURRENT));
            if !self.tick(goes_on) {
                return false;
            }
            time += tick;
        }
        true
    }

    /// Puts the object down where it was picked up, and returns to `stand`.
    fn put_down(&mut self, way: &PickUp, stand: &[f64], goes_on: &mut impl FnMut(&mut R) -> bool) -> bool {
        let slow = SLOW * self.script.arm_speed;
        let Some((above, down)) = way.lift.split_last() else { return false };
        let down = down.iter().rev().chain(way.raise.iter().rev()).chain(way.approach.last());
        if !self.go(stand, goes_on) || !self.go(above, goes_on) {
            return false;
        }
        if !down.into_iter().all(|at| self.go_at(at, slow, goes_on)) {
            return false;
        }
        self.grip = None;
        self.open(LETTING_GO, goes_on)
            && way.approach.iter().rev().all(|at| self.go_at(at, slow, goes_on))
            && self.go(stand, goes_on)
    }
}
