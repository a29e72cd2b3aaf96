//! Trials: the first grasp, and from there a branch for each policy.
//!
//! [`setup`] begins a trial and plays its first grasp, [`branch`] plays one policy from there to the verdict, [`run`] is a trial in
//! progress. [`shared`] is what all trials of a benchmark share, [`disturbance`] what a scenario does to them on purpose,
//! [`watcher`] sees every tick, [`profile`] says where the time goes, and [`held`] keeps first grasps for the evaluation of touch.

pub mod branch;
mod disturbance;
pub mod held;
pub mod profile;
pub mod run;
pub mod setup;
pub mod shared;
pub mod watcher;

use anyhow::{Context as _, Result};
use control::policy::blind::Blind;
use control::policy::touch::Touch;
use control::policy::{Knowledge, Uncertainty};
use control::sensing::Senses;
use grasping::Grasp;
use proving::rehearsal::{Snapshot, TrialStart};
use rand_chacha::ChaCha8Rng;
use scenarios::Sensing;
use scenarios::noise::{TrialNoise, trial_rng};
use scenarios::record::{AblatedTrial, Condition, TrialId, TrialRecord};
use scenarios::referee::FailureCause;
use sim::SimulatedRobot;

use self::branch::{Planned, Play, play, play_plan};

pub use self::held::HeldGrasp;
use self::setup::{Setup, Start};
pub use self::shared::Bench;
pub use self::watcher::{Moment, NoWatcher, Watcher};
use crate::body::{BodySource, Task};

impl Bench {
    /// One trial under one condition on a body from `source`.
    pub fn play(&self, task: &Task, source: &mut dyn BodySource, watcher: &mut dyn Watcher) -> Result<TrialRecord> {
        let (mut noise, mut camera_noise, rng) = setup::draw(self, task.combination, task.trial);
        if task.condition == Condition::Ideal {
            (noise, camera_noise) = (TrialNoise::none(), 0);
        }
        if source.is_real() {
            // Reality brings its own.
            noise = TrialNoise::none();
        }
        let id = TrialId { combination: task.combination, trial: task.trial, condition: task.condition };
        let mut setup = Setup::planned(self, task.combination, noise, camera_noise);
        if task.condition != Condition::Ideal {
            setup = setup.drifting(self, task.combination, task.trial);
        }
        let start = setup.first_grasp(self, Some((source, task)), watcher)?;
        let mut body = start.run.snapshot.robot.clone();
        let played = match task.condition {
            Condition::Touch => self.touch(&start, self.options(id, rng), Sensing::Full, watcher),
            _ => self.plan(&start, self.options(id, rng), watcher).map(|planned| planned.record),
        };
        // Whatever happened, its recording is finished.
        let why = played.as_ref().err().map(|error| format!("{error:#}"));
        let finished = body.finish(played.as_ref().ok(), why.as_deref());
        let record = played?;
        finished?;
        Ok(record)
    }

    /// The ideal run of a combination: no noise, blind.
    pub fn ideal(&self, combination: usize, watcher: &mut dyn Watcher) -> Result<TrialRecord> {
        let start = Setup::planned(self, combination, TrialNoise::none(), 0).first_grasp(self, None, watcher)?;
        let id = TrialId { combination, trial: 0, condition: Condition::Ideal };
        Ok(self.plan(&start, self.options(id, trial_rng(self.seed, combination, 0)), watcher)?.record)
    }

    /// One trial: `conditions` from the same first grasp, and from there, unwatched, `touch` with less of the senses.
    pub fn trial(
        &self,
        combination: usize,
        trial: usize,
        conditions: &[Condition],
        ablations: &[Sensing],
        watcher: &mut dyn Watcher,
    ) -> Result<(Vec<TrialRecord>, Vec<AblatedTrial>)> {
        let (setup, rng) = Setup::noisy(self, combination, trial);
        let mut start = setup.first_grasp(self, None, watcher)?;
        let reacts = self.world.scenario.disturbance.slip.is_some_and(|slip| slip.reaction);
        // Where these hold, touch does not share what blind did.
        let apart = reacts || self.intact.is_some();
        let mut records = Vec::new();
        let mut planned: Option<Planned> = None;
        for &condition in conditions {
            let id = TrialId { combination, trial, condition };
            let record = if condition == Condition::Touch {
                if let Some(intact) = &self.intact {
                    if let Some(why) = intact.impossible.get(&combination) {
                        records.push(self.decline(&setup, id, why, watcher)?);
                        continue;
                    }
                    start = setup.without_digits(self, combination).first_grasp(self, None, watcher)?;
                }
                if reacts {
                    start.run.snapshot.executive.react_to_slip();
                }
                let shared = planned.as_ref().filter(|_| !watcher.active() && !apart);
                let options = Play { planned: shared, ..self.options(id, rng.clone()) };
                self.touch(&start, options, Sensing::Full, watcher)?
            } else {
                let branch = self.plan(&start, self.options(id, rng.clone()), watcher)?;
                let record = branch.record.clone();
                planned = Some(branch);
                record
            };
            records.push(record);
        }
        let planned = planned.filter(|_| !apart);
        let id = TrialId { combination, trial, condition: Condition::Touch };
        let ablated = ablations.iter().map(|&sensing| {
            let options = Play { planned: planned.as_ref(), ..self.options(id, rng.clone()) };
            Ok(AblatedTrial { sensing, record: self.touch(&start, options, sensing, &mut NoWatcher)? })
        });
        Ok((records, ablated.collect::<Result<_>>()?))
    }

    /// Body and controller about to begin the ideal run of a combination, and its planned second grasp.
    pub fn ideal_start(&self, combination: usize) -> Result<(Snapshot, Grasp)> {
        let (first, candidates) = self.plans.plans[combination].grasps(&self.repertoire)?;
        let (world, second) = (&self.world, candidates[0].grasp.clone());
        let board = self.board.with_noise(0);
        let plan = &self.plans.plans[combination];
        let objects = [world.object(&plan.first)?, world.object(&plan.second)?];
        let (protocol, arm) = (world.protocol(), world.cell.ready);
        let start = TrialStart { protocol, grasps: [&first, &second], noise: &TrialNoise::none(), arm };
        let snapshot = Snapshot::at_start(world, &start, &objects, board)?;
        Ok((snapshot, second))
    }

    /// The simulated robot about to begin the ideal run of a combination.
    pub fn scene(&self, combination: usize) -> Result<SimulatedRobot> {
        Ok(self.ideal_start(combination)?.0.robot)
    }

    /// How a branch is played when nothing is shared.
    fn options(&self, id: TrialId, rng: ChaCha8Rng) -> Play<'_> {
        Play { id, noise: &self.world.scenario.noise, rng, planned: None, inject_truth: false, keep_confirm: false }
    }

    /// The branch of the policy `blind`.
    fn plan(&self, start: &Start, options: Play, watcher: &mut dyn Watcher) -> Result<Planned> {
        play_plan(start, &mut Blind::new(start.candidates[0].grasp.clone()), options, watcher)
    }

    /// The branch of the policy `touch`, with what `sensing` leaves of the senses.
    fn touch(&self, start: &Start, options: Play, sensing: Sensing, watcher: &mut dyn Watcher) -> Result<TrialRecord> {
        let (scenario, name) = (&self.world.scenario, &start.objects[0].name);
        let noise = &scenario.noise;
        let knowledge = Knowledge {
            cell: &self.world.cell,
            library: &self.world.objects,
            repertoire: &self.repertoire,
            objects: start.objects.clone(),
            first_known: self.known.get(name).with_context(|| format!("{name} was not made ready to be felt"))?,
            second: start.candidates.clone(),
            uncertainty: Uncertainty { arm: noise.execution.position_sigma, eyes: noise.perception.xy_sigma },
            time_limit: scenario.protocol.time_limit,
        };
        let senses = Senses::new(start.pipeline.as_ref().unwrap_or(&self.pipeline), sensing)?;
        let first = &start.run.snapshot.executive.first().0;
        let mut policy = Touch::new(knowledge, senses, first, options.planned.is_some());
        play(start, &mut policy, Play { inject_truth: sensing == Sensing::TruePose, ..options }, watcher)
    }

    /// The record of a trial for which touch knows no strategy: it does not begin.
    fn decline(&self, setup: &Setup, id: TrialId, why: &str, watcher: &mut dyn Watcher) -> Result<TrialRecord> {
        watcher.branch(id.condition)?;
        let mut start = setup.begin(self, None, watcher.active())?;
        start.run.referee.give_up(FailureCause::NoStrategy);
        start.run.tell(why, None, id.condition, watcher)?;
        let names = [start.objects[0].name.as_str(), start.objects[1].name.as_str()];
        let record = TrialRecord { reason: why.to_owned(), ..start.run.record(names, id)? };
        watcher.outcome(&record)?;
        Ok(record)
    }
}
