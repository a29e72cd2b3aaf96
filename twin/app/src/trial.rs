//! One trial: the first grasp, the look, and from there the branches `blind` and `touch`.

mod adapt;
mod held;

use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::Result;
use control::executive::{Executive, Phase};
use control::perception::{Felt, KnownObject};
use control::strategy::Candidate;
use grasping::Repertoire;
use rand_chacha::ChaCha8Rng;
use scenarios::noise::{TrialNoise, trial_rng};
use scenarios::objects::ObjectModel;
use scenarios::record::{Condition, TrialRecord};
use scenarios::referee::{FailureCause, Referee, SceneTruth};
use sim::robot::Truth;
use sim::tactile::TactileBoard;
use touch::TouchPipeline;

use crate::plan::{Plan, Plans};
use crate::rehearsal::{Snapshot, digit_bits};
use crate::world::{World, drive};

pub use held::HeldGrasp;

/// How often a watched trial takes tactile images, s.
const WATCH_PERIOD: f64 = 0.2;

/// Everything trials share.
pub struct Bench {
    /// Robot, objects, scenario.
    pub world: World,
    /// Grasps.
    pub repertoire: Repertoire,
    /// Combinations.
    pub plans: Plans,
    /// The hand unit's cameras.
    pub board: TactileBoard,
    /// Perception.
    pub pipeline: TouchPipeline,
    /// The first objects of all plans, ready to be registered.
    pub known: BTreeMap<String, KnownObject>,
    /// Seed of everything.
    pub seed: u64,
}

/// What a watcher of a trial sees each tick.
pub struct Moment<'a> {
    /// The body's truth.
    pub truth: &'a Truth,
    /// The controller.
    pub executive: &'a Executive,
    /// What was felt, once it was.
    pub felt: Option<&'a Felt>,
    /// The condition, or `None` while blind and touch are still one.
    pub condition: Option<Condition>,
    /// Text worth noting at this moment.
    pub note: Option<&'a str>,
}

/// A watcher: sees every tick of a trial.
pub trait Watcher {
    /// Whether it looks at all: then every branch is played, even one whose outcome is known, and images are taken throughout.
    fn active(&self) -> bool;
    /// One tick.
    fn see(&mut self, moment: &Moment) -> Result<()>;
    /// A branch begins: everything seen so far also belongs to it.
    fn branch(&mut self, condition: Condition) -> Result<()>;
    /// A branch ended with this record.
    fn outcome(&mut self, record: &TrialRecord) -> Result<()>;
}

/// Watches nothing.
pub struct NoWatcher;

impl Watcher for NoWatcher {
    fn active(&self) -> bool {
        false
    }
    fn see(&mut self, _: &Moment) -> Result<()> {
        Ok(())
    }
    fn branch(&mut self, _: Condition) -> Result<()> {
        Ok(())
    }
    fn outcome(&mut self, _: &TrialRecord) -> Result<()> {
        Ok(())
    }
}

/// A trial in progress: body, controller and referee, which branch together.
#[derive(Clone)]
struct Run {
    snapshot: Snapshot,
    referee: Referee,
}

/// A branch that carried out the plan: what touch shares with it for as long as it does the very same.
struct Planned {
    /// After the second lift.
    confirm: Run,
    /// At the end.
    done: Run,
    record: TrialRecord,
}

/// A trial after its first grasp.
struct Start {
    run: Run,
    objects: [Arc<ObjectModel>; 2],
    candidates: Vec<Candidate>,
}

impl Bench {
    /// The ideal run of a combination: no noise, blind.
    pub fn ideal(&self, combination: usize, watcher: &mut dyn Watcher) -> Result<TrialRecord> {
        let start = self.first_half(combination, &TrialNoise::none(), 0, watcher)?;
        Ok(self.take_planned(&start, (combination, 0, Condition::Ideal), watcher)?.record)
    }

    /// One trial: `blind` and `touch` from the same first grasp.
    pub fn trial(
        &self,
        combination: usize,
        trial: usize,
        conditions: &[Condition],
        watcher: &mut dyn Watcher,
    ) -> Result<Vec<TrialRecord>> {
        let (start, mut rng) = self.begin(combination, trial, watcher)?;
        let mut records = Vec::new();
        let mut planned: Option<Planned> = None;
        for &condition in conditions {
            let id = (combination, trial, condition);
            let record = if condition == Condition::Touch {
                let shared = planned.as_ref().filter(|_| !watcher.active());
                self.adapt(&start, id, shared, &mut rng, watcher)?
            } else {
                let branch = self.take_planned(&start, id, watcher)?;
                let record = branch.record.clone();
                planned = Some(branch);
                record
            };
            records.push(record);
        }
        Ok(records)
    }

    /// The noisy first half of a trial, and the generator as that leaves it.
    fn begin(&self, combination: usize, trial: usize, watcher: &mut dyn Watcher) -> Result<(Start, ChaCha8Rng)> {
        let mut rng = trial_rng(self.seed, combination, trial);
        let noise = TrialNoise::draw(&self.world.scenario.noise, &mut rng);
        let start = self.first_half(combination, &noise, rand::RngExt::random(&mut rng), watcher)?;
        Ok((start, rng))
    }

    fn plan(&self, combination: usize) -> &Plan {
        &self.plans.plans[combination]
    }

    fn first_half(
        &self,
        combination: usize,
        noise: &TrialNoise,
        camera_noise: u64,
        watcher: &mut dyn Watcher,
    ) -> Result<Start> {
        let world = &self.world;
        let plan = self.plan(combination);
        let (first, candidates) = plan.grasps(&self.repertoire)?;
        let objects = [world.object(&plan.first)?, world.object(&plan.second)?];
        let grasps = [&first, &candidates[0].grasp];
        let board = self.board.with_noise(camera_noise);
        let mut snapshot = Snapshot::begin(world, world.protocol(), grasps, noise, world.ready, board)?;
        if watcher.active() {
            snapshot.executive.watch_images(WATCH_PERIOD);
        }
        let mut run =
            Run { snapshot, referee: Referee::new(world.scenario.referee, world.scenario.protocol.hold_time) };
        run.watch(Phase::Decide, None, None, watcher)?;
        Ok(Start { run, objects, candidates })
    }

    /// The second grasp as planned, unseen, and all that follows.
    fn take_planned(&self, start: &Start, id: (usize, usize, Condition), watcher: &mut dyn Watcher) -> Result<Planned> {
        let condition = id.2;
        watcher.branch(condition)?;
        let mut run = start.run.clone();
        match run.snapshot.executive.decide(start.candidates[0].grasp.clone()) {
            Ok(()) => {
                run.tell("the plan is carried out unseen", None, condition, watcher)?;
                run.watch(Phase::Confirm, None, Some(condition), watcher)?;
            }
            Err(_) => run.referee.give_up(FailureCause::Unreachable),
        }
        let confirm = run.clone();
        if run.snapshot.executive.phase() == Phase::Confirm {
            run.snapshot.executive.confirm()?;
            run.watch(Phase::Done, None, Some(condition), watcher)?;
        }
        let record = run.record(start, id);
        watcher.outcome(&record)?;
        Ok(Planned { confirm, done: run, record })
    }
}

impl Run {
    /// The referee's word on what was done so far.
    fn record(&self, start: &Start, (combination, trial, condition): (usize, usize, Condition)) -> TrialRecord {
        let verdict = self.referee.verdict();
        TrialRecord {
            combination,
            trial,
            condition,
            first: start.objects[0].name.clone(),
            second: start.objects[1].name.clone(),
            collision: verdict.collision,
            success: verdict.success,
            cause: verdict.cause,
            switched: false,
            retries: 0,
            reason: String::new(),
            pose_error_mm: None,
            pose_error_deg: None,
            prior_error_mm: None,
            sim_seconds: self.snapshot.robot.truth().time,
            decision_ms: None,
        }
    }

    /// Drives to `until` while referee and watcher look on.
    fn watch(
        &mut self,
        until: Phase,
        felt: Option<&Felt>,
        condition: Option<Condition>,
        watcher: &mut dyn Watcher,
    ) -> Result<()> {
        let Self { snapshot, referee } = self;
        let holding = digit_bits(snapshot.executive.first().0.role.digits());
        let mut failed = Ok(());
        drive(&mut snapshot.robot, &mut snapshot.executive, until, |robot, executive| {
            let truth = robot.truth();
            referee.see(&scene(&truth, executive.phase(), holding));
            if failed.is_ok() {
                failed = watcher.see(&Moment { truth: &truth, executive, felt, condition, note: None });
            }
        })?;
        failed
    }

    /// Tells the watcher what is about to be done, and why.
    fn tell(&self, note: &str, felt: Option<&Felt>, condition: Condition, watcher: &mut dyn Watcher) -> Result<()> {
        watcher.see(&Moment {
            truth: &self.snapshot.robot.truth(),
            executive: &self.snapshot.executive,
            felt,
            condition: Some(condition),
            note: Some(note),
        })
    }
}

/// The referee's view of the scene.
fn scene(truth: &Truth, phase: Phase, holding: u32) -> SceneTruth {
    let count = |object: usize| truth.touched_by[object].count_ones() as usize;
    SceneTruth {
        time: truth.time,
        phase,
        first_touches_second: !truth.object_pairs.is_empty(),
        holding_digits_touch_second: phase >= Phase::LiftFirst && truth.touched_by[1] & holding != 0,
        free_digits_touch_second: truth.touched_by[1] & !holding != 0,
        hand_contacts: [count(0), count(1)],
        on_table: [truth.on_table[0], truth.on_table[1]],
        world_from_object: [truth.objects[0], truth.objects[1]],
        world_from_palm: truth.palm,
    }
}
