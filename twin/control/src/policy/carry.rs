//! The policy of a transport: what to take next, when to carry away, by what is felt after each pick.

use ::touch::Perceived;
use grasping::Grasp;
use hand_model::Digit;

use super::PolicyError;
use super::reach::TURNS;
use crate::carrier::Carrier;
use crate::load::{LoadPlan, Pick, Ready, Skill, feeling, in_words, listed, plan, why_not};
use crate::percept::{Eyes, Percept};
use crate::sensing::Senses;
use crate::workcell::Workcell;

/// How the load is chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Carrying {
    /// One object a trip, with touch: what carrying together is compared to.
    OneByOne,
    /// As many as fit, all as planned, unfelt.
    Blind,
    /// As many as fit, by what is felt after each pick.
    Touch,
}

/// Something to be carried.
#[derive(Debug, Clone, PartialEq)]
pub struct Cargo {
    pub name: String,
    /// m3.
    pub volume: f64,
    /// Numbers of the skills that suit it.
    pub skills: Vec<usize>,
}

/// What the policy knows before a transport begins.
#[derive(Clone, Copy)]
pub struct Knowledge<'a> {
    /// Hand and arm.
    pub cell: &'a Workcell,
    /// What the hand can do.
    pub skills: &'a [Skill],
    /// What is to be carried.
    pub cargo: &'a [Cargo],
    /// Over which place it is released, m.
    pub goal: [f64; 2],
    /// Picks tried at most.
    pub tries: usize,
}

/// How a transport goes on after a decision.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CarryStep {
    /// An object is being taken: play, then [`Carry::perceive`].
    Pick,
    /// What is held is being brought to the goal: play.
    Deliver,
    /// Nothing is left to do.
    Finish,
}

/// An object that is believed to be in the hand.
#[derive(Debug, Clone)]
struct Had {
    object: usize,
    digits: Vec<Digit>,
}

/// Decides a transport.
pub struct Carry<'a> {
    knowledge: Knowledge<'a>,
    carrying: Carrying,
    senses: Senses<'a>,
    /// Objects that are believed to be on the table still.
    left: Vec<usize>,
    had: Vec<Had>,
    /// What the plan goes on with.
    planned: Vec<Pick>,
    /// The pick under way.
    picking: Option<Pick>,
    failures: Vec<(usize, usize)>,
    picks: usize,
    reasons: Vec<String>,
}

impl<'a> Carry<'a> {
    /// A transport of everything, with an empty hand.
    pub fn new(knowledge: Knowledge<'a>, carrying: Carrying, senses: Senses<'a>) -> Self {
        Self {
            left: (0..knowledge.cargo.len()).collect(),
            knowledge,
            carrying,
            senses,
            had: Vec::new(),
            planned: Vec::new(),
            picking: None,
            failures: Vec::new(),
            picks: 0,
            reasons: Vec::new(),
        }
    }

    /// Picks tried so far.
    pub fn picks(&self) -> usize {
        self.picks
    }

    /// What was decided and felt since the last call, in words.
    pub fn take_reasons(&mut self) -> Vec<String> {
        std::mem::take(&mut self.reasons)
    }

    /// Decides what comes next and begins it.
    pub fn decide(&mut self, carrier: &mut Carrier, eyes: &mut dyn Eyes) -> Result<CarryStep, PolicyError> {
        let next = if self.picks < self.knowledge.tries { self.next_pick(eyes)? } else { None };
        if let Some((pick, percept)) = next {
            self.take(carrier, pick, &percept)?;
            return Ok(CarryStep::Pick);
        }
        if self.had.is_empty() {
            return Ok(CarryStep::Finish);
        }
        carrier.deliver(self.knowledge.goal)?;
        self.had.clear();
        self.planned.clear();
        Ok(CarryStep::Deliver)
    }

    /// What to take next, if anything, and where it is seen.
    fn next_pick(&mut self, eyes: &mut dyn Eyes) -> Result<Option<(Pick, Percept)>, PolicyError> {
        let most = match self.carrying {
            Carrying::OneByOne => 1_usize.saturating_sub(self.had.len()),
            Carrying::Blind | Carrying::Touch => Digit::ALL.len() - self.had.len(),
        };
        if most == 0 || self.left.is_empty() {
            return Ok(None);
        }
        let mut percepts: Vec<(usize, Percept)> = Vec::with_capacity(self.left.len());
        for &object in &self.left {
            percepts.extend(eyes.look(object)?.map(|seen| (object, Percept::of_ball(&seen.pose))));
        }
        let of = |object: usize| percepts.iter().find(|(other, _)| *other == object).map(|(_, percept)| *percept);
        if self.carrying != Carrying::Blind || self.had.is_empty() {
            let holding = self.holding();
            let ready: Vec<Ready> = percepts.iter().map(|(object, percept)| self.ready(*object, percept)).collect();
            let now = plan(self.knowledge.skills, &ready, &holding, most);
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

    /// The skills for `object` where it is seen, turned about the vertical into the arm's reach.
    fn ready(&self, object: usize, percept: &Percept) -> Ready {
        let failed = |skill: usize| self.failures.iter().filter(|failed| **failed == (object, skill)).count() as i32;
        let cargo = &self.knowledge.cargo[object];
        let skills = cargo.skills.iter().filter(|skill| self.turn(**skill, percept).is_some());
        Ready { object, volume: cargo.volume, skills: skills.map(|skill| (*skill, failed(*skill))).collect() }
    }

    /// The smallest turn that brings a skill's grasp into the arm's reach, rad.
    fn turn(&self, skill: usize, percept: &Percept) -> Option<f64> {
        let grasp = &self.knowledge.skills[skill].grasp;
        TURNS
            .into_iter()
            .find(|turn| self.knowledge.cell.reaches(&grasp.palm_pose(&percept.position, percept.yaw + turn)))
    }

    fn names(&self) -> Vec<String> {
        self.knowledge.cargo.iter().map(|cargo| cargo.name.clone()).collect()
    }

    fn tell_plan(&mut self, now: &LoadPlan, holding: &[Digit]) {
        let (skills, names) = (self.knowledge.skills, self.names());
        let changed = why_not(&self.planned, now, skills, holding, &names);
        self.reasons.push(match (changed, now.picks.is_empty()) {
            (Some(why), false) => format!("{why}: {} instead", in_words(now, skills, &names)),
            (Some(why), true) => format!("{why}: nothing else fits"),
            (None, false) if self.had.is_empty() => format!("plan: {}", in_words(now, skills, &names)),
            (None, false) => format!("on with {}", in_words(now, skills, &names)),
            (None, true) => format!("no ball left fits beside what {} holds", listed(holding)),
        });
    }

    fn take(&mut self, carrier: &mut Carrier, pick: Pick, percept: &Percept) -> Result<(), PolicyError> {
        self.picks += 1;
        self.picking = Some(pick);
        let skill = &self.knowledge.skills[pick.skill];
        let turn = self.turn(pick.skill, percept).unwrap_or(0.0);
        let grasp = Grasp { yaw: skill.grasp.yaw + turn, ..skill.grasp.clone() };
        // A digit that is felt to have nothing may still keep an object from rolling out: it opens where it is needed, no earlier.
        let holding = self.holding();
        let needed = |digit: &Digit| skill.grasp.digits().contains(digit) && !holding.contains(digit);
        let kept: Vec<Digit> = carrier.holding().into_iter().filter(|digit| !needed(digit)).collect();
        carrier.keep_only(&kept);
        Ok(carrier.take(grasp, percept)?)
    }

    /// After a pick was played: what is in the hand now.
    pub fn perceive(&mut self, carrier: &mut Carrier) -> Result<(), PolicyError> {
        let Some(pick) = self.picking.take() else { return Ok(()) };
        let skill = &self.knowledge.skills[pick.skill];
        if self.carrying == Carrying::Blind {
            self.left.retain(|object| *object != pick.object);
            self.had.push(Had { object: pick.object, digits: skill.keeps.clone() });
            return Ok(());
        }
        let look = carrier.look();
        let Perceived { touches, .. } = self.senses.perceive(&look)?;
        let hand = self.senses.pipeline().hand();
        let feels = |digits: &[Digit]| feeling(hand, &touches, look.readings.servos, digits);
        let new = feels(&skill.grasp.digits());
        let cargo = self.knowledge.cargo;
        let name = &cargo[pick.object].name;
        if new.is_empty() {
            self.reasons.push(format!("nothing felt of {name}: not picked up"));
            self.failures.push((pick.object, pick.skill));
            self.planned.clear();
        } else {
            let as_planned = if new == skill.keeps { "as planned" } else { "not as planned" };
            let by = (listed(&new), listed(&skill.keeps));
            self.reasons.push(format!("{name} is felt by {}, {as_planned} ({})", by.0, by.1));
            self.left.retain(|object| *object != pick.object);
        }
        for had in &mut self.had {
            had.digits = feels(&had.digits);
            if had.digits.is_empty() {
                self.reasons.push(format!("{} is no longer felt", cargo[had.object].name));
                self.left.push(had.object);
            }
        }
        self.had.retain(|had| !had.digits.is_empty());
        self.left.sort_unstable();
        if new.is_empty() {
            let closed = skill.grasp.digits();
            let kept: Vec<Digit> = carrier.holding().into_iter().filter(|digit| !closed.contains(digit)).collect();
            carrier.keep_only(&kept);
        } else {
            self.had.push(Had { object: pick.object, digits: new });
        }
        Ok(())
    }
}
