//! The policy of a trial of more than two objects: takes one after the other, each by digits of its own, and goes by what they feel.
//!
//! Before each grasp the eyes look anew, and looks that agree are averaged. After each grasp every object that should be in the hand is asked for
//! at its own digits ([`feeling`]): what is missing of the last one is taken again, with the grasp that is worth most now; where one that was taken
//! before is gone, everything is laid down and the list begins anew.

use grasping::Grasp;
use grasping::digit_sets::in_words;
use touch::Perceived;
use world::attempt::Attempt;

use super::pick_sequence::plan::feeling;
use super::reach::turned;
use super::{Injected, Knowledge, Policy, PolicyError, Step, Story};
use crate::executor::{Executor, Skill, Target};
use crate::percept::{Eyes, Looked, Percept};
use crate::perception::Felt;
use crate::sensing::Senses;
use crate::worth::{self, Candidate};

/// Time that a trial needs for each object that is still to be taken, and from the last one to its end, s: nothing is taken again later.
const TAKE_TIME: f64 = 9.0;
/// See [`TAKE_TIME`].
const CARRY_TIME: f64 = 7.0;

/// What is known of an object.
struct Item {
    /// Grasps, the planned one first.
    candidates: Vec<Candidate>,
    /// Numbers of those that have failed, one an attempt.
    failures: Vec<u32>,
    /// Looks that its place is the mean of; none before it is looked at anew.
    looks: u32,
    /// It is felt to be in the hand.
    held: bool,
}

/// Takes the objects in turn; see the module's page.
pub struct InTurn<'a> {
    knowledge: Knowledge<'a>,
    senses: Senses<'a>,
    items: Vec<Item>,
    story: Story,
}

impl<'a> InTurn<'a> {
    /// The policy of a trial in which each object is planned to be taken with one of `planned`.
    pub fn new(knowledge: Knowledge<'a>, senses: Senses<'a>, planned: &[&Grasp]) -> Self {
        let proven = [&[][..], &knowledge.second, &knowledge.third];
        let item = |(n, grasp): (usize, &&Grasp)| {
            let known: Vec<Candidate> = match proven.get(n) {
                Some(proven) if !proven.is_empty() => proven.to_vec(),
                _ => {
                    let others = knowledge.repertoire.of(&grasp.object, &grasp.digits);
                    let others = others.filter(|other| other.id != grasp.id);
                    let others = others.map(|other| Candidate::new(other.clone(), worth::UNREHEARSED * other.score));
                    std::iter::once(Candidate::new((*grasp).clone(), grasp.score)).chain(others).collect()
                }
            };
            Item { candidates: known, failures: Vec::new(), looks: 1, held: false }
        };
        let items = planned.iter().enumerate().map(item).collect();
        Self { knowledge, senses, items, story: Story::default() }
    }

    /// Looks at an object anew; false if it is hidden.
    fn see(
        &mut self,
        object: usize,
        again: bool,
        executor: &mut Executor,
        eyes: &mut dyn Eyes,
    ) -> Result<bool, PolicyError> {
        if !self.knowledge.recovery.new_look {
            return Ok(true);
        }
        let Some(sighted) = eyes.look(object)? else { return Ok(false) };
        let seen = Percept::of(&self.knowledge.objects[object], &sighted.pose);
        let known = Looked { mean: executor.target(object).percept, looks: self.items[object].looks };
        let sigma = self.knowledge.uncertainty.stated(sighted.sigma).fresh_look();
        // What was touched may have moved: only the new look counts.
        let Looked { mean, looks } = if again { Looked { mean: seen, looks: 1 } } else { known.again(seen, sigma) };
        executor.see(object, mean);
        self.items[object].looks = looks;
        Ok(true)
    }

    /// Takes an object with the grasp that is worth most now and that the arm gets to.
    fn take(&mut self, object: usize, why: String, executor: &mut Executor) -> Result<Step, PolicyError> {
        let item = &self.items[object];
        let failures = |id: u32| item.failures.iter().filter(|failed| **failed == id).count() as i32;
        let mut order: Vec<(f64, &Candidate)> = item
            .candidates
            .iter()
            .map(|candidate| (candidate.worth * worth::FAILED.powi(failures(candidate.grasp.id)), candidate))
            .collect();
        order.sort_by(|a, b| b.0.total_cmp(&a.0));
        let seen = executor.target(object).percept;
        let model = &self.knowledge.objects[object];
        let ways: Vec<_> = executor.ways().collect();
        let found = order.iter().find_map(|(_, candidate)| {
            turned(&self.knowledge, &candidate.grasp, &seen, model).find_map(|grasp| {
                let path = ways.iter().find_map(|stops| executor.rehearsed_approach(stops, &grasp, &seen))?;
                Some((grasp, path))
            })
        });
        let Some((grasp, path)) = found else {
            self.story.tell(format!("no grasp of {} is in reach", model.name));
            return Ok(Step::GiveUp);
        };
        let planned = item.candidates.first().map(|candidate| candidate.grasp.id);
        self.story.switched |= planned != Some(grasp.id);
        self.story.decisions += 1;
        self.story.tell(format!("{} is taken by {}: {why}", model.name, in_words(&grasp.digits)));
        self.story.attempts.push(Attempt { object, grasp: grasp.id, why, ..Attempt::default() });
        executor.take(object, Target { grasp, percept: seen })?;
        executor.redirect(path);
        Ok(Step::Play)
    }

    /// Looks at an object and takes it.
    fn see_and_take(
        &mut self,
        object: usize,
        why: &str,
        again: bool,
        executor: &mut Executor,
        eyes: &mut dyn Eyes,
    ) -> Result<Step, PolicyError> {
        if self.see(object, again, executor, eyes)? {
            return self.take(object, why.to_owned(), executor);
        }
        self.story.tell(format!("{} is nowhere to be seen", self.knowledge.objects[object].name));
        Ok(Step::NotSeen)
    }

    /// Whether there is time to take the objects from this one on.
    fn has_time(&self, object: usize, time: f64) -> bool {
        let left = (self.items.len() - object) as f64;
        self.knowledge.recovery.retry && time + left * TAKE_TIME + CARRY_TIME < self.knowledge.time_limit
    }
}

impl Policy for InTurn<'_> {
    fn perceive(&mut self, executor: &Executor, injected: Option<Injected>) -> Result<(), PolicyError> {
        let phase = executor.phase();
        let last = if phase.carries() { self.items.len() - 1 } else { phase.object };
        if !matches!(phase.skill, Skill::Look | Skill::Verify) {
            self.items.iter_mut().for_each(|item| item.held = false);
            return Ok(());
        }
        let look = executor.motion().look();
        let Perceived { touches, .. } = self.senses.perceive(&look)?;
        let hand = self.senses.pipeline().hand();
        for (n, item) in self.items.iter_mut().enumerate() {
            let digits = &executor.target(n).grasp.digits;
            item.held = n <= last && !feeling(hand, &touches, look.readings.servos, digits).is_empty();
        }
        if let Some(injected) = injected {
            for (item, held) in self.items.iter_mut().zip([injected.grip.first, injected.grip.second]) {
                item.held = held;
            }
        }
        Ok(())
    }

    fn decide(&mut self, executor: &mut Executor, eyes: &mut dyn Eyes, time: f64) -> Result<Step, PolicyError> {
        let phase = executor.phase();
        let count = self.items.len();
        let last = match phase.skill {
            Skill::Begin => return self.see_and_take(0, "as planned", false, executor, eyes),
            Skill::PutDown => return self.see_and_take(0, "once more, from the beginning", true, executor, eyes),
            Skill::Look => phase.object,
            _ => count - 1,
        };
        let missing = (0..=last).find(|object| !self.items[*object].held);
        if let Some(object) = missing.filter(|object| self.has_time(if *object == last { last } else { 0 }, time)) {
            let failed = executor.target(object).grasp.id;
            self.items[object].failures.push(failed);
            self.story.retries += 1;
            self.story.tell(format!("nothing is felt of {}", self.knowledge.objects[object].name));
            if object == last {
                return self.see_and_take(object, "once more", true, executor, eyes);
            }
            executor.put_down()?;
            return Ok(Step::Play);
        }
        match phase.skill {
            Skill::Look if last + 1 < count => self.see_and_take(last + 1, "as planned", false, executor, eyes),
            Skill::Look => {
                executor.carry_aside()?;
                Ok(Step::Play)
            }
            _ => Ok(Step::Finish),
        }
    }

    fn story(&mut self) -> &mut Story {
        &mut self.story
    }

    fn felt(&self) -> Option<&Felt> {
        None
    }

    fn deliberates(&self) -> bool {
        true
    }
}
