//! Fault matrix: injects every fault into every phase of a trial on the emulated robot in lock-step, and records the
//! outcomes.
//!
//! A trial without noise is run in simulation. In each of its phases, backend and controller are copied, with the
//! emulated devices around the copy. The controller then continues through the whole hardware bridge, and a moment
//! later the fault is injected. All times are on the emulated clock.

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use anyhow::{Context as _, Result, bail};
use bench::recording::Recording;
use bench::trial::{Bench, TickView, Watcher as _};
use bench::workers;
use control::executor::{Executor, Phase, Skill};
use fault_detection::FaultDetector;
use fault_detection::fault::DetectedFault;
use fault_detection::measurements::TickMeasurements;
use grasp_verification::rollout::{RolloutSnapshot, in_grip};
use grasp_verification::simulated_world::SimulatedWorld;
use hand_model::robot::{RobotBackend, RobotCommand};
use hardware_bridge::emulator::lockstep::LockstepRobot;
use hardware_bridge::safety::state::SupervisorState;
use kinova_kortex::emulator::EventKind;
use nalgebra::Isometry3;
use progress::interrupt::Interrupted;
use robot_backends::wire_emulation::{SharedPlant, lockstep_settings, shaft_travel};
use robot_session_log::{RobotSizes, SessionEvent, SessionHeader, SessionReader, SessionRecorder, SessionWriter};
use scenarios::record::Condition;
use serde::{Deserialize, Serialize};
use sim::robot::GroundTruth;

use self::kind::{DetectingParty, ExpectedOutcome, InjectedFault, tick};
use self::ledger::Ledger;
use self::limit_watch::LimitWatch;
use self::moments::{TrialSnapshot, moments};

pub mod kind;
pub mod ledger;
mod limit_watch;
mod moments;
pub mod plant;
mod recordings;
pub mod table;

/// Time limit for an answer of the servos after a fault, s of real time: every answer comes sooner, if at all.
const SERVO_ANSWER_TIMEOUT: f64 = 0.04;
/// Ticks run through the bridge before the fault.
const TICKS_BEFORE_FAULT: usize = 10;
/// Ticks before the fault with fault detection, which registers the change of the backend.
const TICKS_BEFORE_WITH_DETECTOR: usize = 40;
/// Ticks run after the safe state, or after a fault that the robot survives.
const TICKS_AFTER_STOP: usize = 60;
/// Longest wait for a safe state, ticks.
const MAX_STOP_TICKS: usize = 180;
/// Standstill threshold of a joint of the compliant arm, rad/s: about a degree per second, with 2 mrad of travel left.
pub const STANDSTILL_SPEED: f64 = 0.02;
/// Displacement in the palm beyond which an object counts as lost, m.
const SLIP_TOLERANCE: f64 = 0.02;
/// Interval between the images for fault detection, s.
const IMAGE_INTERVAL: f64 = 0.2;
/// Time limit for the detection of a fault, s.
pub const DIAGNOSIS_TIME_LIMIT: f64 = 0.5;
/// Phases with a duration.
pub const PHASES: [Phase; 12] = [
    Phase::run(Skill::Approach, 0),
    Phase::run(Skill::Grasp, 0),
    Phase::run(Skill::Lift, 0),
    Phase::run(Skill::Snapshot, 0),
    Phase::run(Skill::Approach, 1),
    Phase::run(Skill::Grasp, 1),
    Phase::run(Skill::Lift, 1),
    Phase::run(Skill::Snapshot, 1),
    Phase::run(Skill::Carry, 0),
    Phase::run(Skill::Hold, 0),
    Phase::run(Skill::Verify, 0),
    Phase::run(Skill::PutDown, 0),
];

/// Outcome of one injection.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct InjectionOutcome {
    pub kind: InjectedFault,
    #[serde(with = "ledger::phase")]
    pub phase: Phase,
    pub round: usize,
    /// Final state of the supervisor, in its words.
    pub state: String,
    pub as_expected: bool,
    /// Time from the fault until the supervisor holds, or until servos and arm have stopped by themselves, ms. `None`
    /// if the robot rightly continued.
    pub stopped_ms: Option<f64>,
    /// Time from the fault until the arm stands still as well, ms; also `None` if it never did.
    pub safe_ms: Option<f64>,
    /// Speed of the fastest arm joint when the robot stopped ([`InjectionOutcome::stopped_ms`]), rad/s.
    pub speed: f64,
    /// Number of goals that were checked against their limits.
    pub checked: u64,
    /// Number of goals outside their limits.
    pub outside: u64,
    /// Objects in the hand before the fault.
    pub held: usize,
    /// Objects of those that were lost.
    pub lost: usize,
    /// Largest displacement in the palm of the held objects that were not lost, mm.
    pub moved: f64,
    /// True if the recording could be read to its last tick.
    pub intact: bool,
    /// Diagnosis of the fault, if fault detection ran.
    #[serde(alias = "mirrored")]
    pub diagnosis: Option<InjectionDiagnosis>,
}

/// Diagnosis of one injection by fault detection or the supervisor.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct InjectionDiagnosis {
    /// Time from the fault to its detection by the party that can detect it ([`InjectedFault::detecting_party`]), ms.
    /// `None` if there was none within [`DIAGNOSIS_TIME_LIMIT`].
    #[serde(alias = "told_ms")]
    pub detected_ms: Option<f64>,
    /// Reports of fault detection other than that of the fault.
    pub wrong: Vec<String>,
}

impl InjectionDiagnosis {
    /// True if the fault was detected, or rightly was not, and nothing else was reported.
    pub fn is_correct(&self, kind: InjectedFault) -> bool {
        self.wrong.is_empty() && (kind.detecting_party() == DetectingParty::Nobody || self.detected_ms.is_some())
    }
}

/// Returns the number of ticks through the bridge before a fault.
fn ticks_before(mirrored: bool) -> usize {
    if mirrored { TICKS_BEFORE_WITH_DETECTOR } else { TICKS_BEFORE_FAULT }
}

/// Request of a fault matrix: the faults, and the phases in which they are injected.
pub struct FaultMatrix<'a> {
    /// Trials and their world.
    pub bench: &'a Bench,
    /// Kinds of faults.
    pub kinds: Vec<InjectedFault>,
    pub phases: Vec<Phase>,
    /// Number of times that each fault is injected into each phase, each time in another combination.
    pub rounds: usize,
    /// Number of threads.
    pub jobs: usize,
    /// Seed of all random draws.
    pub seed: u64,
    /// Folder for a viewer recording of each injection, made of measurements alone as on hardware.
    pub record: Option<PathBuf>,
    /// True if each injection is also streamed to a viewer.
    pub live: bool,
    /// True if fault detection runs beside each injection.
    pub with_detector: bool,
}

/// Injects the `kinds` of faults into the `phases` of `rounds` trials, except those that `ledger` already has. Each
/// outcome is written to the ledger at once. Returns all outcomes in the order of the injections. Ends early once
/// `interrupted` returns true.
pub fn inject_all(
    plan: &FaultMatrix,
    ledger: Ledger,
    progress: &indicatif::ProgressBar,
    interrupted: &(dyn Fn() -> bool + Sync),
) -> Result<Vec<InjectionOutcome>> {
    let FaultMatrix { bench, kinds, phases, rounds, jobs: threads, seed, .. } = plan;
    let mut jobs = Vec::new();
    for round in 0..*rounds {
        let moments = moments(bench, round % bench.grasp_pairs.pairs.len(), seed ^ round as u64, plan.with_detector)?;
        for (phase, moment) in moments.into_iter().filter(|(phase, _)| phases.contains(phase)) {
            jobs.extend(kinds.iter().map(|kind| (*kind, phase, moment.clone(), round)));
        }
    }
    let total = jobs.len();
    let open: Vec<_> = jobs.into_iter().enumerate().filter(|(n, _)| !ledger.done.contains_key(n)).collect();
    progress.set_length(total as u64);
    progress.set_position((total - open.len()) as u64);
    let (ledger, place) = (Mutex::new(ledger), tempfile::tempdir().context("a folder for recordings")?);
    workers::for_each(*threads, &open, |_, (n, (kind, phase, moment, round))| {
        if interrupted() {
            let ledger = ledger.lock().map_err(|_| anyhow::anyhow!("a worker panicked"))?;
            let resume_hint = format!("continue with `ftac bridge faults --resume {}`", ledger.folder.display());
            bail!(Interrupted { done: ledger.done.len(), total, pieces: "injections are done", resume_hint });
        }
        let file = place.path().join(format!("{n}.mcap"));
        let seed = seed.wrapping_add(*n as u64);
        let watcher = plan.open_recording(*kind, *phase, *round)?;
        let outcome = inject(bench, (*kind, *phase, *round), (moment, watcher), &file, seed)
            .with_context(|| format!("{} in {}, round {round}", kind.name(), phase.name()))?;
        ledger.lock().map_err(|_| anyhow::anyhow!("a worker panicked"))?.append(*n, outcome)?;
        progress.inc(1);
        Ok(())
    })?;
    let ledger = ledger.into_inner().map_err(|_| anyhow::anyhow!("a worker panicked"))?;
    Ok(ledger.done.into_values().collect())
}

/// One injection: a copy of backend and controller at a moment of a trial, with the emulated devices around it.
struct Experiment {
    kind: InjectedFault,
    executor: Executor,
    recorder: SessionRecorder<LockstepRobot>,
    plant: SharedPlant,
    limit_watch: LimitWatch,
    /// Number of ticks in which the host took part.
    ticks: u64,
    alive: bool,
    /// Viewer recording, from the fault on.
    watcher: Option<Recording>,
    /// State that was last reported to the viewer recording.
    reported_state: SupervisorState,
    /// Fault detector, which observes as long as the robot follows its commands.
    detector: Option<FaultDetector>,
    /// Faults detected since the injection.
    faults: Vec<DetectedFault>,
    /// Time at which the supervisor first stopped the robot, s.
    hold_time: Option<f64>,
}

/// Times and speed of a stop.
#[derive(Default)]
struct StopTimes {
    /// See [`InjectionOutcome::stopped_ms`].
    stopped: Option<f64>,
    /// See [`InjectionOutcome::safe_ms`].
    safe: Option<f64>,
    /// See [`InjectionOutcome::speed`].
    speed: f64,
}

impl Experiment {
    /// Runs the ticks before the fault ([`TICKS_BEFORE_FAULT`], or [`TICKS_BEFORE_WITH_DETECTOR`] with fault detection)
    /// through the bridge and records them to `file`.
    fn begin(
        world: &SimulatedWorld,
        kind: InjectedFault,
        moment: &TrialSnapshot,
        file: &Path,
        seed: u64,
    ) -> Result<Self> {
        let TrialSnapshot { snapshot: RolloutSnapshot { robot, mut executor }, detector: mut fault_detector } =
            moment.clone();
        let model = &world.cell.robot;
        let plant = SharedPlant::new(robot);
        if fault_detector.is_some() {
            // The devices' clock starts at zero.
            executor.request_images_every(IMAGE_INTERVAL);
        }
        let robot = LockstepRobot::start(Box::new(plant.clone()), lockstep_settings(&model.hand, seed), model, None)?;
        let session = SessionHeader {
            robot: "emulated".into(),
            seed,
            tick_length: robot.tick_length(),
            ..SessionHeader::default()
        };
        let mut recorder = SessionRecorder::new(robot, SessionWriter::create(file, &session)?);
        let mut watch = LimitWatch::new(shaft_travel(&model.hand), &model.arm);
        let before = ticks_before(fault_detector.is_some());
        for _ in 0..before {
            let sent = tick(&mut recorder, &mut executor)?;
            watch.check(recorder.robot());
            if let (Some(fault_detector), Some(sent)) = (&mut fault_detector, &sent) {
                fault_detector.update(&TickMeasurements::from_executor(&executor, plant.lock().time(), sent, None));
            }
        }
        if recorder.robot().state() != SupervisorState::Running {
            bail!("found the robot in state `{}` before the fault, expected running", recorder.robot().state());
        }
        Ok(Self {
            kind,
            executor,
            recorder,
            plant,
            limit_watch: watch,
            ticks: before as u64,
            alive: true,
            watcher: None,
            reported_state: SupervisorState::Running,
            detector: fault_detector,
            faults: Vec::new(),
            hold_time: None,
        })
    }

    /// Injects the fault and runs until the robot stands still or the time limit is reached.
    fn inject_and_play(&mut self, since: f64) -> Result<StopTimes> {
        self.recorder.robot().set_slack(SERVO_ANSWER_TIMEOUT);
        self.kind.inject(self.recorder.robot());
        let mut stop = StopTimes::default();
        let patience = if self.kind.expected() == ExpectedOutcome::GoesOn { TICKS_AFTER_STOP } else { MAX_STOP_TICKS };
        for _ in 0..patience {
            self.tick()?;
            let now = 1e3 * (self.plant.lock().time() - since);
            if is_stopped(self.kind, self.recorder.robot()) {
                let fastest = fastest_joint(self.recorder.robot());
                if stop.stopped.is_none() {
                    (stop.stopped, stop.speed) = (Some(now), fastest);
                }
                if fastest < STANDSTILL_SPEED {
                    stop.safe = Some(now);
                    break;
                }
            }
        }
        for _ in 0..if stop.safe.is_some() { TICKS_AFTER_STOP } else { 0 } {
            self.tick()?;
        }
        Ok(stop)
    }

    fn tick(&mut self) -> Result<()> {
        let sent = self.kind.run_tick(&mut self.recorder, &mut self.executor)?;
        self.alive = self.alive && !self.kind.ends_host_program();
        self.ticks += u64::from(self.alive);
        self.limit_watch.check(self.recorder.robot());
        self.update_detector(sent.as_ref());
        if let (Some(watcher), true) = (&mut self.watcher, self.alive) {
            let time = self.plant.lock().time();
            let state = self.recorder.robot().state();
            // A state is reported once.
            let note = (self.reported_state != state).then(|| state.to_string());
            self.reported_state = state;
            let (executor, condition) = (&self.executor, Some(Condition::Ideal));
            let note = note.as_deref();
            watcher.on_tick(&TickView {
                time,
                truth: None,
                executor,
                sent: None,
                felt: &[],
                condition,
                note,
                choice: None,
                reversed: false,
            })?;
        }
        Ok(())
    }

    /// Passes the tick in which `sent` was sent to the fault detector. Fault detection ends with the first tick in
    /// which the robot does not follow its commands: from there on the supervisor reports the fault.
    fn update_detector(&mut self, sent: Option<&RobotCommand>) {
        if self.recorder.robot().state() != SupervisorState::Running {
            self.hold_time = self.hold_time.or_else(|| Some(self.plant.lock().time()));
        }
        let (Some(fault_detector), Some(sent), None) = (&mut self.detector, sent, self.hold_time) else { return };
        let time = self.plant.lock().time();
        self.faults.extend_from_slice(fault_detector.update(&TickMeasurements::from_executor(
            &self.executor,
            time,
            sent,
            None,
        )));
    }

    /// Summarises the diagnosis of a fault injected at `since` (s).
    fn diagnosis(&self, since: f64) -> Option<InjectionDiagnosis> {
        self.detector.as_ref()?;
        let teller = self.kind.detecting_party();
        let (named, other): (Vec<_>, Vec<_>) = self.faults.iter().partition(|named| match teller {
            DetectingParty::FaultDetector(kind) => named.kind == kind,
            _ => false,
        });
        let told = match teller {
            DetectingParty::Nobody => None,
            DetectingParty::Supervisor => self.hold_time,
            DetectingParty::FaultDetector(_) => named.first().map(|named| named.time),
        };
        let told_ms =
            told.map(|time| time - since).filter(|delay| *delay < DIAGNOSIS_TIME_LIMIT).map(|delay| 1e3 * delay);
        Some(InjectionDiagnosis { detected_ms: told_ms, wrong: other.iter().map(ToString::to_string).collect() })
    }

    /// Ends the recording. Returns true if it can be read to its last tick.
    fn finish(self, file: &Path) -> Result<bool> {
        let Self { kind, recorder, ticks, watcher, .. } = self;
        watcher.map_or(Ok(()), Recording::finish)?;
        let intact = if kind.ends_host_program() {
            // The part of the file that the operating system has when the program is killed.
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

/// Runs one injection and evaluates its outcome.
fn inject(
    bench: &Bench,
    injection: (InjectedFault, Phase, usize),
    (moment, watcher): (&TrialSnapshot, Option<Recording>),
    file: &Path,
    seed: u64,
) -> Result<InjectionOutcome> {
    let (kind, phase, round) = injection;
    let mut experiment = Experiment::begin(&bench.world, kind, moment, file, seed)?;
    experiment.watcher = watcher;
    let truth = experiment.plant.lock().truth();
    // Height does not show which objects are held: the hand goes down to the second object with the first in it.
    let held: Vec<(usize, Isometry3<f64>)> = (0..2)
        .filter(|object| in_grip(&truth, *object))
        .map(|object| (object, palm_from_object(&truth, object)))
        .collect();
    let since = truth.time;
    let StopTimes { stopped, safe, speed } = experiment.inject_and_play(since)?;
    let truth = experiment.plant.lock().truth();
    // A robot that continues may release an object on purpose.
    let after = held.iter().filter(|_| safe.is_some()).map(|(object, before)| {
        let way = (palm_from_object(&truth, *object).translation.vector - before.translation.vector).norm();
        (truth.touched_by[*object] != 0).then_some(way).filter(|way| *way < SLIP_TOLERANCE)
    });
    let lost = after.clone().filter(Option::is_none).count();
    let moved = 1e3 * after.flatten().fold(0.0, f64::max);
    let state = experiment.recorder.robot().state();
    let (checked, outside) = (experiment.limit_watch.checked, experiment.limit_watch.outside_limits);
    Ok(InjectionOutcome {
        kind,
        phase,
        round,
        as_expected: kind.expected().is_met_by(&state, safe.is_some()),
        state: state.to_string(),
        stopped_ms: stopped,
        safe_ms: safe,
        speed,
        checked,
        outside,
        held: held.len(),
        lost,
        moved,
        diagnosis: experiment.diagnosis(since),
        intact: experiment.finish(file)?,
    })
}

/// True if no command moves the robot any more: the supervisor holds, or, without the host, servos and arm have stopped
/// by themselves.
fn is_stopped(kind: InjectedFault, robot: &mut LockstepRobot) -> bool {
    if kind.ends_host_program() {
        let by_itself = robot.arm().status().events.iter().any(|event| event.what == EventKind::Watchdog);
        robot.devices().watchdogs_tripped() == 6 && by_itself
    } else {
        matches!(robot.state(), SupervisorState::Hold(_) | SupervisorState::Fault(_))
    }
}

/// Returns `palm_from_object` of object `index`.
fn palm_from_object(truth: &GroundTruth, index: usize) -> Isometry3<f64> {
    truth.palm.inverse() * truth.objects[index]
}

/// Returns the speed of the arm's fastest joint, rad/s.
fn fastest_joint(robot: &mut LockstepRobot) -> f64 {
    robot.arm().status().motion.velocity.iter().map(|speed| speed.abs()).fold(0.0, f64::max)
}

/// Returns the number of ticks in a recording, and true if it was finished.
fn ticks_in(file: &Path) -> Result<(u64, bool)> {
    let mut reader = SessionReader::open(file, RobotSizes::Any)?;
    let mut ticks = 0;
    while let Some((_, event)) = reader.next_event()? {
        ticks += u64::from(matches!(event, SessionEvent::Tick(_)));
    }
    Ok((ticks, reader.is_finished()))
}
