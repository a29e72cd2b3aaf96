//! The policy of a transport: decides after each pick, by touch, which object to take next with which digits, and when
//! to deliver.
//!
//! Each pick is the next object of the executor's list. After a delivery the list begins anew.

pub mod plan;

use dexterous_grasping::Grasp;
use dexterous_grasping::digit_sets;
use hand_model::Digit;
use serde::Serialize;
use tactile_perception::PadPerception;

use self::plan::{
    Pick, PickPlan, PickSkill, ReachableObject, describe_plan, explain_replan, holding_digits, plan_picks,
};
use super::reach::YAW_CANDIDATES;
use super::{PolicyError, PolicyStep};
use crate::detection::{DetectedObject, ObjectDetector};
use crate::executor::{Executor, GraspTarget};
use crate::sensing::TouchPerception;
use crate::workcell::Workcell;

/// Rule by which objects are chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum PickMode {
    /// One object per trip, with touch: the baseline of the comparison.
    OneByOne,
    /// As many objects as fit, as planned, without touch.
    Blind,
    /// As many objects as fit, replanned from touch after each pick.
    Touch,
}

impl std::str::FromStr for PickMode {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let known = || Self::ALL.map(Self::argument).join(", ");
        let mode = Self::ALL.into_iter().find(|mode| mode.argument() == text);
        mode.ok_or_else(|| format!("found `{text}`, expected one of {}", known()))
    }
}

impl PickMode {
    /// All modes, the baseline first.
    pub const ALL: [Self; 3] = [Self::OneByOne, Self::Blind, Self::Touch];

    /// Name of the mode on the command line.
    pub fn argument(self) -> &'static str {
        match self {
            Self::OneByOne => "one-by-one",
            Self::Blind => "blind",
            Self::Touch => "touch",
        }
    }

    /// Name of the mode in words.
    pub fn name(self) -> &'static str {
        match self {
            Self::OneByOne => "one by one",
            Self::Blind => "blind",
            Self::Touch => "touch",
        }
    }
}

/// An object to be carried.
#[derive(Debug, Clone, PartialEq)]
pub struct PickObject {
    pub name: String,
    /// Volume, m3.
    pub volume: f64,
    /// Indices of the pickups that suit the object.
    pub skills: Vec<usize>,
}

/// Knowledge of the policy before a transport begins.
#[derive(Clone, Copy)]
pub struct PickTask<'a> {
    /// Hand and arm.
    pub cell: &'a Workcell,
    /// Ways to pick up a ball.
    pub skills: &'a [PickSkill],
    /// The objects to carry.
    pub items: &'a [PickObject],
    /// Position of the palm above the place of release, m.
    pub goal: [f64; 2],
    /// Largest number of picks.
    pub max_picks: usize,
}

/// An object that is estimated to be in the hand.
#[derive(Debug, Clone)]
struct PickedObject {
    object: usize,
    digits: Vec<Digit>,
}

/// Policy of a transport.
pub struct PickSequence<'a> {
    task: PickTask<'a>,
    mode: PickMode,
    senses: TouchPerception<'a>,
    /// Objects that are assumed to be still on the table.
    remaining: Vec<usize>,
    picked: Vec<PickedObject>,
    /// Remaining picks of the plan.
    planned: Vec<Pick>,
    /// The pick under way.
    current_pick: Option<Pick>,
    failures: Vec<(usize, usize)>,
    picks: usize,
    /// Number of picks since the last delivery, which is the length of the executor's list.
    picks_since_delivery: usize,
    reasons: Vec<String>,
}

impl<'a> PickSequence<'a> {
    /// A transport of all objects, beginning with an empty hand.
    pub fn new(task: PickTask<'a>, mode: PickMode, senses: TouchPerception<'a>) -> Self {
        Self {
            remaining: (0..task.items.len()).collect(),
            task,
            mode,
            senses,
            picked: Vec::new(),
            planned: Vec::new(),
            current_pick: None,
            failures: Vec::new(),
            picks: 0,
            picks_since_delivery: 0,
            reasons: Vec::new(),
        }
    }

    /// Number of picks so far.
    pub fn picks(&self) -> usize {
        self.picks
    }

    /// Takes the decisions and tactile findings since the last call, in words.
    pub fn take_reasons(&mut self) -> Vec<String> {
        std::mem::take(&mut self.reasons)
    }

    /// Decides on the next action and begins it: a pick, or the delivery of everything that is held.
    pub fn decide(
        &mut self,
        executor: &mut Executor,
        detector: &mut dyn ObjectDetector,
    ) -> Result<PolicyStep, PolicyError> {
        let next = if self.picks < self.task.max_picks { self.next_pick(detector)? } else { None };
        if let Some((pick, detected)) = next {
            self.take(executor, pick, &detected)?;
            return Ok(PolicyStep::Continue);
        }
        if self.picked.is_empty() {
            return Ok(PolicyStep::Finish);
        }
        executor.deliver(self.task.goal)?;
        self.picked.clear();
        self.planned.clear();
        self.picks_since_delivery = 0;
        Ok(PolicyStep::Continue)
    }

    /// Next pick and the detected pose of its object; `None` if there is nothing to take.
    fn next_pick(&mut self, detector: &mut dyn ObjectDetector) -> Result<Option<(Pick, DetectedObject)>, PolicyError> {
        let most = match self.mode {
            PickMode::OneByOne => 1_usize.saturating_sub(self.picked.len()),
            PickMode::Blind | PickMode::Touch => Digit::ALL.len() - self.picked.len(),
        };
        if most == 0 || self.remaining.is_empty() {
            return Ok(None);
        }
        let mut detected_objects: Vec<(usize, DetectedObject)> = Vec::with_capacity(self.remaining.len());
        for &object in &self.remaining {
            detected_objects
                .extend(detector.detect(object)?.map(|seen| (object, DetectedObject::from_ball_pose(&seen.pose))));
        }
        let of =
            |object: usize| detected_objects.iter().find(|(other, _)| *other == object).map(|(_, detected)| *detected);
        if self.mode != PickMode::Blind || self.picked.is_empty() {
            let holding = self.holding_digits();
            let ready: Vec<ReachableObject> =
                detected_objects.iter().map(|(object, detected)| self.ready(*object, detected)).collect();
            let now = plan_picks(self.task.skills, &ready, &holding, most);
            self.record_plan(&now, &holding);
            self.planned = now.picks;
        }
        if self.planned.is_empty() {
            return Ok(None);
        }
        let pick = self.planned.remove(0);
        Ok(of(pick.object).map(|detected| (pick, detected)))
    }

    fn holding_digits(&self) -> Vec<Digit> {
        self.picked.iter().flat_map(|had| had.digits.iter().copied()).collect()
    }

    /// Pickups for `object` at its detected pose that a rotation about the vertical brings within the arm's reach.
    fn ready(&self, object: usize, detected: &DetectedObject) -> ReachableObject {
        let failed = |pickup: usize| self.failures.iter().filter(|failed| **failed == (object, pickup)).count() as i32;
        let item = &self.task.items[object];
        let pickups = item.skills.iter().filter(|pickup| self.yaw_within_reach(**pickup, detected).is_some());
        ReachableObject {
            object,
            volume: item.volume,
            skills: pickups.map(|pickup| (*pickup, failed(*pickup))).collect(),
        }
    }

    /// Smallest yaw (rad) that brings the grasp of a pickup within the arm's reach.
    fn yaw_within_reach(&self, pickup: usize, detected: &DetectedObject) -> Option<f64> {
        let grasp = &self.task.skills[pickup].grasp;
        YAW_CANDIDATES
            .into_iter()
            .find(|turn| self.task.cell.reaches(&grasp.palm_pose(&detected.position, detected.yaw + turn)))
    }

    fn names(&self) -> Vec<String> {
        self.task.items.iter().map(|item| item.name.clone()).collect()
    }

    fn record_plan(&mut self, now: &PickPlan, holding: &[Digit]) {
        let (pickups, names) = (self.task.skills, self.names());
        let changed = explain_replan(&self.planned, now, pickups, holding, &names);
        self.reasons.push(match (changed, now.picks.is_empty()) {
            (Some(why), false) => format!("{why}: {} instead", describe_plan(now, pickups, &names)),
            (Some(why), true) => format!("{why}: nothing else fits"),
            (None, false) if self.picked.is_empty() => format!("plan: {}", describe_plan(now, pickups, &names)),
            (None, false) => format!("on with {}", describe_plan(now, pickups, &names)),
            (None, true) => format!("no ball left fits beside what {} holds", digit_sets::describe_digits(holding)),
        });
    }

    fn take(&mut self, executor: &mut Executor, pick: Pick, percept: &DetectedObject) -> Result<(), PolicyError> {
        self.picks += 1;
        self.current_pick = Some(pick);
        let pickup = &self.task.skills[pick.skill];
        let turn = self.yaw_within_reach(pick.skill, percept).unwrap_or(0.0);
        let grasp = Grasp { yaw: pickup.grasp.yaw + turn, ..pickup.grasp.clone() };
        // A digit that seems empty may still keep an object from rolling out. It therefore opens only when it is
        // needed.
        let holding = self.holding_digits();
        let needed = |digit: &Digit| pickup.grasp.digits.contains(digit) && !holding.contains(digit);
        let kept: Vec<Digit> = executor.holding_digits().into_iter().filter(|digit| !needed(digit)).collect();
        executor.keep_only(&kept);
        self.picks_since_delivery += 1;
        Ok(executor.take(self.picks_since_delivery - 1, GraspTarget { grasp, detected: *percept })?)
    }

    /// Determines the contents of the hand after a pick was carried out.
    pub fn perceive(&mut self, executor: &mut Executor) -> Result<(), PolicyError> {
        let Some(pick) = self.current_pick.take() else { return Ok(()) };
        let pickup = &self.task.skills[pick.skill];
        if self.mode == PickMode::Blind {
            self.remaining.retain(|object| *object != pick.object);
            self.picked.push(PickedObject { object: pick.object, digits: pickup.keeps.clone() });
            return Ok(());
        }
        let look = executor.motion().snapshot();
        let PadPerception { touches, .. } = self.senses.perceive(&look)?;
        let with = (self.senses.pipeline().hand(), self.senses.hold_limits());
        let feels = |digits: &[Digit]| holding_digits(with, &touches, look.readings.servos, digits);
        let new = feels(&pickup.grasp.digits);
        let items = self.task.items;
        let name = &items[pick.object].name;
        if new.is_empty() {
            self.reasons.push(format!("nothing felt of {name}: not picked up"));
            self.failures.push((pick.object, pick.skill));
            self.planned.clear();
        } else {
            let as_planned = if new == pickup.keeps { "as planned" } else { "not as planned" };
            let by = (digit_sets::describe_digits(&new), digit_sets::describe_digits(&pickup.keeps));
            self.reasons.push(format!("{name} is felt by {}, {as_planned} ({})", by.0, by.1));
            self.remaining.retain(|object| *object != pick.object);
        }
        for had in &mut self.picked {
            had.digits = feels(&had.digits);
            if had.digits.is_empty() {
                self.reasons.push(format!("{} is no longer felt", items[had.object].name));
                self.remaining.push(had.object);
            }
        }
        self.picked.retain(|had| !had.digits.is_empty());
        self.remaining.sort_unstable();
        if new.is_empty() {
            let closed = &pickup.grasp.digits;
            let kept: Vec<Digit> =
                executor.holding_digits().into_iter().filter(|digit| !closed.contains(digit)).collect();
            executor.keep_only(&kept);
        } else {
            self.picked.push(PickedObject { object: pick.object, digits: new });
        }
        Ok(())
    }
}
