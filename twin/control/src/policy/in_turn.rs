//! The policy for a trial of more than two objects: takes one after the other, each with its own digits, and relies on
//! touch.
//!
//! Before each grasp the eyes look again, and looks that agree are averaged. After each grasp, the digits of every
//! object that should be in the hand are checked ([`feeling`]). If the last object is missing, it is taken again with
//! the grasp that is worth most at that time. If an earlier object is missing, everything is laid down and the list
//! begins anew. The pose of each object in the hand is estimated from the pads of its digits and the palm.

use dexterous_grasping::Grasp;
use dexterous_grasping::digit_sets::in_words;
use world::attempt::Attempt;

use super::pick_sequence::plan::feeling;
use super::reach::turned;
use super::tracked::Tracked;
use super::{Injected, Knowledge, Policy, PolicyError, Step, Story};
use crate::executor::{Executor, Skill, Target};
use crate::percept::Eyes;
use crate::perception::{Felt, Grip, feel_each, place_in_hand};
use crate::sensing::Senses;
use crate::worth::{self, Candidate};

/// Time that a trial needs for each object that is still to be taken, s. A retry begins only if enough time is left.
const TAKE_TIME: f64 = 9.0;
/// Time that a trial needs from the last object to its end, s; see [`TAKE_TIME`].
const CARRY_TIME: f64 = 7.0;

/// Takes the objects in turn; see the module documentation.
pub struct InTurn<'a> {
    knowledge: Knowledge<'a>,
    senses: Senses<'a>,
    /// Grasps of each object, the planned one first.
    candidates: Vec<Vec<Candidate>>,
    objects: Vec<Tracked>,
    grip: Grip,
    /// Pose estimate of each object in the hand at the last look.
    felt: Vec<Felt>,
    story: Story,
}

impl<'a> InTurn<'a> {
    /// The policy of a trial in which each object has a planned grasp in `planned`.
    pub fn new(knowledge: Knowledge<'a>, senses: Senses<'a>, planned: &[&Grasp]) -> Self {
        let proven = [&[][..], &knowledge.second, &knowledge.third];
        let known = |(n, grasp): (usize, &&Grasp)| match proven.get(n) {
            Some(proven) if !proven.is_empty() => proven.to_vec(),
            _ => {
                let others = knowledge.repertoire.of(&grasp.object, &grasp.digits);
                let others = others.filter(|other| other.id != grasp.id);
                let others = others.map(|other| Candidate::new(other.clone(), worth::UNREHEARSED * other.score));
                std::iter::once(Candidate::new((*grasp).clone(), grasp.score)).chain(others).collect()
            }
        };
        let candidates = planned.iter().enumerate().map(known).collect();
        let (objects, story) = (Tracked::all(&knowledge), Story::default());
        Self { knowledge, senses, candidates, objects, grip: Grip::default(), felt: Vec::new(), story }
    }

    /// Looks at an object again. Returns false if it is hidden.
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
        let tracked = &mut self.objects[object];
        let Some(seen) = tracked.look(&self.knowledge, eyes)? else { return Ok(false) };
        if again {
            // A touched object may have moved: only the new look counts.
            tracked.replace(Some(seen), executor);
        } else {
            tracked.refine(seen, &self.knowledge, executor);
        }
        Ok(true)
    }

    /// Takes an object with the most valuable grasp that the arm can reach now.
    fn take(&mut self, object: usize, why: String, executor: &mut Executor) -> Result<Step, PolicyError> {
        let (candidates, tracked) = (&self.candidates[object], &self.objects[object]);
        let mut order: Vec<(f64, &Candidate)> = candidates
            .iter()
            .map(|candidate| (candidate.worth * tracked.trust(candidate.grasp.id), candidate))
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
        let planned = candidates.first().map(|candidate| candidate.grasp.id);
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

    /// True if there is time to take the objects from this one on.
    fn has_time(&self, object: usize, time: f64) -> bool {
        let left = (self.objects.len() - object) as f64;
        self.knowledge.recovery.retry && time + left * TAKE_TIME + CARRY_TIME < self.knowledge.time_limit
    }
}

impl Policy for InTurn<'_> {
    fn perceive(&mut self, executor: &Executor, injected: Option<Injected>) -> Result<(), PolicyError> {
        let phase = executor.phase();
        let last = if phase.carries() { self.objects.len() - 1 } else { phase.object };
        self.grip = Grip::default();
        if !matches!(phase.skill, Skill::Look | Skill::Verify) {
            return Ok(());
        }
        let look = executor.motion().look();
        let perceived = self.senses.perceive(&look)?;
        let with = (self.senses.pipeline().hand(), self.senses.hold());
        let targets = &executor.targets()[..=last];
        if let Some(injected) = injected {
            self.grip = injected.grip;
            return Ok(());
        }
        let (touches, servos) = (&perceived.touches, look.readings.servos);
        let holds = |target: &Target| !feeling(with, touches, servos, &target.grasp.digits).is_empty();
        self.grip = targets.iter().map(holds).collect();
        if phase.skill == Skill::Look {
            let held = targets.iter().enumerate().filter(|(n, _)| self.grip.holds(*n));
            let held = held.map(|(n, Target { grasp, percept })| {
                let before = self.felt.iter().find(|felt| felt.object == n && felt.grip.holds(n));
                let place = before.map_or(place_in_hand(grasp, percept), |felt| felt.estimate.palm_from_object);
                (n, self.knowledge.known[n], &grasp.digits[..], place)
            });
            self.felt = feel_each(&self.senses, &look, (perceived, self.grip), &held.collect::<Vec<_>>())?;
        }
        Ok(())
    }

    fn decide(&mut self, executor: &mut Executor, eyes: &mut dyn Eyes, time: f64) -> Result<Step, PolicyError> {
        let phase = executor.phase();
        let count = self.objects.len();
        let last = match phase.skill {
            Skill::Begin => return self.see_and_take(0, "as planned", false, executor, eyes),
            Skill::PutDown => return self.see_and_take(0, "once more, from the beginning", true, executor, eyes),
            Skill::Look => phase.object,
            _ => count - 1,
        };
        let missing = self.grip.missing(last);
        if let Some(object) = missing.filter(|object| self.has_time(if *object == last { last } else { 0 }, time)) {
            let failed = executor.target(object).grasp.id;
            self.objects[object].failed(failed);
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

    fn felt(&self) -> &[Felt] {
        &self.felt
    }

    fn deliberates(&self) -> bool {
        true
    }
}
