//! Judges a trial from ground truth, which only the simulator has; on hardware the operator is asked instead.
//!
//! # Rules
//! - **Contact** (unwanted): before the second grasp has closed (up to the end of its [`Skill::Grasp`]), the held first object
//!   or a digit holding it touches the second object; or the palm does before two free digits have it (once they have, they may
//!   draw it against the palm); or the second object moves by more than `knock_distance` before
//!   its grasp begins without a free digit having touched it (a blow shorter than the referee's sampling). Two objects that both
//!   lie on the table, or both hang in the hand in a later try, may touch each other.
//! - **In the hand** ([`world::holding`]): the object touches the hand, does not touch the table, and its origin is within
//!   `palm_distance` of the palm's.
//! - **Success**: at the end of the hold, which lasted its full time and ended within the time limit, both objects are in the
//!   hand, and neither has moved relative to the palm by more than `slip` since the carry began. A trial that carries again is
//!   judged by its last carry.
//! - **Clean success**: success without any unwanted contact in any try.
//!
//! A contact does not end a trial, and a trial with a contact can succeed. A **try** begins with an approach.

use nalgebra::{Isometry3, Point3};
use serde::{Deserialize, Serialize};

use world::holding::{HoldingRule, Support};
use world::phase::{Phase, Skill};

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
    /// A digit that holds the first object touches the second object. Before anything is held: none does.
    pub holding_digits_touch_second: bool,
    /// The palm touches the second object.
    pub palm_touches_second: bool,
    /// How many of the other digits touch the second object.
    pub free_digits_on_second: usize,
    /// What presses on the second object at this moment.
    pub on_second: Vec<Touch>,
    /// Contacts of each object with the hand.
    pub hand_contacts: [usize; 2],
    /// Whether each object touches the table.
    pub on_table: [bool; 2],
    /// `world_from_object`.
    pub world_from_object: [Isometry3<f64>; 2],
    /// `world_from_palm`.
    pub world_from_palm: Isometry3<f64>,
}

/// What can press on the second object.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Toucher {
    /// The first object.
    FirstObject,
    /// The palm.
    Palm,
    /// A link of a digit, by its number.
    Link(usize),
}

/// A loaded contact on the second object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Touch {
    /// What presses.
    pub by: Toucher,
    /// Whether that is a link of a digit that holds the first object.
    pub holding: bool,
    /// m, world.
    pub point: Point3<f64>,
    /// Normal force, N.
    pub force: f64,
}

/// What an unwanted contact was with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ContactWith {
    /// The held first object touched the second.
    HeldObject,
    /// A digit holding the first object touched the second.
    HoldingDigits,
    /// The palm touched the second before two free digits had it.
    Palm,
    /// The second object was moved.
    Knocked,
}

impl ContactWith {
    /// As files write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::HeldObject => "held_object",
            Self::HoldingDigits => "holding_digits",
            Self::Palm => "palm",
            Self::Knocked => "knocked",
        }
    }
}

/// An unwanted contact.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Contact {
    /// With what.
    pub with: ContactWith,
    /// What pressed first; none where the contact was too short to be seen.
    pub by: Option<Toucher>,
    /// When it began.
    pub phase: Phase,
    /// When it began, s.
    pub time: f64,
    /// Where it began, m, world.
    pub point: Option<Point3<f64>>,
    /// Greatest sum of the normal forces while the try lasted, N.
    pub force: f64,
}

/// How a try went.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TryVerdict {
    /// The object that was to be taken: 0 or 1.
    pub object: usize,
    /// s since the trial began.
    pub begun: f64,
    /// s since the trial began: the next try begins, or the trial ends.
    pub ended: f64,
    /// The first unwanted contact.
    pub contact: Option<Contact>,
    /// Whether the object was in the hand when its lift had ended; none where it was never lifted.
    pub picked: Option<bool>,
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
    /// The controller left the second object alone: a contact was likelier than a hold.
    Declined,
    /// An object was nowhere to be seen.
    NotSeen,
    /// The controller found no strategy left to try.
    NoStrategy,
    /// Whoever decides has failed, or has answered what cannot be.
    PolicyFailed,
    /// The body failed: a servo, a link, a limit.
    RobotFault,
    /// The trial ended before the hold was over.
    NotFinished,
    /// Both objects were held at the end, which came after the time limit.
    TooLate,
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
            Self::Declined => "declined",
            Self::NotSeen => "not seen",
            Self::NoStrategy => "no strategy",
            Self::PolicyFailed => "policy failed",
            Self::RobotFault => "robot fault",
            Self::NotFinished => "not finished",
            Self::TooLate => "too late",
        })
    }
}

/// The referee's judgement.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// Whether there was an unwanted contact in any try.
    pub contact: bool,
    /// The first one; none where it was not measured.
    pub first_contact: Option<Contact>,
    /// Whether the trial succeeded.
    pub success: bool,
    /// Why not; none on success.
    pub cause: Option<FailureCause>,
}

/// Slower than this an object rests, m/s.
const AT_REST: f64 = 0.002;

/// Times of a trial, s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// How long both objects must be held.
    pub hold: f64,
    /// When the hold must be over.
    pub trial: f64,
}

/// Watches one trial.
#[derive(Debug, Clone)]
pub struct Referee {
    rules: RefereeRules,
    limits: Limits,
    tries: Vec<TryVerdict>,
    second_start: Option<Point3<f64>>,
    /// The second object rested at the last sight.
    second_rests: bool,
    free_touch: bool,
    /// Two free digits have had the second object in this try.
    gripped: bool,
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
    /// A referee who has seen nothing yet.
    pub fn new(rules: RefereeRules, limits: Limits) -> Self {
        Self {
            rules,
            limits,
            tries: Vec::new(),
            second_start: None,
            second_rests: false,
            free_touch: false,
            gripped: false,
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
        if truth.phase.is_done() {
            return;
        }
        self.note_try(truth);
        self.watch_second(truth);
        // What counts is the end of the lift, or, if that was skipped, the first sight after it.
        for object in 0..2 {
            let skipped =
                truth.phase.has_lifted(object) && self.last.as_ref().is_none_or(|last| !last.phase.lifts(object));
            if truth.phase == Phase::run(Skill::Lift, object) || skipped {
                self.picked[object] = self.in_hand(truth, object);
                if let Some(last) = self.tries.last_mut().filter(|last| last.object == object) {
                    last.picked = Some(self.picked[object]);
                }
            }
        }
        if !truth.phase.carries() {
            // What was carried and lost is tried again: the carry and the hold that count are the last ones.
            (self.carry_start, self.hold_start, self.slipped) = (None, None, false);
        } else {
            let now = in_palm(truth);
            let start = *self.carry_start.get_or_insert(now);
            self.slipped |= (0..2).any(|object| (now[object] - start[object]).norm() > self.rules.slip);
        }
        if truth.phase.skill == Skill::Hold {
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
        let first_contact = self.tries.iter().find_map(|one| one.contact);
        Verdict { contact: first_contact.is_some(), first_contact, success: cause.is_none(), cause }
    }

    /// All tries so far, in order.
    pub fn tries(&self) -> &[TryVerdict] {
        &self.tries
    }

    /// A try begins when an approach does.
    fn note_try(&mut self, truth: &SceneTruth) {
        let Phase { skill, object, .. } = truth.phase;
        if skill == Skill::Approach && self.last.as_ref().is_none_or(|last| last.phase != truth.phase) {
            // What still rolls after an earlier try has not been knocked: its place counts from when it rests.
            self.second_start = self.last.as_ref().filter(|_| self.second_rests).map(second_at);
            (self.free_touch, self.gripped) = (false, false);
            self.tries.push(TryVerdict { object, begun: truth.time, ended: truth.time, contact: None, picked: None });
        }
        if let Some(last) = self.tries.last_mut() {
            last.ended = truth.time;
        }
    }

    fn watch_second(&mut self, truth: &SceneTruth) {
        let now = second_at(truth);
        let last = self.last.as_ref();
        self.second_rests = last.is_none_or(|last| (now - second_at(last)).norm() < AT_REST * (truth.time - last.time));
        if self.second_rests {
            self.second_start.get_or_insert(now);
        }
        let start = self.second_start.unwrap_or(now);
        if truth.phase.lifts(1) {
            return;
        }
        self.free_touch |= truth.free_digits_on_second > 0;
        self.gripped |= truth.free_digits_on_second >= 2;
        let palm_touches = truth.palm_touches_second && !self.gripped;
        let knocked = !truth.phase.closes(1) && !self.free_touch && (now - start).norm() > self.rules.knock_distance;
        let lies = |object: usize| truth.on_table[object] || truth.hand_contacts[object] == 0;
        let held_touches = truth.first_touches_second && !lies(0) && lies(1);
        let with = match (held_touches, truth.holding_digits_touch_second, palm_touches, knocked) {
            (true, ..) => ContactWith::HeldObject,
            (_, true, ..) => ContactWith::HoldingDigits,
            (_, _, true, _) => ContactWith::Palm,
            (.., true) => ContactWith::Knocked,
            _ => return,
        };
        let unwanted = |touch: &&Touch| match (with, touch.by) {
            (ContactWith::HeldObject, by) => by == Toucher::FirstObject,
            (ContactWith::Palm, by) => by == Toucher::Palm,
            (ContactWith::HoldingDigits, _) => touch.holding,
            (ContactWith::Knocked, _) => false,
        };
        let force = truth.on_second.iter().filter(unwanted).map(|touch| touch.force).sum::<f64>();
        let hardest = truth.on_second.iter().filter(unwanted).max_by(|a, b| a.force.total_cmp(&b.force));
        let Some(last) = self.tries.last_mut() else { return };
        let contact = last.contact.get_or_insert(Contact {
            with,
            by: hardest.map(|touch| touch.by),
            phase: truth.phase,
            time: truth.time,
            point: hardest.map(|touch| touch.point),
            force,
        });
        contact.force = contact.force.max(force);
    }

    fn in_hand(&self, truth: &SceneTruth, object: usize) -> bool {
        HoldingRule::within(self.rules.palm_distance).holds(&Support {
            held: truth.hand_contacts[object] > 0,
            on_table: truth.on_table[object],
            distance: distance_in_palm(truth, object),
            height: truth.world_from_object[object].translation.z,
        })
    }

    fn cause(&self) -> Option<FailureCause> {
        let Some(last) = &self.last else {
            return Some(self.given_up.unwrap_or(FailureCause::NotFinished));
        };
        let held = [0, 1].map(|object| self.in_hand(last, object));
        let lost = [0, 1].map(|object| self.picked[object] && !held[object]);
        let seen = match (lost, self.picked) {
            ([true, true], _) => Some(FailureCause::BothDropped),
            ([true, _], _) => Some(FailureCause::FirstDropped),
            (_, [false, _]) if last.phase.has_lifted(0) => Some(FailureCause::FirstNotPicked),
            ([_, true], _) => Some(FailureCause::SecondDropped),
            (_, [_, false]) if last.phase.has_lifted(1) => Some(FailureCause::SecondNotPicked),
            _ => None,
        };
        // A touch of the table as the lift begins must not pass for a drop: before Look nothing can have been dropped.
        let seen = seen.filter(|_| last.phase.has_lifted(0));
        if seen.is_some() || self.given_up.is_some() {
            return seen.or(self.given_up);
        }
        // A tick of tolerance: the first and the last sample of the hold are one tick closer than the hold is long.
        let finished = self.hold_start.is_some_and(|start| last.time - start >= self.limits.hold - 0.02);
        match (finished, self.slipped, last.time > self.limits.trial) {
            (false, ..) => Some(FailureCause::NotFinished),
            (true, true, _) => Some(FailureCause::Slipped),
            (true, false, true) => Some(FailureCause::TooLate),
            (true, false, false) => None,
        }
    }
}

/// Where the second object is, m, world.
fn second_at(truth: &SceneTruth) -> Point3<f64> {
    truth.world_from_object[1].translation.vector.into()
}

/// Distance of an object's origin from the palm's, m.
pub(crate) fn distance_in_palm(truth: &SceneTruth, object: usize) -> f64 {
    in_palm(truth)[object].coords.norm()
}

/// Origins of both objects in the palm frame, m.
fn in_palm(truth: &SceneTruth) -> [Point3<f64>; 2] {
    truth
        .world_from_object
        .map(|pose| truth.world_from_palm.inverse_transform_point(&Point3::from(pose.translation.vector)))
}

#[cfg(test)]
mod tests;
