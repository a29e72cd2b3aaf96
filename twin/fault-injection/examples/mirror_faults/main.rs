//! Measures the diagnoses of a mirror on plant faults at drawn moments of blind trials, and on sound trials.
//!
//! `mirror_faults SEED FROM TO PLANT MOMENTS [INDIVIDUAL]` plays trial 0 of combinations FROM to TO - 1 (all effects)
//! with the robot as drawn (PLANT 0) or with hidden individual PLANT. At MOMENTS drawn moments of each trial, one fault
//! of each kind that is observable then strikes in a branch of its own. The branch is played for as long as a diagnosis
//! may take. A diagnosis counts if kind and part are right. A diagnosis that neither the fault nor the ground truth
//! explains counts as wrong, and so does one in the sound trial itself.
//!
//! `mirror_faults sound SEED FROM TO PLANT CONDITIONS TRIALS [INDIVIDUAL]` plays trials 0 to TRIALS - 1 of them under
//! CONDITIONS (such as `blind,touch`) with a mirror beside them and no fault.
//!
//! INDIVIDUAL is the file of an identified robot (`ftac twin identify`), which the control stack and the twin use as
//! their model of the robot. Without it they use the robot as drawn.

mod fault;
mod happened;
mod sound;

use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use bench::builtin::{hide_plant, make_bench};
use bench::robot::robot_of;
use bench::trial::Bench;
use bench::trial::setup::Setup;
use control::executor::Executor;
use fault_detection::Mirror;
use fault_detection::divergence::Divergence;
use fault_detection::seen::Seen;
use hand_model::Hand;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use robot_backends::Body;
use scenarios::Scenario;
use sim::SimulatedRobot;

use self::fault::{Fault, KINDS, same};
use self::happened::Happened;

/// Time limit after a fault within which its diagnosis counts, s.
const WITHIN: f64 = 0.5;
/// Minimum interval between drawn moments, s, and earliest moment, s: before it no camera has taken a second image.
const APART: (f64, f64) = (0.3, 0.6);
/// Length of the trials that moments are drawn from, s.
const TRIAL: f64 = 12.0;

/// A trial in progress.
#[derive(Clone)]
struct Play {
    robot: Box<SimulatedRobot>,
    executor: Executor,
    mirror: Option<Mirror>,
    happened: Happened,
    spent: (u32, Duration),
}

impl Play {
    /// Plays one tick, with the continuous effect of `fault` in it.
    fn tick(&mut self, bench: &Bench, fault: Option<&Fault>) -> Result<()> {
        self.executor.go_on()?;
        let seen = self.robot.observe();
        let command = self.executor.tick(&seen)?;
        let sent = self.robot.send(&command);
        if let Some(fault) = fault {
            fault.press(&mut self.robot);
        }
        self.robot.wait_for_tick();
        self.happened.see(&self.robot.truth(), self.executor.phase());
        let begun = Instant::now();
        let seen = Seen::of(&self.executor, self.robot.time(), &sent, None);
        let mirror = match &mut self.mirror {
            Some(mirror) => mirror,
            none => none.insert(Mirror::new(&bench.world, &seen.arm.position)?),
        };
        mirror.see(&seen);
        self.spent.0 += 1;
        self.spent.1 += begun.elapsed();
        Ok(())
    }

    fn named(&self) -> &[Divergence] {
        self.mirror.as_ref().map_or(&[], Mirror::named)
    }

    fn is_over(&self) -> bool {
        self.executor.phase().is_done()
    }
}

/// Counts of the injected faults of one kind.
#[derive(Debug, Default)]
struct Tally {
    struck: u32,
    named: u32,
    /// Correct diagnoses that came together with another one that nothing explains.
    wrong: u32,
    delays: Vec<f64>,
}

/// Plays the fault branches of one moment.
fn strike(bench: &Bench, play: &Play, rng: &mut ChaCha8Rng, label: &str, tallies: &mut [Tally]) -> Result<()> {
    let hand: &Hand = &bench.world.cell.robot.hand;
    let Some(residuals) = play.mirror.as_ref().map(Mirror::residuals) else { return Ok(()) };
    let mut sound = play.clone();
    let (begun, known) = (play.robot.time(), play.named().len());
    let end = begun + WITHIN - 1e-6;
    while sound.robot.time() < end && !sound.is_over() {
        sound.tick(bench, None)?;
    }
    if sound.is_over() {
        return Ok(());
    }
    for (kind, fault) in Fault::draw(rng, hand, (&play.robot, &play.executor), residuals) {
        let mut branch = play.clone();
        fault.strike(&mut branch.robot, hand);
        while branch.robot.time() < end && !branch.is_over() {
            branch.tick(bench, Some(&fault))?;
        }
        let named = &branch.named()[known..];
        let right = named.iter().find(|named| fault.is(named, hand));
        let explained = |one: &Divergence| {
            fault.is(one, hand)
                || branch.happened.justifies(one)
                || sound.named()[known..].iter().any(|other| same(one, other))
        };
        let wrong: Vec<String> = named.iter().filter(|one| !explained(one)).map(ToString::to_string).collect();
        let tally = &mut tallies[kind];
        tally.struck += 1;
        tally.named += u32::from(right.is_some());
        tally.wrong += u32::from(!wrong.is_empty());
        tally.delays.extend(right.map(|right| right.time - begun));
        if right.is_none() || !wrong.is_empty() {
            let what = if right.is_none() { "missed" } else { "named" };
            println!("{label} {fault:?}: {what}; {}", wrong.join("; "));
        }
    }
    Ok(())
}

/// Plays one trial and the faults at its moments. Returns the sound part of the trial with its diagnoses.
fn trial(
    bench: &Bench,
    (combination, moments): (usize, usize),
    rng: &mut ChaCha8Rng,
    tallies: &mut [Tally],
) -> Result<Play> {
    let (setup, _) = Setup::noisy(bench, combination, 0)?;
    let start = setup.begin(bench, None, true)?;
    let snapshot = start.run.snapshot;
    let Body::Simulated(robot) = snapshot.robot else { bail!("the body is not the simulated one") };
    let (executor, happened) = (snapshot.executor, Happened::default());
    let mut play = Play { robot, executor, mirror: None, happened, spent: Default::default() };
    let mut times: Vec<f64> = (0..moments).map(|_| rng.random_range(APART.1..TRIAL)).collect();
    times.sort_by(f64::total_cmp);
    times.dedup_by(|later, earlier| *later - *earlier < APART.0);
    let mut times = times.into_iter().peekable();
    while !play.is_over() {
        if times.next_if(|time| play.robot.time() >= *time).is_some() {
            let (phase, progress) = (play.executor.phase().name(), play.executor.motion().progress());
            let label = format!("{combination} at {:.2} s ({phase} {progress:.2})", play.robot.time());
            strike(bench, &play, rng, &label, tallies)?;
        }
        play.tick(bench, None)?;
    }
    Ok(play)
}

/// Prepares the first `combos` combinations with the body of hidden individual `plant`, or of the robot as drawn if
/// `plant` is 0. The control stack uses the robot model of the file `individual`, or the robot as drawn.
fn make(combos: usize, seed: u64, plant: u64, individual: Option<&String>) -> Result<Bench> {
    let path = individual.map_or(Path::new(""), Path::new);
    let text = individual.map(|_| ftac_platform::data::read_text(path)).transpose()?;
    let robot = robot_of(None, text.as_deref(), path)?;
    let mut bench = make_bench(&robot, Scenario::benchmark(), combos, seed, true)?;
    if plant > 0 {
        hide_plant(&mut bench, plant)?;
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
    let [seed, from, to, plant, moments, individual @ ..] = &arguments[..] else {
        bail!("expected SEED FROM TO PLANT MOMENTS [INDIVIDUAL], found {} arguments", arguments.len());
    };
    let (seed, plant): (u64, u64) = (seed.parse()?, plant.parse()?);
    let (from, to, moments): (usize, usize, usize) = (from.parse()?, to.parse()?, moments.parse()?);
    let bench = make(to, seed, plant, individual.first())?;
    let mut tallies: Vec<Tally> = KINDS.iter().map(|_| Tally::default()).collect();
    let (mut seconds, mut false_alarms, mut ticks, mut spent) = (0.0, 0, 0, Duration::ZERO);
    let mut alarms: BTreeMap<&str, u32> = BTreeMap::new();
    for combination in from..to {
        let mut rng = ChaCha8Rng::seed_from_u64(seed * 1000 + combination as u64);
        let play = trial(&bench, (combination, moments), &mut rng, &mut tallies)?;
        for named in play.named() {
            let right = play.happened.justifies(named);
            println!("{combination} sound: {named}{}", if right { ", rightly" } else { ", wrongly" });
            false_alarms += u32::from(!right);
            *alarms.entry(named.kind.name()).or_default() += u32::from(!right);
        }
        seconds += play.robot.time();
        (ticks, spent) = (ticks + play.spent.0, spent + play.spent.1);
    }
    let (mut struck, mut named) = (0, 0);
    for (kind, tally) in KINDS.iter().zip(&mut tallies) {
        tally.delays.sort_by(f64::total_cmp);
        let middle = tally.delays.get(tally.delays.len() / 2).copied().unwrap_or(f64::NAN);
        let Tally { struck: of, named: right, wrong, .. } = *tally;
        println!(
            "{kind:18} {right:4} of {of:4} named, median after {middle:.3} s; beside it something wrong in {wrong}"
        );
        (struck, named) = (struck + of, named + right);
    }
    println!(
        "all                {named:4} of {struck:4}, {:.1} %",
        100.0 * f64::from(named) / f64::from(struck.max(1))
    );
    println!("sound: {seconds:.0} s simulated, {false_alarms} named wrongly {alarms:?}");
    println!("the mirror took {:.3} ms a tick", 1e3 * spent.as_secs_f64() / f64::from(ticks.max(1)));
    Ok(())
}
