//! `ftac trial`: plays and records one trial.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use bench::builtin::{COMBINATIONS, expect_errors, make_bench, read_pads_by};
use bench::fault_watch::beside;
use bench::recording::Recording;
use bench::robot::robot_of;
use bench::trial::Watcher;
use clap::{Args, ValueEnum};
use fault_detection::divergence::Divergence;
use robot_backends::Task;
use scenarios::record::Condition;
use scenarios::record::TrialRecord;
use schemars::JsonSchema;
use serde::Serialize;

use crate::options::body::{Body, PlaceArgs, check_body, source};
use crate::options::robot::{RobotArgs, individual, pads, say_whose_pads};
use crate::options::scenario::ScenarioArgs;
use crate::options::tactile_backend::TactileBackend;
use crate::terminal::{Outcome, Terminal};

/// Arguments of `trial`.
#[derive(Debug, Args)]
pub struct TrialArgs {
    /// Number of the combination, from 0.
    pub combination: usize,
    /// Number of the trial, from 0.
    #[arg(long, default_value_t = 0)]
    pub trial: usize,
    /// Policy; `ideal` runs without noise.
    #[arg(long, value_enum, default_value_t = Policy::Touch)]
    pub policy: Policy,
    #[command(flatten)]
    pub model: RobotArgs,
    #[command(flatten)]
    pub scenario: ScenarioArgs,
    /// Robot backend.
    #[arg(long, value_enum, default_value_t = Body::Sim)]
    pub robot: Body,
    /// Individual robot for both the backend and the control stack: a file of `ftac twin identify`; default: the
    /// nominal robot.
    #[arg(long, value_name = "FILE")]
    pub individual: Option<PathBuf>,
    /// Calibration of the tactile pads: a file of `ftac touch train`, or of the hand's own pads; default: that of the
    /// nominal pads.
    #[arg(long, value_name = "FILE")]
    pub pads: Option<PathBuf>,
    /// Simulate candidates for the second grasp (rollouts from the state as felt) before one is chosen.
    #[arg(long)]
    pub foresee: bool,
    /// Run a twin in parallel with the robot, show it as a ghost, and name the divergences.
    #[arg(long)]
    pub mirror: bool,
    /// Configuration file of the hardware bridge, for --robot hardware.
    #[arg(long)]
    pub config: Option<PathBuf>,
    #[command(flatten)]
    pub places: PlaceArgs,
    /// Folder for the session's MCAP file, for `ftac replay`; hardware always records, into recordings/sessions by default.
    #[arg(long)]
    pub session: Option<PathBuf>,
    /// Stream to a Rerun viewer.
    #[arg(long)]
    pub live: bool,
    /// Renderer of the tactile images.
    #[arg(long, value_enum, default_value_t = TactileBackend::Cpu)]
    pub tactile: TactileBackend,
    /// Also record the true scene of an emulated robot; otherwise its recording shows only measurements and beliefs.
    #[arg(long)]
    pub truth: bool,
    /// Recording file for the viewer; default: recordings/combination_N_trial_K_POLICY.rrd. For hardware it shows
    /// measurements and beliefs.
    #[arg(long)]
    pub out: Option<PathBuf>,
}

/// Policy that decides the second grasp.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Policy {
    /// As planned, without noise.
    Ideal,
    /// As planned.
    Blind,
    /// Looks and retries by encoders and currents, without tactile images.
    Reflex,
    /// Adapts to the tactile images.
    Touch,
}

impl Policy {
    /// Returns the condition of the benchmark that this policy plays.
    pub fn condition(self) -> Condition {
        match self {
            Self::Ideal => Condition::Ideal,
            Self::Blind => Condition::Blind,
            Self::Reflex => Condition::Reflex,
            Self::Touch => Condition::Touch,
        }
    }
}

/// JSON output of `trial`: the record, and the divergences that a mirror (parallel twin) named.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Played<'a> {
    #[serde(flatten)]
    record: &'a TrialRecord,
    /// With --mirror: divergences between robot and twin.
    #[serde(skip_serializing_if = "Option::is_none")]
    divergences: Option<&'a [Divergence]>,
}

/// Runs `ftac trial`: plays one trial and records it.
pub fn trial(terminal: &Terminal, args: &TrialArgs) -> Outcome {
    check_body(args.robot, args.config.as_deref(), &[args.policy.condition()])?;
    let places = args.places.places(args.robot)?;
    let (scenario, text) = args.scenario.read()?;
    let pairs = scenario.combinations().min(COMBINATIONS);
    if args.combination >= pairs {
        bail!("COMBO: found {}, expected 0 to {}", args.combination, pairs - 1);
    }
    let combos = args.combination + 1;
    let nominal = args.model.model()?;
    args.robot.expect(&nominal)?;
    let (individual, path) = individual(args.individual.as_deref(), &nominal)?;
    let pads = pads(args.pads.as_deref(), &nominal)?;
    let robot_model = nominal.sources;
    let quiet = terminal.quiet || terminal.json;
    let model = robot_of(robot_model.as_ref(), individual.as_deref(), &path)?;
    let mut bench = make_bench(&model, scenario, combos, terminal.seed, quiet)?;
    if bench.plans.plans.len() <= args.combination {
        bail!(
            "COMBO: found {}, expected 0 to {}: {}",
            args.combination,
            bench.plans.plans.len() - 1,
            bench.notes.join("; ")
        );
    }
    places.set_up(&mut bench.world)?;
    read_pads_by(&mut bench, pads.as_deref(), Path::new("--pads"))?;
    say_whose_pads(args.robot, &[args.policy.condition()], pads.as_deref());
    bench.board = args.tactile.board(bench.board);
    bench.foresee(args.foresee);
    expect_errors(&mut bench, None, Path::new("uncertainty"), args.robot.name())?;
    let condition = args.policy.condition();
    let mut place = source(&bench.world, args.robot, (args.config.as_deref(), &args.places), args.session.clone())?;
    let task = Task {
        robot: args.robot.name().to_owned(),
        seed: terminal.seed,
        combination: args.combination,
        trial: args.trial,
        condition,
        watched: true,
        combos,
        scenario: text,
        places,
        robot_model,
        individual,
        pads,
        foresees: args.foresee,
        mirrored: args.mirror,
    };
    let file = args.out.clone().unwrap_or_else(|| {
        PathBuf::from(format!("recordings/combination_{}_trial_{}_{}.rrd", args.combination, args.trial, condition))
    });
    if let Some(folder) = file.parent() {
        std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    }
    let mut targets = vec![telemetry::Target::File(file.clone())];
    if args.live {
        targets.push(telemetry::Target::Spawn);
    }
    let mut recording = Recording::open(&targets, &bench, &task, (args.robot.began(), args.truth))?;
    let play = |watcher: &mut dyn Watcher| match (&mut place, condition) {
        (Some(place), _) => bench.play(&task, place.as_mut(), watcher).map(|outcome| outcome.record),
        (None, Condition::Ideal) => bench.ideal(args.combination, watcher).map(|outcome| outcome.record),
        (None, condition) => bench
            .trial(args.combination, args.trial, &[condition], &[], watcher)
            .map(|mut results| results.records.remove(0)),
    };
    let tells = args.robot == Body::Hardware && !terminal.quiet;
    let (played, named) = beside(&bench, Some(&mut recording), (args.mirror, tells, condition), play);
    let named = named.map(|named| named.into_iter().map(|named| named.divergence).collect::<Vec<_>>());
    // The recording of a stopped trial holds everything up to the stop.
    let finished = recording.finish();
    if let Some(named) = named.as_ref().filter(|_| !terminal.json) {
        tell_divergences(named);
    }
    let record = played?;
    finished?;
    tell_trial(terminal, &record, named.as_deref())?;
    if !terminal.json {
        println!("recorded in {0}; see it with `ftac view {0}`", file.display());
    }
    Ok(failure(&record))
}

/// Returns the cause of failure, if the trial failed.
fn failure(record: &TrialRecord) -> Option<String> {
    let cause = record.cause.map_or_else(|| "cause unknown".to_owned(), |cause| cause.to_string());
    (!record.success).then(|| format!("the trial failed: {cause}"))
}

/// Prints the divergences that a mirror named, one per line.
fn tell_divergences(named: &[Divergence]) {
    match named {
        [] => println!("mirror: nothing differs between robot and twin that it can name"),
        named => named.iter().for_each(|divergence| println!("mirror: {divergence}")),
    }
}

/// Prints the record, with the divergences `named` by a mirror, if there was one.
fn tell_trial(terminal: &Terminal, record: &TrialRecord, named: Option<&[Divergence]>) -> Result<()> {
    let mut text = format!(
        "{}, {}: success {}, unwanted contact {}\n",
        record.objects().join(" then "),
        record.condition,
        record.success,
        record.contact
    );
    if !record.reason.is_empty() {
        text += &format!("{}\n", record.reason);
    }
    terminal.print(&Played { record, divergences: named }, &text)
}
