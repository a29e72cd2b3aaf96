//! Judges a trial from ground truth, which only the simulator has; on hardware the operator is asked instead.
//!
//! # Rules
//! The objects of a trial are a list, in the order in which they are taken.
//! - **Contact** (unwanted): before the grasp of an object after the first has closed (up to the end of its [`Skill::Grasp`]), one that is held, taken
//!   before it, or a digit holding one touches it; or the palm does before two free digits have it (once they have, they may
//!   draw it against the palm; nor does it count where a single digit takes the object against the palm); or it moves by more than `knock_distance` before
//!   its grasp begins without a free digit having touched it (a blow shorter than the referee's sampling). Objects that both
//!   lie on the table, or both hang in the hand in a later try, may touch each other. A trial of one object knows no such contact.
//! - **In the hand** ([`world::holding`]): the object touches the hand, does not touch the table, and its origin is within
//!   `palm_distance` of the palm's.
//! - **Success**: at the end of the hold, which lasted its full time and ended within the time limit, all objects are in the
//!   hand, and none has moved relative to the palm by more than `slip` since the carry began. A trial that carries again is
//!   judged by its last carry.
//! - **Clean success**: success without any unwanted contact in any try.
//!
//! A contact does not end a trial, and a trial with a contact can succeed. A **try** begins with an approach.

use nalgebra::{Isometry3, Point3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use world::holding::{HoldingRule, Support};
use world::layout::MOST_OBJECTS;
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

/// The scene as it is.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneTruth {
    /// s since the trial began.
    pub time: f64,
    /// What the controller says it is doing.
    pub phase: Phase,
    /// The objects in the order in which they are taken.
    pub objects: Vec<ObjectTruth>,
    /// `world_from_palm`.
    pub world_from_palm: Isometry3<f64>,
}

/// One object as it is.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectTruth {
    /// Indices of the objects taken before it that touch it.
    pub touching_objects: Vec<usize>,
    /// A digit that holds one of those touches it. Before anything is held: none does.
    pub holding_digits_touch: bool,
    /// The palm touches it.
    pub palm_touches: bool,
    /// How many of the digits that are not for those touch it.
    pub free_digits: usize,
    /// A single digit takes it, against the palm: then the palm may touch it.
    pub palm_takes: bool,
    /// What presses on it at this moment; not seen of the first object.
    pub pressed_by: Vec<Touch>,
    /// Contacts with the hand.
    pub hand_contacts: usize,
    /// Whether it touches the table.
    pub on_table: bool,
    /// `world_from_object`.
    pub world_from_object: Isometry3<f64>,
}

impl ObjectTruth {
    /// An object that touches nothing but the table.
    pub fn standing(world_from_object: Isometry3<f64>) -> Self {
        Self {
            touching_objects: Vec::new(),
            holding_digits_touch: false,
            palm_touches: false,
            free_digits: 0,
            palm_takes: false,
            pressed_by: Vec::new(),
            hand_contacts: 0,
            on_table: true,
            world_from_object,
        }
    }

    /// True where it is not in the hand.
    fn lies(&self) -> bool {
        self.on_table || self.hand_contacts == 0
    }

    fn position(&self) -> Point3<f64> {
        self.world_from_object.translation.vector.into()
    }
}

/// What can press on an object after the first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Toucher {
    /// The first object.
    FirstObject,
    /// The second object.
    SecondObject,
    /// The palm.
    Palm,
    /// A link of a digit, by its number.
    Link(usize),
}

/// A loaded contact on an object after the first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Touch {
    /// What presses.
    pub by: Toucher,
    /// Whether that is a link of a digit that holds an object taken before.
    pub holding: bool,
    /// m, world.
    pub point: Point3<f64>,
    /// Normal force, N.
    pub force: f64,
}

/// What an unwanted contact was with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ContactWith {
    /// A held object touched the one that was to be taken.
    HeldObject,
    /// A digit holding an object did.
    HoldingDigits,
    /// The palm did, before two free digits had it.
    Palm,
    /// It was moved.
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
    /// Index of the object that was to be taken.
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
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
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
    /// The third object was not in the hand after its lift.
    ThirdNotPicked,
    /// The third object was picked up and lost.
    ThirdDropped,
    /// Both were picked up and lost.
    BothDropped,
    /// Of three, several were picked up and lost.
    SeveralDropped,
    /// All are in the hand, but one moved in it by more than the rules allow.
    Slipped,
    /// The controller found no way to reach an object.
    Unreachable,
    /// The controller left an object alone: a contact was likelier than a hold.
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
    /// All objects were held at the end, which came after the time limit.
    TooLate,
}

impl std::fmt::Display for FailureCause {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.pad(match self {
            Self::FirstNotPicked => "first not picked",
            Self::FirstDropped => "first dropped",
            Self::SecondNotPicked => "second not picked",
            Self::SecondDropped => "second dropped",
            Self::ThirdNotPicked => "third not picked",
            Self::ThirdDropped => "third dropped",
            Self::BothDropped => "both dropped",
            Self::SeveralDropped => "several dropped",
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

/// Causes of a failure with each object: it was dropped, or not picked up.
const OF_OBJECT: [[FailureCause; 2]; MOST_OBJECTS] = [
    [FailureCause::FirstDropped, FailureCause::FirstNotPicked],
    [FailureCause::SecondDropped, FailureCause::SecondNotPicked],
    [FailureCause::ThirdDropped, FailureCause::ThirdNotPicked],
];

/// Slower than this an object rests, m/s.
const AT_REST: f64 = 0.002;

/// Times of a trial, s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// How long the objects must be held.
    pub hold: f64,
    /// When the hold must be over.
    pub trial: f64,
}

/// How an object has fared.
#[derive(Debug, Clone, Default)]
struct Watched {
    /// From where it counts as knocked, m, world.
    start: Option<Point3<f64>>,
    /// It rested at the last sight.
    rests: bool,
    free_touch: bool,
    /// Two free digits have had it in this try.
    gripped: bool,
    /// It was in the hand when its own lift had ended.
    picked: bool,
}

/// Watches one trial.
#[derive(Debug, Clone)]
pub struct Referee {
    rules: RefereeRules,
    limits: Limits,
    tries: Vec<TryVerdict>,
    /// The objects as far as they have been seen.
    watched: Vec<Watched>,
    /// Their origins in the palm frame when the carry began, m.
    carry_start: Option<Vec<Point3<f64>>>,
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
            watched: Vec::new(),
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
        self.watched.resize_with(truth.objects.len(), Watched::default);
        self.note_try(truth);
        for object in 1..truth.objects.len() {
            self.watch(truth, object);
        }
        // What counts is the end of the lift, or, if that was skipped, the first sight after it.
        for object in 0..truth.objects.len() {
            let skipped =
                truth.phase.has_lifted(object) && self.last.as_ref().is_none_or(|last| !last.phase.lifts(object));
            if truth.phase == Phase::run(Skill::Lift, object) || skipped {
                let picked = self.in_hand(truth, object);
                self.watched[object].picked = picked;
                if let Some(last) = self.tries.last_mut().filter(|last| last.object == object) {
                    last.picked = Some(picked);
                }
            }
        }
        if !truth.phase.carries() {
            // What was carried and lost is tried again: the carry and the hold that count are the last ones.
            (self.carry_start, self.hold_start, self.slipped) = (None, None, false);
        } else {
            let now = in_palm(truth);
            let start = self.carry_start.get_or_insert_with(|| now.clone());
            self.slipped |= now.iter().zip(start).any(|(now, start)| (*now - *start).norm() > self.rules.slip);
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
            for (n, watched) in self.watched.iter_mut().enumerate() {
                watched.start = self.last.as_ref().filter(|_| watched.rests).map(|last| last.objects[n].position());
                (watched.free_touch, watched.gripped) = (false, false);
            }
            self.tries.push(TryVerdict { object, begun: truth.time, ended: truth.time, contact: None, picked: None });
        }
        if let Some(last) = self.tries.last_mut() {
            last.ended = truth.time;
        }
    }

    /// Looks for what an object after the first must not meet.
    fn watch(&mut self, truth: &SceneTruth, index: usize) {
        let (object, last) = (&truth.objects[index], self.last.as_ref());
        let (now, watched) = (object.position(), &mut self.watched[index]);
        watched.rests =
            last.is_none_or(|last| (now - last.objects[index].position()).norm() < AT_REST * (truth.time - last.time));
        if watched.rests {
            watched.start.get_or_insert(now);
        }
        let start = watched.start.unwrap_or(now);
        if truth.phase.lifts(index) {
            return;
        }
        watched.free_touch |= object.free_digits > 0;
        watched.gripped |= object.free_digits >= 2;
        let palm_touches = object.palm_touches && !watched.gripped && !object.palm_takes;
        let knocked =
            !truth.phase.closes(index) && !watched.free_touch && (now - start).norm() > self.rules.knock_distance;
        let held_touches = object.lies() && object.touching_objects.iter().any(|other| !truth.objects[*other].lies());
        let with = match (held_touches, object.holding_digits_touch, palm_touches, knocked) {
            (true, ..) => ContactWith::HeldObject,
            (_, true, ..) => ContactWith::HoldingDigits,
            (_, _, true, _) => ContactWith::Palm,
            (.., true) => ContactWith::Knocked,
            _ => return,
        };
        let unwanted = |touch: &&Touch| match (with, touch.by) {
            (ContactWith::HeldObject, by) => matches!(by, Toucher::FirstObject | Toucher::SecondObject),
            (ContactWith::Palm, by) => by == Toucher::Palm,
            (ContactWith::HoldingDigits, _) => touch.holding,
            (ContactWith::Knocked, _) => false,
        };
        let force = object.pressed_by.iter().filter(unwanted).map(|touch| touch.force).sum::<f64>();
        let hardest = object.pressed_by.iter().filter(unwanted).max_by(|a, b| a.force.total_cmp(&b.force));
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
            held: truth.objects[object].hand_contacts > 0,
            on_table: truth.objects[object].on_table,
            distance: distance_in_palm(truth, object),
            height: truth.objects[object].world_from_object.translation.z,
        })
    }

    fn cause(&self) -> Option<FailureCause> {
        let Some(last) = &self.last else {
            return Some(self.given_up.unwrap_or(FailureCause::NotFinished));
        };
        let lost: Vec<bool> =
            self.watched.iter().enumerate().map(|(n, watched)| watched.picked && !self.in_hand(last, n)).collect();
        let seen = match lost.iter().filter(|lost| **lost).count() {
            2 if lost.len() == 2 => Some(FailureCause::BothDropped),
            2.. => Some(FailureCause::SeveralDropped),
            _ => {
                lost.iter().zip(&self.watched).zip(OF_OBJECT).enumerate().find_map(|(n, ((lost, watched), causes))| {
                    let [dropped, not_picked] = causes;
                    match (lost, watched.picked) {
                        (true, _) => Some(dropped),
                        (_, false) if last.phase.has_lifted(n) => Some(not_picked),
                        _ => None,
                    }
                })
            }
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

/// Distance of an object's origin from the palm's, m.
pub(crate) fn distance_in_palm(truth: &SceneTruth, object: usize) -> f64 {
    truth.world_from_palm.inverse_transform_point(&truth.objects[object].position()).coords.norm()
}

/// Origins of the objects in the palm frame, m.
fn in_palm(truth: &SceneTruth) -> Vec<Point3<f64>> {
    truth.objects.iter().map(|object| truth.world_from_palm.inverse_transform_point(&object.position())).collect()
}

#[cfg(test)]
mod tests;
