//! The policy for a trial of more than two objects: takes one after the other, each with its own digits, and relies on
//! touch.
//!
//! Before each grasp the objects are detected again, and detections that agree are averaged. After each grasp, the
//! digits of every object that should be in the hand are checked ([`holding_digits`]). If the last object is missing,
//! it is taken again with the grasp that has the highest score at that time. If an earlier object is missing,
//! everything is laid down and the list begins anew. The pose of each object in the hand is estimated from the pads of
//! its digits and the palm.

use dexterous_grasping::Grasp;
use dexterous_grasping::digit_sets::describe_digits;
use world::attempt::Attempt;

use super::pick_sequence::plan::holding_digits;
use super::reach::yaw_variants;
use super::tracked::TrackedObject;
use super::{DecisionTrace, InjectedHold, Knowledge, PolicyError, PolicyStep, TrialPolicy};
use crate::detection::ObjectDetector;
use crate::executor::{Executor, GraspTarget, Skill};
use crate::perception::{HoldState, ObjectEstimate, estimate_each_hold, pose_in_hand};
use crate::score::{self, GraspCandidate};
use crate::sensing::TouchPerception;

/// Time that a trial needs for each object that is still to be taken, s. A retry begins only if enough time is left.
const TAKE_TIME: f64 = 9.0;
/// Time that a trial needs from the last object to its end, s; see [`TAKE_TIME`].
const CARRY_TIME: f64 = 7.0;

/// Takes the objects in turn; see the module documentation.
pub struct SequentialPolicy<'a> {
    knowledge: Knowledge<'a>,
    senses: TouchPerception<'a>,
    /// Grasps of each object, the planned one first.
    candidates: Vec<Vec<GraspCandidate>>,
    objects: Vec<TrackedObject>,
    hold_state: HoldState,
    /// Pose estimate of each object in the hand at the last tactile snapshot.
    felt: Vec<ObjectEstimate>,
    trace: DecisionTrace,
}

impl<'a> SequentialPolicy<'a> {
    /// The policy of a trial in which each object has a planned grasp in `planned`.
    pub fn new(knowledge: Knowledge<'a>, senses: TouchPerception<'a>, planned: &[&Grasp]) -> Self {
        let verified = [&[][..], &knowledge.second_candidates, &knowledge.third_candidates];
        let known = |(n, grasp): (usize, &&Grasp)| match verified.get(n) {
            Some(verified) if !verified.is_empty() => verified.to_vec(),
            _ => {
                let others = knowledge.repertoire.for_digits(&grasp.object, &grasp.digits);
                let others = others.filter(|other| other.id != grasp.id);
                let others =
                    others.map(|other| GraspCandidate::new(other.clone(), score::NO_ROLLOUT_FACTOR * other.score));
                std::iter::once(GraspCandidate::new((*grasp).clone(), grasp.score)).chain(others).collect()
            }
        };
        let candidates = planned.iter().enumerate().map(known).collect();
        let (objects, story) = (TrackedObject::for_trial(&knowledge), DecisionTrace::default());
        Self {
            knowledge,
            senses,
            candidates,
            objects,
            hold_state: HoldState::default(),
            felt: Vec::new(),
            trace: story,
        }
    }

    /// Detects an object again. Returns false if it is hidden.
    fn detect(
        &mut self,
        object: usize,
        again: bool,
        executor: &mut Executor,
        detector: &mut dyn ObjectDetector,
    ) -> Result<bool, PolicyError> {
        if !self.knowledge.recovery.new_detection {
            return Ok(true);
        }
        let tracked = &mut self.objects[object];
        let Some(seen) = tracked.detect(&self.knowledge, detector)? else { return Ok(false) };
        if again {
            // A touched object may have moved: only the new detection counts.
            tracked.replace_detection(Some(seen), executor);
        } else {
            tracked.add_detection(seen, &self.knowledge, executor);
        }
        Ok(true)
    }

    /// Takes an object with the grasp of the highest score that the arm can reach now.
    fn take(&mut self, object: usize, why: String, executor: &mut Executor) -> Result<PolicyStep, PolicyError> {
        let (candidates, tracked) = (&self.candidates[object], &self.objects[object]);
        let mut order: Vec<(f64, &GraspCandidate)> = candidates
            .iter()
            .map(|candidate| (candidate.score * tracked.failure_factor(candidate.grasp.id), candidate))
            .collect();
        order.sort_by(|a, b| b.0.total_cmp(&a.0));
        let seen = executor.target(object).detected;
        let model = &self.knowledge.objects[object];
        let paths: Vec<_> = executor.approach_paths().collect();
        let found = order.iter().find_map(|(_, candidate)| {
            yaw_variants(&self.knowledge, &candidate.grasp, &seen, model).find_map(|grasp| {
                let path = paths.iter().find_map(|stops| executor.feasible_approach(stops, &grasp, &seen))?;
                Some((grasp, path))
            })
        });
        let Some((grasp, path)) = found else {
            self.trace.record(format!("no grasp of {} is in reach", model.name));
            return Ok(PolicyStep::GiveUp);
        };
        let planned = candidates.first().map(|candidate| candidate.grasp.id);
        self.trace.switched |= planned != Some(grasp.id);
        self.trace.decisions += 1;
        self.trace.record(format!("{} is taken by {}: {why}", model.name, describe_digits(&grasp.digits)));
        self.trace.attempts.push(Attempt { object, grasp: grasp.id, why, ..Attempt::default() });
        executor.take(object, GraspTarget { grasp, detected: seen })?;
        executor.redirect(path);
        Ok(PolicyStep::Continue)
    }

    /// Detects an object and takes it.
    fn detect_and_take(
        &mut self,
        object: usize,
        why: &str,
        again: bool,
        executor: &mut Executor,
        detector: &mut dyn ObjectDetector,
    ) -> Result<PolicyStep, PolicyError> {
        if self.detect(object, again, executor, detector)? {
            return self.take(object, why.to_owned(), executor);
        }
        self.trace.record(format!("{} is not detected", self.knowledge.objects[object].name));
        Ok(PolicyStep::NotDetected)
    }

    /// True if there is time to take the objects from this one on.
    fn has_time(&self, object: usize, time: f64) -> bool {
        let left = (self.objects.len() - object) as f64;
        self.knowledge.recovery.retry && time + left * TAKE_TIME + CARRY_TIME < self.knowledge.time_limit
    }
}

impl TrialPolicy for SequentialPolicy<'_> {
    fn perceive(&mut self, executor: &Executor, injected: Option<InjectedHold>) -> Result<(), PolicyError> {
        let phase = executor.phase();
        let last = if phase.has_begun_carry() { self.objects.len() - 1 } else { phase.object };
        self.hold_state = HoldState::default();
        if !matches!(phase.skill, Skill::Snapshot | Skill::Verify) {
            return Ok(());
        }
        let look = executor.motion().snapshot();
        let perceived = self.senses.perceive(&look)?;
        let with = (self.senses.pipeline().hand(), self.senses.hold_limits());
        let targets = &executor.targets()[..=last];
        if let Some(injected) = injected {
            self.hold_state = injected.hold_state;
            return Ok(());
        }
        let (touches, servos) = (&perceived.touches, look.readings.servos);
        let holds = |target: &GraspTarget| !holding_digits(with, touches, servos, &target.grasp.digits).is_empty();
        self.hold_state = targets.iter().map(holds).collect();
        if phase.skill == Skill::Snapshot {
            let held = targets.iter().enumerate().filter(|(n, _)| self.hold_state.holds(*n));
            let held = held.map(|(n, GraspTarget { grasp, detected: percept })| {
                let before = self.felt.iter().find(|felt| felt.object == n && felt.hold_state.holds(n));
                let place = before.map_or(pose_in_hand(grasp, percept), |felt| felt.estimate.palm_from_object);
                (n, self.knowledge.known_objects[n], &grasp.digits[..], place)
            });
            self.felt =
                estimate_each_hold(&self.senses, &look, (perceived, self.hold_state), &held.collect::<Vec<_>>())?;
        }
        Ok(())
    }

    fn decide(
        &mut self,
        executor: &mut Executor,
        detector: &mut dyn ObjectDetector,
        time: f64,
    ) -> Result<PolicyStep, PolicyError> {
        let phase = executor.phase();
        let count = self.objects.len();
        let last = match phase.skill {
            Skill::Begin => return self.detect_and_take(0, "as planned", false, executor, detector),
            Skill::PutDown => {
                return self.detect_and_take(0, "once more, from the beginning", true, executor, detector);
            }
            Skill::Snapshot => phase.object,
            _ => count - 1,
        };
        let missing = self.hold_state.first_missing(last);
        if let Some(object) = missing.filter(|object| self.has_time(if *object == last { last } else { 0 }, time)) {
            let failed = executor.target(object).grasp.id;
            self.objects[object].count_failure(failed);
            self.trace.retries += 1;
            self.trace.record(format!("nothing is felt of {}", self.knowledge.objects[object].name));
            if object == last {
                return self.detect_and_take(object, "once more", true, executor, detector);
            }
            executor.put_down()?;
            return Ok(PolicyStep::Continue);
        }
        match phase.skill {
            Skill::Snapshot if last + 1 < count => {
                self.detect_and_take(last + 1, "as planned", false, executor, detector)
            }
            Skill::Snapshot => {
                executor.carry_aside()?;
                Ok(PolicyStep::Continue)
            }
            _ => Ok(PolicyStep::Finish),
        }
    }

    fn trace(&mut self) -> &mut DecisionTrace {
        &mut self.trace
    }

    fn felt(&self) -> &[ObjectEstimate] {
        &self.felt
    }

    fn deliberates(&self) -> bool {
        true
    }
}
