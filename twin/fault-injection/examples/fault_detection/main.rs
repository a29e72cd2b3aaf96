//! Measures fault detection on plant faults at random moments of blind trials, and on sound trials.
//!
//! `fault_detection SEED FROM TO PLANT MOMENTS [INSTANCE]` runs trial 0 of combinations FROM to TO - 1 (all effects) with
//! the nominal robot (PLANT 0) or with robot instance PLANT, unknown to the controller. At MOMENTS random moments of
//! each trial, one fault of each kind that is observable then is injected, each in its own branch. The branch is run
//! for as long as detection may take. A diagnosis is correct if its kind and part are. A diagnosis that neither the
//! fault nor the ground truth explains counts as wrong, and so does one in the sound trial itself.
//!
//! `fault_detection sound SEED FROM TO PLANT CONDITIONS TRIALS [INSTANCE]` runs trials 0 to TRIALS - 1 of them under
//! CONDITIONS (such as `blind,touch`) with fault detection and without faults.
//!
//! INSTANCE is the file of an identified robot (`ftac sysid identify`), the robot model of control stack and fault
//! detection. Without it they use the nominal model.

mod event_times;
mod fault;
mod sound;

use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use bench::builtin::{make_bench, set_plant_instance};
use bench::robot::robot_from_sources;
use bench::trial::Bench;
use bench::trial::setup::InitialConditions;
use control::executor::Executor;
use fault_detection::FaultDetector;
use fault_detection::fault::DetectedFault;
use fault_detection::measurements::TickMeasurements;
use hand_model::Hand;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use robot_backends::Backend;
use scenarios::Scenario;
use sim::SimulatedRobot;

use self::event_times::FaultEventTimes;
use self::fault::{ExampleFault, FAULT_KINDS, is_same_finding};

/// Time limit after a fault within which its diagnosis counts, s.
const DIAGNOSIS_TIME_LIMIT: f64 = 0.5;
/// Minimum interval between the random moments, s, and earliest moment, s: before it no camera has taken a second
/// image.
const MOMENT_SPACING: (f64, f64) = (0.3, 0.6);
/// Length of the trials that moments are drawn from, s.
const TRIAL_DURATION: f64 = 12.0;

/// A trial in progress.
#[derive(Clone)]
struct RunningTrial {
    robot: Box<SimulatedRobot>,
    executor: Executor,
    detector: Option<FaultDetector>,
    event_times: FaultEventTimes,
    computing_time: (u32, Duration),
}

impl RunningTrial {
    /// Runs one tick, with the continuous effect of `fault` in it.
    fn tick(&mut self, bench: &Bench, fault: Option<&ExampleFault>) -> Result<()> {
        self.executor.continue_as_planned()?;
        let seen = self.robot.observe();
        let command = self.executor.tick(&seen)?;
        let sent = self.robot.send(&command);
        if let Some(fault) = fault {
            fault.apply_push(&mut self.robot);
        }
        self.robot.wait_for_tick();
        self.event_times.record(&self.robot.truth(), self.executor.phase());
        let begun = Instant::now();
        let seen = TickMeasurements::from_executor(&self.executor, self.robot.time(), &sent, None);
        let fault_detector = match &mut self.detector {
            Some(fault_detector) => fault_detector,
            none => none.insert(FaultDetector::new(&bench.world, &seen.arm.position)?),
        };
        fault_detector.update(&seen);
        self.computing_time.0 += 1;
        self.computing_time.1 += begun.elapsed();
        Ok(())
    }

    fn faults(&self) -> &[DetectedFault] {
        self.detector.as_ref().map_or(&[], FaultDetector::faults)
    }

    fn is_over(&self) -> bool {
        self.executor.phase().is_done()
    }
}

/// Counts of the injected faults of one kind.
#[derive(Debug, Default)]
struct Tally {
    injected: u32,
    diagnosed: u32,
    /// Correct diagnoses together with another, unexplained one.
    wrong: u32,
    delays: Vec<f64>,
}

/// Runs the fault branches of one moment.
fn run_fault_branches(
    bench: &Bench,
    running: &RunningTrial,
    rng: &mut ChaCha8Rng,
    label: &str,
    tallies: &mut [Tally],
) -> Result<()> {
    let hand: &Hand = &bench.world.cell.robot.hand;
    let Some(residuals) = running.detector.as_ref().map(FaultDetector::residuals) else { return Ok(()) };
    let mut sound = running.clone();
    let (begun, known) = (running.robot.time(), running.faults().len());
    let end = begun + DIAGNOSIS_TIME_LIMIT - 1e-6;
    while sound.robot.time() < end && !sound.is_over() {
        sound.tick(bench, None)?;
    }
    if sound.is_over() {
        return Ok(());
    }
    for (kind, fault) in ExampleFault::draw(rng, hand, (&running.robot, &running.executor), residuals) {
        let mut branch = running.clone();
        fault.inject(&mut branch.robot, hand);
        while branch.robot.time() < end && !branch.is_over() {
            branch.tick(bench, Some(&fault))?;
        }
        let named = &branch.faults()[known..];
        let right = named.iter().find(|named| fault.matches(named, hand));
        let explained = |one: &DetectedFault| {
            fault.matches(one, hand)
                || branch.event_times.justifies(one)
                || sound.faults()[known..].iter().any(|other| is_same_finding(one, other))
        };
        let wrong: Vec<String> = named.iter().filter(|one| !explained(one)).map(ToString::to_string).collect();
        let tally = &mut tallies[kind];
        tally.injected += 1;
        tally.diagnosed += u32::from(right.is_some());
        tally.wrong += u32::from(!wrong.is_empty());
        tally.delays.extend(right.map(|right| right.time - begun));
        if right.is_none() || !wrong.is_empty() {
            let what = if right.is_none() { "missed" } else { "detected" };
            println!("{label} {fault:?}: {what}; {}", wrong.join("; "));
        }
    }
    Ok(())
}

/// Runs one trial and the faults at its moments. Returns the sound part of the trial with its diagnoses.
fn trial(
    bench: &Bench,
    (combination, moments): (usize, usize),
    rng: &mut ChaCha8Rng,
    tallies: &mut [Tally],
) -> Result<RunningTrial> {
    let (setup, _) = InitialConditions::noisy(bench, combination, 0)?;
    let start = setup.begin(bench, None, true)?;
    let snapshot = start.run.snapshot;
    let Backend::Simulated(robot) = snapshot.robot else { bail!("the backend is not the simulated one") };
    let (executor, happened) = (snapshot.executor, FaultEventTimes::default());
    let mut running =
        RunningTrial { robot, executor, detector: None, event_times: happened, computing_time: Default::default() };
    let mut times: Vec<f64> = (0..moments).map(|_| rng.random_range(MOMENT_SPACING.1..TRIAL_DURATION)).collect();
    times.sort_by(f64::total_cmp);
    times.dedup_by(|later, earlier| *later - *earlier < MOMENT_SPACING.0);
    let mut times = times.into_iter().peekable();
    while !running.is_over() {
        if times.next_if(|time| running.robot.time() >= *time).is_some() {
            let (phase, progress) = (running.executor.phase().name(), running.executor.motion().progress());
            let label = format!("{combination} at {:.2} s ({phase} {progress:.2})", running.robot.time());
            run_fault_branches(bench, &running, rng, &label, tallies)?;
        }
        running.tick(bench, None)?;
    }
    Ok(running)
}

/// Prepares the first `combos` combinations with robot instance `plant` as backend, or the nominal robot if `plant` is
/// 0. The control stack uses the robot model of the file `instance`, or the nominal model.
fn prepare_bench(combos: usize, seed: u64, plant: u64, instance: Option<&String>) -> Result<Bench> {
    let path = instance.map_or(Path::new(""), Path::new);
    let text = instance.map(|_| ftac_platform::data::read_text(path)).transpose()?;
    let robot = robot_from_sources(None, text.as_deref(), path)?;
    let mut bench = make_bench(&robot, Scenario::benchmark(), combos, seed, true)?;
    if plant > 0 {
        set_plant_instance(&mut bench, plant)?;
    }
    Ok(bench)
}

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let [mode, rest @ ..] = &arguments[..]
        && mode == "sound"
    {
        return sound::main(rest);
    }
    let [seed, from, to, plant, moments, instance @ ..] = &arguments[..] else {
        bail!("expected SEED FROM TO PLANT MOMENTS [INSTANCE], found {} arguments", arguments.len());
    };
    let (seed, plant): (u64, u64) = (seed.parse()?, plant.parse()?);
    let (from, to, moments): (usize, usize, usize) = (from.parse()?, to.parse()?, moments.parse()?);
    let bench = prepare_bench(to, seed, plant, instance.first())?;
    let mut tallies: Vec<Tally> = FAULT_KINDS.iter().map(|_| Tally::default()).collect();
    let (mut seconds, mut false_alarms, mut ticks, mut spent) = (0.0, 0, 0, Duration::ZERO);
    let mut alarms: BTreeMap<&str, u32> = BTreeMap::new();
    for combination in from..to {
        let mut rng = ChaCha8Rng::seed_from_u64(seed * 1000 + combination as u64);
        let running = trial(&bench, (combination, moments), &mut rng, &mut tallies)?;
        for named in running.faults() {
            let right = running.event_times.justifies(named);
            println!("{combination} sound: {named}{}", if right { ", rightly" } else { ", wrongly" });
            false_alarms += u32::from(!right);
            *alarms.entry(named.kind.name()).or_default() += u32::from(!right);
        }
        seconds += running.robot.time();
        (ticks, spent) = (ticks + running.computing_time.0, spent + running.computing_time.1);
    }
    let (mut struck, mut named) = (0, 0);
    for (kind, tally) in FAULT_KINDS.iter().zip(&mut tallies) {
        tally.delays.sort_by(f64::total_cmp);
        let middle = tally.delays.get(tally.delays.len() / 2).copied().unwrap_or(f64::NAN);
        let Tally { injected: of, diagnosed: right, wrong, .. } = *tally;
        println!(
            "{kind:18} {right:4} of {of:4} detected, median after {middle:.3} s; additional wrong diagnoses in {wrong}"
        );
        (struck, named) = (struck + of, named + right);
    }
    println!(
        "all                {named:4} of {struck:4}, {:.1} %",
        100.0 * f64::from(named) / f64::from(struck.max(1))
    );
    println!("sound: {seconds:.0} s simulated, {false_alarms} false alarms {alarms:?}");
    println!("fault detection took {:.3} ms a tick", 1e3 * spent.as_secs_f64() / f64::from(ticks.max(1)));
    Ok(())
}
