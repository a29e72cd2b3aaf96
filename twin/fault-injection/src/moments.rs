//! Snapshots of body, controller and mirror at drawn moments of a trial without noise, from which faults are injected.

use anyhow::Result;
use bench::trial::Bench;
use control::executor::Phase;
use fault_detection::Mirror;
use fault_detection::seen::Seen;
use grasp_verification::rehearsal::Snapshot;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::kind::tick;
use super::{IMAGES, PHASES, before};

/// Snapshot of body and controller, with the mirror that observes them.
#[derive(Clone)]
pub struct Watched {
    pub snapshot: Snapshot,
    pub mirror: Option<Mirror>,
}

impl Watched {
    /// Begins the ideal run of a combination.
    fn start(bench: &Bench, combination: usize, mirrored: bool) -> Result<Self> {
        let mut snapshot = bench.ideal_start(combination)?;
        snapshot.executor.take_planned(0)?;
        let mirror = if mirrored {
            snapshot.executor.watch_images(IMAGES);
            Some(Mirror::new(&bench.world, &bench.world.cell.ready)?)
        } else {
            None
        };
        Ok(Self { snapshot, mirror })
    }

    fn tick(&mut self) -> Result<()> {
        let Self { snapshot: Snapshot { robot, executor }, mirror } = self;
        let sent = tick(robot, executor)?;
        if let (Some(mirror), Some(sent)) = (mirror, &sent) {
            mirror.see(&Seen::of(executor, robot.time(), sent, None));
        }
        Ok(())
    }

    fn phase(&self) -> Phase {
        self.snapshot.executor.phase()
    }
}

/// Returns snapshots of body, controller and mirror at a drawn moment in each phase of a combination's ideal run.
pub fn moments(bench: &Bench, combination: usize, seed: u64, mirrored: bool) -> Result<Vec<(Phase, Watched)>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut lengths = Counts::default();
    let mut count = |watched: &Watched| *lengths.of(watched.phase()) += 1;
    put_down((bench, combination, false), &mut count)?;
    play((bench, combination, false), &mut count)?;
    let before = before(mirrored);
    // The last ticks are excluded: the fault must strike within the phase.
    let mut drawn = lengths;
    for (_, length) in &mut drawn.0 {
        *length = rng.random_range(1..=length.saturating_sub(before + 5).max(1));
    }
    let (mut moments, mut counts) = (Vec::new(), Counts::default());
    let mut take = |watched: &Watched| {
        let phase = watched.phase();
        let count = counts.of(phase);
        *count += 1;
        if PHASES.contains(&phase) && drawn.of(phase) == count {
            moments.push((phase, watched.clone()));
        }
    };
    play((bench, combination, mirrored), &mut take)?;
    put_down((bench, combination, mirrored), &mut take)?;
    Ok(moments)
}

/// Number of ticks of each phase, in the order in which the phases were entered.
#[derive(Default)]
struct Counts(Vec<(Phase, usize)>);

impl Counts {
    fn of(&mut self, phase: Phase) -> &mut usize {
        let known = self.0.iter().position(|(known, _)| *known == phase).unwrap_or_else(|| {
            self.0.push((phase, 0));
            self.0.len() - 1
        });
        &mut self.0[known].1
    }
}

/// Plays the ideal run of a combination in simulation, with or without a mirror. Calls `see` in every tick.
fn play((bench, combination, mirrored): (&Bench, usize, bool), see: &mut impl FnMut(&Watched)) -> Result<()> {
    let mut watched = Watched::start(bench, combination, mirrored)?;
    while !watched.phase().is_done() {
        watched.snapshot.executor.go_on()?;
        watched.tick()?;
        see(&watched);
    }
    Ok(())
}

/// Plays up to the decision and puts the first object down again, as the touch condition does after losing its grip.
/// Calls `see` in every tick of the put-down.
fn put_down((bench, combination, mirrored): (&Bench, usize, bool), see: &mut impl FnMut(&Watched)) -> Result<()> {
    let mut watched = Watched::start(bench, combination, mirrored)?;
    while !watched.phase().waits() {
        watched.tick()?;
    }
    watched.snapshot.executor.put_down()?;
    while !watched.phase().waits() {
        watched.tick()?;
        if !watched.phase().waits() {
            see(&watched);
        }
    }
    Ok(())
}
