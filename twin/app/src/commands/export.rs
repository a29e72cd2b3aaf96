//! `ftac export`: exports recorded sessions to the formats of other programs.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use bench::recording::{Recording, TimeOrigin};
use clap::Subcommand;
use hand_model::RobotModel;
use robot_backends::TrialStopped;
use robot_backends::TrialTask;
use robot_backends::replay::{ReplayFactory, check_session};
use robot_session_log::ros2::{self, RobotNames};
use robot_session_log::{Replay, RobotSizes, SessionEvent, SessionReader};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;
use telemetry::RecordingTarget;

use super::demonstrations::{VideoQuality, call_package, path_text};
use super::replay::{build_bench, read_task};
use super::sessions::{BAG_SUFFIX, sessions_in};
use crate::options::output_file::check_other_file;
use crate::terminal::{Outcome, Terminal};

/// `export` commands.
#[derive(Debug, Subcommand)]
pub enum ExportCommand {
    /// Export a session (MCAP) as a recording for the Rerun viewer: the control stack runs on it again, and its
    /// perception, estimates and decisions are drawn.
    Rrd {
        /// Session file.
        session: PathBuf,
        /// File for the recording; default: beside the session.
        #[arg(long)]
        out: Option<PathBuf>,
    },
    /// Export a session (MCAP) as a ROS 2 bag (MCAP, profile ros2): joint states, commands and tactile images as
    /// standard messages.
    Ros2 {
        /// Session file.
        session: PathBuf,
        /// File for the bag; default: beside the session, ending in .ros2.mcap.
        #[arg(long)]
        out: Option<PathBuf>,
    },
    /// Export all sessions of a folder as ROS 2 bags, which Foxglove and the mcap tools open.
    Mcap {
        /// Folder of sessions, such as the result of `ftac bench --robot emulated --record all`.
        folder: PathBuf,
        /// Folder for the bags; default: beside each session, ending in .ros2.mcap.
        #[arg(long)]
        out: Option<PathBuf>,
    },
    /// Export all sessions of a folder as a LeRobot data set (v3.0), with the observations and actions of the
    /// environments: vectors, and the pads' images as video. Needs the Python package ftac[lerobot].
    Lerobot {
        /// Folder of sessions, such as the result of `ftac bench --robot emulated --record all`.
        folder: PathBuf,
        /// Folder for the data set, which must not exist; default: FOLDER/lerobot.
        #[arg(long)]
        out: Option<PathBuf>,
        /// Width and height of the images, pixels; an even number.
        #[arg(long, default_value_t = 64, value_parser = clap::value_parser!(u16).range(16..=240))]
        images: u16,
        /// Video of the images: lossless, or a constant rate factor of H.264 from 1 (large) to 40 (small).
        #[arg(long, default_value = "lossless")]
        video: VideoQuality,
    },
}

/// JSON output of `export rrd`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct RrdOutput {
    /// File of the recording (RRD).
    recording: PathBuf,
    /// Control ticks.
    ticks: u64,
    /// First difference of this program from the session, which ends the recording; null if there is none.
    left: Option<String>,
}

/// JSON output of `export ros2`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct BagOutput {
    /// File of the bag.
    bag: PathBuf,
    /// Number of messages.
    messages: u64,
}

/// JSON output of `export mcap`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct BagsOutput {
    /// One entry per session.
    bags: Vec<BagOutput>,
}

/// JSON output of `export lerobot`, as the Python package reports it.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LerobotOutput {
    /// Folder of the data set.
    dataset: String,
    /// Number of sessions.
    episodes: u64,
    /// Number of frames of all episodes.
    frames: u64,
    /// Size of the data set, bytes.
    bytes: u64,
}

pub fn run(terminal: &Terminal, command: &ExportCommand) -> Outcome {
    let (session, out) = match command {
        ExportCommand::Rrd { session, out } => (session, out),
        ExportCommand::Ros2 { session, out } => {
            let out = out.clone().unwrap_or_else(|| session.with_extension(&BAG_SUFFIX[1..]));
            check_other_file("--out", &out, [session.as_path()])?;
            let messages = export_bag(session, &out)?;
            let text = format!("{messages} messages in {0}; play them with `ros2 bag play {0}`\n", out.display());
            terminal.print(&BagOutput { bag: out, messages }, &text)?;
            return Ok((messages == 0).then(|| nothing_measured(session)));
        }
        ExportCommand::Mcap { folder, out } => return export_bags(terminal, folder, out.as_deref()),
        ExportCommand::Lerobot { folder, out, images, video } => {
            return export_lerobot(terminal, folder, out.as_deref(), (*images, *video));
        }
    };
    let out = out.clone().unwrap_or_else(|| session.with_extension("rrd"));
    check_other_file("--out", &out, [session.as_path()])?;
    let (ticks, shortfall) = export_rrd(terminal, session, &out)?;
    let text = format!("{ticks} ticks in {0}; see them with `ftac view {0}`\n", out.display());
    let drawn = RrdOutput { recording: out, ticks, left: shortfall };
    terminal.print(&drawn, &text)?;
    Ok(drawn.left)
}

fn nothing_measured(session: &Path) -> String {
    format!("{}: found no measurements, expected a session that began", session.display())
}

/// Returns the robot of a session, or the built-in one if the session belongs to no trial.
pub fn robot_of_session(reader: &SessionReader) -> Result<RobotModel> {
    let task = serde_json::from_slice::<TrialTask>(&reader.session().task).ok();
    Ok(RobotModel::from_sources(task.and_then(|task| task.robot_model).as_ref())?)
}

/// Writes a session as the bag `out` and returns the number of messages.
fn export_bag(session: &Path, out: &Path) -> Result<u64> {
    let reader = SessionReader::open(session, RobotSizes::Any)?;
    let robot = robot_of_session(&reader)?;
    let names = RobotNames::from_model(&robot);
    let mut reader = reader.with_sizes(RobotSizes::from_robot(&robot));
    // An unfinished file never has the bag's name.
    let partial = out.with_extension("partial");
    let messages = ros2::export(&mut reader, &names, &partial).inspect_err(|_| drop(std::fs::remove_file(&partial)))?;
    std::fs::rename(&partial, out).with_context(|| out.display().to_string())?;
    if !reader.is_finished() {
        eprintln!("{}: it ends in mid-write; everything up to there is in the bag", session.display());
    }
    Ok(messages)
}

/// Lists the sessions of a folder and of its subfolder `sessions`, sorted by path.
fn sessions(folder: &Path) -> Result<Vec<PathBuf>> {
    let inner = folder.join("sessions");
    let mut found = Vec::new();
    for folder in std::iter::once(folder).chain(inner.is_dir().then_some(inner.as_path())) {
        found.append(&mut sessions_in(folder)?);
    }
    found.sort();
    if found.is_empty() {
        bail!(
            "{}: found no session (*.mcap), expected those of `ftac bench --robot emulated --record all`",
            folder.display()
        );
    }
    Ok(found)
}

/// Writes all sessions of a folder as bags.
fn export_bags(terminal: &Terminal, folder: &Path, out: Option<&Path>) -> Outcome {
    let all = sessions(folder)?;
    let bag_of = |session: &PathBuf| {
        let beside = session.with_extension(&BAG_SUFFIX[1..]);
        out.map_or_else(|| beside.clone(), |out| out.join(beside.file_name().unwrap_or_default()))
    };
    let mut names = BTreeSet::new();
    if let Some(session) = all.iter().find(|session| !names.insert(bag_of(session))) {
        bail!("--out: found two sessions of the name {}, expected one of each", session.display());
    }
    if let Some(out) = out {
        std::fs::create_dir_all(out).with_context(|| out.display().to_string())?;
    }
    let bar = progress::bar(all.len() as u64, "sessions", terminal.quiet || terminal.json);
    let (mut bags, mut empty, mut failed) = (Vec::new(), None, Vec::new());
    for session in &all {
        let bag = bag_of(session);
        let messages = match export_bag(session, &bag) {
            Ok(messages) => messages,
            Err(error) if all.len() == 1 => return Err(error),
            // The others do not depend on it.
            Err(error) => {
                bar.suspend(|| eprintln!("{error:#}"));
                failed.push(session.display().to_string());
                bar.inc(1);
                continue;
            }
        };
        if messages == 0 {
            empty.get_or_insert_with(|| nothing_measured(session));
        }
        bags.push(BagOutput { bag, messages });
        bar.inc(1);
    }
    bar.finish_and_clear();
    let place = out.unwrap_or(folder).display();
    let text = format!("{} bags in {place}\n", bags.len());
    terminal.print(&BagsOutput { bags }, &text)?;
    Ok((!failed.is_empty()).then(|| format!("not exported: {}", failed.join(", "))).or(empty))
}

/// Writes all sessions of a folder as a LeRobot data set, by means of the Python package.
fn export_lerobot(
    terminal: &Terminal,
    folder: &Path,
    out: Option<&Path>,
    (images, video): (u16, VideoQuality),
) -> Outcome {
    let all = sessions(folder)?;
    let out = out.map_or_else(|| folder.join("lerobot"), Path::to_owned);
    let texts = all.iter().map(|session| path_text(session)).collect::<Result<Vec<_>>>()?;
    let arguments = json!({
        "sessions": texts,
        "out": path_text(&out)?,
        "images": images,
        "video": video.to_json(),
        "quiet": terminal.quiet,
    });
    let told: LerobotOutput = call_package("export lerobot", "export", &arguments)?;
    let text = format!("{} episodes, {} frames in {}\n", told.episodes, told.frames, out.display());
    terminal.print(&told, &text)?;
    Ok(None)
}

/// Makes the recording `out` of a session. Returns its number of ticks and, if the session has more, the reason.
pub fn export_rrd(terminal: &Terminal, session: &Path, out: &Path) -> Result<(u64, Option<String>)> {
    let (task, scenario) = read_task(session)?;
    let bench = build_bench(terminal, &task, scenario, session)?;
    let robot = &bench.world.cell.robot;
    check_session(session, robot)?;
    let began = if task.keeps_wall_time() { find_time_origin(session)? } else { TimeOrigin::Never };
    let (mut source, report) =
        ReplayFactory::new(Replay::new(SessionReader::open(session, RobotSizes::from_robot(robot))?)?, task.is_real());
    let mut recording = Recording::open(&[RecordingTarget::File(out.to_owned())], &bench, &task, (began, false))?;
    let finished = bench.run(&task, &mut source, &mut recording);
    let (progress, fault) = report.take().context("the trial ended before the recording began")?;
    let finished = finished.map(drop).or_else(|error| match error.downcast_ref::<TrialStopped>() {
        // The trial cannot continue if the recording was cut short or the controller diverged from it.
        Some(_) => Ok(()),
        None => Err(error),
    });
    if progress.ticks == 0 {
        // The recording would be empty, whatever the cause.
        recording.discard()?;
        finished?;
        anyhow::bail!("{}: found no complete tick, expected a session that began", session.display());
    }
    recording.finish()?;
    finished?;
    let left = fault.map(|fault| {
        format!("the recording ends where this program ({}) diverges from it: {fault}", env!("CARGO_PKG_VERSION"))
    });
    Ok((progress.ticks, left))
}

/// Finds the wall-clock time of the robot's time 0.
fn find_time_origin(session: &Path) -> Result<TimeOrigin> {
    let mut reader = SessionReader::open(session, RobotSizes::Any)?;
    while let Some((times, event)) = reader.next_event()? {
        if let SessionEvent::Observation(observation) = event {
            let host = (reader.start_time() + times.host).as_nanos() as i64;
            return Ok(TimeOrigin::At(host.saturating_sub((observation.time * 1e9) as i64)));
        }
    }
    Ok(TimeOrigin::Never)
}
