//! `ftac bench` and `ftac report`.

mod merge;
mod summary_output;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use bench::builtin::{COMBINATION_COUNT, bench_from_request};
use bench::journal::{Journal, RecordingSelection as Recorded, RunRequest};
use bench::provenance::Provenance;
use bench::run::{self, RunOptions};
use clap::{Args, ValueEnum};
use control::uncertainty::Uncertainty;
use external_policy::{ExternalPolicy, PolicySource, SimulatedTimePassage};
use robot_backends::driver::DrivenRobot;
use robot_backends::validation::MAX_TRIALS;
use scenarios::Ablation;
use scenarios::effects::Effect;
use scenarios::record::Condition;

pub use self::merge::report;
use self::summary_output::{print_summary, shortfall};
use crate::options::backend::{BackendKind, PoseSourceArgs, RobotOption, RobotParser, backend_factory, check_backend};
use crate::options::driver::{DriverArgs, introduce_again};
use crate::options::robot::{RobotArgs, instance_text, pad_calibration_text, warn_nominal_pads};
use crate::options::scenario::ScenarioArgs;
use crate::options::tactile_backend::TactileBackend;
use crate::terminal::{Outcome, Terminal};

/// Arguments of `bench`.
#[derive(Debug, Args)]
pub struct BenchArgs {
    /// Number of object combinations; default: 60, or all pairs of a scenario that has fewer.
    #[arg(long)]
    pub combos: Option<usize>,
    /// Trials per combination.
    #[arg(long, default_value_t = 10)]
    pub trials: usize,
    /// Conditions (policies) to run.
    #[arg(long, value_delimiter = ',', default_value = "ideal,blind,reflex,touch", value_name = "CONDITIONS")]
    pub conditions: Vec<String>,
    /// External policy, run as the condition `external` beside the others: a Python class, as FILE.py:CLASS. See
    /// twin/python/README.md.
    #[arg(long, value_name = "FILE:CLASS")]
    pub policy: Option<String>,
    /// Argument for the constructor of the policy's class (repeatable). A value that parses as JSON is passed as such
    /// (0.5, true, [1, 2]), any other as text.
    #[arg(long, value_name = "KEY=VALUE", requires = "policy")]
    pub policy_arg: Vec<String>,
    /// Time limit for each answer of the policy, s; default: 60. If it is exceeded, the trial fails and the policy's
    /// process is killed.
    #[arg(long, value_name = "SECONDS", requires = "policy", value_parser = clap::value_parser!(u32).range(1..=86_400))]
    pub policy_timeout: Option<u32>,
    /// Simulated time that passes while the policy computes: none (`paused`), or as much as on the wall clock (`wall`).
    #[arg(long, value_enum, default_value_t = PolicyTime::Paused, requires = "policy")]
    pub policy_time: PolicyTime,
    /// Robot backend, or a robot of your own behind a driver in Python: FILE.py:CLASS. Default: sim. See
    /// twin/python/README.md.
    #[arg(long, value_parser = RobotParser)]
    pub robot: Option<RobotOption>,
    #[command(flatten)]
    pub driver: DriverArgs,
    /// Configuration file of the hardware bridge, for --robot hardware; or file with the limits of a robot of your own,
    /// for --robot FILE.py:CLASS.
    #[arg(long)]
    pub config: Option<PathBuf>,
    #[command(flatten)]
    pub places: PoseSourceArgs,
    #[command(flatten)]
    pub model: RobotArgs,
    #[command(flatten)]
    pub scenario: ScenarioArgs,
    /// Number of threads; default: all cores.
    #[arg(long)]
    pub jobs: Option<usize>,
    /// Run only shard i of n, as `i/n`.
    #[arg(long, default_value = "1/1")]
    pub shard: String,
    /// Result folder; default: the next free recordings/bench-N.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Trials to record; default: sample, or the setting of the run that is resumed.
    #[arg(long, value_enum)]
    pub record: Option<RecordArg>,
    /// Film the first trial, blind beside touch with the tactile images, for the report (recordings/film.webp); it takes
    /// a minute of processor time.
    #[arg(long)]
    pub film: bool,
    /// Scale factor of the random errors of arm and object detector, for a curve of success over noise. Effects stay
    /// on: pads, gel, cables, objects that differ from their models, detection latency and detections that mistake one
    /// pose for another; see --without and --no-errors.
    #[arg(long, default_value_t = 1.0)]
    pub noise_scale: f64,
    /// Effort of the search for grasps of pairs that are not in the grasp pair table, and of their verification under
    /// random errors, 0 to 9; overrides the scenario's. At 1 it takes about 3 to 12 core minutes per pair; results are
    /// kept for later runs.
    #[arg(long, value_parser = clap::value_parser!(u32).range(..=9), conflicts_with = "resume")]
    pub effort: Option<u32>,
    /// Switch off all errors and effects, as --noise-scale 0 --without all; the controller expects none either.
    #[arg(long, conflicts_with_all = ["noise_scale", "without", "resume"])]
    pub no_errors: bool,
    /// Switch off effects of the scenario: pads, gel, cables, detector, arm, objects, floor, time, or all.
    #[arg(long, value_delimiter = ',', value_name = "EFFECTS")]
    pub without: Vec<String>,
    /// Errors that the controller expects: a file like twin/control/data/uncertainty.toml, which is the default.
    #[arg(long, value_name = "FILE")]
    pub uncertainty: Option<PathBuf>,
    /// Robot instance for both the backend and the control stack: a file of `ftac sysid identify`; default: the nominal
    /// model.
    #[arg(long, value_name = "FILE")]
    pub instance: Option<PathBuf>,
    /// Calibration of the tactile pads: a file of `ftac touch train`, or of the hand's own pads; default: that of the
    /// nominal pads.
    #[arg(long, value_name = "FILE")]
    pub pads: Option<PathBuf>,
    /// Let touch and reflex simulate candidates for the second grasp (rollouts from the estimated state) before they
    /// choose one.
    #[arg(long)]
    pub look_ahead: bool,
    /// Run fault detection: a reference model in parallel with the robot. Detected faults are written to faults.csv.
    #[arg(long)]
    pub detect_faults: bool,
    /// Number of the instance that a simulated or emulated robot is, unknown to the control stack; default: the robot
    /// that the control stack assumes.
    #[arg(long, value_name = "N")]
    pub plant: Option<u64>,
    /// Ablations of touch to run as well, all or those named: palm_only, fingertips, quarter_of_pads, coarse_images,
    /// points_only, true_pose, no_retry, no_new_detection, no_exploration.
    #[arg(long, num_args = 0.., value_delimiter = ',', value_name = "NAMES")]
    pub ablations: Option<Vec<String>>,
    /// Stream every trial to a Rerun viewer as well (one thread).
    #[arg(long)]
    pub live: bool,
    /// Renderer of the tactile images.
    #[arg(long, value_enum, default_value_t = TactileBackend::Cpu)]
    pub tactile: TactileBackend,
    /// Resume the interrupted run in this folder.
    #[arg(
        long,
        conflicts_with_all = [
            "combos", "trials", "seed", "conditions", "robot_arg", "robot_timeout", "scenario", "shard", "out", "noise_scale", "without",
            "uncertainty", "ablations", "policy_arg", "policy_timeout", "policy_time", "registration", "mount", "instance", "plant",
            "look_ahead", "detect_faults", "pads", "tactile", "robot_model",
        ]
    )]
    pub resume: Option<PathBuf>,
}

/// Simulated time that passes while an external policy computes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PolicyTime {
    /// No simulated time.
    Paused,
    /// As much as on the wall clock. On the real robot this is always so.
    Wall,
}

/// Trials to record.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum RecordArg {
    /// None.
    None,
    /// The first trial of every tenth combination.
    Sample,
    /// For each condition, the first trial of every cause of failure, run again after the benchmark.
    Causes,
    /// Every trial.
    All,
}

impl From<RecordArg> for Recorded {
    fn from(record: RecordArg) -> Self {
        match record {
            RecordArg::None => Self::None,
            RecordArg::Sample => Self::Sample,
            RecordArg::Causes => Self::Causes,
            RecordArg::All => Self::All,
        }
    }
}

impl BenchArgs {
    /// Returns the robot backend.
    fn robot(&self) -> RobotOption {
        self.robot.clone().unwrap_or(BackendKind::Sim.into())
    }
}

/// Returns the requested run, or the interrupted one to resume, its folder, and the robot behind the driver that runs
/// it, if there is one.
fn request(terminal: &Terminal, args: &BenchArgs) -> Result<(RunRequest, PathBuf, Option<DrivenRobot>)> {
    if args.combos == Some(0) {
        bail!("--combos: found 0, expected at least 1");
    }
    if !(1..=MAX_TRIALS).contains(&args.trials) {
        bail!("--trials: found {}, expected 1 to {MAX_TRIALS}", args.trials);
    }
    if args.jobs == Some(0) {
        bail!("--jobs: found 0, expected at least 1");
    }
    if !(0.0..=10.0).contains(&args.noise_scale) {
        bail!("--noise-scale: found {}, expected 0 to 10", args.noise_scale);
    }
    let noise_scale = if args.no_errors { 0.0 } else { args.noise_scale };
    let (robot, config) = (args.robot(), args.config.as_deref());
    if noise_scale != 1.0 && !robot.is(BackendKind::Sim) {
        let option =
            if args.no_errors { "--no-errors:".to_owned() } else { format!("--noise-scale: found {noise_scale}") };
        bail!("{option} with --robot {robot}, expected it with the simulated robot");
    }
    if let Some(folder) = &args.resume {
        let request = Journal::read(folder).context("--resume")?.1;
        check_policy(request.policy.as_ref(), args.policy.as_deref(), folder)?;
        let driven = resumed_driver(&request, args, folder)?;
        return Ok((request, folder.clone(), driven));
    }
    let model = args.model.model()?;
    robot.check_supported(&model)?;
    check_backend(&robot, config, &[])?;
    let (scenario, text) = args.scenario.read()?;
    let pairs = scenario.combination_count();
    let combos = args.combos.unwrap_or(pairs.min(COMBINATION_COUNT));
    if combos > pairs {
        bail!("--combos: found {combos}, expected at most the scenario's {pairs} pairs");
    }
    let conditions = parse_conditions(&args.conditions, args.policy.is_some())?;
    let ablations = parse_ablations(args)?;
    let noisy = conditions.iter().any(|condition| *condition != Condition::Ideal);
    for (option, given) in [("--ablations", !ablations.is_empty()), ("--film", args.film)] {
        if given && !noisy {
            bail!("{option}: found only the condition ideal, expected one with errors in --conditions");
        }
    }
    let shard = parse_part(&args.shard, "--shard")?;
    if shard.1 > combos {
        bail!("--shard: found {} shards, expected at most as many as the {combos} combinations", shard.1);
    }
    if args.film && shard.0 != 1 {
        bail!("--film: found shard {} of {}, expected the first, which has the trial that is filmed", shard.0, shard.1);
    }
    let driven = args.driver.introduce(&robot, &model, config, &conditions)?;
    let request = RunRequest {
        combos,
        trials: args.trials,
        seed: terminal.seed,
        robot: robot.name().into(),
        driver: driven.as_ref().map(|driven| driven.driver.clone()),
        shard,
        conditions,
        ablations,
        without: if args.no_errors { Effect::ALL.to_vec() } else { parse_without(&args.without)? },
        uncertainty: read_uncertainty(args.uncertainty.as_deref())?,
        policy: parse_policy(args)?,
        noise_scale,
        effort: args.effort,
        scenario: text,
        places: args.places.pose_sources(&robot)?,
        robot_instance: instance_text(args.instance.as_deref(), &model)?.0,
        pads: pad_calibration_text(args.pads.as_deref(), &model)?,
        robot_model: model.sources,
        plant_instance: args.plant,
        looks_ahead: args.look_ahead,
        detects_faults: args.detect_faults,
        // Filled in after the scenario's own objects have been tried.
        notes: Vec::new(),
        left_out: Vec::new(),
        gpu: args.tactile == TactileBackend::Gpu,
        record: args.record.map_or_else(Recorded::default, Recorded::from),
        provenance: vec![Provenance::now()],
    };
    Ok((request, args.out.clone().unwrap_or_else(next_free_folder), driven))
}

/// Returns the robot behind the driver of a run that is resumed, if it has one. Another robot is refused.
fn resumed_driver(request: &RunRequest, args: &BenchArgs, folder: &Path) -> Result<Option<DrivenRobot>> {
    match (&request.driver, &args.robot) {
        (Some(driver), named) => {
            let model = request.robot_model(folder)?;
            let robot = (&model, args.config.as_deref());
            introduce_again(driver, named.as_ref(), robot, (folder, &request.conditions)).map(Some)
        }
        (None, Some(named)) => bail!(
            "--robot: found {named} with --resume, expected none: the run in {} is on the robot {}",
            folder.display(),
            request.robot
        ),
        (None, None) => Ok(None),
    }
}

/// Runs `ftac bench`. All input is checked before anything is written.
pub fn benchmark(terminal: &Terminal, args: &BenchArgs) -> Outcome {
    let (mut request, folder, driven) = request(terminal, args)?;
    let robot = match &request.driver {
        Some(driver) => RobotOption::Driver(driver.class.name()),
        None => <BackendKind as clap::ValueEnum>::from_str(&request.robot, false)
            .map_err(|_| anyhow::anyhow!("{}: robot: found {}, expected a backend", folder.display(), request.robot))?
            .into(),
    };
    if request.places.detector != args.places.detector.is_some() {
        let (found, expected) = if request.places.detector { ("none", "one") } else { ("one", "none") };
        bail!("--detector: found {found}, expected {expected}, as at the start of the run in {}", folder.display());
    }
    check_backend(&robot, args.config.as_deref(), &request.conditions)?;
    let scenario = request.scenario().with_context(|| folder.display().to_string())?;
    if !robot.is(BackendKind::Sim) && !scenario.disturbance.is_none() {
        bail!("--robot: found {robot}, expected the simulated robot (sim) for a scenario with [disturbance]");
    }
    if args.film && !robot.is(BackendKind::Sim) {
        bail!("--film: found --robot {robot}, expected the simulated robot (sim), whose poses are known");
    }
    if !request.ablations.is_empty() && !scenario.disturbance.disabled().is_empty() {
        bail!("--ablations: found a scenario with disabled_digits, expected one without");
    }
    let real = robot.is(BackendKind::Hardware) || driven.is_some();
    if real && request.plant_instance.is_some() {
        bail!("--plant: found --robot {robot}, expected a simulated or emulated robot");
    }
    let quiet = terminal.quiet || terminal.json;
    let jobs = if args.live || request.keeps_wall_time() {
        1
    } else {
        args.jobs.unwrap_or_else(bench::workers::available_threads)
    };
    // All input has been checked before anything is written.
    let mut bench = bench_from_request(&request, quiet)?;
    let asked = request.combos;
    if args.resume.is_none() {
        request.combos = bench.grasp_pairs.pairs.len().min(asked);
        (request.notes, request.left_out) = (bench.notes.clone(), bench.left_out.clone());
    }
    warn_nominal_pads(request.keeps_wall_time(), &request.conditions, request.pads.as_deref());
    let tactile = if request.gpu { TactileBackend::Gpu } else { TactileBackend::Cpu };
    bench.cameras = tactile.select_renderer(bench.cameras);
    // A fault of a simulated robot is gone with its trial; a real robot waits for an operator.
    bench.continues_after_faults = !real && request.policy.is_none();
    if let Some(source) = &mut request.policy {
        source.check()?;
        let external = ExternalPolicy::start(source.clone())?;
        if args.resume.is_none() {
            source.introduction = Some(external.introduction.clone());
        }
        bench.external_policy = Some(external);
    }
    let sessions = |record: bool| (record || real).then(|| folder.join("sessions"));
    let place = |record: bool| {
        backend_factory(
            &bench.world,
            (&robot, driven.as_ref()),
            (args.config.as_deref(), &args.places),
            sessions(record && !robot.is(BackendKind::Sim)),
        )
    };
    // A wrong configuration is detected before anything is written, and so is a missing viewer.
    drop(place(false)?);
    if args.live {
        telemetry::viewer::find().ok_or(telemetry::TelemetryError::NoViewer)?;
    }
    let journal = match &args.resume {
        Some(folder) => Journal::resume(folder)?.0,
        None => Journal::create(&folder, &request)?,
    };
    let record = args.record.map_or(request.record, Recorded::from);
    let options = RunOptions { jobs, record, film: args.film, quiet, live: args.live, open_factory: &place };
    let summary = run::run(&bench, &request, journal, &folder, &options)?;
    print_summary(terminal, &summary, &folder)?;
    let fewer = (args.combos.is_some() && request.combos < asked)
        .then(|| format!("only {} of {asked} combinations can be done", request.combos));
    Ok(shortfall(&summary).or(fewer))
}

/// Parses `--ablations`; without names, all of them.
fn parse_ablations(args: &BenchArgs) -> Result<Vec<Ablation>> {
    let Some(names) = &args.ablations else { return Ok(Vec::new()) };
    if !args.robot().is(BackendKind::Sim) {
        bail!("--ablations: found --robot {}, expected sim, whose state can be restored", args.robot());
    }
    if names.is_empty() {
        return Ok(Ablation::ALL.to_vec());
    }
    let wanted: BTreeSet<Ablation> = names.iter().map(|name| name.parse()).collect::<Result<_, _>>()?;
    Ok(wanted.into_iter().collect())
}

/// Parses `--conditions`, in the order of `trials.csv`. If an external policy is given (`own`), its condition is added.
fn parse_conditions(names: &[String], own: bool) -> Result<Vec<Condition>> {
    let mut wanted: BTreeSet<Condition> =
        names.iter().map(|name| name.parse()).collect::<Result<_, _>>().context("--conditions")?;
    if wanted.contains(&Condition::External) && !own {
        bail!("--conditions: found external, expected --policy FILE.py:CLASS with it");
    }
    wanted.extend(own.then_some(Condition::External));
    Ok(wanted.into_iter().collect())
}

/// Parses `--policy` and its options.
fn parse_policy(args: &BenchArgs) -> Result<Option<PolicySource>> {
    // On the real robot time passes anyway.
    let waits = args.policy_time == PolicyTime::Wall && !args.robot().is(BackendKind::Hardware);
    let pace = if waits { SimulatedTimePassage::Wall } else { SimulatedTimePassage::Paused };
    let Some(text) = &args.policy else { return Ok(None) };
    let source = PolicySource::parse(text, &args.policy_arg, pace)?;
    Ok(Some(PolicySource { timeout: args.policy_timeout.unwrap_or(source.timeout), ..source }))
}

/// Refuses a policy other than that named on the command line. The folder may be of unknown origin: its files must not
/// choose the program that runs.
fn check_policy(kept: Option<&PolicySource>, named: Option<&str>, folder: &Path) -> Result<()> {
    let of = |source: &PolicySource| source.python_class().name();
    match (kept, named) {
        (None, None) => Ok(()),
        (Some(kept), Some(named)) if of(kept) == named => Ok(()),
        (None, Some(named)) => {
            bail!("--policy: found {named}, expected none, as at the start of the run in {}", folder.display())
        }
        (Some(kept), found) => bail!(
            "--resume {}: found {}, expected --policy {}, which the run was begun with: a folder does not choose what runs",
            folder.display(),
            found.map_or("no --policy".to_owned(), |found| format!("--policy {found}")),
            of(kept)
        ),
    }
}

/// Parses `--without`.
fn parse_without(names: &[String]) -> Result<Vec<Effect>> {
    if names.iter().any(|name| name == "all") {
        return Ok(Effect::ALL.to_vec());
    }
    let wanted: BTreeSet<Effect> =
        names.iter().map(|name| name.parse()).collect::<Result<_, _>>().context("--without (or all)")?;
    Ok(wanted.into_iter().collect())
}

/// Reads and validates the file that `--uncertainty` names, and returns its text.
fn read_uncertainty(path: Option<&Path>) -> Result<Option<String>> {
    let Some(path) = path else { return Ok(None) };
    let text = ftac_platform::data::read_text(path).context("--uncertainty")?;
    Uncertainty::parse(&text, path).context("--uncertainty")?;
    Ok(Some(text))
}

fn next_free_folder() -> PathBuf {
    (1..).map(|n| PathBuf::from(format!("recordings/bench-{n}"))).find(|folder| !folder.exists()).unwrap_or_default()
}

/// Parses part `i` of `n`, counted from 1, as `i/n`.
pub fn parse_part(text: &str, option: &str) -> Result<(usize, usize)> {
    let parts = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
    match parts {
        Some((i, n)) if (1..=n).contains(&i) => Ok((i, n)),
        _ => bail!("{option}: found `{text}`, expected i/n with 1 <= i <= n, such as 1/2"),
    }
}
