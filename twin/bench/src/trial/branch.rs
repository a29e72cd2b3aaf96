//! A branch of a trial: one policy from the start or the end of the first grasp to the verdict.

use std::sync::Arc;
use std::time::Instant;

use anyhow::Result;
use control::executor::{Phase, Skill, SkillStage};
use control::perception::ObjectEstimate;
use control::policy::{FirstDecision, PolicyStep, TrialPolicy};
use control::strategy::Assessment;
use grasp_verification::rollout::{RolloutSnapshot, in_hand};
use scenarios::noise::NoiseLevels;
use scenarios::record::{TrialId, TrialRecord};
use scenarios::referee::FailureCause;
use scenarios::tries::TryRecord;
use sim::robot::GroundTruth;
use world::attempt::Attempt;
use world::objects::{ObjectModel, ObjectSet};

use super::profile::Activity;
use super::run::Run;
use super::setup::PreparedTrial;
use super::simulated_detector::{DetectionNoise, SimulatedDetector};
use super::watcher::Watcher;
use external_policy::SimulatedTimePassage;

/// Outcome of a trial under one condition.
#[derive(Debug, Clone)]
pub struct TrialOutcome {
    /// Record of the trial as a whole.
    pub record: TrialRecord,
    /// Records of its tries.
    pub tries: Vec<TryRecord>,
}

/// Settings of a branch.
pub struct BranchSettings<'a> {
    /// Identity of the trial.
    pub id: TrialId,
    /// Noise levels of later detections of the objects.
    pub noise: &'a NoiseLevels,
    /// Models of the objects in every stable pose.
    pub library: &'a ObjectSet,
    /// Generators of later detections, in the state after the first one.
    pub detection_noise: DetectionNoise,
    /// Duration of a decision from measurements, s.
    pub decision_time: f64,
    /// True if the true state replaces the pose estimate from touch.
    pub inject_truth: bool,
    /// Simulated time that passes while the policy computes, in addition to `decision_time`.
    pub pace: SimulatedTimePassage,
}

/// Result of a branch.
struct BranchResult {
    run: Run,
    /// Wall time of the slowest decision, ms.
    slowest_ms: f64,
    /// Ground truth at the last pose estimate of the first object.
    truth_at_estimate: Option<GroundTruth>,
}

/// Runs `policy` from `start` to the verdict.
pub fn run_branch(
    start: &PreparedTrial,
    policy: &mut dyn TrialPolicy,
    with: BranchSettings,
    watcher: &mut dyn Watcher,
) -> Result<TrialOutcome> {
    let id = with.id;
    watcher.on_branch(id.condition)?;
    let mut branch = decide_and_run(start, policy, with, watcher)?;
    let trace = policy.trace();
    trace.reasons.extend(branch.run.describe_slips());
    let mut record = branch.run.record(&start.objects, id)?;
    record.switched = !trace.is_as_planned();
    record.retries = trace.retries;
    record.reason = trace.reasons.join("; ");
    note_decision(&mut record, trace.first_decision);
    let tries = try_records(start, trace.attempts.clone(), &branch.run, id);
    record.decision_ms = (branch.slowest_ms > 0.0).then_some(branch.slowest_ms);
    if let Some(truth) = &branch.truth_at_estimate {
        policy.felt().iter().for_each(|felt| note_pose(&mut record, truth, &start.objects[felt.object], felt));
    }
    watcher.on_outcome(&record)?;
    Ok(TrialOutcome { record, tries })
}

/// Returns the records of all tries: the planned first grasp, unless the policy began the trial, and the policy's
/// attempts.
fn try_records(start: &PreparedTrial, attempts: Vec<Attempt>, run: &Run, id: TrialId) -> Vec<TryRecord> {
    let executor = &start.run.snapshot.executor;
    let grasp = executor.target(0).grasp.id;
    let first = Attempt { object: 0, grasp, why: "as planned".to_owned(), ..Attempt::default() };
    let verdicts = run.referee.tries();
    let planned = (executor.phase().skill != Skill::Begin).then_some(first);
    let all = planned.into_iter().chain(attempts).enumerate();
    all.map(|(number, attempt)| TryRecord::new(id, number, &attempt, verdicts.get(number))).collect()
}

/// Runs one decision after the other until the policy finishes or gives up.
fn decide_and_run(
    start: &PreparedTrial,
    policy: &mut dyn TrialPolicy,
    mut with: BranchSettings,
    watcher: &mut dyn Watcher,
) -> Result<BranchResult> {
    let run = start.run.clone();
    let condition = with.id.condition;
    let mut branch = BranchResult { run, slowest_ms: 0.0, truth_at_estimate: None };
    loop {
        let phase = branch.run.snapshot.executor.phase();
        if let Some(why) = &branch.run.fault {
            policy.trace().reasons.push(why.clone());
            break;
        }
        if policy.deliberates() && with.decision_time > 0.0 && branch.run.snapshot.robot.is_cloneable() {
            let felt = if phase.has_begun(1) { policy.felt() } else { &[] };
            branch.run.wait(with.decision_time, felt, Some(condition), watcher)?;
        }
        let (before, begun) = (policy.trace().decisions, Instant::now());
        let waiting = (with.pace == SimulatedTimePassage::Wall).then(|| branch.run.snapshot.executor.clone());
        let step = decide(&mut branch.run, &start.objects, policy, &mut with)?;
        if let Some(waiting) = waiting {
            let decided = std::mem::replace(&mut branch.run.snapshot.executor, waiting);
            let felt = if phase.has_begun(1) { policy.felt() } else { &[] };
            branch.run.wait(begun.elapsed().as_secs_f64(), felt, Some(condition), watcher)?;
            branch.run.snapshot.executor = decided;
        }
        if policy.trace().decisions > before {
            branch.slowest_ms = branch.slowest_ms.max(begun.elapsed().as_secs_f64() * 1e3);
        }
        // The hold is estimated before the second object is grasped or palpated, that of a single object before it is
        // carried, and those of three objects after each lift.
        let next = branch.run.snapshot.executor.phase();
        let alone = start.objects.len() == 1 && next.skill == Skill::Carry;
        let felt_hold = policy.trace().decisions > before || next == Phase::palpate(1, SkillStage::Reach) || alone;
        let each = start.objects.len() > 2 && phase.skill == Skill::Snapshot;
        if phase.waits_for_decision() && (phase.has_begun_lift(0) && !phase.has_begun(1) && felt_hold || each) {
            branch.truth_at_estimate = branch.run.snapshot.robot.truth();
        }
        for text in policy.trace().take_announcements() {
            branch.run.notify_watcher((Some(&text), None), policy.felt(), condition, watcher)?;
        }
        if let Some(choice) = policy.trace().take_choice() {
            branch.run.notify_watcher((None, Some(&choice)), policy.felt(), condition, watcher)?;
        }
        match step {
            PolicyStep::Continue => {}
            PolicyStep::Finish => break,
            PolicyStep::GiveUp => {
                branch.run.referee.give_up(FailureCause::Unreachable);
                break;
            }
            PolicyStep::Decline => {
                branch.run.referee.give_up(FailureCause::Declined);
                break;
            }
            PolicyStep::Failed => {
                branch.run.referee.give_up(FailureCause::PolicyFailed);
                break;
            }
            PolicyStep::NotDetected => {
                branch.run.referee.give_up(FailureCause::NotDetected);
                break;
            }
        }
        let felt = if next.has_begun(1) { policy.felt() } else { &[] };
        branch.run.run_until(Phase::waits_for_decision, felt, Some(condition), watcher)?;
    }
    Ok(branch)
}

/// Returns the first decision of `policy`, which is not carried out. `None` if the policy does not detect the first
/// object in the hand.
pub fn predict_decision(
    start: &PreparedTrial,
    policy: &mut dyn TrialPolicy,
    mut with: BranchSettings,
) -> Result<Option<FirstDecision>> {
    decide(&mut start.run.clone(), &start.objects, policy, &mut with)?;
    let held = policy.felt().first().is_some_and(|felt| felt.hold_state.holds(felt.object));
    Ok(policy.trace().first_decision.filter(|_| held))
}

/// Notes the predictions of the first decision for the planned grasp and for the chosen one.
pub fn note_decision(record: &mut TrialRecord, decision: Option<FirstDecision>) {
    let mm = |assessed: Assessment| Some(1e3 * assessed.separation).filter(|separation| separation.is_finite());
    record.risk = decision.map(|decision| decision.planned.risk);
    record.plan_separation_mm = decision.and_then(|decision| mm(decision.planned));
    record.chosen_separation_mm = decision.and_then(|decision| decision.chosen).and_then(mm);
}

/// Makes one decision: perceives, then decides.
fn decide(
    run: &mut Run,
    objects: &[Arc<ObjectModel>],
    policy: &mut dyn TrialPolicy,
    with: &mut BranchSettings,
) -> Result<PolicyStep> {
    let injected = if with.inject_truth { run.true_state() } else { None };
    let Run { snapshot: RolloutSnapshot { robot, executor }, disturber, history, profile, .. } = run;
    profile.measure(Activity::Perception, || policy.perceive(executor, injected))?;
    let time = robot.time();
    let BranchSettings { noise, library, detection_noise: detections, .. } = with;
    let mut detector =
        SimulatedDetector { robot, disturber, noise, detection_noise: detections, objects, library, history };
    Ok(profile.measure(Activity::Choice, || policy.decide(executor, &mut detector, time))?)
}

/// Notes the referee's errors of the pose estimate, for the record only.
fn note_pose(record: &mut TrialRecord, truth: &GroundTruth, object: &ObjectModel, felt: &ObjectEstimate) {
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
