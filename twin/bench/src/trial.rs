//! One trial: the first grasp, the look, and from there the branches `blind` and `touch`.

pub mod adapt;
mod disturbance;
mod held;
mod opening;
mod spent;

use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::{Context as _, Result, bail};
use control::executive::{Executive, Phase};
use control::perception::{Felt, KnownObject};
use control::strategy::Candidate;
use grasping::{Grasp, Repertoire};
use hand_model::CAMERAS;
use hand_model::robot::{Robot, TactileFrame, TactileImage};
use nalgebra::Isometry3;
use rand_chacha::ChaCha8Rng;
use scenarios::Sensing;
use scenarios::noise::{ObjectNoise, TrialNoise, trial_rng};
use scenarios::objects::ObjectModel;
use scenarios::record::{AblatedTrial, Condition, TrialRecord};
use scenarios::referee::{FailureCause, Referee, SceneTruth};
use sim::SimulatedRobot;
use sim::robot::Truth;
use sim::tactile::TactileBoard;
use touch::TouchPipeline;

use crate::body::{Body, Stopped, Task, Venue};
use proving::plan::{Plan, Plans};
use proving::rehearsal::{Snapshot, digit_bits};
use proving::world::World;

use disturbance::Disturber;
pub use held::HeldGrasp;
pub use opening::Intact;
pub use spent::{Part, Spent};

/// How often a watched trial takes tactile images, s.
const WATCH_PERIOD: f64 = 0.2;
/// A period that no trial outlasts: one look at the untouched pads, s.
const ONCE: f64 = 1e6;

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
    /// Where the time went.
    pub spent: Arc<Spent>,
    /// What was planned while all digits had power, where some have none: `ideal` and `blind` know no other.
    pub intact: Option<Intact>,
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
    snapshot: Snapshot<Body>,
    referee: Referee,
    spent: Arc<Spent>,
    disturber: Disturber,
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
    /// Perception with the backgrounds that the body itself has shown; the bench's own where the body is simulated.
    pipeline: Option<TouchPipeline>,
}

/// Where a trial is played: on branching simulated bodies, or on one body of a venue.
type Place<'a> = Option<(&'a mut dyn Venue, &'a Task)>;

impl Bench {
    /// One trial under one condition on a body from `venue`.
    pub fn play(&self, task: &Task, venue: &mut dyn Venue, watcher: &mut dyn Watcher) -> Result<TrialRecord> {
        let mut rng = trial_rng(self.seed, task.combination, task.trial);
        let mut noise = TrialNoise::draw(&self.world.scenario.noise, &mut rng);
        let mut camera_noise: u64 = rand::RngExt::random(&mut rng);
        noise.shifts = self.world.scenario.layout.draw(&mut rng);
        if task.condition == Condition::Ideal {
            (noise, camera_noise) = (TrialNoise::none(), 0);
        }
        if venue.is_real() {
            // Reality brings its own.
            noise = TrialNoise::none();
        }
        let id = (task.combination, task.trial, task.condition);
        let opening = self.opening(task.combination, noise, camera_noise);
        let start = self.first_half(&opening, Some((venue, task)), watcher)?;
        let mut body = start.run.snapshot.robot.clone();
        let played = match task.condition {
            Condition::Touch => self.adapt(&start, id, Sensing::Full, None, &mut rng, watcher),
            _ => self.take_planned(&start, id, watcher).map(|planned| planned.record),
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
        let start = self.first_half(&self.opening(combination, TrialNoise::none(), 0), None, watcher)?;
        Ok(self.take_planned(&start, (combination, 0, Condition::Ideal), watcher)?.record)
    }

    /// One trial: `blind` and `touch` from the same first grasp, and from there, unwatched, `touch` with less of the senses.
    pub fn trial(
        &self,
        combination: usize,
        trial: usize,
        conditions: &[Condition],
        ablations: &[Sensing],
        watcher: &mut dyn Watcher,
    ) -> Result<(Vec<TrialRecord>, Vec<AblatedTrial>)> {
        let (opening, rng) = self.noisy_opening(combination, trial)?;
        let what = &self.world.scenario.disturbance;
        let mut start = self.first_half(&opening, None, watcher)?;
        let reacts = what.slip.is_some_and(|slip| slip.reaction);
        // Touch goes ways of its own from the beginning, or in the middle of what blind does.
        let parts = reacts || self.intact.is_some();
        let mut records = Vec::new();
        let mut planned: Option<Planned> = None;
        for &condition in conditions {
            let id = (combination, trial, condition);
            let record = if condition == Condition::Touch {
                if let Some(intact) = &self.intact {
                    if let Some(why) = intact.impossible.get(&combination) {
                        records.push(self.give_up(&opening, id, why, watcher)?);
                        continue;
                    }
                    let own = self.without_digits(&opening, combination);
                    start = self.first_half(&own, None, watcher)?;
                }
                if reacts {
                    start.run.snapshot.executive.react_to_slip();
                }
                let shared = planned.as_ref().filter(|_| !watcher.active() && !parts);
                self.adapt(&start, id, Sensing::Full, shared, &mut rng.clone(), watcher)?
            } else {
                let branch = self.take_planned(&start, id, watcher)?;
                let record = branch.record.clone();
                planned = Some(branch);
                record
            };
            records.push(record);
        }
        let planned = planned.filter(|_| !parts);
        let ablated = ablations
            .iter()
            .map(|&sensing| {
                let id = (combination, trial, Condition::Touch);
                let (shared, watcher) = (planned.as_ref(), &mut NoWatcher);
                Ok(AblatedTrial {
                    sensing,
                    record: self.adapt(&start, id, sensing, shared, &mut rng.clone(), watcher)?,
                })
            })
            .collect::<Result<_>>()?;
        Ok((records, ablated))
    }

    /// The noisy first half of a trial, and the generator as that leaves it.
    fn begin(&self, combination: usize, trial: usize, watcher: &mut dyn Watcher) -> Result<(Start, ChaCha8Rng)> {
        let (opening, rng) = self.noisy_opening(combination, trial)?;
        Ok((self.first_half(&opening, None, watcher)?, rng))
    }

    /// Body and controller about to begin the ideal run of a combination, and its planned second grasp.
    pub fn ideal_start(&self, combination: usize) -> Result<(Snapshot, Grasp)> {
        let (first, candidates) = self.plan(combination).grasps(&self.repertoire)?;
        let (world, second) = (&self.world, candidates[0].grasp.clone());
        let board = self.board.with_noise(0);
        let noise = TrialNoise::none();
        let snapshot = Snapshot::begin(world, world.protocol(), [&first, &second], &noise, world.cell.ready, board)?;
        Ok((snapshot, second))
    }

    /// The simulated robot about to begin the ideal run of a combination.
    pub fn scene(&self, combination: usize) -> Result<SimulatedRobot> {
        Ok(self.ideal_start(combination)?.0.robot)
    }

    fn plan(&self, combination: usize) -> &Plan {
        &self.plans.plans[combination]
    }

    /// Up to the decision. A body that is not simulated shows its untouched pads on the way to the first object.
    fn to_decision(&self, run: &mut Run, watcher: &mut dyn Watcher) -> Result<Option<TouchPipeline>> {
        let mut pipeline = None;
        if !run.snapshot.robot.branches() {
            run.watch(Phase::GraspFirst, None, None, watcher)?;
            pipeline = Some(self.pipeline.with_backgrounds(backgrounds(run.snapshot.executive.newest_images())?)?);
        }
        run.watch(Phase::Decide, None, None, watcher)?;
        Ok(pipeline)
    }

    /// The perception of a trial.
    fn pipeline_of<'a>(&'a self, start: &'a Start) -> &'a TouchPipeline {
        start.pipeline.as_ref().unwrap_or(&self.pipeline)
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
        let record = run.record(start, id)?;
        watcher.outcome(&record)?;
        Ok(Planned { confirm, done: run, record })
    }
}

impl Run {
    /// The word of the referee, or of whoever judges instead, on what was done so far.
    fn record(
        &mut self,
        start: &Start,
        (combination, trial, condition): (usize, usize, Condition),
    ) -> Result<TrialRecord> {
        let verdict = match self.snapshot.robot.judge()? {
            Some(verdict) => verdict,
            None => self.referee.verdict(),
        };
        Ok(TrialRecord {
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
            disturbance: self.disturber.log(),
            pose_error_mm: None,
            pose_error_deg: None,
            prior_error_mm: None,
            sim_seconds: self.snapshot.robot.time(),
            decision_ms: None,
        })
    }

    /// Drives to `until` while referee and watcher look on.
    fn watch(
        &mut self,
        until: Phase,
        felt: Option<&Felt>,
        condition: Option<Condition>,
        watcher: &mut dyn Watcher,
    ) -> Result<()> {
        let Self { snapshot, referee, disturber, spent } = self;
        let holding = digit_bits(snapshot.executive.first().0.role.digits());
        let Snapshot { robot, executive } = snapshot;
        while executive.phase() < until {
            let observation = robot.observe();
            let command = spent.on(Part::Control, || executive.tick(&observation))?;
            robot.send(&command);
            let note = match robot {
                Body::Simulated(robot) => disturber.act(robot, executive),
                Body::Sole(_) => None,
            };
            let part = if command.capture { Part::Images } else { Part::Physics };
            spent.on(part, || robot.wait_for_tick());
            spent.on(Part::Referee, || {
                let Some(truth) = robot.truth() else { return Ok(()) };
                referee.see(&scene(&truth, executive.phase(), holding));
                disturber.see(&truth);
                watcher.see(&Moment { truth: &truth, executive, felt, condition, note: note.as_deref() })
            })?;
            // The last tick of a recording may also be the last of a trial.
            if let Some(why) = robot.stopped().filter(|_| executive.phase() < Phase::Done) {
                bail!(Stopped(format!("{} while {}", why, executive.phase().name())));
            }
        }
        // What comes next is to be decided first.
        robot.pause();
        Ok(())
    }

    /// What the reaction to slip did, in words.
    fn slips(&self) -> Option<String> {
        let [first, second] = self.snapshot.executive.slips();
        (first + second > 0).then(|| {
            format!(
                "while carrying, slip was felt {first} times in the first grip and {second} in the second: held harder"
            )
        })
    }

    /// What prior perception says of object `index` now, errors of its own and of the scenario's included.
    fn look(&mut self, index: usize, noise: &ObjectNoise) -> Result<Isometry3<f64>> {
        let misled = self.disturber.misled(index, noise);
        self.snapshot.robot.look(index, &misled)
    }

    /// Tells the watcher what is about to be done, and why.
    fn tell(&self, note: &str, felt: Option<&Felt>, condition: Condition, watcher: &mut dyn Watcher) -> Result<()> {
        let Some(truth) = self.snapshot.robot.truth() else { return Ok(()) };
        watcher.see(&Moment {
            truth: &truth,
            executive: &self.snapshot.executive,
            felt,
            condition: Some(condition),
            note: Some(note),
        })
    }
}

/// One image a camera, of untouched pads.
fn backgrounds(frames: &[TactileFrame]) -> Result<Vec<Arc<TactileImage>>> {
    let image = |camera: usize| {
        let frame = frames.iter().rev().find(|frame| frame.camera == camera);
        frame.map(|frame| frame.image.clone()).with_context(|| {
            format!("camera {camera}: found no image of its untouched pad, expected one on the way to the first object")
        })
    };
    (0..CAMERAS).map(image).collect()
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
