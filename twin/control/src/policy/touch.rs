//! The policy `touch`: decides by what is felt, and tries again what touch says has failed.
//!
//! At each decision the look is interpreted ([`crate::perception`]), [`crate::recovery`] says what should come next, and
//! [`crate::strategy`] chooses the grasp of the second object given the pose of the first as felt. What failed is tried again where
//! the eyes see it now. Where they do not see what is to be taken, the hand steps aside and they look once more; what only comes
//! later is taken to be where it was seen last, and looked for when its turn comes. Before an object is taken it is touched
//! ([`exploration`]): where the first one sits in the hand decides how well the second one can be taken.

mod exploration;
pub(super) mod first;

use std::collections::BTreeMap;

use grasping::{Grasp, Role};
use nalgebra::Vector3;
use touch::{InHand, PoseEstimate};
use world::attempt::Attempt;

use super::reach::{Wanted, within_reach};
use super::{Choice, Injected, Knowledge, Policy, PolicyError, Reordered, Step, Story, Uncertainty};
use crate::collision::Solid;
use crate::executive::{Executive, Skill, Target};
use crate::odds::{Aimed, Belief};
use crate::percept::{Eyes, Looked, Percept};
use crate::perception::{Expected, Felt, Grip, feel, grip, trusted};
use crate::recovery::{Next, probe};
use crate::sensing::Senses;
use crate::strategy::{Assessment, Decision, Foresight, Held, Situation, choose, object_solids, rehearsals};
use crate::worth::{Candidate, SWITCH_GAIN};

/// Time that a trial needs from a new try of the first object to its end, s: none begins later.
const TRY_TIME: f64 = 14.0;
/// The felt pose's standard deviation counts up to this, m.
const MOST_SIGMA: f64 = 0.01;

/// What the policy knows while a trial goes on.
pub struct Touch<'a> {
    knowledge: Knowledge<'a>,
    senses: Senses<'a>,
    /// The objects' own solids.
    solids: [Vec<Solid>; 2],
    /// Grasps of the first object, the planned one first; a worth counts the second grasps that can follow.
    first: Vec<Candidate>,
    story: Story,
    /// The robot's clock at the present decision, s.
    time: f64,
    /// How often each grasp of the first and of the second object, by its number, has failed.
    failures: [BTreeMap<u32, i32>; 2],
    /// Grasps that failed in a row.
    in_a_row: usize,
    /// The objects as they were seen first.
    seen: Option<[Percept; 2]>,
    /// Offset of the aim from what is seen, m, where no rehearsal says better: kept while it works.
    aim: Vector3<f64>,
    /// What is known about the error of the aim at the second object.
    belief: Belief,
    /// The last try at the second object, if only the eyes said where it is.
    tried: Option<Aimed>,
    /// What the latest look at either object states of its own error, m.
    sighted: [Option<f64>; 2],
    /// Looks that the second object's place is the mean of.
    looks: u32,
    /// What is known about it since the second object was touched where it stands.
    located: Option<Belief>,
    /// The first object was touched where it stands.
    first_located: bool,
    felt: Option<Felt>,
    grip: Grip,
    /// The hand has been emptied: the first object comes next, without a look.
    emptied: bool,
    /// Where an object is in the hand that has just touched it, if it was felt.
    touched: Option<PoseEstimate>,
    /// The hand has stepped aside so that the eyes find this object.
    sought: Option<usize>,
    /// The second object was hidden when it was last looked for.
    second_is_hidden: bool,
}

impl<'a> Touch<'a> {
    /// The policy of a trial whose first grasp is planned as `first`.
    pub fn new(knowledge: Knowledge<'a>, senses: Senses<'a>, first: &Grasp) -> Self {
        let mut story = Story::default();
        if let Some(Reordered { planned, other }) = knowledge.reordered {
            let name = &knowledge.objects[0].name;
            story.tell(format!("{name} is taken first: that promises {other:.2}, the planned order {planned:.2}"));
        }
        Self {
            solids: [0, 1].map(|object| object_solids(&knowledge.objects[object])),
            first: first::candidates(&knowledge, &senses, first),
            time: 0.0,
            belief: Belief::new(&knowledge.uncertainty.stated(knowledge.sighted[1])),
            sighted: knowledge.sighted,
            tried: None,
            looks: 1,
            located: None,
            first_located: false,
            knowledge,
            senses,
            story,
            failures: Default::default(),
            in_a_row: 0,
            seen: None,
            aim: Vector3::zeros(),
            felt: None,
            grip: Grip { first: false, second: false },
            emptied: false,
            touched: None,
            sought: None,
            second_is_hidden: false,
        }
    }

    /// Both objects where they should be in the hand: the first as it was felt last, the second as its grasp holds it.
    fn in_hand(&self, expected: &Expected, second: &Grasp) -> Vec<InHand<'_>> {
        let felt = self.felt.as_ref().map(|felt| felt.estimate.palm_from_object);
        let first = trusted(felt.unwrap_or(expected.palm_from_object));
        let first = InHand { shape: self.knowledge.known[0], prior: first };
        let second = second.held.map(|held| InHand { shape: self.knowledge.known[1], prior: trusted(held) });
        std::iter::once(first).chain(second).collect()
    }

    /// A grasp that just failed is worth less for the rest of the trial, and the next one aims elsewhere.
    fn mark_down(&mut self, next: Next, executive: &Executive) {
        let (object, failed) = match next {
            Next::GoOn => return,
            Next::FirstAgain | Next::StartOver => (0, executive.target(0).grasp.id),
            Next::SecondAgain => (1, executive.target(1).grasp.id),
        };
        *self.failures[object].entry(failed).or_default() += 1;
        if next != Next::StartOver {
            self.in_a_row += 1;
            if self.in_a_row > 1 {
                self.aim = probe(self.in_a_row, self.knowledge.uncertainty.arm);
            }
        }
    }

    /// The eyes look at an object anew. None if it is hidden.
    fn see(&mut self, index: usize, eyes: &mut dyn Eyes) -> Result<Option<Percept>, PolicyError> {
        if let Some(seen) = self.seen.filter(|_| !self.knowledge.recovery.new_look) {
            return Ok(Some(seen[index]));
        }
        let Some(sighted) = eyes.look(index)? else { return Ok(None) };
        self.sighted[index] = sighted.sigma;
        Ok(Some(Percept::of(&self.knowledge.objects[index], &sighted.pose)))
    }

    /// The errors that are expected of where an object is seen and of the arm that goes there.
    fn uncertainty(&self, object: usize) -> Uncertainty {
        self.knowledge.uncertainty.stated(self.sighted[object])
    }

    /// The same for the second object; the executive keeps the last percept while it is hidden.
    fn see_second(&mut self, executive: &mut Executive, eyes: &mut dyn Eyes) -> Result<(), PolicyError> {
        let seen = self.see(1, eyes)?;
        self.second_is_hidden = seen.is_none();
        if let Some(seen) = seen {
            executive.see(1, seen);
            (self.looks, self.located) = (1, None);
        }
        Ok(())
    }

    /// Looks once more at the second object, which nothing has moved: its place is the mean of all looks that agree.
    fn see_better(&mut self, executive: &mut Executive, eyes: &mut dyn Eyes) -> Result<(), PolicyError> {
        let Some(seen) = self.see(1, eyes)?.filter(|_| self.knowledge.recovery.new_look) else { return Ok(()) };
        let known = Looked { mean: executive.target(1).percept, looks: self.looks };
        let Looked { mean, looks } = known.again(seen, self.uncertainty(1).fresh_look());
        executive.see(1, mean);
        self.looks = looks;
        Ok(())
    }

    /// An object that is needed now is hidden: the hand steps aside once, or, where it has done so, the trial is given up.
    fn seek(&mut self, index: usize, executive: &mut Executive, aside: bool) -> Result<Step, PolicyError> {
        let name = &self.knowledge.objects[index].name;
        if aside {
            self.story.reasons.push(format!("{name} is nowhere to be seen"));
            return Ok(Step::NotSeen);
        }
        self.story.tell(format!("{name} is hidden: the hand steps aside to look again"));
        executive.step_aside(index)?;
        self.sought = Some(index);
        Ok(Step::Play)
    }

    fn within_reach(&self, role: Role, executive: &Executive, seen: &Percept) -> Vec<Candidate> {
        let index = usize::from(role == Role::Second);
        let candidates = [&self.first, self.following(executive).1][index];
        let (object, failures) = (&*self.knowledge.objects[index], &self.failures[index]);
        within_reach(&self.knowledge, &Wanted { object, role, candidates, failures }, seen)
    }

    /// Looks at the second object and takes it; `aside`: the hand is out of the way already.
    fn second_again(
        &mut self,
        executive: &mut Executive,
        eyes: &mut dyn Eyes,
        aside: bool,
    ) -> Result<Step, PolicyError> {
        self.see_second(executive, eyes)?;
        if self.second_is_hidden { self.seek(1, executive, aside) } else { self.touch_or_take(1, executive) }
    }

    /// What is in the hand.
    fn held(&self, executive: &Executive, felt: &Felt) -> Held<'_> {
        Held {
            name: &self.knowledge.objects[0].name,
            solids: &self.solids[0],
            pose: felt.estimate.palm_from_object,
            joints: felt.estimate.q.to_vec(),
            digits: executive.target(0).grasp.role.digits(),
            sigma: felt.estimate.sigma().0.min(MOST_SIGMA),
        }
    }

    /// Decides how to take the second object, and begins.
    fn take_second(&mut self, executive: &mut Executive) -> Result<Step, PolicyError> {
        let seen = executive.target(1).percept;
        let mut within = self.within_reach(Role::Second, executive, &seen);
        self.story.decisions += 1;
        loop {
            let Some(felt) = self.felt.as_ref().filter(|_| !within.is_empty()) else {
                return Ok(self.give_up(1, &seen));
            };
            let decision = self.choose(executive, &within, felt)?;
            self.story.risk.get_or_insert(decision.plan.risk);
            let declined = decision.chosen.held < decision.chosen.risk;
            self.story.choice = Some(Choice::of(&decision, declined));
            if declined {
                return self.way_out(executive, &decision);
            }
            let attempt = attempt(&decision, felt);
            let beside = Percept { position: seen.position + decision.aim, ..seen };
            self.story.aimed |= self.seen.is_none_or(|[_, first_look]| beside != first_look);
            let Some(path) = executive.rehearsed_approach(&decision.way, &decision.grasp, &beside) else {
                within.retain(|candidate| candidate.grasp.id != decision.grasp.id);
                continue;
            };
            self.story.switched |= decision.switched;
            // What failed at an object that was touched tells nothing of where the eyes see things.
            self.tried = self.located.is_none().then_some(decision.aimed);
            executive.take(1, Target { grasp: decision.grasp, percept: beside })?;
            executive.redirect(path);
            self.story.attempts.push(attempt);
            self.story.tell(decision.reason);
            return Ok(Step::Play);
        }
    }

    /// The grasp for the second object, given what is felt of the first.
    fn choose(&self, executive: &Executive, candidates: &[Candidate], felt: &Felt) -> Result<Decision, PolicyError> {
        let second = &self.knowledge.objects[1];
        let held = self.held(executive, felt);
        let (first, _) = self.following(executive);
        let uncertainty = self.uncertainty(1);
        let situation = Situation {
            executive,
            hand: &self.knowledge.cell.robot.hand,
            held: &held,
            rehearsed: first.held.zip(first.held_joints.as_deref()),
            target: &self.solids[1],
            target_sigma: self.located.as_ref().map_or(uncertainty.arm.hypot(uncertainty.eyes), Belief::sigma),
            all: rehearsals(candidates),
            belief: self.located.as_ref().unwrap_or(&self.belief),
            looks: self.looks,
            probe: self.aim,
            foresight: self.knowledge.foresees.map(|foresees| Foresight {
                foresees,
                objects: &self.knowledge.objects,
                covariance: &felt.estimate.covariance,
            }),
        };
        choose(&situation, candidates)?.ok_or_else(|| PolicyError::NoPlan(second.name.clone()))
    }

    /// Whether no try begins any more.
    fn is_late(&self) -> bool {
        self.time + TRY_TIME > self.knowledge.time_limit
    }

    /// What is done where a contact is likelier than a hold: the first object is put down and taken otherwise, if that promises
    /// more, else the second one is left alone.
    fn way_out(&mut self, executive: &mut Executive, decision: &Decision) -> Result<Step, PolicyError> {
        let Assessment { held, risk, utility, .. } = decision.chosen;
        let odds = format!("the best grasp holds with {held:.2} and touches with {risk:.2}");
        let present = executive.target(0).grasp.id;
        let otherwise = self.otherwise(present).filter(|worth| *worth > SWITCH_GAIN * utility);
        if otherwise.is_none() || self.is_late() || !self.knowledge.recovery.retry {
            self.story.tell(format!("declined: {odds}"));
            return Ok(Step::Decline);
        }
        self.story.tell(format!("{odds}: the first object is put down and taken otherwise"));
        self.story.retries += 1;
        *self.failures[0].entry(present).or_default() += 1;
        executive.put_down()?;
        self.emptied = true;
        Ok(Step::Play)
    }

    fn give_up(&mut self, index: usize, seen: &Percept) -> Step {
        let object = &self.knowledge.objects[index];
        let tilt = (seen.rotation * object.rest.inverse() * Vector3::z()).angle(&Vector3::z()).to_degrees();
        let at = seen.position;
        self.story.reasons.push(format!(
            "no grasp of {} is in reach at ({:.2}, {:.2}, {:.2}) m, tilted by {tilt:.0} deg",
            object.name, at.x, at.y, at.z
        ));
        Step::GiveUp
    }
}

/// A try at the second object, as decided.
fn attempt(decision: &Decision, felt: &Felt) -> Attempt {
    let (pose, covariance) = (felt.estimate.palm_from_object, &felt.estimate.covariance);
    let (at, turn) = (pose.translation.vector, pose.rotation.scaled_axis());
    Attempt {
        object: 1,
        grasp: decision.grasp.id,
        why: decision.reason.clone(),
        clearance: Some(decision.chosen.clearance),
        risk: Some(decision.chosen.risk),
        felt: Some([at.x, at.y, at.z, turn.x, turn.y, turn.z]),
        covariance: Some(std::array::from_fn(|n| covariance[(n / 6, n % 6)])),
    }
}

impl Policy for Touch<'_> {
    fn perceive(&mut self, executive: &Executive, injected: Option<Injected>) -> Result<(), PolicyError> {
        if self.emptied || self.sought.is_some() {
            return Ok(());
        }
        self.seen.get_or_insert([executive.target(0).percept, executive.target(1).percept]);
        if executive.phase().skill == Skill::Begin {
            return Ok(());
        }
        let [Target { grasp: first, percept }, Target { grasp: second, .. }] =
            [0, 1].map(|object| executive.target(object));
        let expected = Expected::of(first, percept, second);
        let phase = executive.phase();
        if phase.skill == Skill::Palpate {
            return self.perceive_touch(phase.object, executive, &expected);
        }
        if !phase.has_lifted(1) {
            let mut felt = feel(&self.senses, &executive.motion().look(), self.knowledge.known[0], &expected)?;
            if let Some(injected) = injected {
                felt.estimate.palm_from_object = injected.palm_from_object;
                felt.estimate.covariance.fill(0.0);
                felt.grip = injected.grip;
            }
            self.story.reasons.extend(felt.faults.iter().map(|fault| format!("left out: {fault}")));
            self.grip = felt.grip;
            self.felt = Some(felt);
        } else {
            self.grip = match injected {
                Some(injected) => injected.grip,
                None => grip(&self.senses, &executive.motion().look(), &expected, &self.in_hand(&expected, second))?,
            };
        }
        Ok(())
    }

    fn decide(&mut self, executive: &mut Executive, eyes: &mut dyn Eyes, time: f64) -> Result<Step, PolicyError> {
        self.time = time;
        if std::mem::take(&mut self.emptied) {
            return self.first_again(executive, eyes, false);
        }
        match self.sought.take() {
            Some(0) => return self.first_again(executive, eyes, true),
            Some(_) => return self.second_again(executive, eyes, true),
            None => {}
        }
        let phase = executive.phase();
        match (phase.skill, phase.object) {
            (Skill::Begin, _) => return self.touch_or_take(0, executive),
            (Skill::Palpate, 0) => {
                self.locate_first(executive);
                return self.take_first(executive);
            }
            (Skill::Palpate, _) => {
                self.locate_second(executive);
                return self.take_second(executive);
            }
            _ => {}
        }
        let next =
            if self.is_late() || !self.knowledge.recovery.retry { Next::GoOn } else { Next::after(phase, self.grip) };
        if let (Some(tried), Skill::Look, Next::SecondAgain) = (self.tried.take(), phase.skill, next) {
            self.belief.failed(&tried, self.looks);
        }
        match (phase.skill, next) {
            (Skill::Verify, Next::GoOn) => return Ok(Step::Finish),
            (Skill::Look, Next::GoOn) if phase.object == 1 => {
                executive.carry_aside()?;
                return Ok(Step::Play);
            }
            (_, Next::GoOn) => self.in_a_row = 0,
            _ => {
                self.story.retries += 1;
                self.story.tell(next.reason().to_owned());
                self.mark_down(next, executive);
            }
        }
        match next {
            Next::FirstAgain => self.first_again(executive, eyes, false),
            Next::StartOver => {
                executive.put_down()?;
                self.emptied = true;
                Ok(Step::Play)
            }
            Next::SecondAgain => self.second_again(executive, eyes, false),
            Next::GoOn if self.second_is_hidden => self.second_again(executive, eyes, false),
            Next::GoOn => {
                self.see_better(executive, eyes)?;
                self.touch_or_take(1, executive)
            }
        }
    }

    fn story(&mut self) -> &mut Story {
        &mut self.story
    }

    fn felt(&self) -> Option<&Felt> {
        self.felt.as_ref()
    }

    fn deliberates(&self) -> bool {
        true
    }
}
