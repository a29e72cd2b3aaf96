//! `ftac replay`: runs the control stack on a recorded session and compares every command bit by bit; or compares two
//! sessions.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use bench::builtin::{make_bench, replace_calibration, set_expected_errors};
use bench::robot::robot_from_sources;
use bench::trial::{Bench, NoWatcher};
use hand_model::RobotModel;
use robot_backends::replay::{ReplayFactory, check_session};
use robot_backends::{DetectionFailed, TrialStopped, TrialTask};
use robot_session_log::comparison::compare;
use robot_session_log::{Replay, RobotSizes, SessionReader};
use scenarios::Scenario;
use scenarios::record::{Condition, TrialRecord};
use schemars::JsonSchema;
use serde::Serialize;

use super::sessions::sessions_in;
use crate::terminal::Terminal;

/// JSON output of `replay` of one session.
#[derive(Debug, Serialize, JsonSchema)]
pub struct ReplayOutput {
    /// Robot backend: sim, direct, emulated, hardware or python.
    robot: String,
    /// Number of the combination, from 0.
    combination: usize,
    /// Number of the trial, from 0.
    trial: usize,
    /// Condition of the trial.
    #[schemars(with = "String")]
    condition: Condition,
    /// Control ticks.
    ticks: u64,
    /// Number of bit-identical commands.
    identical_commands: u64,
    /// True if the session is complete (not cut short).
    complete: bool,
    /// First command that differs, or null.
    difference: Option<String>,
    /// True if replay and session made the same decisions; null if one of them has none.
    same_decisions: Option<bool>,
    /// Reason for the failed detection in which both session and replay end, or null.
    failed_detection: Option<String>,
}

/// Result for a session of a folder, replayed or not.
#[derive(Debug, Serialize, JsonSchema)]
#[serde(untagged)]
enum ReplayRow {
    Replayed(ReplayOutput),
    NotReplayed {
        /// Error that prevented the replay.
        error: String,
    },
}

#[derive(Debug, Serialize, JsonSchema)]
struct SessionReplay {
    session: PathBuf,
    /// Result as for a single session, or its error.
    replayed: ReplayRow,
    /// Shortfall of this session, or null.
    shortfall: Option<String>,
}

/// JSON output of `replay` of a folder.
#[derive(Debug, Serialize, JsonSchema)]
pub struct FolderReplayOutput {
    /// One entry per session, sorted by name.
    sessions: Vec<SessionReplay>,
}

/// JSON output of `replay --against`: comparison of two sessions.
#[derive(Debug, Serialize, JsonSchema)]
pub struct ComparisonOutput {
    /// Number of bit-identical ticks.
    identical_ticks: u64,
    /// Number of bit-identical values.
    identical_values: u64,
    /// Number of bit-identical images.
    identical_images: u64,
    /// First observation or command that differs, or null.
    difference: Option<String>,
}

/// Runs `ftac replay` on one session, or on all of a folder.
pub fn command(terminal: &Terminal, path: &Path) -> Result<Option<String>> {
    if !path.is_dir() {
        let (replayed, shortfall) = replay_session(terminal, path)?;
        terminal.print(&replayed, "")?;
        return Ok(shortfall);
    }
    // The sessions of a benchmark lie in a subfolder of its results.
    let inside = path.join("sessions");
    let folder = if inside.is_dir() { inside } else { path.to_owned() };
    let sessions = sessions_in(&folder)?;
    if sessions.is_empty() {
        bail!(
            "{}: found no session (MCAP), expected one from `ftac trial --session`, or of `ftac bench --robot emulated --record all`",
            folder.display()
        );
    }
    let (mut rows, mut short) = (Vec::new(), Vec::new());
    for session in &sessions {
        if !terminal.json {
            println!("{}", session.display());
        }
        // A session that cannot be replayed does not stop the others.
        let (replayed, shortfall) = match replay_session(terminal, session) {
            Ok((replayed, shortfall)) => (ReplayRow::Replayed(replayed), shortfall),
            Err(error) => {
                let error = crate::front::error_text(&error);
                eprintln!("{error}");
                (ReplayRow::NotReplayed { error: error.clone() }, Some(error))
            }
        };
        short.extend(shortfall.as_ref().map(|why| format!("{}: {why}", session.display())));
        rows.push(SessionReplay { session: session.clone(), replayed, shortfall });
    }
    terminal.print(&FolderReplayOutput { sessions: rows }, "")?;
    let first =
        short.first().map(|first| format!("{} of {} sessions; the first: {first}", short.len(), sessions.len()));
    Ok(first)
}

/// Replays one session. Returns the result and the shortfall, if any.
fn replay_session(terminal: &Terminal, recording: &Path) -> Result<(ReplayOutput, Option<String>)> {
    let other = describe_other_program(recording)?;
    let named = |error: anyhow::Error| match &other {
        Some(other) => error.context(other.clone()),
        None => error,
    };
    if let (Some(other), false) = (&other, terminal.quiet) {
        eprintln!("warning: {other}");
    }
    let (task, scenario) = read_task(recording).map_err(named)?;
    let bench = build_bench(terminal, &task, scenario, recording).map_err(named)?;
    replay_trial(terminal, &bench, &task, recording).map_err(named)
}

/// Builds the bench on which the trial of a session is replayed.
pub fn build_bench(terminal: &Terminal, task: &TrialTask, scenario: Scenario, recording: &Path) -> Result<Bench> {
    if task.condition == Condition::External {
        bail!(
            "{}: condition: found external, expected a built-in one: a session lacks the answers of an external policy",
            recording.display()
        );
    }
    session_bench(task, scenario, recording, terminal.quiet || terminal.json)
}

/// Builds the bench of a session's trial, under any condition.
pub fn session_bench(task: &TrialTask, scenario: Scenario, recording: &Path, quiet: bool) -> Result<Bench> {
    // A smaller set of combinations is the beginning of a larger one.
    let combos = task.combination + 1;
    let robot = robot_from_sources(task.robot_model.as_ref(), task.instance.as_deref(), recording)?;
    let mut bench = make_bench(&robot, scenario, combos, task.seed, quiet)?;
    task.places.apply_to(&mut bench.world)?;
    replace_calibration(&mut bench, task.pads.as_deref(), recording)?;
    bench.set_look_ahead(task.looks_ahead);
    set_expected_errors(&mut bench, None, recording, &task.robot)?;
    if task.combination >= bench.grasp_pairs.pairs.len() {
        bail!(
            "{}: combination: found {}, expected 0 to {}",
            recording.display(),
            task.combination,
            bench.grasp_pairs.pairs.len().saturating_sub(1)
        );
    }
    Ok(bench)
}

/// Runs `--against`: compares two sessions, observation by observation and command by command. The shortfall is the
/// first bit that differs.
pub fn compare_sessions(terminal: &Terminal, recording: &Path, other: &Path) -> Result<Option<String>> {
    let compared = compare(
        &mut SessionReader::open(recording, RobotSizes::Any)?,
        &mut SessionReader::open(other, RobotSizes::Any)?,
    )?;
    let text = format!(
        "{} ticks, {} numbers and {} images identical bit by bit\n",
        compared.ticks, compared.values, compared.images
    );
    let compared = ComparisonOutput {
        identical_ticks: compared.ticks,
        identical_values: compared.values,
        identical_images: compared.images,
        difference: compared.difference.as_ref().map(ToString::to_string),
    };
    terminal.print(&compared, &text)?;
    Ok(compared.difference)
}

/// Reads the task of a session file and its scenario, both self-contained.
pub fn read_task(path: &Path) -> Result<(TrialTask, Scenario)> {
    Ok(TrialTask::parse(&SessionReader::open(path, RobotSizes::Any)?.session().task, path)?)
}

/// Replays the trial. The shortfall is the point at which it diverges from the recording.
fn replay_trial(
    terminal: &Terminal,
    bench: &Bench,
    task: &TrialTask,
    path: &Path,
) -> Result<(ReplayOutput, Option<String>)> {
    let robot = &bench.world.cell.robot;
    let (outcome, whole) = read_outcome(path, robot)?;
    let reader = SessionReader::open(path, RobotSizes::from_robot(robot))?;
    let (mut source, report) = ReplayFactory::new(Replay::new(reader)?, task.is_real());
    let finished = bench.run(task, &mut source, &mut NoWatcher);
    let (finished, failed) = match finished {
        Ok(outcome) => (Some(outcome.record), None),
        // The trial cannot continue if the recording was cut short or the controller diverged from it.
        Err(error) if error.chain().any(|cause| cause.is::<TrialStopped>()) => (None, None),
        Err(error) => match error.chain().find_map(|cause| cause.downcast_ref::<DetectionFailed>()) {
            Some(DetectionFailed(why)) => (None, Some(why.clone())),
            None => return Err(error),
        },
    };
    let (progress, fault) = report.take().context("the trial ended before the recording began")?;
    let decided = |record: &TrialRecord| (record.switched, record.retries, record.reason.clone());
    let same = match (&finished, &outcome) {
        (Some(finished), Some(recorded)) => Some(decided(finished) == decided(recorded)),
        _ => None,
    };
    let told = ReplayOutput {
        robot: task.robot.clone(),
        combination: task.combination,
        trial: task.trial,
        condition: task.condition,
        ticks: progress.ticks,
        identical_commands: progress.commands,
        complete: whole,
        difference: fault.as_ref().map(ToString::to_string),
        same_decisions: same,
        failed_detection: failed.clone(),
    };
    if !terminal.json {
        println!("{} trial {} of combination {}, {}", task.robot, task.trial, task.combination, task.condition);
        println!("{} ticks, {} commands identical bit by bit", progress.ticks, progress.commands);
        match (&outcome, same) {
            (Some(record), Some(true)) => {
                println!("the same decisions");
                record.decisions().for_each(|decision| println!("  {decision}"));
            }
            (None, _) if failed.is_some() => {
                println!("it ends in the same failed detection: {}", failed.as_deref().unwrap_or_default())
            }
            (None, _) => {
                println!("the recording ends before the trial does{}", if whole { "" } else { ", in mid-write" })
            }
            _ => {}
        }
    }
    let other = describe_other_program(path)?.map_or(String::new(), |other| format!(" ({other})"));
    let shortfall = match (fault, same) {
        (Some(fault), _) => Some(format!("{fault}{other}")),
        (None, _) if progress.commands == 0 && failed.is_none() => {
            Some("the recording ends before its first command: nothing was compared".to_owned())
        }
        (None, Some(false)) => Some(format!("the decisions differ from the recorded ones{other}")),
        _ => None,
    };
    Ok((told, shortfall))
}

/// Names the program and version that recorded the session, if it is another than this: differences may then come from
/// the program.
pub fn describe_other_program(path: &Path) -> Result<Option<String>> {
    let program = SessionReader::open(path, RobotSizes::Any)?.session().program.clone();
    let this = concat!("ftac ", env!("CARGO_PKG_VERSION"));
    Ok((program != this).then(|| format!("recorded by {program}, this is {this}")))
}

/// Reads the recorded outcome of a trial of this robot. The flag is true if the file was finished.
fn read_outcome(path: &Path, robot: &RobotModel) -> Result<(Option<TrialRecord>, bool)> {
    let (outcome, whole) = check_session(path, robot)?;
    let read = |text: Vec<u8>| serde_json::from_slice(&text).with_context(|| format!("{}: outcome", path.display()));
    Ok((outcome.map(read).transpose()?, whole))
}
