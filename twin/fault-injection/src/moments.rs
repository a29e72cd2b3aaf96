//! Snapshots of backend, controller and fault detector at random moments of a trial without noise, for the injection of
//! faults.

use anyhow::Result;
use bench::trial::Bench;
use control::executor::Phase;
use fault_detection::FaultDetector;
use fault_detection::measurements::TickMeasurements;
use grasp_verification::rollout::RolloutSnapshot;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::kind::tick;
use super::{IMAGE_INTERVAL, PHASES, ticks_before};

/// Snapshot of backend and controller, with the fault detector that observes them.
#[derive(Clone)]
pub struct TrialSnapshot {
    pub snapshot: RolloutSnapshot,
    pub detector: Option<FaultDetector>,
}

impl TrialSnapshot {
    /// Starts the ideal run of a combination.
    fn start(bench: &Bench, combination: usize, mirrored: bool) -> Result<Self> {
        let mut snapshot = bench.ideal_start(combination)?;
        snapshot.executor.take_planned(0)?;
        let fault_detector = if mirrored {
            snapshot.executor.request_images_every(IMAGE_INTERVAL);
            Some(FaultDetector::new(&bench.world, &bench.world.cell.ready_posture)?)
        } else {
            None
        };
        Ok(Self { snapshot, detector: fault_detector })
    }

    fn tick(&mut self) -> Result<()> {
        let Self { snapshot: RolloutSnapshot { robot, executor }, detector: fault_detector } = self;
        let sent = tick(robot, executor)?;
        if let (Some(fault_detector), Some(sent)) = (fault_detector, &sent) {
            fault_detector.update(&TickMeasurements::from_executor(executor, robot.time(), sent, None));
        }
        Ok(())
    }

    fn phase(&self) -> Phase {
        self.snapshot.executor.phase()
    }
}

/// Returns snapshots of backend, controller and fault detector at a random moment in each phase of a combination's
/// ideal run.
pub fn moments(bench: &Bench, combination: usize, seed: u64, mirrored: bool) -> Result<Vec<(Phase, TrialSnapshot)>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut lengths = Counts::default();
    let mut count = |watched: &TrialSnapshot| *lengths.count_mut(watched.phase()) += 1;
    run_put_down((bench, combination, false), &mut count)?;
    run_ideal((bench, combination, false), &mut count)?;
    let before = ticks_before(mirrored);
    // The last ticks are excluded: the fault must be injected within the phase.
    let mut drawn = lengths;
    for (_, length) in &mut drawn.0 {
        *length = rng.random_range(1..=length.saturating_sub(before + 5).max(1));
    }
    let (mut moments, mut counts) = (Vec::new(), Counts::default());
    let mut take = |watched: &TrialSnapshot| {
        let phase = watched.phase();
        let count = counts.count_mut(phase);
        *count += 1;
        if PHASES.contains(&phase) && drawn.count_mut(phase) == count {
            moments.push((phase, watched.clone()));
        }
    };
    run_ideal((bench, combination, mirrored), &mut take)?;
    run_put_down((bench, combination, mirrored), &mut take)?;
    Ok(moments)
}

/// Number of ticks of each phase, in the order in which the phases were entered.
#[derive(Default)]
struct Counts(Vec<(Phase, usize)>);

impl Counts {
    fn count_mut(&mut self, phase: Phase) -> &mut usize {
        let known = self.0.iter().position(|(known, _)| *known == phase).unwrap_or_else(|| {
            self.0.push((phase, 0));
            self.0.len() - 1
        });
        &mut self.0[known].1
    }
}

/// Runs the ideal run of a combination in simulation, with or without fault detection. Calls `see` in every tick.
fn run_ideal(
    (bench, combination, mirrored): (&Bench, usize, bool),
    see: &mut impl FnMut(&TrialSnapshot),
) -> Result<()> {
    let mut watched = TrialSnapshot::start(bench, combination, mirrored)?;
    while !watched.phase().is_done() {
        watched.snapshot.executor.continue_as_planned()?;
        watched.tick()?;
        see(&watched);
    }
    Ok(())
}

/// Runs up to the decision and puts the first object down again, as the touch condition does after losing its grip.
/// Calls `see` in every tick of the put-down.
fn run_put_down(
    (bench, combination, mirrored): (&Bench, usize, bool),
    see: &mut impl FnMut(&TrialSnapshot),
) -> Result<()> {
    let mut watched = TrialSnapshot::start(bench, combination, mirrored)?;
    while !watched.phase().waits_for_decision() {
        watched.tick()?;
    }
    watched.snapshot.executor.put_down()?;
    while !watched.phase().waits_for_decision() {
        watched.tick()?;
        if !watched.phase().waits_for_decision() {
            see(&watched);
        }
    }
    Ok(())
}
