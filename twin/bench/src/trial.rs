//! Trials: the first grasp, and from there a branch for each policy.
//!
//! [`setup`] prepares a trial and runs its first grasp. [`on_branch`] runs one policy from there to the verdict, and
//! [`conditions`] runs one after the other. [`run`] is a trial in progress, and [`simulated_detector`] is its object
//! detector. [`shared`] holds the data that all trials of a benchmark share, and [`disturbance`] applies a scenario's
//! disturbances. [`watcher`] observes every tick, [`filming`] keeps it for a film, [`profile`] measures computing time,
//! and [`held_grasp`] keeps first grasps for the evaluation of touch.

pub mod branch;
mod capabilities;
mod conditions;
mod disturbance;
mod external_trial;
pub mod filming;
pub mod held_grasp;
pub mod profile;
pub mod run;
pub mod setup;
pub mod shared;
pub mod simulated_detector;
pub mod step_recorder;
pub mod watcher;

use std::sync::Arc;

use anyhow::{Context as _, Result, ensure};
use control::action::ActionLimits;
use control::look_ahead::LookAheadSettings;
use control::perception::KnownObject;
use control::policy::blind::BlindPolicy;
use control::policy::chooser::ChooserPolicy;
use control::policy::sequential::SequentialPolicy;
use control::policy::touch::TouchPolicy;
use control::policy::{FirstDecision, Knowledge, Recovery, order};
use control::sensing::TouchPerception;
use grasp_verification::rollout::{RolloutSnapshot, TrialStart};
use rand::RngExt as _;
use scenarios::Ablation;
use scenarios::generator::trial_rng;
use scenarios::noise::TrialNoise;
use scenarios::record::{AblatedTrial, Condition, TrialId, TrialRecord};
use scenarios::referee::FailureCause;
use sim::SimulatedRobot;
use world::Sensing;
use world::layout::MAX_OBJECTS;
use world::objects::ObjectModel;

use self::branch::{BranchSettings, note_decision, predict_decision, run_branch};
use self::simulated_detector::DetectionNoise;

pub use self::branch::TrialOutcome;
pub use self::capabilities::PolicyCapabilities;
use self::conditions::Branches;
pub use self::conditions::TrialResults;
pub use self::held_grasp::HeldGrasp;
use self::setup::{InitialConditions, PreparedTrial, PriorKnowledge};
pub use self::shared::Bench;
pub use self::step_recorder::RecordedSteps;
pub use self::watcher::{NoWatcher, TickView, Watcher};
use external_policy::chooser::ExternalChooser;
use external_policy::message::{self, TrialInfo};
use external_policy::{DecisionLevel, PolicyIntroduction, PolicyServer, SimulatedTimePassage};
use robot_backends::{BackendFactory, TrialTask};

/// Domain separator: gives external policies other seeds than the trials.
const EXTERNAL_POLICY_DOMAIN: u64 = 0x6f77_6e5f_706f_6c69;

impl Bench {
    /// Runs one trial under one condition on a backend from `source`.
    pub fn run(
        &self,
        task: &TrialTask,
        source: &mut dyn BackendFactory,
        watcher: &mut dyn Watcher,
    ) -> Result<TrialOutcome> {
        let (mut noise, mut camera_noise, detections) = setup::draw_noise(self, task.combination, task.trial)?;
        if task.condition == Condition::Ideal {
            (noise, camera_noise) = (TrialNoise::none(), 0);
        }
        if source.is_real() {
            // A real backend has its own errors.
            noise = TrialNoise::none();
        }
        let id = TrialId { combination: task.combination, trial: task.trial, condition: task.condition };
        let mut setup = InitialConditions::planned(self, task.combination, noise, camera_noise);
        if task.condition != Condition::Ideal {
            setup = setup.with_drift(self, task.combination, task.trial);
        }
        let means = PolicyCapabilities::for_condition(task.condition);
        let start = match means {
            Some(means) if means.may_skip_planned_grasp() => {
                setup.reordered_for(self, means)?.begin_at_rest(self, Some((source, task)), watcher)?
            }
            _ if self.skips_planned_grasp(task.condition) => {
                setup.begin_at_rest(self, Some((source, task)), watcher)?
            }
            _ => setup.run_first_grasp(self, Some((source, task)), watcher)?,
        };
        let mut body = start.run.snapshot.robot.clone();
        let run = match means {
            _ if task.condition == Condition::External => {
                self.run_external_policy(&start, self.branch_settings(id, detections), watcher)
            }
            Some(means) => self.run_touch(&start, self.branch_settings(id, detections), means, watcher),
            None => self.run_blind(&start, self.branch_settings(id, detections), watcher),
        };
        // The recording is finished in any case.
        let why = run.as_ref().err().map(|error| format!("{error:#}"));
        let finished = body.finish(run.as_ref().ok().map(|outcome| &outcome.record), why.as_deref());
        let outcome = run?;
        // A full disk must not lose the operator's verdict.
        finished.with_context(|| {
            format!(
                "the session is incomplete; the verdict was {}",
                serde_json::to_string(&outcome.record).unwrap_or_default()
            )
        })?;
        Ok(outcome)
    }

    /// Runs one trial in which an external policy, represented by `server`, decides. The errors are the same as for every
    /// other condition of the trial.
    pub fn run_with_server(
        &self,
        combination: usize,
        trial: usize,
        (introduction, pace): (&PolicyIntroduction, SimulatedTimePassage),
        server: &mut dyn PolicyServer,
    ) -> Result<TrialOutcome> {
        let (setup, detections) = InitialConditions::noisy(self, combination, trial)?;
        let start = match introduction.level {
            DecisionLevel::Act => setup.begin_at_rest(self, None, &mut NoWatcher)?,
            DecisionLevel::Choose => setup.run_first_grasp(self, None, &mut NoWatcher)?,
        };
        let options = self.branch_settings(TrialId { combination, trial, condition: Condition::External }, detections);
        self.run_server_branch(&start, introduction, server, BranchSettings { pace, ..options }, &mut NoWatcher)
    }

    /// Runs the ideal run of a combination: no noise, blind.
    pub fn run_ideal(&self, combination: usize, watcher: &mut dyn Watcher) -> Result<TrialOutcome> {
        let start = InitialConditions::planned(self, combination, TrialNoise::none(), 0)
            .run_first_grasp(self, None, watcher)?;
        let id = TrialId { combination, trial: 0, condition: Condition::Ideal };
        let detections = DetectionNoise::new(trial_rng(self.seed, combination, 0), None);
        let mut outcome = self.run_blind(&start, self.branch_settings(id, detections.clone()), watcher)?;
        self.note_prediction(&start, self.branch_settings(id, detections), &mut outcome.record)?;
        Ok(outcome)
    }

    /// Runs one trial: all `conditions` with the same errors, and then, unwatched, `touch` under `ablations`.
    pub fn run_each_condition(
        &self,
        combination: usize,
        trial: usize,
        conditions: &[Condition],
        ablations: &[Ablation],
        watcher: &mut dyn Watcher,
    ) -> Result<TrialResults> {
        let (setup, detections) = InitialConditions::noisy(self, combination, trial)?;
        let start = setup.run_first_grasp(self, None, watcher)?;
        let branches = Branches { bench: self, setup: &setup, start, detection_noise: detections };
        let id = |condition| TrialId { combination, trial, condition };
        let mut results = TrialResults::default();
        for &condition in conditions {
            results.add(branches.run(id(condition), watcher)?);
        }
        for record in results.records.iter_mut().filter(|record| record.condition == Condition::Blind) {
            self.note_prediction(
                &branches.start,
                self.branch_settings(id(Condition::Blind), branches.detection_noise.clone()),
                record,
            )?;
        }
        for &ablation in ablations {
            let outcome = branches.run_deciding_policy(id(Condition::Touch), ablation.into(), &mut NoWatcher)?;
            results.ablated.push(AblatedTrial { ablation, record: outcome.record });
        }
        Ok(results)
    }

    /// Returns backend and controller at the start of the ideal run of a combination.
    pub fn ideal_start(&self, combination: usize) -> Result<RolloutSnapshot> {
        let plan = &self.grasp_pairs.pairs[combination];
        let grasps = plan.grasps(&self.world.cell.robot.hand, &self.repertoire)?;
        let world = &self.world;
        let board = self.cameras.with_noise(0);
        let objects = world.models(&plan.objects())?;
        let (protocol, arm) = (world.protocol(), world.cell.ready_posture);
        let start = TrialStart { protocol, grasps: &grasps.planned(), noise: &TrialNoise::none(), arm };
        RolloutSnapshot::at_start(world, &start, &objects, board)
    }

    /// Returns the simulated robot at the start of the ideal run of a combination.
    pub fn ideal_scene(&self, combination: usize) -> Result<SimulatedRobot> {
        Ok(self.ideal_start(combination)?.robot)
    }

    /// Returns the settings of a branch.
    fn branch_settings(&self, id: TrialId, detections: DetectionNoise) -> BranchSettings<'_> {
        let scenario = &self.world.scenario;
        BranchSettings {
            id,
            noise: &scenario.noise,
            library: &self.world.objects,
            detection_noise: detections,
            decision_time: scenario.effects.time.map_or(0.0, |time| time.decision),
            inject_truth: false,
            pace: SimulatedTimePassage::Paused,
        }
    }

    /// Runs the branch of the policy `blind`.
    fn run_blind(
        &self,
        start: &PreparedTrial,
        options: BranchSettings,
        watcher: &mut dyn Watcher,
    ) -> Result<TrialOutcome> {
        run_branch(
            start,
            &mut BlindPolicy::new(start.grasps.planned().into_iter().cloned().collect()),
            options,
            watcher,
        )
    }

    /// Runs the branch of the policy `touch`, with the `means` that are left to it.
    fn run_touch(
        &self,
        start: &PreparedTrial,
        options: BranchSettings,
        means: PolicyCapabilities,
        watcher: &mut dyn Watcher,
    ) -> Result<TrialOutcome> {
        let inject_truth = means.sensing == Sensing::TruePose;
        let knowledge = self.prior_knowledge(start.prior_knowledge(), means)?;
        if means.sensing != Sensing::ServosOnly {
            self.prepare_objects(&start.objects);
        }
        let options = BranchSettings { inject_truth, ..options };
        if start.objects.len() > 2 {
            let senses = TouchPerception::new(start.pipeline.as_ref().unwrap_or(&self.pipeline), means.sensing)?;
            return run_branch(
                start,
                &mut SequentialPolicy::new(knowledge, senses, &start.grasps.planned()),
                options,
                watcher,
            );
        }
        run_branch(start, &mut self.touch_policy(start, knowledge, means)?, options, watcher)
    }

    /// Runs the branch of the external policy.
    fn run_external_policy(
        &self,
        start: &PreparedTrial,
        options: BranchSettings,
        watcher: &mut dyn Watcher,
    ) -> Result<TrialOutcome> {
        let own =
            self.external_policy.as_ref().context("--policy: found none, expected one for the condition `external`")?;
        let options = BranchSettings { pace: own.source.pace, ..options };
        own.with_process(|server| self.run_server_branch(start, &own.introduction, server, options, watcher))
    }

    /// Runs the branch of a policy represented by `server`.
    fn run_server_branch(
        &self,
        start: &PreparedTrial,
        introduction: &PolicyIntroduction,
        server: &mut dyn PolicyServer,
        options: BranchSettings,
        watcher: &mut dyn Watcher,
    ) -> Result<TrialOutcome> {
        let TrialId { combination, trial, .. } = options.id;
        ensure!(
            introduction.level == DecisionLevel::Act || start.objects.len() == 2,
            "--policy: found one that chooses, in a trial of {}; expected one that acts, or a scenario with objects in first and second alone",
            start.objects.iter().map(|object| object.name.as_str()).collect::<Vec<_>>().join(", ")
        );
        let executor = &start.run.snapshot.executor;
        let limits = ActionLimits::for_workcell(&self.world.cell);
        let reset = message::reset_question(&TrialInfo {
            combination,
            trial,
            seed: trial_rng(self.seed ^ EXTERNAL_POLICY_DOMAIN, combination, trial).random(),
            objects: start.objects.iter().map(|object| &**object).collect(),
            yaws: executor.targets().iter().map(|target| target.detected.yaw).collect(),
            limits: &limits,
        });
        if introduction.level == DecisionLevel::Act {
            return external_trial::run_external_trial(
                self,
                start,
                (server, &reset, introduction.images),
                &options,
                watcher,
            );
        }
        let means = PolicyCapabilities { sensing: Sensing::Full, recovery: Recovery::FULL, explores: false };
        self.prepare_objects(&start.objects);
        let pipeline = start.pipeline.as_ref().unwrap_or(&self.pipeline);
        let (knowledge, senses) =
            (self.prior_knowledge(start.prior_knowledge(), means)?, TouchPerception::new(pipeline, Sensing::Full)?);
        let mut chooser = ExternalChooser::new(server, &self.world.cell.robot.hand, pipeline.backgrounds(), reset);
        run_branch(start, &mut ChooserPolicy::new(knowledge, senses, &mut chooser), options, watcher)
    }

    /// Notes the prediction of touch for the planned grasp after the first one. Notes nothing if touch does not detect
    /// the first object in the hand, or if the trial does not have two objects.
    fn note_prediction(&self, start: &PreparedTrial, options: BranchSettings, record: &mut TrialRecord) -> Result<()> {
        if start.objects.len() != 2 {
            return Ok(());
        }
        let recovery = Recovery { retry: false, new_detection: false };
        let means = PolicyCapabilities { sensing: Sensing::Full, recovery, explores: false };
        let foresees = self.rollout_model.as_ref().map(|twin| LookAheadSettings::plan_only(twin));
        let knowledge = Knowledge { look_ahead: foresees, ..self.prior_knowledge(start.prior_knowledge(), means)? };
        let decision = predict_decision(start, &mut self.touch_policy(start, knowledge, means)?, options)?;
        // The condition carries out the planned grasp, whatever touch would choose.
        note_decision(record, decision.map(|decision| FirstDecision { chosen: None, ..decision }));
        Ok(())
    }

    /// Returns the expected score of the best grasps for a policy with these `means` in a trial that begins as `setup`.
    fn expected_score(&self, setup: &InitialConditions, means: PolicyCapabilities) -> Result<f64> {
        let (grasps, senses) = (
            setup.grasp_pair.grasps(&self.world.cell.robot.hand, &self.repertoire)?,
            TouchPerception::new(&self.pipeline, means.sensing)?,
        );
        let objects = setup.objects(self)?;
        let known =
            PriorKnowledge { objects: &objects, grasps: &grasps, reordered: None, sighted: [None; MAX_OBJECTS] };
        let knowledge = self.prior_knowledge(known, means)?;
        Ok(order::best_sequence_score(&knowledge, &senses, &grasps.first))
    }

    /// Makes these objects ready to be felt, so that no decision has to wait for their distances.
    fn prepare_objects(&self, objects: &[Arc<ObjectModel>]) {
        objects.iter().filter_map(|object| self.known_objects.get(&object.name)).for_each(KnownObject::prepare);
    }

    /// Returns the prior knowledge of a policy about a trial.
    fn prior_knowledge<'a>(&'a self, trial: PriorKnowledge, means: PolicyCapabilities) -> Result<Knowledge<'a>> {
        let PriorKnowledge { objects, grasps, reordered, sighted } = trial;
        let known = |object: &Arc<ObjectModel>| {
            let known = self.known_objects.get(&object.name);
            known.with_context(|| format!("{} cannot be registered", object.name))
        };
        Ok(Knowledge {
            cell: &self.world.cell,
            library: &self.world.objects,
            repertoire: &self.repertoire,
            objects: objects.to_vec(),
            known_objects: objects.iter().map(known).collect::<Result<_>>()?,
            second_candidates: grasps.second_candidates.clone(),
            third_candidates: grasps.third_candidates.clone(),
            fallen_candidates: grasps.fallen_candidates.clone(),
            alternative_firsts: grasps.alternative_firsts.clone(),
            uncertainty: self.uncertainty,
            first_detection_sigmas: sighted,
            time_limit: self.world.scenario.protocol.time_limit,
            recovery: means.recovery,
            palpates: means.explores,
            look_ahead: self.rollout_model.as_ref().map(|twin| LookAheadSettings::with_alternatives(twin)),
            reordered,
        })
    }

    /// Creates the policy `touch` of a trial, with this `knowledge`.
    fn touch_policy<'a>(
        &'a self,
        start: &'a PreparedTrial,
        knowledge: Knowledge<'a>,
        means: PolicyCapabilities,
    ) -> Result<TouchPolicy<'a>> {
        let senses = TouchPerception::new(start.pipeline.as_ref().unwrap_or(&self.pipeline), means.sensing)?;
        let first = &start.run.snapshot.executor.target(0).grasp;
        Ok(TouchPolicy::new(knowledge, senses, first))
    }

    /// Returns the record of a trial for which touch has no strategy and which is not started.
    fn declined_trial(
        &self,
        setup: &InitialConditions,
        id: TrialId,
        why: &str,
        watcher: &mut dyn Watcher,
    ) -> Result<TrialOutcome> {
        watcher.on_branch(id.condition)?;
        let mut start = setup.begin(self, None, watcher.is_active())?;
        start.run.referee.give_up(FailureCause::NoStrategy);
        start.run.notify_watcher((Some(why), None), &[], id.condition, watcher)?;
        let record = TrialRecord { reason: why.to_owned(), ..start.run.record(&start.objects, id)? };
        watcher.on_outcome(&record)?;
        Ok(TrialOutcome { record, tries: Vec::new() })
    }
}
