//! Trials: the first grasp, and from there a branch for each policy.
//!
//! [`setup`] begins a trial and plays its first grasp. [`branch`] plays one policy from there to the verdict, and
//! [`conditions`] plays one after the other. [`run`] is a trial in progress, and [`eyes`] is its prior perception.
//! [`shared`] holds the data that all trials of a benchmark share, and [`disturbance`] applies a scenario's
//! disturbances. [`watcher`] sees every tick, [`filming`] keeps it for a film, [`profile`] measures computing time, and
//! [`held`] keeps first grasps for the evaluation of touch.

pub mod branch;
mod conditions;
mod disturbance;
mod driven;
pub mod eyes;
pub mod filming;
pub mod held;
mod means;
pub mod profile;
pub mod run;
pub mod setup;
pub mod shared;
pub mod watcher;

use std::sync::Arc;

use anyhow::{Context as _, Result, ensure};
use control::action::ActionLimits;
use control::foresight::Foresees;
use control::policy::blind::Blind;
use control::policy::chosen::Chosen;
use control::policy::in_turn::InTurn;
use control::policy::touch::Touch;
use control::policy::{FirstDecision, Knowledge, Recovery, order};
use control::sensing::Senses;
use grasp_verification::rehearsal::{Snapshot, TrialStart};
use rand::RngExt as _;
use scenarios::Ablation;
use scenarios::generator::trial_rng;
use scenarios::noise::TrialNoise;
use scenarios::record::{AblatedTrial, Condition, TrialId, TrialRecord};
use scenarios::referee::FailureCause;
use sim::SimulatedRobot;
use world::Sensing;
use world::layout::MOST_OBJECTS;
use world::objects::ObjectModel;

use self::branch::{Play, foretell, note_decision, play};
use self::eyes::Looks;

pub use self::branch::TrialOutcome;
use self::conditions::Branches;
pub use self::conditions::TrialResults;
pub use self::held::HeldGrasp;
pub use self::means::Means;
use self::setup::{Known, Setup, Start};
pub use self::shared::Bench;
pub use self::watcher::{Moment, NoWatcher, Watcher};
use external_policy::chooser::HostChooser;
use external_policy::message::{self, Info};
use external_policy::{Guest, Host, Level, Pace};
use robot_backends::{BodySource, Task};

/// Domain separator: makes the seeds of the user's own policies differ from those of the trials.
const OWN: u64 = 0x6f77_6e5f_706f_6c69;

impl Bench {
    /// Plays one trial under one condition on a body from `source`.
    pub fn play(&self, task: &Task, source: &mut dyn BodySource, watcher: &mut dyn Watcher) -> Result<TrialOutcome> {
        let (mut noise, mut camera_noise, looks) = setup::draw(self, task.combination, task.trial)?;
        if task.condition == Condition::Ideal {
            (noise, camera_noise) = (TrialNoise::none(), 0);
        }
        if source.is_real() {
            // A real body has its own errors.
            noise = TrialNoise::none();
        }
        let id = TrialId { combination: task.combination, trial: task.trial, condition: task.condition };
        let mut setup = Setup::planned(self, task.combination, noise, camera_noise);
        if task.condition != Condition::Ideal {
            setup = setup.drifting(self, task.combination, task.trial);
        }
        let means = Means::of(task.condition);
        let start = match means {
            Some(means) if means.begin_otherwise() => {
                setup.ordered(self, means)?.at_rest(self, Some((source, task)), watcher)?
            }
            _ if self.begins_otherwise(task.condition) => setup.at_rest(self, Some((source, task)), watcher)?,
            _ => setup.first_grasp(self, Some((source, task)), watcher)?,
        };
        let mut body = start.run.snapshot.robot.clone();
        let played = match means {
            _ if task.condition == Condition::Own => self.own(&start, self.options(id, looks), watcher),
            Some(means) => self.touch(&start, self.options(id, looks), means, watcher),
            None => self.plan(&start, self.options(id, looks), watcher),
        };
        // The recording is finished in any case.
        let why = played.as_ref().err().map(|error| format!("{error:#}"));
        let finished = body.finish(played.as_ref().ok().map(|outcome| &outcome.record), why.as_deref());
        let outcome = played?;
        // A full disk must not lose the operator's verdict.
        finished.with_context(|| {
            format!(
                "the session is not whole; the verdict was {}",
                serde_json::to_string(&outcome.record).unwrap_or_default()
            )
        })?;
        Ok(outcome)
    }

    /// Plays one trial in which a policy of the user's own, represented by `host`, decides. The errors are those that
    /// every condition of the trial meets.
    pub fn hosted(
        &self,
        combination: usize,
        trial: usize,
        (guest, pace): (&Guest, Pace),
        host: &mut dyn Host,
    ) -> Result<TrialOutcome> {
        let (setup, looks) = Setup::noisy(self, combination, trial)?;
        let start = match guest.level {
            Level::Act => setup.at_rest(self, None, &mut NoWatcher)?,
            Level::Choose => setup.first_grasp(self, None, &mut NoWatcher)?,
        };
        let options = self.options(TrialId { combination, trial, condition: Condition::Own }, looks);
        self.guest(&start, guest, host, Play { pace, ..options }, &mut NoWatcher)
    }

    /// Plays the ideal run of a combination: no noise, blind.
    pub fn ideal(&self, combination: usize, watcher: &mut dyn Watcher) -> Result<TrialOutcome> {
        let start = Setup::planned(self, combination, TrialNoise::none(), 0).first_grasp(self, None, watcher)?;
        let id = TrialId { combination, trial: 0, condition: Condition::Ideal };
        let looks = Looks::new(trial_rng(self.seed, combination, 0), None);
        let mut outcome = self.plan(&start, self.options(id, looks.clone()), watcher)?;
        self.foretell(&start, self.options(id, looks), &mut outcome.record)?;
        Ok(outcome)
    }

    /// Plays one trial: all `conditions` with the same errors, and then, unwatched, `touch` under `ablations`.
    pub fn trial(
        &self,
        combination: usize,
        trial: usize,
        conditions: &[Condition],
        ablations: &[Ablation],
        watcher: &mut dyn Watcher,
    ) -> Result<TrialResults> {
        let (setup, looks) = Setup::noisy(self, combination, trial)?;
        let start = setup.first_grasp(self, None, watcher)?;
        let branches = Branches { bench: self, setup: &setup, start, looks };
        let id = |condition| TrialId { combination, trial, condition };
        let mut results = TrialResults::default();
        for &condition in conditions {
            results.add(branches.play(id(condition), watcher)?);
        }
        for record in results.records.iter_mut().filter(|record| record.condition == Condition::Blind) {
            self.foretell(&branches.start, self.options(id(Condition::Blind), branches.looks.clone()), record)?;
        }
        for &ablation in ablations {
            let outcome = branches.deliberate(id(Condition::Touch), ablation.into(), &mut NoWatcher)?;
            results.ablated.push(AblatedTrial { ablation, record: outcome.record });
        }
        Ok(results)
    }

    /// Returns body and controller about to begin the ideal run of a combination.
    pub fn ideal_start(&self, combination: usize) -> Result<Snapshot> {
        let plan = &self.plans.plans[combination];
        let grasps = plan.grasps(&self.world.cell.robot.hand, &self.repertoire)?;
        let world = &self.world;
        let board = self.board.with_noise(0);
        let objects = world.models(&plan.objects())?;
        let (protocol, arm) = (world.protocol(), world.cell.ready);
        let start = TrialStart { protocol, grasps: &grasps.planned(), noise: &TrialNoise::none(), arm };
        Snapshot::at_start(world, &start, &objects, board)
    }

    /// Returns the simulated robot about to begin the ideal run of a combination.
    pub fn scene(&self, combination: usize) -> Result<SimulatedRobot> {
        Ok(self.ideal_start(combination)?.robot)
    }

    /// Returns the settings of a branch.
    fn options(&self, id: TrialId, looks: Looks) -> Play<'_> {
        let scenario = &self.world.scenario;
        Play {
            id,
            noise: &scenario.noise,
            library: &self.world.objects,
            looks,
            decision_time: scenario.effects.time.map_or(0.0, |time| time.decision),
            inject_truth: false,
            pace: Pace::Stand,
        }
    }

    /// Plays the branch of the policy `blind`.
    fn plan(&self, start: &Start, options: Play, watcher: &mut dyn Watcher) -> Result<TrialOutcome> {
        play(start, &mut Blind::new(start.grasps.planned().into_iter().cloned().collect()), options, watcher)
    }

    /// Plays the branch of the policy `touch`, with the `means` that are left to it.
    fn touch(&self, start: &Start, options: Play, means: Means, watcher: &mut dyn Watcher) -> Result<TrialOutcome> {
        let inject_truth = means.sensing == Sensing::TruePose;
        let knowledge = self.knowledge(start.known(), means)?;
        let options = Play { inject_truth, ..options };
        if start.objects.len() > 2 {
            let senses = Senses::new(start.pipeline.as_ref().unwrap_or(&self.pipeline), means.sensing)?;
            return play(start, &mut InTurn::new(knowledge, senses, &start.grasps.planned()), options, watcher);
        }
        play(start, &mut self.touch_policy(start, knowledge, means)?, options, watcher)
    }

    /// Plays the branch of the user's own policy.
    fn own(&self, start: &Start, options: Play, watcher: &mut dyn Watcher) -> Result<TrialOutcome> {
        let own = self.own.as_ref().context("the condition own needs a policy, and none was given (--policy)")?;
        let options = Play { pace: own.source.pace, ..options };
        own.with(|host| self.guest(start, &own.guest, host, options, watcher))
    }

    /// Plays the branch of a policy represented by `host`.
    fn guest(
        &self,
        start: &Start,
        guest: &Guest,
        host: &mut dyn Host,
        options: Play,
        watcher: &mut dyn Watcher,
    ) -> Result<TrialOutcome> {
        let TrialId { combination, trial, .. } = options.id;
        ensure!(
            guest.level == Level::Act || start.objects.len() == 2,
            "--policy: found one that chooses, in a trial of {}; expected one that acts, or a scenario with objects in first and second alone",
            start.objects.iter().map(|object| object.name.as_str()).collect::<Vec<_>>().join(", ")
        );
        let executor = &start.run.snapshot.executor;
        let limits = ActionLimits::of(&self.world.cell);
        let reset = message::reset(&Info {
            combination,
            trial,
            seed: trial_rng(self.seed ^ OWN, combination, trial).random(),
            objects: start.objects.iter().map(|object| object.name.as_str()).collect(),
            yaws: executor.targets().iter().map(|target| target.percept.yaw).collect(),
            limits: &limits,
        });
        if guest.level == Level::Act {
            return driven::drive(self, start, (host, &reset, guest.images), &options, watcher);
        }
        let means = Means { sensing: Sensing::Full, recovery: Recovery::FULL, explores: false };
        let pipeline = start.pipeline.as_ref().unwrap_or(&self.pipeline);
        let (knowledge, senses) = (self.knowledge(start.known(), means)?, Senses::new(pipeline, Sensing::Full)?);
        let mut chooser = HostChooser::new(host, &self.world.cell.robot.hand, pipeline.backgrounds(), reset);
        play(start, &mut Chosen::new(knowledge, senses, &mut chooser), options, watcher)
    }

    /// Notes the prediction of touch for the plan after the first grasp. Notes nothing if the first object is not felt
    /// in the hand, or if the trial does not have two objects.
    fn foretell(&self, start: &Start, options: Play, record: &mut TrialRecord) -> Result<()> {
        if start.objects.len() != 2 {
            return Ok(());
        }
        let recovery = Recovery { retry: false, new_look: false };
        let means = Means { sensing: Sensing::Full, recovery, explores: false };
        let foresees = self.twin.as_ref().map(|twin| Foresees::plan(twin));
        let knowledge = Knowledge { foresees, ..self.knowledge(start.known(), means)? };
        let decision = foretell(start, &mut self.touch_policy(start, knowledge, means)?, options)?;
        // The condition carries out the plan, whatever touch would choose.
        note_decision(record, decision.map(|decision| FirstDecision { chosen: None, ..decision }));
        Ok(())
    }

    /// Returns the expected utility of the best grasps for a policy with these `means` in a trial that begins as
    /// `setup`.
    fn promise(&self, setup: &Setup, means: Means) -> Result<f64> {
        let (grasps, senses) = (
            setup.plan.grasps(&self.world.cell.robot.hand, &self.repertoire)?,
            Senses::new(&self.pipeline, means.sensing)?,
        );
        let objects = setup.objects(self)?;
        let known = Known { objects: &objects, grasps: &grasps, reordered: None, sighted: [None; MOST_OBJECTS] };
        let knowledge = self.knowledge(known, means)?;
        Ok(order::promise(&knowledge, &senses, &grasps.first))
    }

    /// Returns the prior knowledge of a policy about a trial.
    fn knowledge<'a>(&'a self, trial: Known, means: Means) -> Result<Knowledge<'a>> {
        let Known { objects, grasps, reordered, sighted } = trial;
        let known = |object: &Arc<ObjectModel>| {
            let known = self.known.get(&object.name);
            known.inspect(|known| known.prepare()).with_context(|| format!("{} cannot be felt", object.name))
        };
        Ok(Knowledge {
            cell: &self.world.cell,
            library: &self.world.objects,
            repertoire: &self.repertoire,
            objects: objects.to_vec(),
            known: objects.iter().map(known).collect::<Result<_>>()?,
            second: grasps.second.clone(),
            third: grasps.third.clone(),
            fallen: grasps.fallen.clone(),
            others: grasps.others.clone(),
            uncertainty: self.uncertainty,
            sighted,
            time_limit: self.world.scenario.protocol.time_limit,
            recovery: means.recovery,
            explores: means.explores,
            foresees: self.twin.as_ref().map(|twin| Foresees::best(twin)),
            reordered,
        })
    }

    /// Creates the policy `touch` of a trial, with this `knowledge`.
    fn touch_policy<'a>(&'a self, start: &'a Start, knowledge: Knowledge<'a>, means: Means) -> Result<Touch<'a>> {
        let senses = Senses::new(start.pipeline.as_ref().unwrap_or(&self.pipeline), means.sensing)?;
        let first = &start.run.snapshot.executor.target(0).grasp;
        Ok(Touch::new(knowledge, senses, first))
    }

    /// Returns the record of a trial for which touch has no strategy: it does not begin.
    fn decline(&self, setup: &Setup, id: TrialId, why: &str, watcher: &mut dyn Watcher) -> Result<TrialOutcome> {
        watcher.branch(id.condition)?;
        let mut start = setup.begin(self, None, watcher.active())?;
        start.run.referee.give_up(FailureCause::NoStrategy);
        start.run.tell((Some(why), None), &[], id.condition, watcher)?;
        let record = TrialRecord { reason: why.to_owned(), ..start.run.record(&start.objects, id)? };
        watcher.outcome(&record)?;
        Ok(TrialOutcome { record, tries: Vec::new() })
    }
}
