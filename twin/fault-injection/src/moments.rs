//! Body, controller and mirror at drawn moments of a trial without noise, from which faults are injected.

use std::collections::BTreeMap;

use anyhow::Result;
use bench::mirror::Mirror;
use bench::mirror::seen::Seen;
use bench::trial::Bench;
use control::executive::Phase;
use grasping::Grasp;
use proving::rehearsal::Snapshot;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::kind::tick;
use super::{IMAGES, PHASES, before};

/// Body and controller, and a mirror that looks on.
#[derive(Clone)]
pub struct Watched {
    pub snapshot: Snapshot,
    pub mirror: Option<Mirror>,
}

impl Watched {
    /// About to begin the ideal run of a combination, and the grasp of the second object.
    fn start(bench: &Bench, combination: usize, mirrored: bool) -> Result<(Self, Grasp)> {
        let (mut snapshot, second) = bench.ideal_start(combination)?;
        let mirror = if mirrored {
            snapshot.executive.watch_images(IMAGES);
            Some(Mirror::new(&bench.world, &bench.world.cell.ready)?)
        } else {
            None
        };
        Ok((Self { snapshot, mirror }, second))
    }

    fn tick(&mut self) -> Result<()> {
        let Self { snapshot: Snapshot { robot, executive }, mirror } = self;
        let sent = tick(robot, executive)?;
        if let (Some(mirror), Some(sent)) = (mirror, &sent) {
            mirror.see(&Seen::of(executive, robot.time(), sent, None));
        }
        Ok(())
    }

    fn phase(&self) -> Phase {
        self.snapshot.executive.phase()
    }
}

/// Body, controller and mirror in each phase of a combination's ideal run, at a drawn moment.
pub fn moments(bench: &Bench, combination: usize, seed: u64, mirrored: bool) -> Result<Vec<(Phase, Watched)>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut lengths: BTreeMap<Phase, usize> = BTreeMap::new();
    let mut count = |watched: &Watched| *lengths.entry(watched.phase()).or_default() += 1;
    play((bench, combination, false), &mut count)?;
    put_down((bench, combination, false), &mut count)?;
    let before = before(mirrored);
    // Not in the last ticks: the fault shall strike in the phase.
    let drawn: BTreeMap<Phase, usize> = lengths
        .into_iter()
        .map(|(phase, length)| (phase, rng.random_range(1..=length.saturating_sub(before + 5).max(1))))
        .collect();
    let (mut moments, mut counts) = (Vec::new(), BTreeMap::<Phase, usize>::new());
    let mut take = |watched: &Watched| {
        let phase = watched.phase();
        let count = counts.entry(phase).or_default();
        *count += 1;
        if PHASES.contains(&phase) && drawn.get(&phase) == Some(count) {
            moments.push((phase, watched.clone()));
        }
    };
    play((bench, combination, mirrored), &mut take)?;
    put_down((bench, combination, mirrored), &mut take)?;
    Ok(moments)
}

/// Plays the ideal run of a combination in simulation, mirrored or not; `see` is shown every tick.
fn play((bench, combination, mirrored): (&Bench, usize, bool), see: &mut impl FnMut(&Watched)) -> Result<()> {
    let (mut watched, second) = Watched::start(bench, combination, mirrored)?;
    while watched.phase() < Phase::Done {
        match watched.phase() {
            Phase::Decide => watched.snapshot.executive.decide(second.clone())?,
            Phase::Confirm => watched.snapshot.executive.confirm()?,
            _ => {}
        }
        watched.tick()?;
        see(&watched);
    }
    Ok(())
}

/// Plays to the decision and lays the first object down again, as touch does when it has lost its hold; `see` is shown the laying down.
fn put_down((bench, combination, mirrored): (&Bench, usize, bool), see: &mut impl FnMut(&Watched)) -> Result<()> {
    let (mut watched, _) = Watched::start(bench, combination, mirrored)?;
    while watched.phase() < Phase::Decide {
        watched.tick()?;
    }
    watched.snapshot.executive.put_down()?;
    while watched.phase() == Phase::PutDown {
        watched.tick()?;
        if watched.phase() == Phase::PutDown {
            see(&watched);
        }
    }
    Ok(())
}
