//! `ftac trial`: runs and records one trial.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use bench::builtin::{COMBINATION_COUNT, make_bench, replace_calibration, set_expected_errors};
use bench::fault_watch::run_with_detector;
use bench::recording::{Recording, TimeOrigin};
use bench::robot::robot_from_sources;
use bench::trial::Watcher;
use clap::{Args, ValueEnum};
use fault_detection::fault::DetectedFault;
use robot_backends::TrialTask;
use robot_backends::validation::MAX_TRIALS;
use scenarios::record::Condition;
use scenarios::record::TrialRecord;
use schemars::JsonSchema;
use serde::Serialize;

use crate::options::backend::{BackendKind, PoseSourceArgs, RobotOption, RobotParser, backend_factory, check_backend};
use crate::options::combination::combination_number;
use crate::options::driver::DriverArgs;
use crate::options::robot::{RobotArgs, instance_text, pad_calibration_text, warn_nominal_pads};
use crate::options::ros2::Ros2Args;
use crate::options::scenario::ScenarioArgs;
use crate::options::tactile_backend::TactileBackend;
use crate::terminal::{Outcome, Terminal};

/// Arguments of `trial`.
#[derive(Debug, Args)]
pub struct TrialArgs {
    /// Number of the combination, from 0.
    #[arg(value_parser = combination_number)]
    pub combination: usize,
    /// Number of the trial, from 0.
    #[arg(long, default_value_t = 0)]
    pub trial: usize,
    /// Policy; `ideal` runs without noise.
    #[arg(long, value_enum, default_value_t = TrialPolicy::Touch)]
    pub policy: TrialPolicy,
    #[command(flatten)]
    pub model: RobotArgs,
    #[command(flatten)]
    pub scenario: ScenarioArgs,
    /// Robot backend, or a robot of your own behind a driver in Python: FILE.py:CLASS. See twin/python/README.md.
    #[arg(long, value_parser = RobotParser, default_value = "sim")]
    pub robot: RobotOption,
    #[command(flatten)]
    pub driver: DriverArgs,
    /// Robot instance for both the backend and the control stack: a file of `ftac sysid identify`; default: the nominal
    /// model.
    #[arg(long, value_name = "FILE")]
    pub instance: Option<PathBuf>,
    /// Calibration of the tactile pads: a file of `ftac touch train`, or of the hand's own pads; default: that of the
    /// nominal pads.
    #[arg(long, value_name = "FILE")]
    pub pads: Option<PathBuf>,
    /// Simulate candidates for the second grasp (rollouts from the estimated state) before one is chosen.
    #[arg(long)]
    pub look_ahead: bool,
    /// Run fault detection: a reference model in parallel with the robot, shown as a ghost. Detected faults are
    /// printed.
    #[arg(long)]
    pub detect_faults: bool,
    /// Configuration file of the hardware bridge, for --robot hardware; or file with the limits of a robot of your own,
    /// for --robot FILE.py:CLASS.
    #[arg(long)]
    pub config: Option<PathBuf>,
    #[command(flatten)]
    pub places: PoseSourceArgs,
    /// Folder for the session's MCAP file, for `ftac replay`; hardware and robots of your own always record, into
    /// recordings/sessions by default.
    #[arg(long)]
    pub session: Option<PathBuf>,
    #[command(flatten)]
    pub ros2: Ros2Args,
    /// Stream to a Rerun viewer.
    #[arg(long)]
    pub live: bool,
    /// Renderer of the tactile images.
    #[arg(long, value_enum, default_value_t = TactileBackend::Cpu)]
    pub tactile: TactileBackend,
    /// Also record the true scene of an emulated robot; otherwise its recording shows only measurements and estimates.
    #[arg(long)]
    pub truth: bool,
    /// Recording file for the viewer; default: recordings/combination_N_trial_K_POLICY.rrd. For hardware it shows
    /// measurements and estimates.
    #[arg(long)]
    pub out: Option<PathBuf>,
}

/// Policy that decides the second grasp.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TrialPolicy {
    /// As planned, without noise.
    Ideal,
    /// As planned.
    Blind,
    /// Explores and retries by encoders and currents, without tactile images.
    Reflex,
    /// Adapts to the tactile images.
    Touch,
}

impl TrialPolicy {
    /// Returns the benchmark condition of this policy.
    pub fn condition(self) -> Condition {
        match self {
            Self::Ideal => Condition::Ideal,
            Self::Blind => Condition::Blind,
            Self::Reflex => Condition::Reflex,
            Self::Touch => Condition::Touch,
        }
    }
}

/// JSON output of `trial`: the record, and the detected faults.
#[derive(Debug, Serialize, JsonSchema)]
pub struct TrialOutput<'a> {
    #[serde(flatten)]
    record: &'a TrialRecord,
    /// With --detect-faults: detected faults.
    #[serde(skip_serializing_if = "Option::is_none")]
    faults: Option<&'a [DetectedFault]>,
}

/// Runs `ftac trial`: runs one trial and records it.
pub fn trial(terminal: &Terminal, args: &TrialArgs) -> Outcome {
    let condition = args.policy.condition();
    check_backend(&args.robot, args.config.as_deref(), &[condition])?;
    if args.ros2.ros2.is_some() && args.robot.is(BackendKind::Ros2) {
        bail!(
            "--ros2: found --robot ros2, expected another one: a robot on ROS 2 topics publishes its measurements itself"
        );
    }
    let places = args.places.pose_sources(&args.robot)?;
    let (scenario, text) = args.scenario.read()?;
    if args.trial >= MAX_TRIALS {
        bail!("--trial: found {}, expected 0 to {}", args.trial, MAX_TRIALS - 1);
    }
    let pairs = scenario.combination_count().min(COMBINATION_COUNT);
    if args.combination >= pairs {
        bail!("COMBO: found {}, expected 0 to {}", args.combination, pairs - 1);
    }
    let combos = args.combination + 1;
    let nominal = args.model.model()?;
    args.robot.check_supported(&nominal)?;
    let (individual, path) = instance_text(args.instance.as_deref(), &nominal)?;
    let pads = pad_calibration_text(args.pads.as_deref(), &nominal)?;
    let robot_model = nominal.sources;
    let quiet = terminal.quiet || terminal.json;
    let model = robot_from_sources(robot_model.as_ref(), individual.as_deref(), &path)?;
    let driven = args.driver.introduce(&args.robot, &model, args.config.as_deref(), &[condition])?;
    let mut bench = make_bench(&model, scenario, combos, terminal.seed, quiet)?;
    if bench.grasp_pairs.pairs.len() <= args.combination {
        bail!(
            "COMBO: found {}, expected 0 to {}: {}",
            args.combination,
            bench.grasp_pairs.pairs.len() - 1,
            bench.notes.join("; ")
        );
    }
    places.apply_to(&mut bench.world)?;
    replace_calibration(&mut bench, pads.as_deref(), Path::new("--pads"))?;
    bench.cameras = args.tactile.select_renderer(bench.cameras);
    bench.set_look_ahead(args.look_ahead);
    set_expected_errors(&mut bench, None, Path::new("uncertainty"), args.robot.name())?;
    let place = backend_factory(
        &bench.world,
        (&args.robot, driven.as_ref()),
        (args.config.as_deref(), &args.places),
        args.session.clone(),
    )?;
    let mut place = args.ros2.publish(place, &bench.world.cell)?;
    let task = TrialTask {
        robot: args.robot.name().to_owned(),
        driver: driven.map(|driven| driven.driver),
        seed: terminal.seed,
        combination: args.combination,
        trial: args.trial,
        condition,
        images_throughout: true,
        combos,
        scenario: text,
        places,
        robot_model,
        instance: individual,
        pads,
        looks_ahead: args.look_ahead,
        detects_faults: args.detect_faults,
    };
    warn_nominal_pads(task.keeps_wall_time(), &[condition], task.pads.as_deref());
    let file = args.out.clone().unwrap_or_else(|| {
        PathBuf::from(format!("recordings/combination_{:02}_trial_{}_{}.rrd", args.combination, args.trial, condition))
    });
    if let Some(folder) = file.parent() {
        std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    }
    if let Some(folder) = &args.session {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("--session: cannot create the folder {}", folder.display()))?;
    }
    let mut targets = vec![telemetry::RecordingTarget::File(file.clone())];
    if args.live {
        telemetry::viewer::find().ok_or(telemetry::TelemetryError::NoViewer)?;
        targets.push(telemetry::RecordingTarget::Spawn);
    }
    let began = if task.keeps_wall_time() { TimeOrigin::Now } else { TimeOrigin::Never };
    let mut recording = Recording::open(&targets, &bench, &task, (began, args.truth))?;
    let run_trial = |watcher: &mut dyn Watcher| match (&mut place, condition) {
        (Some(place), _) => bench.run(&task, place.as_mut(), watcher).map(|outcome| outcome.record),
        (None, Condition::Ideal) => bench.run_ideal(args.combination, watcher).map(|outcome| outcome.record),
        (None, condition) => bench
            .run_each_condition(args.combination, args.trial, &[condition], &[], watcher)
            .map(|mut results| results.records.remove(0)),
    };
    let tells = task.keeps_wall_time() && !terminal.quiet;
    let (outcome, named) =
        run_with_detector(&bench, Some(&mut recording), (args.detect_faults, tells, condition), run_trial);
    let named = named.map(|named| named.into_iter().map(|named| named.fault).collect::<Vec<_>>());
    // The recording of a stopped trial holds everything up to the stop.
    let finished = recording.finish();
    if let Some(named) = named.as_ref().filter(|_| !terminal.json) {
        print_detected_faults(named);
    }
    let record = outcome?;
    finished?;
    print_trial(terminal, &record, named.as_deref())?;
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

/// Prints the detected faults, one per line.
fn print_detected_faults(named: &[DetectedFault]) {
    match named {
        [] => println!("fault detection: no fault detected"),
        named => named.iter().for_each(|fault| println!("fault detection: {fault}")),
    }
}

/// Prints the record, with the detected faults `named`, if fault detection ran.
fn print_trial(terminal: &Terminal, record: &TrialRecord, named: Option<&[DetectedFault]>) -> Result<()> {
    let mut text = format!(
        "{}, {}: success {}, unwanted contact {}\n",
        record.objects().join(" then "),
        record.condition,
        record.success,
        record.contact
    );
    record.decisions().for_each(|decision| text += &format!("  {decision}\n"));
    terminal.print(&TrialOutput { record, faults: named }, &text)
}
