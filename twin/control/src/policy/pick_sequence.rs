//! The policy of a transport: decides after each pick, by touch, which object to take next with which digits, and when
//! to deliver.
//!
//! Each pick is the next object of the executor's list. After a delivery the list begins anew.

pub mod plan;

use dexterous_grasping::Grasp;
use dexterous_grasping::digit_sets;
use hand_model::Digit;
use serde::Serialize;
use tactile_perception::Perceived;

use self::plan::{Pick, PickPlan, Pickup, Ready, feeling, in_words, plan, why_not};
use super::reach::TURNS;
use super::{PolicyError, Step};
use crate::executor::{Executor, Target};
use crate::percept::{Eyes, Percept};
use crate::sensing::Senses;
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
pub struct Item {
    pub name: String,
    /// Volume, m3.
    pub volume: f64,
    /// Indices of the pickups that suit the object.
    pub pickups: Vec<usize>,
}

/// Knowledge of the policy before a transport begins.
#[derive(Clone, Copy)]
pub struct PickTask<'a> {
    /// Hand and arm.
    pub cell: &'a Workcell,
    /// Ways to pick up a ball.
    pub pickups: &'a [Pickup],
    /// The objects to carry.
    pub items: &'a [Item],
    /// Position of the palm above the place of release, m.
    pub goal: [f64; 2],
    /// Largest number of picks.
    pub tries: usize,
}

/// An object that is believed to be in the hand.
#[derive(Debug, Clone)]
struct Had {
    object: usize,
    digits: Vec<Digit>,
}

/// Policy of a transport.
pub struct PickSequence<'a> {
    task: PickTask<'a>,
    mode: PickMode,
    senses: Senses<'a>,
    /// Objects that are believed to be still on the table.
    left: Vec<usize>,
    had: Vec<Had>,
    /// Remaining picks of the plan.
    planned: Vec<Pick>,
    /// The pick under way.
    picking: Option<Pick>,
    failures: Vec<(usize, usize)>,
    picks: usize,
    /// Number of picks since the last delivery, which is the length of the executor's list.
    in_list: usize,
    reasons: Vec<String>,
}

impl<'a> PickSequence<'a> {
    /// A transport of all objects, beginning with an empty hand.
    pub fn new(task: PickTask<'a>, mode: PickMode, senses: Senses<'a>) -> Self {
        Self {
            left: (0..task.items.len()).collect(),
            task,
            mode,
            senses,
            had: Vec::new(),
            planned: Vec::new(),
            picking: None,
            failures: Vec::new(),
            picks: 0,
            in_list: 0,
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
    pub fn decide(&mut self, executor: &mut Executor, eyes: &mut dyn Eyes) -> Result<Step, PolicyError> {
        let next = if self.picks < self.task.tries { self.next_pick(eyes)? } else { None };
        if let Some((pick, percept)) = next {
            self.take(executor, pick, &percept)?;
            return Ok(Step::Play);
        }
        if self.had.is_empty() {
            return Ok(Step::Finish);
        }
        executor.deliver(self.task.goal)?;
        self.had.clear();
        self.planned.clear();
        self.in_list = 0;
        Ok(Step::Play)
    }

    /// Next pick and the percept of its object; `None` if there is nothing to take.
    fn next_pick(&mut self, eyes: &mut dyn Eyes) -> Result<Option<(Pick, Percept)>, PolicyError> {
        let most = match self.mode {
            PickMode::OneByOne => 1_usize.saturating_sub(self.had.len()),
            PickMode::Blind | PickMode::Touch => Digit::ALL.len() - self.had.len(),
        };
        if most == 0 || self.left.is_empty() {
            return Ok(None);
        }
        let mut percepts: Vec<(usize, Percept)> = Vec::with_capacity(self.left.len());
        for &object in &self.left {
            percepts.extend(eyes.look(object)?.map(|seen| (object, Percept::of_ball(&seen.pose))));
        }
        let of = |object: usize| percepts.iter().find(|(other, _)| *other == object).map(|(_, percept)| *percept);
        if self.mode != PickMode::Blind || self.had.is_empty() {
            let holding = self.holding();
            let ready: Vec<Ready> = percepts.iter().map(|(object, percept)| self.ready(*object, percept)).collect();
            let now = plan(self.task.pickups, &ready, &holding, most);
            self.tell_plan(&now, &holding);
            self.planned = now.picks;
        }
        if self.planned.is_empty() {
            return Ok(None);
        }
        let pick = self.planned.remove(0);
        Ok(of(pick.object).map(|percept| (pick, percept)))
    }

    fn holding(&self) -> Vec<Digit> {
        self.had.iter().flat_map(|had| had.digits.iter().copied()).collect()
    }

    /// Pickups for `object` at its percept that a rotation about the vertical brings within the arm's reach.
    fn ready(&self, object: usize, percept: &Percept) -> Ready {
        let failed = |pickup: usize| self.failures.iter().filter(|failed| **failed == (object, pickup)).count() as i32;
        let item = &self.task.items[object];
        let pickups = item.pickups.iter().filter(|pickup| self.turn(**pickup, percept).is_some());
        Ready { object, volume: item.volume, pickups: pickups.map(|pickup| (*pickup, failed(*pickup))).collect() }
    }

    /// Smallest yaw (rad) that brings the grasp of a pickup within the arm's reach.
    fn turn(&self, pickup: usize, percept: &Percept) -> Option<f64> {
        let grasp = &self.task.pickups[pickup].grasp;
        TURNS.into_iter().find(|turn| self.task.cell.reaches(&grasp.palm_pose(&percept.position, percept.yaw + turn)))
    }

    fn names(&self) -> Vec<String> {
        self.task.items.iter().map(|item| item.name.clone()).collect()
    }

    fn tell_plan(&mut self, now: &PickPlan, holding: &[Digit]) {
        let (pickups, names) = (self.task.pickups, self.names());
        let changed = why_not(&self.planned, now, pickups, holding, &names);
        self.reasons.push(match (changed, now.picks.is_empty()) {
            (Some(why), false) => format!("{why}: {} instead", in_words(now, pickups, &names)),
            (Some(why), true) => format!("{why}: nothing else fits"),
            (None, false) if self.had.is_empty() => format!("plan: {}", in_words(now, pickups, &names)),
            (None, false) => format!("on with {}", in_words(now, pickups, &names)),
            (None, true) => format!("no ball left fits beside what {} holds", digit_sets::in_words(holding)),
        });
    }

    fn take(&mut self, executor: &mut Executor, pick: Pick, percept: &Percept) -> Result<(), PolicyError> {
        self.picks += 1;
        self.picking = Some(pick);
        let pickup = &self.task.pickups[pick.pickup];
        let turn = self.turn(pick.pickup, percept).unwrap_or(0.0);
        let grasp = Grasp { yaw: pickup.grasp.yaw + turn, ..pickup.grasp.clone() };
        // A digit that seems empty may still keep an object from rolling out. It therefore opens only when it is
        // needed.
        let holding = self.holding();
        let needed = |digit: &Digit| pickup.grasp.digits.contains(digit) && !holding.contains(digit);
        let kept: Vec<Digit> = executor.holding().into_iter().filter(|digit| !needed(digit)).collect();
        executor.keep_only(&kept);
        self.in_list += 1;
        Ok(executor.take(self.in_list - 1, Target { grasp, percept: *percept })?)
    }

    /// Determines the contents of the hand after a pick was played.
    pub fn perceive(&mut self, executor: &mut Executor) -> Result<(), PolicyError> {
        let Some(pick) = self.picking.take() else { return Ok(()) };
        let pickup = &self.task.pickups[pick.pickup];
        if self.mode == PickMode::Blind {
            self.left.retain(|object| *object != pick.object);
            self.had.push(Had { object: pick.object, digits: pickup.keeps.clone() });
            return Ok(());
        }
        let look = executor.motion().look();
        let Perceived { touches, .. } = self.senses.perceive(&look)?;
        let with = (self.senses.pipeline().hand(), self.senses.hold());
        let feels = |digits: &[Digit]| feeling(with, &touches, look.readings.servos, digits);
        let new = feels(&pickup.grasp.digits);
        let items = self.task.items;
        let name = &items[pick.object].name;
        if new.is_empty() {
            self.reasons.push(format!("nothing felt of {name}: not picked up"));
            self.failures.push((pick.object, pick.pickup));
            self.planned.clear();
        } else {
            let as_planned = if new == pickup.keeps { "as planned" } else { "not as planned" };
            let by = (digit_sets::in_words(&new), digit_sets::in_words(&pickup.keeps));
            self.reasons.push(format!("{name} is felt by {}, {as_planned} ({})", by.0, by.1));
            self.left.retain(|object| *object != pick.object);
        }
        for had in &mut self.had {
            had.digits = feels(&had.digits);
            if had.digits.is_empty() {
                self.reasons.push(format!("{} is no longer felt", items[had.object].name));
                self.left.push(had.object);
            }
        }
        self.had.retain(|had| !had.digits.is_empty());
        self.left.sort_unstable();
        if new.is_empty() {
            let closed = &pickup.grasp.digits;
            let kept: Vec<Digit> = executor.holding().into_iter().filter(|digit| !closed.contains(digit)).collect();
            executor.keep_only(&kept);
        } else {
            self.had.push(Had { object: pick.object, digits: new });
        }
        Ok(())
    }
}
