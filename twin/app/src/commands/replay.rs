//! `ftac replay`: the control stack on a recorded session, held to every command bit by bit; or two sessions side by side.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use bench::builtin::{expect_errors, make_bench, read_pads_by};
use bench::robot::robot_of;
use bench::trial::{Bench, NoWatcher};
use hand_model::RobotModel;
use robot_backends::replayed::{ReplaySource, check};
use robot_backends::{LookFailed, Stopped, Task};
use scenarios::Scenario;
use scenarios::record::{Condition, TrialRecord};
use schemars::JsonSchema;
use serde::Serialize;
use session_log::comparison::compare;
use session_log::{Reader, Replay, Sizes};

use super::sessions::sessions_in;
use crate::terminal::Terminal;

/// Outcome of one session.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Replayed {
    /// Body: sim, rounded, emulated or hardware.
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
    /// Commands alike bit by bit.
    identical_commands: u64,
    /// True if the session has its end.
    whole: bool,
    /// The first command that differs, or null.
    divergence: Option<String>,
    /// True if both sessions decided alike; null where one has no decisions.
    same_decisions: Option<bool>,
    /// Reason for the failed look in which both session and replay end, or null.
    failed_look: Option<String>,
}

/// A session of a folder, replayed or not.
#[derive(Debug, Serialize, JsonSchema)]
#[serde(untagged)]
enum Row {
    Replayed(Replayed),
    NotReplayed {
        /// Reason why it could not be replayed.
        error: String,
    },
}

#[derive(Debug, Serialize, JsonSchema)]
struct Session {
    session: PathBuf,
    /// As of a single session, or its error.
    replayed: Row,
    /// In which respect it falls short, or null.
    shortfall: Option<String>,
}

/// Outcome of the sessions of a folder.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Folder {
    /// A session each, by name.
    sessions: Vec<Session>,
}

/// Two sessions side by side.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Compared {
    /// Ticks alike bit by bit.
    identical_ticks: u64,
    /// Numbers alike bit by bit.
    identical_values: u64,
    /// Images alike bit by bit.
    identical_images: u64,
    /// The first observation or command that differs, or null.
    difference: Option<String>,
}

/// The command: one session, or all of a folder.
pub fn command(terminal: &Terminal, path: &Path) -> Result<Option<String>> {
    if !path.is_dir() {
        let (replayed, shortfall) = one(terminal, path)?;
        terminal.print(&replayed, "")?;
        return Ok(shortfall);
    }
    // A benchmark's sessions lie in a folder of their own within its results.
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
        // One that cannot be replayed does not keep the others from it.
        let (replayed, shortfall) = match one(terminal, session) {
            Ok((replayed, shortfall)) => (Row::Replayed(replayed), shortfall),
            Err(error) => {
                let error = crate::front::words(&error);
                eprintln!("{error}");
                (Row::NotReplayed { error: error.clone() }, Some(error))
            }
        };
        short.extend(shortfall.as_ref().map(|why| format!("{}: {why}", session.display())));
        rows.push(Session { session: session.clone(), replayed, shortfall });
    }
    terminal.print(&Folder { sessions: rows }, "")?;
    let first =
        short.first().map(|first| format!("{} of {} sessions; the first: {first}", short.len(), sessions.len()));
    Ok(first)
}

/// One session, and in which respect it falls short.
fn one(terminal: &Terminal, recording: &Path) -> Result<(Replayed, Option<String>)> {
    let other = other_program(recording)?;
    let named = |error: anyhow::Error| match &other {
        Some(other) => error.context(other.clone()),
        None => error,
    };
    if let (Some(other), false) = (&other, terminal.quiet) {
        eprintln!("warning: {other}");
    }
    let (task, scenario) = task(recording).map_err(named)?;
    let bench = bench_of(terminal, &task, scenario, recording).map_err(named)?;
    run(terminal, &bench, &task, recording).map_err(named)
}

/// What the trial of a session is played with.
pub fn bench_of(terminal: &Terminal, task: &Task, scenario: Scenario, recording: &Path) -> Result<Bench> {
    if task.condition == Condition::Own {
        bail!(
            "{}: condition: found own, expected one that comes with this program: what a policy of one's own answered is not in the session",
            recording.display()
        );
    }
    let quiet = terminal.quiet || terminal.json;
    // A shorter draw is the beginning of a longer one.
    let combos = task.combination + 1;
    let robot = robot_of(task.robot_model.as_ref(), task.individual.as_deref(), recording)?;
    let mut bench = make_bench(&robot, scenario, combos, task.seed, quiet)?;
    task.places.set_up(&mut bench.world)?;
    read_pads_by(&mut bench, task.pads.as_deref(), recording)?;
    bench.foresee(task.foresees);
    expect_errors(&mut bench, None, recording, &task.robot)?;
    if task.combination >= bench.plans.plans.len() {
        bail!(
            "{}: combination: found {}, expected 0 to {}",
            recording.display(),
            task.combination,
            bench.plans.plans.len().saturating_sub(1)
        );
    }
    Ok(bench)
}

/// `--against`: two sessions, observation by observation and command by command; the shortfall is the first bit that differs.
pub fn against(terminal: &Terminal, recording: &Path, other: &Path) -> Result<Option<String>> {
    let compared = compare(&mut Reader::open(recording, Sizes::Any)?, &mut Reader::open(other, Sizes::Any)?)?;
    let text = format!(
        "{} ticks, {} numbers and {} images identical bit by bit\n",
        compared.ticks, compared.values, compared.images
    );
    let compared = Compared {
        identical_ticks: compared.ticks,
        identical_values: compared.values,
        identical_images: compared.images,
        difference: compared.difference.as_ref().map(ToString::to_string),
    };
    terminal.print(&compared, &text)?;
    Ok(compared.difference)
}

/// What the file says of itself: the task and its scenario, with everything that they need in them.
pub fn task(path: &Path) -> Result<(Task, Scenario)> {
    Ok(Task::parse(&Reader::open(path, Sizes::Any)?.session().task, path)?)
}

/// Runs it; the shortfall is where it left the recording.
fn run(terminal: &Terminal, bench: &Bench, task: &Task, path: &Path) -> Result<(Replayed, Option<String>)> {
    let robot = &bench.world.cell.robot;
    let (outcome, whole) = outcome(path, robot)?;
    let reader = Reader::open(path, Sizes::of(robot))?;
    let (mut source, report) = ReplaySource::new(Replay::new(reader)?, task.robot == "hardware");
    let played = bench.play(task, &mut source, &mut NoWatcher);
    let (played, failed) = match played {
        Ok(outcome) => (Some(outcome.record), None),
        // Where the recording was cut short, or the controller left it, the trial cannot go on.
        Err(error) if error.chain().any(|cause| cause.is::<Stopped>()) => (None, None),
        Err(error) => match error.chain().find_map(|cause| cause.downcast_ref::<LookFailed>()) {
            Some(LookFailed(why)) => (None, Some(why.clone())),
            None => return Err(error),
        },
    };
    let (progress, divergence) = report.take().context("the trial ended before the recording began")?;
    let decided = |record: &TrialRecord| (record.switched, record.retries, record.reason.clone());
    let same = match (&played, &outcome) {
        (Some(played), Some(recorded)) => Some(decided(played) == decided(recorded)),
        _ => None,
    };
    let told = Replayed {
        robot: task.robot.clone(),
        combination: task.combination,
        trial: task.trial,
        condition: task.condition,
        ticks: progress.ticks,
        identical_commands: progress.commands,
        whole,
        divergence: divergence.as_ref().map(ToString::to_string),
        same_decisions: same,
        failed_look: failed.clone(),
    };
    if !terminal.json {
        println!("{} trial {} of combination {}, {}", task.robot, task.trial, task.combination, task.condition);
        println!("{} ticks, {} commands identical bit by bit", progress.ticks, progress.commands);
        match (&outcome, same) {
            (Some(record), Some(true)) if !record.reason.is_empty() => {
                println!("the same decisions: {}", record.reason)
            }
            (Some(_), Some(true)) => println!("the same decisions"),
            (None, _) if failed.is_some() => {
                println!("it ends in the same failed look: {}", failed.as_deref().unwrap_or_default())
            }
            (None, _) => {
                println!("the recording ends before the trial does{}", if whole { "" } else { ", in mid-write" })
            }
            _ => {}
        }
    }
    let other = other_program(path)?.map_or(String::new(), |other| format!(" ({other})"));
    let shortfall = match (divergence, same) {
        (Some(divergence), _) => Some(format!("{divergence}{other}")),
        (None, _) if progress.commands == 0 && failed.is_none() => {
            Some("the recording ends before its first command: nothing was compared".to_owned())
        }
        (None, Some(false)) => Some(format!("the decisions differ from the recorded ones{other}")),
        _ => None,
    };
    Ok((told, shortfall))
}

/// Whose session it is, if it is another program's: what differs may be the program's doing.
pub fn other_program(path: &Path) -> Result<Option<String>> {
    let program = Reader::open(path, Sizes::Any)?.session().program.clone();
    let this = concat!("ftac ", env!("CARGO_PKG_VERSION"));
    Ok((program != this).then(|| format!("recorded by {program}, this is {this}")))
}

/// What came of the recorded trial of a hand with so many cameras, and whether the file was finished.
fn outcome(path: &Path, robot: &RobotModel) -> Result<(Option<TrialRecord>, bool)> {
    let (outcome, whole) = check(path, robot)?;
    let read = |text: Vec<u8>| serde_json::from_slice(&text).with_context(|| format!("{}: outcome", path.display()));
    Ok((outcome.map(read).transpose()?, whole))
}
