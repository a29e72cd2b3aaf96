//! The policy `touch`: decides on tactile perception, and retries a grasp that has failed according to touch.
//!
//! At each decision the tactile snapshot is interpreted ([`crate::perception`]), [`crate::recovery`] determines the
//! next step, and [`crate::strategy`] chooses the grasp of the second object given the felt pose of the first. A failed
//! grasp is tried again at the object's new detected pose. If a required object is not visible, the hand steps aside
//! and the detector tries again. An object that comes later is assumed to be at its last detected pose, and is detected
//! again when its turn comes. An object is palpated before it is taken (`palpation`), because the pose of the first one
//! in the hand determines how well the second one can be taken. `empty_hand` takes the first object, and `beside` an
//! object beside held ones.
//!
//! Each decision leads from one `ExecutorActivity` to another: `Start -> Palpates(0) -> Takes(0) -> Palpates(1) ->
//! Takes(1) -> Carries` if all goes well, and from `Takes(0)` to `Carries` in a trial of one object. A lost object
//! leads back to a palpation or to `LaysDown`, a hidden one to `StepsAside`. A decision that begins nothing ends the
//! trial.

mod beside;
pub(super) mod empty_hand;
mod exploration;

use dexterous_grasping::{Grasp, digit_sets};
use nalgebra::Vector3;
use tactile_perception::{ExpectedObject, PoseEstimate};

use super::reach::{ReachQuery, reachable_candidates};
use super::tracked::TrackedObject;
use super::{DecisionTrace, InjectedHold, Knowledge, OrderComparison, PolicyError, PolicyStep, TrialPolicy};
use crate::collision::Solid;
use crate::detection::{DetectedObject, ObjectDetector};
use crate::executor::{Executor, GraspTarget, Skill};
use crate::outcome_model::{AimPosterior, AimedGrasp};
use crate::perception::{ExpectedHolds, HoldState, ObjectEstimate, default_prior, detect_hold_state, estimate_hold};
use crate::recovery::{NextAction, probe_offset};
use crate::score::GraspCandidate;
use crate::sensing::TouchPerception;
use crate::strategy::object_solids;

/// Time that a trial needs from the start of a new try at the first object to its end, s; no try begins later.
const MIN_TRY_TIME: f64 = 14.0;
/// Height above the table, as a share of the lift, above which a detected object must be in the hand.
const IN_HAND_HEIGHT_SHARE: f64 = 0.5;
/// Upper limit on the standard deviation that is assumed for the felt pose, m.
const MAX_POSE_SIGMA: f64 = 0.01;

/// Activity of the executor until the next decision.
enum ExecutorActivity {
    /// Waiting to begin, or taking the first object as planned.
    Start,
    /// Palpating an object; `found` is its pose in the hand, if it was felt.
    Palpates { object: usize, found: Option<Box<PoseEstimate>> },
    /// Taking an object; `aimed` is the aim, if only the detector located the object.
    Takes { object: usize, aimed: Option<AimedGrasp> },
    /// Carrying the held objects.
    Carries,
    /// Laying everything down. The first object comes next, without a snapshot of the hand.
    LaysDown,
    /// Moving out of the detector's view, so that an object can be detected.
    StepsAside { sought: usize },
}

/// State of the policy during a trial.
pub struct TouchPolicy<'a> {
    knowledge: Knowledge<'a>,
    senses: TouchPerception<'a>,
    /// Solids of each object, in its own frame.
    solids: Vec<Vec<Solid>>,
    /// Grasps of the first object, the planned one first; their scores include the second grasps that can follow.
    first: Vec<GraspCandidate>,
    trace: DecisionTrace,
    activity: ExecutorActivity,
    /// Time of the present decision, by the robot's clock, s.
    time: f64,
    objects: Vec<TrackedObject>,
    /// Number of consecutive failed grasps.
    consecutive_failures: usize,
    /// First detected poses of the objects.
    first_detections: Option<Vec<DetectedObject>>,
    /// Offset of the aim from the detected position, m, if no rollout suggests a better one. Kept while it works.
    aim: Vector3<f64>,
    /// Posterior of the error of the aim at the second object, if only the detector has located it.
    aim_posterior: AimPosterior,
    felt: Option<ObjectEstimate>,
    hold_state: HoldState,
}

impl<'a> TouchPolicy<'a> {
    /// The policy of a trial whose first grasp is planned as `first`.
    pub fn new(knowledge: Knowledge<'a>, senses: TouchPerception<'a>, first: &Grasp) -> Self {
        let mut story = DecisionTrace::default();
        if let Some(OrderComparison { planned, other }) = knowledge.reordered {
            let name = &knowledge.objects[0].name;
            story.record(format!("{name} is taken first: that order scores {other:.2}, the planned one {planned:.2}"));
        }
        Self {
            solids: knowledge.objects.iter().map(|object| object_solids(object)).collect(),
            first: empty_hand::candidates(&knowledge, &senses, first),
            activity: ExecutorActivity::Start,
            time: 0.0,
            aim_posterior: AimPosterior::new(
                &knowledge.uncertainty.with_detector_sigma(knowledge.first_detection_sigmas[1]),
            ),
            objects: TrackedObject::for_trial(&knowledge),
            knowledge,
            senses,
            trace: story,
            consecutive_failures: 0,
            first_detections: None,
            aim: Vector3::zeros(),
            felt: None,
            hold_state: HoldState::default(),
        }
    }

    /// Expected poses of the objects in the hand: of the first as it was last felt, of the second from its grasp.
    fn expected_in_hand(&self, expected: &ExpectedHolds, second: Option<&Grasp>) -> Vec<ExpectedObject<'_>> {
        let felt = self.felt.as_ref().map(|felt| felt.estimate.palm_from_object);
        let first = default_prior(felt.unwrap_or(expected.palm_from_object));
        let first = ExpectedObject { shape: self.knowledge.known_objects[0], prior: first };
        let held = second.and_then(|second| second.held);
        let second =
            held.map(|held| ExpectedObject { shape: self.knowledge.known_objects[1], prior: default_prior(held) });
        std::iter::once(first).chain(second).collect()
    }

    /// Lowers the score of a failed grasp for the rest of the trial, and changes the aim of the next one.
    fn penalize_grasp(&mut self, next: NextAction, executor: &Executor) {
        let (object, failed) = match next {
            NextAction::Continue => return,
            NextAction::StartOver => (0, executor.target(0).grasp.id),
            NextAction::Retry(object) => (object, executor.target(object).grasp.id),
        };
        self.objects[object].count_failure(failed);
        if next != NextAction::StartOver {
            self.consecutive_failures += 1;
            if self.consecutive_failures > 1 {
                self.aim = probe_offset(self.consecutive_failures, self.knowledge.uncertainty.arm);
            }
        }
    }

    /// Detects an object again; `None` if it is hidden.
    fn detect(
        &mut self,
        index: usize,
        detector: &mut dyn ObjectDetector,
    ) -> Result<Option<DetectedObject>, PolicyError> {
        match self.first_detections.as_ref().filter(|_| !self.knowledge.recovery.new_detection) {
            Some(seen) => Ok(Some(seen[index])),
            None => self.objects[index].detect(&self.knowledge, detector),
        }
    }

    /// Detects an object and all later ones, which a try may have moved, and takes it. With `aside`, the hand is out of
    /// the way already.
    fn retry(
        &mut self,
        object: usize,
        executor: &mut Executor,
        detector: &mut dyn ObjectDetector,
        aside: bool,
    ) -> Result<PolicyStep, PolicyError> {
        let seen = self.detect(object, detector)?;
        self.retry_at(object, seen, executor, detector, aside)
    }

    /// Like [`Self::retry`], for an object that was detected just now at `seen`.
    fn retry_at(
        &mut self,
        object: usize,
        seen: Option<DetectedObject>,
        executor: &mut Executor,
        detector: &mut dyn ObjectDetector,
        aside: bool,
    ) -> Result<PolicyStep, PolicyError> {
        self.objects[object].replace_detection(seen, executor);
        for index in object + 1..self.objects.len() {
            let seen = self.detect(index, detector)?;
            self.objects[index].replace_detection(seen, executor);
        }
        if self.objects[object].hidden {
            self.handle_hidden(object, executor, aside)
        } else {
            self.palpate_or_take(object, executor)
        }
    }

    /// Takes an object at its detected or felt position.
    fn take(&mut self, object: usize, executor: &mut Executor) -> Result<PolicyStep, PolicyError> {
        if object == 0 { self.take_with_empty_hand(executor) } else { self.take_beside(object, executor) }
    }

    /// Handles a required object that is hidden: the hand steps aside once; after that, the trial is given up.
    fn handle_hidden(&mut self, index: usize, executor: &mut Executor, aside: bool) -> Result<PolicyStep, PolicyError> {
        let name = &self.knowledge.objects[index].name;
        if aside {
            self.trace.reasons.push(format!("{name} is not detected"));
            return Ok(PolicyStep::NotDetected);
        }
        self.trace.record(format!("{name} is hidden: the hand steps aside for a new detection"));
        executor.step_aside(index)?;
        self.activity = ExecutorActivity::StepsAside { sought: index };
        Ok(PolicyStep::Continue)
    }

    fn reachable(&self, index: usize, executor: &Executor, seen: &DetectedObject) -> Vec<GraspCandidate> {
        let candidates = [&self.first, self.second_candidates(executor).1][index];
        let (object, tracked) = (&*self.knowledge.objects[index], &self.objects[index]);
        // A grasp may leave out one of the digits that are meant for the object.
        let digits = &digit_sets(executor.motion().hand(), self.objects.len())[index];
        reachable_candidates(&self.knowledge, &ReachQuery { object, digits, candidates, tracked }, seen)
    }

    /// Decides from the snapshot of the hand after the activity of the state `looked`.
    fn decide_after_snapshot(
        &mut self,
        executor: &mut Executor,
        detector: &mut dyn ObjectDetector,
        looked: ExecutorActivity,
    ) -> Result<PolicyStep, PolicyError> {
        let tries = !self.is_late() && self.knowledge.recovery.retry;
        let last = self.knowledge.objects.len() - 1;
        let mut next =
            if tries { NextAction::after(executor.phase(), self.hold_state, last) } else { NextAction::Continue };
        let mut seen = None;
        if let Some(missing) = next.missing_object() {
            seen = self.detect(missing, detector)?;
            if seen.is_some_and(|there| self.is_above_table(missing, &there, executor)) {
                let name = &self.knowledge.objects[missing].name;
                self.trace.record(format!("{name} is not felt, but detected above the table: it is held"));
                next = NextAction::Continue;
            }
        }
        match (looked, next) {
            (ExecutorActivity::Carries, NextAction::Continue) => return Ok(PolicyStep::Finish),
            (ExecutorActivity::Takes { object: 1, .. }, NextAction::Continue) => {
                executor.carry_aside()?;
                self.activity = ExecutorActivity::Carries;
                return Ok(PolicyStep::Continue);
            }
            (ExecutorActivity::Takes { object, aimed: Some(aimed) }, NextAction::Retry(again)) if object == again => {
                self.aim_posterior.update_after_failure(&aimed, self.objects[object].detections);
            }
            _ => {}
        }
        match next {
            NextAction::Continue => self.consecutive_failures = 0,
            _ => {
                self.trace.retries += 1;
                let taken = if let NextAction::Retry(object) = next { object } else { 0 };
                self.trace.record(next.reason(&executor.target(taken).grasp.digits));
                self.penalize_grasp(next, executor);
            }
        }
        match next {
            NextAction::Continue if last == 0 => {
                executor.carry_aside()?;
                self.activity = ExecutorActivity::Carries;
                Ok(PolicyStep::Continue)
            }
            NextAction::Retry(object) => self.retry_at(object, seen, executor, detector, false),
            NextAction::StartOver => self.lay_down(executor),
            NextAction::Continue if self.objects[1].hidden => self.retry(1, executor, detector, false),
            NextAction::Continue => {
                if self.knowledge.recovery.new_detection
                    && let Some(seen) = self.detect(1, detector)?
                {
                    self.objects[1].add_detection(seen, &self.knowledge, executor);
                }
                self.palpate_or_take(1, executor)
            }
        }
    }

    /// True if an object detected at `there` is so far above the table that only the hand can hold it.
    fn is_above_table(&self, object: usize, there: &DetectedObject, executor: &Executor) -> bool {
        let pose = there.pose();
        let down = pose.inverse_transform_vector(&-Vector3::z());
        let lowest = (pose * self.knowledge.objects[object].shape.support(&down)).z;
        lowest > IN_HAND_HEIGHT_SHARE * executor.lift()
    }

    fn lay_down(&mut self, executor: &mut Executor) -> Result<PolicyStep, PolicyError> {
        executor.put_down()?;
        self.activity = ExecutorActivity::LaysDown;
        Ok(PolicyStep::Continue)
    }

    /// True when it is too late to begin another try.
    fn is_late(&self) -> bool {
        self.time + MIN_TRY_TIME > self.knowledge.time_limit
    }

    fn give_up(&mut self, index: usize, seen: &DetectedObject) -> PolicyStep {
        let object = &self.knowledge.objects[index];
        let tilt = (seen.rotation * object.rest.inverse() * Vector3::z()).angle(&Vector3::z()).to_degrees();
        let at = seen.position;
        self.trace.reasons.push(format!(
            "no grasp of {} is in reach at ({:.2}, {:.2}, {:.2}) m, tilted by {tilt:.0} deg",
            object.name, at.x, at.y, at.z
        ));
        PolicyStep::GiveUp
    }
}

impl TrialPolicy for TouchPolicy<'_> {
    fn perceive(&mut self, executor: &Executor, injected: Option<InjectedHold>) -> Result<(), PolicyError> {
        if matches!(self.activity, ExecutorActivity::LaysDown | ExecutorActivity::StepsAside { .. }) {
            return Ok(());
        }
        self.first_detections.get_or_insert_with(|| executor.targets().iter().map(|target| target.detected).collect());
        if executor.phase().skill == Skill::Begin {
            return Ok(());
        }
        let GraspTarget { grasp: first, detected: percept } = executor.target(0);
        let second = executor.targets().get(1).map(|second| &second.grasp);
        let expected = ExpectedHolds::from_grasps(first, percept, second);
        if let ExecutorActivity::Palpates { object, .. } = self.activity {
            return self.perceive_touch(object, executor, &expected);
        }
        if matches!(self.activity, ExecutorActivity::Start | ExecutorActivity::Takes { object: 0, .. }) {
            let mut felt =
                estimate_hold(&self.senses, &executor.motion().snapshot(), self.knowledge.known_objects[0], &expected)?;
            if let Some(injected) = injected {
                felt.estimate.palm_from_object = injected.palm_from_object;
                felt.estimate.covariance.fill(0.0);
                felt.hold_state = injected.hold_state;
            }
            self.trace.reasons.extend(felt.faults.iter().map(|fault| format!("left out: {fault}")));
            self.hold_state = felt.hold_state;
            self.felt = Some(felt);
        } else {
            self.hold_state = match injected {
                Some(injected) => injected.hold_state,
                None => detect_hold_state(
                    &self.senses,
                    &executor.motion().snapshot(),
                    &expected,
                    &self.expected_in_hand(&expected, second),
                )?,
            };
        }
        Ok(())
    }

    fn decide(
        &mut self,
        executor: &mut Executor,
        detector: &mut dyn ObjectDetector,
        time: f64,
    ) -> Result<PolicyStep, PolicyError> {
        self.time = time;
        match std::mem::replace(&mut self.activity, ExecutorActivity::Start) {
            ExecutorActivity::Start if executor.phase().skill == Skill::Begin => self.palpate_or_take(0, executor),
            looked @ (ExecutorActivity::Start | ExecutorActivity::Takes { .. } | ExecutorActivity::Carries) => {
                self.decide_after_snapshot(executor, detector, looked)
            }
            ExecutorActivity::Palpates { object, found } => {
                self.update_from_touch(object, executor, found);
                self.take(object, executor)
            }
            ExecutorActivity::LaysDown => self.retry(0, executor, detector, false),
            ExecutorActivity::StepsAside { sought } => self.retry(sought, executor, detector, true),
        }
    }

    fn trace(&mut self) -> &mut DecisionTrace {
        &mut self.trace
    }

    fn felt(&self) -> &[ObjectEstimate] {
        self.felt.as_slice()
    }

    fn deliberates(&self) -> bool {
        true
    }
}
