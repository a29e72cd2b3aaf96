//! Referee: judges a trial from ground truth, which only the simulator has. On hardware the operator is asked instead.
//!
//! # Rules
//! The objects of a trial are a list, in the order in which they are picked.
//! - **Unwanted contact**: from the second object on, any of these events before the grasp of the object has closed (the end
//!   of its [`Skill::Grasp`]):
//!   - An object picked earlier and still held, or a digit that holds one, touches the object.
//!   - The palm touches the object before two free digits hold it. After that they may draw it against the palm.
//!     A grasp by a single digit against the palm is exempt.
//!   - The object moves by more than `knock_distance` before its grasp begins and before a free digit has touched it. This
//!     catches a blow shorter than the referee's sampling interval.
//!
//!   Objects that both lie on the table, or both hang in the hand in a later try, may touch each other. A trial of one
//! object   has no unwanted contacts.
//! - **In the hand** ([`world::holding`]): the object touches the hand, does not touch the table, and its origin is within
//!   `palm_distance` of the palm's origin.
//! - **Success**: at the end of the hold, all objects are in the hand, and none has moved relative to the palm by more than
//!   `slip` since the carry began. The hold must have lasted its full time and ended within the time limit. A trial
//! that   carries more than once is judged by its last carry.
//! - **Clean success**: success without an unwanted contact in any try.
//!
//! A contact does not end a trial, and a trial with a contact can still succeed. A **try** begins with an approach.

use nalgebra::{Isometry3, Point3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use world::holding::{HoldingRule, SupportState};
use world::layout::MAX_OBJECTS;
use world::phase::{Phase, Skill};

/// Thresholds of the referee.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RefereeRules {
    /// Greatest distance of a held object's origin from the palm's origin, m.
    pub palm_distance: f64,
    /// Greatest displacement of a held object relative to the palm since the carry began (slip), m.
    pub slip: f64,
    /// Displacement beyond which an untouched object counts as knocked, m.
    pub knock_distance: f64,
}

/// Ground truth of the scene at one instant.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneTruth {
    /// Time since the trial began, s.
    pub time: f64,
    /// Phase that the controller reports.
    pub phase: Phase,
    /// Objects in the order in which they are picked.
    pub objects: Vec<ObjectTruth>,
    /// Pose of the palm, `world_from_palm`.
    pub world_from_palm: Isometry3<f64>,
}

/// Ground truth of one object.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectTruth {
    /// Indices of the objects picked before this one that touch it.
    pub touching_objects: Vec<usize>,
    /// True if a digit that holds one of the earlier objects touches this one; false before anything is held.
    pub holding_digits_touch: bool,
    /// True if the palm touches it.
    pub palm_touches: bool,
    /// Number of digits that touch it and hold no earlier object.
    pub free_digits: usize,
    /// True if the grasp uses a single digit against the palm; the palm may then touch the object.
    pub palm_grasp: bool,
    /// Loaded contacts on it at this instant; not recorded for the first object.
    pub pressed_by: Vec<TouchEvent>,
    /// Number of contacts with the hand.
    pub hand_contacts: usize,
    /// True if it touches the table.
    pub on_table: bool,
    /// Pose of the object, `world_from_object`.
    pub world_from_object: Isometry3<f64>,
}

impl ObjectTruth {
    /// Returns an object that touches nothing but the table.
    pub fn resting_on_table(world_from_object: Isometry3<f64>) -> Self {
        Self {
            touching_objects: Vec::new(),
            holding_digits_touch: false,
            palm_touches: false,
            free_digits: 0,
            palm_grasp: false,
            pressed_by: Vec::new(),
            hand_contacts: 0,
            on_table: true,
            world_from_object,
        }
    }

    /// True if the object is not in the hand.
    fn is_out_of_hand(&self) -> bool {
        self.on_table || self.hand_contacts == 0
    }

    fn position(&self) -> Point3<f64> {
        self.world_from_object.translation.vector.into()
    }
}

/// Parts that can press on an object after the first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ContactingBody {
    /// The first object.
    FirstObject,
    /// The second object.
    SecondObject,
    /// The palm.
    Palm,
    /// A link of a digit, by its index.
    Link(usize),
}

/// A loaded contact on an object after the first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TouchEvent {
    /// The part that presses.
    pub by: ContactingBody,
    /// True if `by` is a link of a digit that holds an earlier object.
    pub holding: bool,
    /// Contact point in the world frame, m.
    pub point: Point3<f64>,
    /// Normal force, N.
    pub force: f64,
}

/// Kind of an unwanted contact.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ContactWith {
    /// A held object touched the object to be picked next.
    HeldObject,
    /// A digit that holds an object touched it.
    HoldingDigits,
    /// The palm touched it before two free digits held it.
    Palm,
    /// It was knocked: it moved before its grasp began, without a touch by a free digit.
    Knocked,
}

impl ContactWith {
    /// Name in files.
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
pub struct UnwantedContact {
    /// Kind of the contact.
    pub with: ContactWith,
    /// Part with the greatest normal force when the contact began; none if the contact was too short to be sampled.
    pub by: Option<ContactingBody>,
    /// Phase in which it began.
    pub phase: Phase,
    /// Time at which it began, s since the trial began.
    pub time: f64,
    /// Point of the greatest normal force when it began, world frame, m.
    pub point: Option<Point3<f64>>,
    /// Greatest sum of the normal forces during the try, N.
    pub force: f64,
}

/// Outcome of one try.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TryVerdict {
    /// Index of the object to be picked.
    pub object: usize,
    /// Start of the try, s since the trial began.
    pub begun: f64,
    /// End of the try, s since the trial began: the next try begins, or the trial ends.
    pub ended: f64,
    /// First unwanted contact of the try.
    pub contact: Option<UnwantedContact>,
    /// True if the object was in the hand at the end of its lift; none if it was never lifted.
    pub picked: Option<bool>,
}

/// Cause of a trial's failure.
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
    /// Both objects of a trial of two were picked up and lost.
    BothDropped,
    /// Two or more objects of a trial of three were picked up and lost.
    SeveralDropped,
    /// All objects are in the hand, but one slipped: it moved relative to the palm by more than the rules allow.
    Slipped,
    /// The controller found no reachable approach path to an object.
    Unreachable,
    /// The controller declined an object: a contact was more likely than a hold.
    Declined,
    /// An object was not detected anywhere.
    #[serde(alias = "not_seen")]
    NotDetected,
    /// The controller found no strategy left to try.
    NoStrategy,
    /// The policy failed or gave an invalid answer.
    PolicyFailed,
    /// The robot failed: a servo, a link, a limit.
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
            Self::NotDetected => "not detected",
            Self::NoStrategy => "no strategy",
            Self::PolicyFailed => "policy failed",
            Self::RobotFault => "robot fault",
            Self::NotFinished => "not finished",
            Self::TooLate => "too late",
        })
    }
}

/// Verdict of the referee.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// True if there was an unwanted contact in any try.
    pub contact: bool,
    /// First unwanted contact; none if contacts were not measured.
    pub first_contact: Option<UnwantedContact>,
    /// True if the trial succeeded.
    pub success: bool,
    /// Cause of the failure; none on success.
    pub cause: Option<FailureCause>,
}

/// Failure causes of each object: dropped, and not picked up.
const CAUSES_BY_OBJECT: [[FailureCause; 2]; MAX_OBJECTS] = [
    [FailureCause::FirstDropped, FailureCause::FirstNotPicked],
    [FailureCause::SecondDropped, FailureCause::SecondNotPicked],
    [FailureCause::ThirdDropped, FailureCause::ThirdNotPicked],
];

/// Speed below which an object counts as at rest, m/s.
const REST_SPEED: f64 = 0.002;

/// Times by which a trial is judged, s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RefereeLimits {
    /// Required duration of the hold.
    pub hold: f64,
    /// Time limit for the end of the hold.
    pub trial: f64,
}

/// State that the referee keeps of one object.
#[derive(Debug, Clone, Default)]
struct ObjectMonitor {
    /// Position in the world frame from which a knock is measured, m.
    start: Option<Point3<f64>>,
    /// True if it was at rest at the last sample.
    at_rest: bool,
    free_touch: bool,
    /// True if two free digits have held it in this try.
    gripped: bool,
    /// True if it was in the hand at the end of its own lift.
    picked: bool,
}

/// Referee of one trial.
#[derive(Debug, Clone)]
pub struct Referee {
    rules: RefereeRules,
    limits: RefereeLimits,
    tries: Vec<TryVerdict>,
    /// State of the objects observed so far.
    monitors: Vec<ObjectMonitor>,
    /// Origins of the objects in the palm frame when the carry began, m.
    carry_start: Option<Vec<Point3<f64>>>,
    slipped: bool,
    hold_start: Option<f64>,
    /// Newest ground truth up to the end of the hold.
    last: Option<SceneTruth>,
    given_up: Option<FailureCause>,
}

impl Referee {
    /// Creates a referee without observations.
    pub fn new(rules: RefereeRules, limits: RefereeLimits) -> Self {
        Self {
            rules,
            limits,
            tries: Vec::new(),
            monitors: Vec::new(),
            carry_start: None,
            slipped: false,
            hold_start: None,
            last: None,
            given_up: None,
        }
    }

    /// Takes the ground truth after a physics step or control tick. Samples come in order of time, the first one before
    /// anything moves.
    pub fn observe(&mut self, truth: &SceneTruth) {
        if truth.phase.is_done() {
            return;
        }
        self.monitors.resize_with(truth.objects.len(), ObjectMonitor::default);
        self.begin_try(truth);
        for object in 1..truth.objects.len() {
            self.check_contacts(truth, object);
        }
        // The end of the lift decides or, if the lift was skipped, the first sample after it.
        for object in 0..truth.objects.len() {
            let skipped = truth.phase.has_lifted(object)
                && self.last.as_ref().is_none_or(|last| !last.phase.has_begun_lift(object));
            if truth.phase == Phase::run(Skill::Lift, object) || skipped {
                let picked = self.in_hand(truth, object);
                self.monitors[object].picked = picked;
                if let Some(last) = self.tries.last_mut().filter(|last| last.object == object) {
                    last.picked = Some(picked);
                }
            }
        }
        if !truth.phase.has_begun_carry() {
            // An object that was carried and lost is tried again. The last carry and hold count.
            (self.carry_start, self.hold_start, self.slipped) = (None, None, false);
        } else {
            let now = positions_in_palm(truth);
            let start = self.carry_start.get_or_insert_with(|| now.clone());
            self.slipped |= now.iter().zip(start).any(|(now, start)| (*now - *start).norm() > self.rules.slip);
        }
        if truth.phase.skill == Skill::Hold {
            self.hold_start.get_or_insert(truth.time);
        }
        self.last = Some(truth.clone());
    }

    /// Records that the controller gave up, for a cause that the scene does not show. Only the first cause counts.
    pub fn give_up(&mut self, cause: FailureCause) {
        self.given_up.get_or_insert(cause);
    }

    /// Returns the verdict on everything observed so far.
    pub fn verdict(&self) -> Verdict {
        let cause = self.cause();
        let first_contact = self.tries.iter().find_map(|one| one.contact);
        Verdict { contact: first_contact.is_some(), first_contact, success: cause.is_none(), cause }
    }

    /// Returns all tries so far, in order.
    pub fn tries(&self) -> &[TryVerdict] {
        &self.tries
    }

    /// Begins a new try when an approach begins.
    fn begin_try(&mut self, truth: &SceneTruth) {
        let Phase { skill, object, .. } = truth.phase;
        if skill == Skill::Approach && self.last.as_ref().is_none_or(|last| last.phase != truth.phase) {
            // An object still rolling after an earlier try has not been knocked: its reference position is taken once
            // it rests.
            for (n, watched) in self.monitors.iter_mut().enumerate() {
                watched.start = self.last.as_ref().filter(|_| watched.at_rest).map(|last| last.objects[n].position());
                (watched.free_touch, watched.gripped) = (false, false);
            }
            self.tries.push(TryVerdict { object, begun: truth.time, ended: truth.time, contact: None, picked: None });
        }
        if let Some(last) = self.tries.last_mut() {
            last.ended = truth.time;
        }
    }

    /// Checks an object after the first for unwanted contacts.
    fn check_contacts(&mut self, truth: &SceneTruth, index: usize) {
        let (object, last) = (&truth.objects[index], self.last.as_ref());
        let (now, watched) = (object.position(), &mut self.monitors[index]);
        watched.at_rest = last
            .is_none_or(|last| (now - last.objects[index].position()).norm() < REST_SPEED * (truth.time - last.time));
        if watched.at_rest {
            watched.start.get_or_insert(now);
        }
        let start = watched.start.unwrap_or(now);
        if truth.phase.has_begun_lift(index) {
            return;
        }
        watched.free_touch |= object.free_digits > 0;
        watched.gripped |= object.free_digits >= 2;
        let palm_touches = object.palm_touches && !watched.gripped && !object.palm_grasp;
        let knocked = !truth.phase.has_begun_grasp(index)
            && !watched.free_touch
            && (now - start).norm() > self.rules.knock_distance;
        let held_touches = object.is_out_of_hand()
            && object.touching_objects.iter().any(|other| !truth.objects[*other].is_out_of_hand());
        let with = match (held_touches, object.holding_digits_touch, palm_touches, knocked) {
            (true, ..) => ContactWith::HeldObject,
            (_, true, ..) => ContactWith::HoldingDigits,
            (_, _, true, _) => ContactWith::Palm,
            (.., true) => ContactWith::Knocked,
            _ => return,
        };
        let unwanted = |touch: &&TouchEvent| match (with, touch.by) {
            (ContactWith::HeldObject, by) => matches!(by, ContactingBody::FirstObject | ContactingBody::SecondObject),
            (ContactWith::Palm, by) => by == ContactingBody::Palm,
            (ContactWith::HoldingDigits, _) => touch.holding,
            (ContactWith::Knocked, _) => false,
        };
        let force = object.pressed_by.iter().filter(unwanted).map(|touch| touch.force).sum::<f64>();
        let hardest = object.pressed_by.iter().filter(unwanted).max_by(|a, b| a.force.total_cmp(&b.force));
        let Some(last) = self.tries.last_mut() else { return };
        let contact = last.contact.get_or_insert(UnwantedContact {
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
        HoldingRule::distance_only(self.rules.palm_distance).holds(&SupportState {
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
            self.monitors.iter().enumerate().map(|(n, watched)| watched.picked && !self.in_hand(last, n)).collect();
        let seen = match lost.iter().filter(|lost| **lost).count() {
            2 if lost.len() == 2 => Some(FailureCause::BothDropped),
            2.. => Some(FailureCause::SeveralDropped),
            _ => lost.iter().zip(&self.monitors).zip(CAUSES_BY_OBJECT).enumerate().find_map(
                |(n, ((lost, watched), causes))| {
                    let [dropped, not_picked] = causes;
                    match (lost, watched.picked) {
                        (true, _) => Some(dropped),
                        (_, false) if last.phase.has_lifted(n) => Some(not_picked),
                        _ => None,
                    }
                },
            ),
        };
        // A touch of the table as the lift begins is not a drop: nothing can be dropped before the end of the lift.
        let seen = seen.filter(|_| last.phase.has_lifted(0));
        if seen.is_some() || self.given_up.is_some() {
            return seen.or(self.given_up);
        }
        // Tolerance of one tick: the first and the last sample of the hold are one tick closer together than the hold
        // is long.
        let finished = self.hold_start.is_some_and(|start| last.time - start >= self.limits.hold - 0.02);
        match (finished, self.slipped, last.time > self.limits.trial) {
            (false, ..) => Some(FailureCause::NotFinished),
            (true, true, _) => Some(FailureCause::Slipped),
            (true, false, true) => Some(FailureCause::TooLate),
            (true, false, false) => None,
        }
    }
}

/// Returns the distance of an object's origin from the palm's origin, m.
pub(crate) fn distance_in_palm(truth: &SceneTruth, object: usize) -> f64 {
    truth.world_from_palm.inverse_transform_point(&truth.objects[object].position()).coords.norm()
}

/// Returns the origins of the objects in the palm frame, m.
fn positions_in_palm(truth: &SceneTruth) -> Vec<Point3<f64>> {
    truth.objects.iter().map(|object| truth.world_from_palm.inverse_transform_point(&object.position())).collect()
}

#[cfg(test)]
mod tests;
