//! How a trial begins: with which plan, noise and disturbances, on which body; and the trial that cannot begin.

use std::collections::BTreeMap;

use anyhow::Result;
use grasping::Repertoire;
use hand_model::Digit;
use rand_chacha::ChaCha8Rng;
use scenarios::disturbance::Disturbances;
use scenarios::noise::{TrialNoise, trial_rng};
use scenarios::record::{Condition, TrialRecord};
use scenarios::referee::{FailureCause, Referee};

use super::disturbance::{Disturber, resized};
use super::{Bench, ONCE, Place, Run, Start, WATCH_PERIOD, Watcher};
use crate::body::{Body, Setting};
use proving::ball_sizes;
use proving::plan::without::plan_without;
use proving::plan::{Plan, Plans};
use proving::rehearsal::Snapshot;

/// What was planned before digits lost their power.
pub struct Intact {
    /// Grasps.
    pub repertoire: Repertoire,
    /// Combinations.
    pub plans: Plans,
    /// Combinations that cannot be done without those digits, and why.
    pub impossible: BTreeMap<usize, String>,
}

/// What a trial begins with.
pub(super) struct Opening<'a> {
    plan: Plan,
    repertoire: &'a Repertoire,
    noise: TrialNoise,
    camera_noise: u64,
    /// What happens beside noise.
    disturbances: Disturbances,
}

impl Bench {
    /// From now on touch does without `digits`, as well as it can; what was planned stays what `ideal` and `blind` know.
    pub fn do_without(&mut self, digits: &[Digit]) -> Result<()> {
        let without = plan_without(&self.world, &self.repertoire, &self.plans, digits)?;
        self.intact = Some(Intact {
            repertoire: std::mem::replace(&mut self.repertoire, without.repertoire),
            plans: std::mem::replace(&mut self.plans, without.plans),
            impossible: without.impossible,
        });
        Ok(())
    }

    /// A combination as it was planned, undisturbed.
    pub(super) fn opening(&self, combination: usize, noise: TrialNoise, camera_noise: u64) -> Opening<'_> {
        let (repertoire, plans) = match &self.intact {
            Some(intact) => (&intact.repertoire, &intact.plans),
            None => (&self.repertoire, &self.plans),
        };
        let plan = plans.plans[combination].clone();
        Opening { plan, repertoire, noise, camera_noise, disturbances: Disturbances::default() }
    }

    /// The same with the noise and the disturbances of a trial, and the generator as that leaves it.
    pub(super) fn noisy_opening(&self, combination: usize, trial: usize) -> Result<(Opening<'_>, ChaCha8Rng)> {
        let mut rng = trial_rng(self.seed, combination, trial);
        let mut noise = TrialNoise::draw(&self.world.scenario.noise, &mut rng);
        let camera_noise = rand::RngExt::random(&mut rng);
        noise.shifts = self.world.scenario.layout.draw(&mut rng);
        let mut opening = self.opening(combination, noise, camera_noise);
        opening.disturbances = self.world.scenario.disturbance.clone();
        if let Some(sweep) = &opening.disturbances.size_sweep {
            opening.plan = ball_sizes::plan_of(&opening.plan, sweep, trial);
        }
        Ok((opening, rng))
    }

    /// The same trial as touch begins it where digits have no power.
    pub(super) fn without_digits<'a>(&'a self, opening: &Opening<'a>, combination: usize) -> Opening<'a> {
        let (plan, repertoire) = (self.plan(combination).clone(), &self.repertoire);
        Opening { plan, repertoire, disturbances: opening.disturbances.clone(), ..*opening }
    }

    /// The record of a trial for which touch knows no strategy: it does not begin.
    pub(super) fn give_up(
        &self,
        opening: &Opening,
        id: (usize, usize, Condition),
        why: &str,
        watcher: &mut dyn Watcher,
    ) -> Result<TrialRecord> {
        watcher.branch(id.2)?;
        let start = self.at_the_start(opening, None, watcher.active())?;
        let mut run = start.run.clone();
        run.referee.give_up(FailureCause::NoStrategy);
        run.tell(why, None, id.2, watcher)?;
        let record = TrialRecord { reason: why.to_owned(), ..run.record(&start, id)? };
        watcher.outcome(&record)?;
        Ok(record)
    }

    /// Body, controller and referee of a trial about to begin.
    fn at_the_start(&self, opening: &Opening, place: Place, watched: bool) -> Result<Start> {
        let world = &self.world;
        let (first, candidates) = opening.plan.grasps(opening.repertoire)?;
        let objects = [world.object(&opening.plan.first)?, world.object(&opening.plan.second)?];
        let disturber = Disturber::new(&opening.disturbances, &objects);
        let real = resized(&objects, opening.disturbances.sizes())?;
        let grasps = [&first, &candidates[0].grasp];
        let board = self.board.with_noise(opening.camera_noise);
        let watched = place.as_ref().map_or(watched, |(_, task)| task.watched);
        let noise = disturber.misled_at_first(&opening.noise);
        let Snapshot { mut robot, executive } =
            Snapshot::begin_with(world, world.protocol(), &real, grasps, &noise, world.cell.ready, board)?;
        disturber.prepare(&mut robot);
        let robot = match place {
            None => Body::Simulated(Box::new(robot)),
            Some((venue, task)) => {
                let places = world.places(&objects, &noise);
                let named = std::array::from_fn(|n| (objects[n].name.as_str(), places[n]));
                Body::enter(venue, &Setting { task, objects: named }, robot, env!("CARGO_PKG_VERSION"))?
            }
        };
        let mut snapshot = Snapshot { robot, executive };
        if watched {
            snapshot.executive.watch_images(WATCH_PERIOD);
        } else if !snapshot.robot.branches() {
            snapshot.executive.watch_images(ONCE);
        }
        let referee = Referee::new(world.scenario.referee, world.scenario.protocol.hold_time);
        Ok(Start {
            run: Run { snapshot, referee, disturber, spent: self.spent.clone() },
            objects,
            candidates,
            pipeline: None,
        })
    }

    /// Up to the decision.
    pub(super) fn first_half(&self, opening: &Opening, place: Place, watcher: &mut dyn Watcher) -> Result<Start> {
        let mut start = self.at_the_start(opening, place, watcher.active())?;
        match self.to_decision(&mut start.run, watcher) {
            Ok(pipeline) => Ok(Start { pipeline, ..start }),
            Err(error) => {
                // Whatever happened, its recording is finished; the first error is the one to tell.
                let _ = start.run.snapshot.robot.finish(None, Some(&format!("{error:#}")));
                Err(error)
            }
        }
    }
}
