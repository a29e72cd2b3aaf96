//! The fault matrix: every fault in every phase of a trial, on the emulated robot in lock-step, and what comes of it.
//!
//! A trial without noise is played in simulation; in each of its phases body and controller are copied, the emulated devices are put around the
//! copy, the controller goes on through the whole bridge, and a moment later something breaks. All times are the emulated clock's.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use anyhow::{Context as _, Result, bail};
use control::executive::{Executive, Phase};
use hand_model::robot::Robot;
use hardware_bridge::emulator::lockstep::LockstepRobot;
use hardware_bridge::safety::state::State;
use kortex::emulator::EventKind;
use nalgebra::Isometry3;
use proving::rehearsal::{Snapshot, in_grip};
use proving::world::World;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use scenarios::record::Condition;
use session_log::{Event, Reader, Recorder, Session, Writer};
use sim::robot::Truth;

use self::kind::{Expected, Kind, tick};
use self::watch::Watch;
use crate::body::emulated::{SharedPlant, settings, travel};
use crate::recording::Recording;
use crate::trial::{Bench, Moment, Watcher as _};
use crate::workers;

pub mod kind;
mod recorded;
mod watch;

/// Waited for an answer of the servos from the fault on, s of real time: what comes at all comes sooner.
const SLACK: f64 = 0.04;
/// Ticks through the bridge before the fault, and after the safe state.
const BEFORE: usize = 10;
const AFTER: usize = 60;
/// Longest wait for a safe state, ticks.
const LONGEST: usize = 180;
/// A joint of the sprung arm that is slower than this stands, rad/s: about a degree a second, of which 2 mrad are left to go.
pub const STANDS: f64 = 0.02;
/// An object that moved further than this in the palm is lost, m.
const SLIPPED: f64 = 0.02;
/// Phases with a beginning and an end.
pub const PHASES: [Phase; 12] = [
    Phase::ApproachFirst,
    Phase::GraspFirst,
    Phase::LiftFirst,
    Phase::Look,
    Phase::ApproachSecond,
    Phase::GraspSecond,
    Phase::LiftSecond,
    Phase::Check,
    Phase::Carry,
    Phase::Hold,
    Phase::Verify,
    Phase::PutDown,
];

/// What came of one injection.
#[derive(Debug, Clone)]
pub struct Outcome {
    pub kind: Kind,
    pub phase: Phase,
    pub round: usize,
    /// In the words of the supervisor.
    pub state: String,
    pub as_expected: bool,
    /// From the fault until the supervisor holds, or until servos and arm have stopped by themselves, ms; `None` where the robot rightly went on.
    pub stopped_ms: Option<f64>,
    /// From the fault until the arm stands as well, ms; `None` also where it never did.
    pub safe_ms: Option<f64>,
    /// The fastest joint of the arm at that first moment, rad/s.
    pub speed: f64,
    /// Goals held to their limits, and those outside them.
    pub checked: u64,
    pub outside: u64,
    /// Objects in the hand before, and lost after.
    pub held: usize,
    pub lost: usize,
    /// How far those that were not lost have moved in it at the most, mm.
    pub moved: f64,
    /// Whether the recording could be read to its last tick.
    pub intact: bool,
}

/// Which faults go into which phases.
pub struct Matrix<'a> {
    /// Trials and what they need.
    pub bench: &'a Bench,
    /// Faults.
    pub kinds: Vec<Kind>,
    pub phases: Vec<Phase>,
    /// Times every fault is injected into every phase, each time in another combination.
    pub rounds: usize,
    /// Threads.
    pub jobs: usize,
    /// Seed of everything random.
    pub seed: u64,
    /// Folder for a recording of each injection for the viewer, made of measurements alone as on hardware.
    pub record: Option<PathBuf>,
    /// Whether each is streamed to a viewer, too.
    pub live: bool,
}

/// Injects `kinds` of faults into `phases` of `rounds` trials; the outcomes in the order of the injections.
pub fn inject_all(plan: &Matrix, progress: &indicatif::ProgressBar) -> Result<Vec<Outcome>> {
    let Matrix { bench, kinds, phases, rounds, jobs: threads, seed, .. } = plan;
    let mut jobs = Vec::new();
    for round in 0..*rounds {
        let moments = moments(bench, round % bench.plans.plans.len(), seed ^ round as u64)?;
        for (phase, snapshot) in moments.into_iter().filter(|(phase, _)| phases.contains(phase)) {
            jobs.extend(kinds.iter().map(|kind| (*kind, phase, snapshot.clone(), round)));
        }
    }
    progress.set_length(jobs.len() as u64);
    let outcomes = Mutex::new(BTreeMap::new());
    let folder = tempfile::tempdir().context("a folder for recordings")?;
    workers::for_each(*threads, &jobs, |n, (kind, phase, snapshot, round)| {
        let file = folder.path().join(format!("{n}.mcap"));
        let seed = seed.wrapping_add(n as u64);
        let watcher = plan.watcher(*kind, *phase, *round)?;
        let outcome = inject(bench, (*kind, *phase, *round), (snapshot, watcher), &file, seed)
            .with_context(|| format!("{} in {}, round {round}", kind.name(), phase.name()))?;
        outcomes.lock().map_err(|_| anyhow::anyhow!("a worker panicked"))?.insert(n, outcome);
        progress.inc(1);
        Ok(())
    })?;
    Ok(outcomes.into_inner().unwrap_or_default().into_values().collect())
}

/// Body and controller in each phase of a combination's ideal run, at a drawn moment.
fn moments(bench: &Bench, combination: usize, seed: u64) -> Result<Vec<(Phase, Snapshot)>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut lengths: BTreeMap<Phase, usize> = BTreeMap::new();
    let mut count = |snapshot: &Snapshot| *lengths.entry(snapshot.executive.phase()).or_default() += 1;
    play(bench, combination, &mut count)?;
    put_down(bench, combination, &mut count)?;
    // Not in the last ticks: the fault shall strike in the phase.
    let drawn: BTreeMap<Phase, usize> = lengths
        .into_iter()
        .map(|(phase, length)| (phase, rng.random_range(1..=length.saturating_sub(BEFORE + 5).max(1))))
        .collect();
    let (mut moments, mut counts) = (Vec::new(), BTreeMap::<Phase, usize>::new());
    let mut take = |snapshot: &Snapshot| {
        let phase = snapshot.executive.phase();
        let count = counts.entry(phase).or_default();
        *count += 1;
        if PHASES.contains(&phase) && drawn.get(&phase) == Some(count) {
            moments.push((phase, snapshot.clone()));
        }
    };
    play(bench, combination, &mut take)?;
    put_down(bench, combination, &mut take)?;
    Ok(moments)
}

/// Plays the ideal run of a combination in simulation; `see` is shown every tick.
fn play(bench: &Bench, combination: usize, see: &mut impl FnMut(&Snapshot)) -> Result<()> {
    let (mut snapshot, second) = bench.ideal_start(combination)?;
    while snapshot.executive.phase() < Phase::Done {
        match snapshot.executive.phase() {
            Phase::Decide => snapshot.executive.decide(second.clone())?,
            Phase::Confirm => snapshot.executive.confirm()?,
            _ => {}
        }
        tick(&mut snapshot.robot, &mut snapshot.executive)?;
        see(&snapshot);
    }
    Ok(())
}

/// Plays to the decision and lays the first object down again, as touch does when it has lost its hold; `see` is shown the laying down.
fn put_down(bench: &Bench, combination: usize, see: &mut impl FnMut(&Snapshot)) -> Result<()> {
    let (mut snapshot, _) = bench.ideal_start(combination)?;
    while snapshot.executive.phase() < Phase::Decide {
        tick(&mut snapshot.robot, &mut snapshot.executive)?;
    }
    snapshot.executive.put_down()?;
    while snapshot.executive.phase() == Phase::PutDown {
        tick(&mut snapshot.robot, &mut snapshot.executive)?;
        if snapshot.executive.phase() == Phase::PutDown {
            see(&snapshot);
        }
    }
    Ok(())
}

/// One injection: a copy of body and controller at a moment of a trial, with the emulated devices around it.
struct Experiment {
    kind: Kind,
    executive: Executive,
    recorder: Recorder<LockstepRobot>,
    plant: SharedPlant,
    watch: Watch,
    /// Ticks in which the host took part.
    ticks: u64,
    alive: bool,
    /// From the fault on.
    watcher: Option<Recording>,
    /// The state that was told to it last.
    told: State,
}

/// How the robot stopped.
#[derive(Default)]
struct Stop {
    /// See [`Outcome::stopped_ms`].
    stopped: Option<f64>,
    /// See [`Outcome::safe_ms`].
    safe: Option<f64>,
    /// See [`Outcome::speed`].
    speed: f64,
}

impl Experiment {
    /// Plays [`BEFORE`] ticks through the bridge; the recording goes to `file`.
    fn begin(world: &World, kind: Kind, moment: &Snapshot, file: &Path, seed: u64) -> Result<Self> {
        let Snapshot { robot, mut executive } = moment.clone();
        let (hand, arm) = (&world.cell.hand, &world.cell.arm);
        let plant = SharedPlant::new(robot);
        let robot = LockstepRobot::start(Box::new(plant.clone()), settings(hand, seed), arm, None)?;
        let session =
            Session { robot: "emulated".into(), seed, tick_length: robot.tick_length(), ..Session::default() };
        let mut recorder = Recorder::new(robot, Writer::create(file, &session)?);
        let mut watch = Watch::new(travel(hand));
        for _ in 0..BEFORE {
            tick(&mut recorder, &mut executive)?;
            watch.see(recorder.robot());
        }
        if recorder.robot().state() != State::Running {
            bail!("found the robot in state `{}` before the fault, expected running", recorder.robot().state());
        }
        Ok(Self {
            kind,
            executive,
            recorder,
            plant,
            watch,
            ticks: BEFORE as u64,
            alive: true,
            watcher: None,
            told: State::Running,
        })
    }

    /// Injects the fault and plays until the robot stands, or long enough.
    fn strike(&mut self, since: f64) -> Result<Stop> {
        self.recorder.robot().set_slack(SLACK);
        self.kind.strike(self.recorder.robot());
        let mut stop = Stop::default();
        let patience = if self.kind.expected() == Expected::GoesOn { AFTER } else { LONGEST };
        for _ in 0..patience {
            self.tick()?;
            let now = 1e3 * (self.plant.lock().truth().time - since);
            if is_stopped(self.kind, self.recorder.robot()) {
                let fastest = fastest_joint(self.recorder.robot());
                if stop.stopped.is_none() {
                    (stop.stopped, stop.speed) = (Some(now), fastest);
                }
                if fastest < STANDS {
                    stop.safe = Some(now);
                    break;
                }
            }
        }
        for _ in 0..if stop.safe.is_some() { AFTER } else { 0 } {
            self.tick()?;
        }
        Ok(stop)
    }

    fn tick(&mut self) -> Result<()> {
        self.alive = self.kind.drive(&mut self.recorder, &mut self.executive)? && self.alive;
        self.ticks += u64::from(self.alive);
        self.watch.see(self.recorder.robot());
        if let (Some(watcher), true) = (&mut self.watcher, self.alive) {
            let time = self.recorder.robot().observe().time;
            let state = self.recorder.robot().state();
            // A state is told once.
            let note = (self.told != state).then(|| state.to_string());
            self.told = state;
            let (executive, condition) = (&self.executive, Some(Condition::Ideal));
            let note = note.as_deref();
            watcher.see(&Moment {
                time,
                truth: None,
                executive,
                sent: None,
                felt: None,
                condition,
                note,
                choice: None,
                reversed: false,
            })?;
        }
        Ok(())
    }

    /// Ends the recording; whether it can be read to its last tick.
    fn finish(self, file: &Path) -> Result<bool> {
        let Self { kind, recorder, ticks, watcher, .. } = self;
        watcher.map_or(Ok(()), Recording::finish)?;
        let intact = if kind.kills_the_host() {
            // What the operating system has of the file when the program is gone.
            let copy = file.with_extension("killed.mcap");
            std::fs::copy(file, &copy)?;
            let read = ticks_in(&copy)?;
            std::fs::remove_file(&copy)?;
            drop(recorder);
            read == (ticks, false)
        } else {
            let (robot, written) = recorder.finish();
            drop(robot);
            written?;
            ticks_in(file)? == (ticks, true)
        };
        std::fs::remove_file(file)?;
        Ok(intact)
    }
}

/// One injection and what came of it.
fn inject(
    bench: &Bench,
    injection: (Kind, Phase, usize),
    (moment, watcher): (&Snapshot, Option<Recording>),
    file: &Path,
    seed: u64,
) -> Result<Outcome> {
    let (kind, phase, round) = injection;
    let mut experiment = Experiment::begin(&bench.world, kind, moment, file, seed)?;
    experiment.watcher = watcher;
    let truth = experiment.plant.lock().truth();
    // The hand goes down to the second object with the first in it, so that height does not tell what is held.
    let held: Vec<(usize, Isometry3<f64>)> =
        (0..2).filter(|object| in_grip(&truth, *object)).map(|object| (object, in_palm(&truth, object))).collect();
    let Stop { stopped, safe, speed } = experiment.strike(truth.time)?;
    let truth = experiment.plant.lock().truth();
    // Where the robot goes on it may let go on purpose.
    let after = held.iter().filter(|_| safe.is_some()).map(|(object, before)| {
        let way = (in_palm(&truth, *object).translation.vector - before.translation.vector).norm();
        (truth.touched_by[*object] != 0).then_some(way).filter(|way| *way < SLIPPED)
    });
    let lost = after.clone().filter(Option::is_none).count();
    let moved = 1e3 * after.flatten().fold(0.0, f64::max);
    let state = experiment.recorder.robot().state();
    let (checked, outside) = (experiment.watch.checked, experiment.watch.outside);
    Ok(Outcome {
        kind,
        phase,
        round,
        as_expected: kind.expected().fits(&state, safe.is_some()),
        state: state.to_string(),
        stopped_ms: stopped,
        safe_ms: safe,
        speed,
        checked,
        outside,
        held: held.len(),
        lost,
        moved,
        intact: experiment.finish(file)?,
    })
}

/// Whether no command moves the robot any more: the supervisor holds, or where there is none left, servos and arm have stopped by themselves.
fn is_stopped(kind: Kind, robot: &mut LockstepRobot) -> bool {
    if kind.kills_the_host() {
        let by_itself = robot.arm().status().events.iter().any(|event| event.what == EventKind::Watchdog);
        robot.devices().watchdogs_tripped() == 6 && by_itself
    } else {
        matches!(robot.state(), State::Hold(_) | State::Fault(_))
    }
}

/// Where object `index` is in the palm.
fn in_palm(truth: &Truth, index: usize) -> Isometry3<f64> {
    truth.palm.inverse() * truth.objects[index]
}

/// Speed of the arm's fastest joint, rad/s.
fn fastest_joint(robot: &mut LockstepRobot) -> f64 {
    robot.arm().status().motion.velocity.iter().map(|speed| speed.abs()).fold(0.0, f64::max)
}

/// Ticks in a recording, and whether it was finished.
fn ticks_in(file: &Path) -> Result<(u64, bool)> {
    let mut reader = Reader::open(file)?;
    let mut ticks = 0;
    while let Some((_, event)) = reader.next_event()? {
        ticks += u64::from(matches!(event, Event::Tick(_)));
    }
    Ok((ticks, reader.is_whole()))
}
