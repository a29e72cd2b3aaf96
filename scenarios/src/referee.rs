//! Judges a trial from ground truth, which only the simulator has; on hardware the operator is asked instead.
//!
//! # Rules
//! - **Collision**: before the second grasp has closed (up to the end of [`Phase::GraspSecond`]), the first object or one of
//!   the digits holding it touches the second object; or the second object moves by more than `knock_distance` before its
//!   grasp begins without a free digit having touched it (a blow shorter than the referee's sampling).
//! - **In the hand** ([`crate::holding`]): the object touches the hand, does not touch the table, and its origin is within
//!   `palm_distance` of the palm's.
//! - **Success**: at the end of the hold, which lasted its full time, both objects are in the hand, and neither has moved
//!   relative to the palm by more than `slip` since the carry began. A trial that carries again is judged by its last carry.
//!
//! A collision does not end a trial, and a trial with a collision can succeed.

use nalgebra::{Isometry3, Point3};
use serde::{Deserialize, Serialize};

use crate::holding::{HoldingRule, Support};
use crate::phase::Phase;

/// Thresholds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RefereeRules {
    /// m.
    pub palm_distance: f64,
    /// m.
    pub slip: f64,
    /// m.
    pub knock_distance: f64,
}

/// The scene as it is. Pairs are (first object, second object).
#[derive(Debug, Clone, PartialEq)]
pub struct SceneTruth {
    /// s since the trial began.
    pub time: f64,
    /// What the controller says it is doing.
    pub phase: Phase,
    /// The first object touches the second.
    pub first_touches_second: bool,
    /// A digit that holds the first object, or the palm, touches the second object. Before anything is held: none does.
    pub holding_digits_touch_second: bool,
    /// Any other digit touches the second object.
    pub free_digits_touch_second: bool,
    /// Contacts of each object with the hand.
    pub hand_contacts: [usize; 2],
    /// Whether each object touches the table.
    pub on_table: [bool; 2],
    /// `world_from_object`.
    pub world_from_object: [Isometry3<f64>; 2],
    /// `world_from_palm`.
    pub world_from_palm: Isometry3<f64>,
}

/// What the collision was with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CollisionWith {
    /// The first object touched the second.
    HeldObject,
    /// A digit holding the first object touched the second.
    HoldingDigits,
    /// The second object was moved.
    Knocked,
}

/// Why a trial failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FailureCause {
    /// The first object was not in the hand after its lift.
    FirstNotPicked,
    /// The first object was picked up and lost.
    FirstDropped,
    /// The second object was not in the hand after its lift.
    SecondNotPicked,
    /// The second object was picked up and lost.
    SecondDropped,
    /// Both were picked up and lost.
    BothDropped,
    /// Both are in the hand, but one moved in it by more than the rules allow.
    Slipped,
    /// The controller found no way to reach an object.
    Unreachable,
    /// An object was nowhere to be seen.
    NotSeen,
    /// The controller found no strategy left to try.
    NoStrategy,
    /// The body failed: a servo, a link, a limit.
    RobotFault,
    /// The trial ended before the hold was over.
    NotFinished,
}

impl std::fmt::Display for FailureCause {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.pad(match self {
            Self::FirstNotPicked => "first not picked",
            Self::FirstDropped => "first dropped",
            Self::SecondNotPicked => "second not picked",
            Self::SecondDropped => "second dropped",
            Self::BothDropped => "both dropped",
            Self::Slipped => "slipped",
            Self::Unreachable => "unreachable",
            Self::NotSeen => "not seen",
            Self::NoStrategy => "no strategy",
            Self::RobotFault => "robot fault",
            Self::NotFinished => "not finished",
        })
    }
}

/// The referee's judgement.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// Whether there was a collision.
    pub collision: bool,
    /// When the first one was, s.
    pub collision_time: Option<f64>,
    /// What the first one was with.
    pub collision_with: Option<CollisionWith>,
    /// Whether the trial succeeded.
    pub success: bool,
    /// Why not; none on success.
    pub cause: Option<FailureCause>,
}

/// Watches one trial.
#[derive(Debug, Clone)]
pub struct Referee {
    rules: RefereeRules,
    hold_time: f64,
    collision: Option<(f64, CollisionWith)>,
    second_start: Option<Point3<f64>>,
    free_touch: bool,
    /// Each object was in the hand when its own lift had ended.
    picked: [bool; 2],
    carry_start: Option<[Point3<f64>; 2]>,
    slipped: bool,
    hold_start: Option<f64>,
    /// Newest truth up to the hold's end.
    last: Option<SceneTruth>,
    given_up: Option<FailureCause>,
}

impl Referee {
    /// `hold_time` s is how long both objects must be held.
    pub fn new(rules: RefereeRules, hold_time: f64) -> Self {
        Self {
            rules,
            hold_time,
            collision: None,
            second_start: None,
            free_touch: false,
            picked: [false; 2],
            carry_start: None,
            slipped: false,
            hold_start: None,
            last: None,
            given_up: None,
        }
    }

    /// Takes the scene after one physics step or control tick, in order of time. The first one is taken before anything moves.
    pub fn see(&mut self, truth: &SceneTruth) {
        if truth.phase == Phase::Done {
            return;
        }
        self.watch_second(truth);
        // What counts is the end of the lift, or, if that was skipped, the first sight after it.
        for (object, lift) in [(0, Phase::LiftFirst), (1, Phase::LiftSecond)] {
            let skipped = truth.phase > lift && self.last.as_ref().is_none_or(|last| last.phase < lift);
            if truth.phase == lift || skipped {
                self.picked[object] = self.in_hand(truth, object);
            }
        }
        if truth.phase < Phase::Carry {
            // What was carried and lost is tried again: the carry and the hold that count are the last ones.
            (self.carry_start, self.hold_start, self.slipped) = (None, None, false);
        } else {
            let now = in_palm(truth);
            let start = *self.carry_start.get_or_insert(now);
            self.slipped |= (0..2).any(|object| (now[object] - start[object]).norm() > self.rules.slip);
        }
        if truth.phase == Phase::Hold {
            self.hold_start.get_or_insert(truth.time);
        }
        self.last = Some(truth.clone());
    }

    /// The controller gave up, for a cause the scene does not show. Only the first cause counts.
    pub fn give_up(&mut self, cause: FailureCause) {
        self.given_up.get_or_insert(cause);
    }

    /// The judgement on all that was seen.
    pub fn verdict(&self) -> Verdict {
        let cause = self.cause();
        Verdict {
            collision: self.collision.is_some(),
            collision_time: self.collision.map(|(time, _)| time),
            collision_with: self.collision.map(|(_, with)| with),
            success: cause.is_none(),
            cause,
        }
    }

    fn watch_second(&mut self, truth: &SceneTruth) {
        let now = Point3::from(truth.world_from_object[1].translation.vector);
        let start = *self.second_start.get_or_insert(now);
        if truth.phase > Phase::GraspSecond {
            return;
        }
        self.free_touch |= truth.free_digits_touch_second;
        let knocked =
            truth.phase < Phase::GraspSecond && !self.free_touch && (now - start).norm() > self.rules.knock_distance;
        let with = match (truth.first_touches_second, truth.holding_digits_touch_second, knocked) {
            (true, ..) => CollisionWith::HeldObject,
            (_, true, _) => CollisionWith::HoldingDigits,
            (_, _, true) => CollisionWith::Knocked,
            _ => return,
        };
        self.collision.get_or_insert((truth.time, with));
    }

    fn in_hand(&self, truth: &SceneTruth, object: usize) -> bool {
        HoldingRule::within(self.rules.palm_distance).holds(&Support {
            held: truth.hand_contacts[object] > 0,
            on_table: truth.on_table[object],
            distance: in_palm(truth)[object].coords.norm(),
            height: truth.world_from_object[object].translation.z,
        })
    }

    fn cause(&self) -> Option<FailureCause> {
        let Some(last) = &self.last else {
            return Some(self.given_up.unwrap_or(FailureCause::NotFinished));
        };
        let held = [0, 1].map(|object| self.in_hand(last, object));
        let lost = [0, 1].map(|object| self.picked[object] && !held[object]);
        let after = |lift: Phase| last.phase > lift;
        let seen = match (lost, self.picked) {
            ([true, true], _) => Some(FailureCause::BothDropped),
            ([true, _], _) => Some(FailureCause::FirstDropped),
            (_, [false, _]) if after(Phase::LiftFirst) => Some(FailureCause::FirstNotPicked),
            ([_, true], _) => Some(FailureCause::SecondDropped),
            (_, [_, false]) if after(Phase::LiftSecond) => Some(FailureCause::SecondNotPicked),
            _ => None,
        };
        // A touch of the table as the lift begins must not pass for a drop: before Look nothing can have been dropped.
        let seen = if after(Phase::LiftFirst) { seen } else { None };
        if seen.is_some() || self.given_up.is_some() {
            return seen.or(self.given_up);
        }
        // A tick of tolerance: the first and the last sample of the hold are one tick closer than the hold is long.
        let finished = self.hold_start.is_some_and(|start| last.time - start >= self.hold_time - 0.02);
        match (finished, self.slipped) {
            (false, _) => Some(FailureCause::NotFinished),
            (true, true) => Some(FailureCause::Slipped),
            (true, false) => None,
        }
    }
}

/// Origins of both objects in the palm frame, m.
fn in_palm(truth: &SceneTruth) -> [Point3<f64>; 2] {
    truth
        .world_from_object
        .map(|pose| truth.world_from_palm.inverse_transform_point(&Point3::from(pose.translation.vector)))
}

#[cfg(test)]
mod tests;
