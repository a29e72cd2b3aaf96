//! One trial: the first grasp, the look, and from there the branches `blind` and `touch`.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

use anyhow::Result;
use control::executive::{Executive, Percept, Phase};
use control::perception::{Felt, KnownObject, feel};
use control::strategy::{Candidate, Decision, Held, choose};
use grasping::{Grasp, Repertoire};
use nalgebra::{Isometry3, UnitQuaternion};
use rand_chacha::ChaCha8Rng;
use scenarios::noise::{TrialNoise, trial_rng};
use scenarios::objects::ObjectModel;
use scenarios::record::{Condition, TrialRecord};
use scenarios::referee::{self, FailureCause, Referee, SceneTruth};
use sim::robot::{ObjectPlacement, SceneSetup, SimulatedRobot, Truth};
use sim::tactile::TactileBoard;
use touch::TouchPipeline;

use crate::plan::{Plan, Plans};
use crate::rehearsal::{Snapshot, digit_bits};
use crate::world::{World, drive, percept};

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

#[derive(Clone)]
struct Start {
    snapshot: Snapshot,
    referee: Referee,
    objects: [Arc<ObjectModel>; 2],
    candidates: Vec<Candidate>,
}

struct Perceived {
    decision: Decision,
    felt: Felt,
    milliseconds: f64,
}

impl Bench {
    /// The ideal run of a combination: no noise, blind.
    pub fn ideal(&self, combination: usize, watcher: &mut dyn Watcher) -> Result<TrialRecord> {
        let start = self.first_half(combination, &TrialNoise::none(), 0, watcher)?;
        self.second_half(combination, 0, Condition::Ideal, &start, None, watcher)
    }

    /// One trial: `blind` and `touch` from the same first grasp.
    pub fn trial(
        &self,
        combination: usize,
        trial: usize,
        conditions: &[Condition],
        watcher: &mut dyn Watcher,
    ) -> Result<Vec<TrialRecord>> {
        let mut rng = trial_rng(self.seed, combination, trial);
        let noise = TrialNoise::draw(&self.world.scenario.noise, &mut rng);
        let start = self.first_half(combination, &noise, rand::RngExt::random(&mut rng), watcher)?;
        let perceived = self.look(&start)?;
        let again = match conditions.contains(&Condition::Touch) && !perceived.felt.anything() {
            true => Some(self.retry(&start, &mut rng, watcher)?),
            false => None,
        };
        let mut records = Vec::new();
        let mut kept: Option<TrialRecord> = None;
        for &condition in conditions {
            let (start, perceived) = match &again {
                Some((start, perceived)) if condition == Condition::Touch => (start, perceived),
                _ => (&start, &perceived),
            };
            let switched = condition == Condition::Touch && (perceived.decision.switched || again.is_some());
            let mut record = match &kept {
                // Blind and touch send the very same commands from the same snapshot: the outcome is the same, bit by bit.
                Some(same) if !switched && !watcher.active() => TrialRecord { condition, ..same.clone() },
                _ => self.second_half(combination, trial, condition, start, Some(perceived), watcher)?,
            };
            if !switched {
                kept = Some(record.clone());
            }
            if condition == Condition::Touch {
                self.note_perception(&mut record, start, perceived);
                if again.is_some() {
                    record.switched = true;
                    record.reason = format!("nothing felt after the first grasp: tried it again; {}", record.reason);
                }
            }
            records.push(record);
        }
        Ok(records)
    }

    /// Touch felt nothing in the hand: prior perception looks at the first object anew (with an error of its own), and the
    /// first grasp is tried once more.
    fn retry(&self, start: &Start, rng: &mut ChaCha8Rng, watcher: &mut dyn Watcher) -> Result<(Start, Perceived)> {
        watcher.branch(Condition::Touch)?;
        let noise = TrialNoise::draw(&self.world.scenario.noise, rng).objects[0];
        let mut again = start.clone();
        let seen = noise.perceived(&again.snapshot.robot.truth().objects[0]);
        again.snapshot.executive.retry_first(percept(&again.objects[0], &seen))?;
        watch(&mut again.snapshot, Phase::Decide, &mut again.referee, None, Some(Condition::Touch), watcher)?;
        let perceived = self.look(&again)?;
        Ok((again, perceived))
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
        let poses = world.places(&objects[0], &objects[1]);
        let percepts: [Percept; 2] =
            std::array::from_fn(|n| percept(&objects[n], &noise.objects[n].perceived(&poses[n])));
        let setup = SceneSetup {
            world_from_base: Isometry3::from_parts(noise.position.into(), UnitQuaternion::identity())
                * world.world_from_base,
            mount_error: UnitQuaternion::from_scaled_axis(noise.rotation),
            arm_start: world.ready,
            objects: objects
                .iter()
                .zip(&poses)
                .map(|(model, pose)| ObjectPlacement { model: model.clone(), pose: *pose })
                .collect(),
            engine: sim::engine::EngineSettings::default(),
        };
        let robot =
            SimulatedRobot::new(world.hand.clone(), world.arm.clone(), &setup, self.board.with_noise(camera_noise));
        let tick = hand_model::robot::Robot::tick_length(&robot);
        let planned = candidates[0].grasp.clone();
        let executive = Executive::new(
            world.hand.clone(),
            world.arm_servo(world.ready)?,
            world.protocol(),
            (first, percepts[0]),
            (planned, percepts[1]),
            tick,
        )?;
        let mut snapshot = Snapshot { robot, executive };
        if watcher.active() {
            snapshot.executive.watch_images(WATCH_PERIOD);
        }
        let mut referee = Referee::new(world.scenario.referee, world.scenario.protocol.hold_time);
        watch(&mut snapshot, Phase::Decide, &mut referee, None, None, watcher)?;
        Ok(Start { snapshot, referee, objects, candidates })
    }

    /// What touch makes of the images.
    fn look(&self, start: &Start) -> Result<Perceived> {
        let begun = Instant::now();
        let executive = &start.snapshot.executive;
        let felt = feel(&self.pipeline, executive, &self.known[&start.objects[0].name])?;
        let held = Held {
            object: &start.objects[0],
            pose: felt.estimate.palm_from_object,
            joints: felt.estimate.q.to_vec(),
            digits: executive.first().0.role.digits(),
            sigma: felt.estimate.sigma().0.min(0.01),
        };
        let noise = &self.world.scenario.noise;
        let sigma = noise.execution.position_sigma.hypot(noise.perception.xy_sigma);
        let decision = choose(executive, &self.world.hand, &held, &start.objects[1], &start.candidates, sigma)?;
        let milliseconds = begun.elapsed().as_secs_f64() * 1e3;
        let decision =
            decision.ok_or_else(|| anyhow::anyhow!("the plan of {} has no second grasp", start.objects[1].name))?;
        Ok(Perceived { decision, felt, milliseconds })
    }

    fn second_half(
        &self,
        combination: usize,
        trial: usize,
        condition: Condition,
        start: &Start,
        perceived: Option<&Perceived>,
        watcher: &mut dyn Watcher,
    ) -> Result<TrialRecord> {
        watcher.branch(condition)?;
        let mut snapshot = start.snapshot.clone();
        let mut referee = start.referee.clone();
        let touch = perceived.filter(|_| condition == Condition::Touch);
        let planned: Grasp = start.candidates[0].grasp.clone();
        let (grasp, note) = match touch {
            Some(perceived) => (perceived.decision.grasp.clone(), perceived.decision.reason.clone()),
            None => (planned, "the plan is carried out unseen".to_owned()),
        };
        let felt = touch.map(|perceived| &perceived.felt);
        match snapshot.executive.decide(grasp) {
            Ok(()) => {
                let first = Moment {
                    truth: &snapshot.robot.truth(),
                    executive: &snapshot.executive,
                    felt,
                    condition: Some(condition),
                    note: Some(&note),
                };
                watcher.see(&first)?;
                watch(&mut snapshot, Phase::Done, &mut referee, felt, Some(condition), watcher)?;
            }
            Err(_) => referee.give_up(FailureCause::Unreachable),
        }
        let verdict = referee.verdict();
        let record = TrialRecord {
            combination,
            trial,
            condition,
            first: start.objects[0].name.clone(),
            second: start.objects[1].name.clone(),
            collision: verdict.collision,
            success: verdict.success,
            cause: verdict.cause,
            switched: touch.is_some_and(|perceived| perceived.decision.switched),
            reason: String::new(),
            pose_error_mm: None,
            pose_error_deg: None,
            prior_error_mm: None,
            sim_seconds: snapshot.robot.truth().time,
            decision_ms: None,
        };
        watcher.outcome(&record)?;
        Ok(record)
    }

    /// What the referee knows about the estimate, for the record only.
    fn note_perception(&self, record: &mut TrialRecord, start: &Start, perceived: &Perceived) {
        record.reason = perceived.decision.reason.clone();
        record.switched = perceived.decision.switched;
        record.decision_ms = Some(perceived.milliseconds);
        let truth = start.snapshot.robot.truth();
        // A dropped object has no place in the hand that could be estimated.
        if !crate::rehearsal::in_hand(&truth, 0) {
            return;
        }
        let real = truth.palm.inverse() * truth.objects[0];
        let estimate = perceived.felt.estimate.palm_from_object;
        let apart = |pose: &Isometry3<f64>| (pose.translation.vector - real.translation.vector).norm() * 1e3;
        record.pose_error_mm = Some(apart(&estimate));
        record.prior_error_mm = Some(apart(&perceived.felt.prior));
        record.pose_error_deg = Some(start.objects[0].symmetry.angle(&real.rotation, &estimate.rotation).to_degrees());
    }
}

/// Drives to `until` while referee and watcher look on.
fn watch(
    snapshot: &mut Snapshot,
    until: Phase,
    referee: &mut Referee,
    felt: Option<&Felt>,
    condition: Option<Condition>,
    watcher: &mut dyn Watcher,
) -> Result<()> {
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

/// The referee's view of the scene.
fn scene(truth: &Truth, phase: Phase, holding: u32) -> SceneTruth {
    let count = |object: usize| truth.touched_by[object].count_ones() as usize;
    SceneTruth {
        time: truth.time,
        phase: match phase {
            Phase::ApproachFirst => referee::Phase::ApproachFirst,
            Phase::GraspFirst => referee::Phase::GraspFirst,
            Phase::LiftFirst => referee::Phase::LiftFirst,
            Phase::Look | Phase::Decide => referee::Phase::Look,
            Phase::ApproachSecond => referee::Phase::ApproachSecond,
            Phase::GraspSecond => referee::Phase::GraspSecond,
            Phase::LiftSecond => referee::Phase::LiftSecond,
            Phase::Carry => referee::Phase::Carry,
            Phase::Hold => referee::Phase::Hold,
            Phase::Done => referee::Phase::Done,
        },
        first_touches_second: !truth.object_pairs.is_empty(),
        holding_digits_touch_second: phase >= Phase::LiftFirst && truth.touched_by[1] & holding != 0,
        free_digits_touch_second: truth.touched_by[1] & !holding != 0,
        hand_contacts: [count(0), count(1)],
        on_table: [truth.on_table[0], truth.on_table[1]],
        world_from_object: [truth.objects[0], truth.objects[1]],
        world_from_palm: truth.palm,
    }
}
