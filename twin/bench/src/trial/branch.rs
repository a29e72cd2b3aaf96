//! A branch of a trial: one policy from the beginning or the end of the first grasp to the verdict.

use std::sync::Arc;
use std::time::Instant;

use anyhow::Result;
use control::executor::{Phase, Skill, Stage};
use control::perception::Felt;
use control::policy::{FirstDecision, Policy, Step};
use control::strategy::Assessment;
use grasp_verification::rehearsal::{Snapshot, in_hand};
use scenarios::noise::NoiseLevels;
use scenarios::record::{TrialId, TrialRecord};
use scenarios::referee::FailureCause;
use scenarios::tries::TryRecord;
use sim::robot::Truth;
use world::attempt::Attempt;
use world::objects::{ObjectModel, ObjectSet};

use super::eyes::{Looks, NoisyEyes};
use super::profile::Activity;
use super::run::Run;
use super::setup::Start;
use super::watcher::Watcher;
use external_policy::Pace;

/// Outcome of a trial under one condition.
#[derive(Debug, Clone)]
pub struct TrialOutcome {
    /// Record of the trial as a whole.
    pub record: TrialRecord,
    /// Records of its tries.
    pub tries: Vec<TryRecord>,
}

/// Settings of a branch.
pub struct Play<'a> {
    /// Identity of the trial.
    pub id: TrialId,
    /// Noise levels of later looks at the objects.
    pub noise: &'a NoiseLevels,
    /// Models of the objects in every stable pose.
    pub library: &'a ObjectSet,
    /// Generators of later looks, in the state after the first one.
    pub looks: Looks,
    /// Duration of a decision from measurements, s.
    pub decision_time: f64,
    /// True if the true state replaces the pose estimate from touch.
    pub inject_truth: bool,
    /// Time that passes while the policy decides, in addition to `decision_time`.
    pub pace: Pace,
}

/// Result of a branch.
struct Played {
    run: Run,
    /// Wall time of the slowest decision, ms.
    slowest_ms: f64,
    /// Ground truth at the last pose estimate of the first object.
    at_estimate: Option<Truth>,
}

/// Plays `policy` from `start` to the verdict.
pub fn play(start: &Start, policy: &mut dyn Policy, with: Play, watcher: &mut dyn Watcher) -> Result<TrialOutcome> {
    let id = with.id;
    watcher.branch(id.condition)?;
    let mut played = decide_and_play(start, policy, with, watcher)?;
    let story = policy.story();
    story.reasons.extend(played.run.slips());
    let mut record = played.run.record(&start.objects, id)?;
    record.switched = !story.is_as_planned();
    record.retries = story.retries;
    record.reason = story.reasons.join("; ");
    note_decision(&mut record, story.first_decision);
    let tries = tries(start, story.attempts.clone(), &played.run, id);
    record.decision_ms = (played.slowest_ms > 0.0).then_some(played.slowest_ms);
    if let Some(truth) = &played.at_estimate {
        policy.felt().iter().for_each(|felt| note_pose(&mut record, truth, &start.objects[felt.object], felt));
    }
    watcher.outcome(&record)?;
    Ok(TrialOutcome { record, tries })
}

/// Returns the records of all tries: the planned first grasp, unless the policy began the trial, and the policy's own
/// attempts.
fn tries(start: &Start, attempts: Vec<Attempt>, run: &Run, id: TrialId) -> Vec<TryRecord> {
    let executor = &start.run.snapshot.executor;
    let grasp = executor.target(0).grasp.id;
    let first = Attempt { object: 0, grasp, why: "as planned".to_owned(), ..Attempt::default() };
    let verdicts = run.referee.tries();
    let planned = (executor.phase().skill != Skill::Begin).then_some(first);
    let all = planned.into_iter().chain(attempts).enumerate();
    all.map(|(number, attempt)| TryRecord::new(id, number, &attempt, verdicts.get(number))).collect()
}

/// Plays one decision after the other until the policy finishes or gives up.
fn decide_and_play(
    start: &Start,
    policy: &mut dyn Policy,
    mut with: Play,
    watcher: &mut dyn Watcher,
) -> Result<Played> {
    let run = start.run.clone();
    let condition = with.id.condition;
    let mut played = Played { run, slowest_ms: 0.0, at_estimate: None };
    loop {
        let phase = played.run.snapshot.executor.phase();
        if let Some(why) = &played.run.fault {
            policy.story().reasons.push(why.clone());
            break;
        }
        if policy.deliberates() && with.decision_time > 0.0 && played.run.snapshot.robot.branches() {
            let felt = if phase.begins(1) { policy.felt() } else { &[] };
            played.run.wait(with.decision_time, felt, Some(condition), watcher)?;
        }
        let (before, begun) = (policy.story().decisions, Instant::now());
        let waiting = (with.pace == Pace::Wall).then(|| played.run.snapshot.executor.clone());
        let step = decide(&mut played.run, &start.objects, policy, &mut with)?;
        if let Some(waiting) = waiting {
            let decided = std::mem::replace(&mut played.run.snapshot.executor, waiting);
            let felt = if phase.begins(1) { policy.felt() } else { &[] };
            played.run.wait(begun.elapsed().as_secs_f64(), felt, Some(condition), watcher)?;
            played.run.snapshot.executor = decided;
        }
        if policy.story().decisions > before {
            played.slowest_ms = played.slowest_ms.max(begun.elapsed().as_secs_f64() * 1e3);
        }
        // The hold is felt before the second object is grasped or palpated, that of a single object before it is
        // carried, and those of three objects after each lift.
        let next = played.run.snapshot.executor.phase();
        let alone = start.objects.len() == 1 && next.skill == Skill::Carry;
        let felt_hold = policy.story().decisions > before || next == Phase::palpate(1, Stage::Reach) || alone;
        let each = start.objects.len() > 2 && phase.skill == Skill::Look;
        if phase.waits() && (phase.lifts(0) && !phase.begins(1) && felt_hold || each) {
            played.at_estimate = played.run.snapshot.robot.truth();
        }
        for text in policy.story().take_announcements() {
            played.run.tell((Some(&text), None), policy.felt(), condition, watcher)?;
        }
        if let Some(choice) = policy.story().take_choice() {
            played.run.tell((None, Some(&choice)), policy.felt(), condition, watcher)?;
        }
        match step {
            Step::Play => {}
            Step::Finish => break,
            Step::GiveUp => {
                played.run.referee.give_up(FailureCause::Unreachable);
                break;
            }
            Step::Decline => {
                played.run.referee.give_up(FailureCause::Declined);
                break;
            }
            Step::Failed => {
                played.run.referee.give_up(FailureCause::PolicyFailed);
                break;
            }
            Step::NotSeen => {
                played.run.referee.give_up(FailureCause::NotSeen);
                break;
            }
        }
        let felt = if next.begins(1) { policy.felt() } else { &[] };
        played.run.play(Phase::waits, felt, Some(condition), watcher)?;
    }
    Ok(played)
}

/// Returns the first decision of `policy`, which is not carried out. `None` if the policy does not feel the first
/// object in the hand.
pub fn foretell(start: &Start, policy: &mut dyn Policy, mut with: Play) -> Result<Option<FirstDecision>> {
    decide(&mut start.run.clone(), &start.objects, policy, &mut with)?;
    let held = policy.felt().first().is_some_and(|felt| felt.grip.holds(felt.object));
    Ok(policy.story().first_decision.filter(|_| held))
}

/// Notes the predictions of the first decision for the plan and for its choice.
pub fn note_decision(record: &mut TrialRecord, decision: Option<FirstDecision>) {
    let mm = |assessed: Assessment| Some(1e3 * assessed.separation).filter(|separation| separation.is_finite());
    record.risk = decision.map(|decision| decision.plan.risk);
    record.plan_separation_mm = decision.and_then(|decision| mm(decision.plan));
    record.chosen_separation_mm = decision.and_then(|decision| decision.chosen).and_then(mm);
}

/// Makes one decision: perceives, then decides.
fn decide(run: &mut Run, objects: &[Arc<ObjectModel>], policy: &mut dyn Policy, with: &mut Play) -> Result<Step> {
    let injected = if with.inject_truth { run.true_state() } else { None };
    let Run { snapshot: Snapshot { robot, executor }, disturber, history, profile, .. } = run;
    profile.on(Activity::Perception, || policy.perceive(executor, injected))?;
    let time = robot.time();
    let Play { noise, library, looks, .. } = with;
    let mut eyes = NoisyEyes { robot, disturber, noise, looks, objects, library, history };
    Ok(profile.on(Activity::Choice, || policy.decide(executor, &mut eyes, time))?)
}

/// Notes the referee's errors of the pose estimate, for the record only.
fn note_pose(record: &mut TrialRecord, truth: &Truth, object: &ObjectModel, felt: &Felt) {
    // A dropped object has no pose in the hand to estimate.
    if !in_hand(truth, felt.object) {
        return;
    }
    let real = truth.palm.inverse() * truth.objects[felt.object];
    let estimate = felt.estimate.palm_from_object;
    let apart = |pose: &nalgebra::Isometry3<f64>| (pose.translation.vector - real.translation.vector).norm() * 1e3;
    let turned = object.symmetry.angle(&real.rotation, &estimate.rotation).to_degrees();
    if let Some(later) = felt.object.checked_sub(1) {
        if let Some(error) = record.later_pose_errors.0.get_mut(later) {
            *error = Some([apart(&estimate), turned]);
        }
        return;
    }
    record.pose_error_mm = Some(apart(&estimate));
    record.prior_error_mm = Some(apart(&felt.prior));
    record.pose_error_deg = Some(turned);
}
