//! `ftac export`: recorded sessions in the formats of other programs.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use bench::body::Stopped;
use bench::body::replayed::ReplaySource;
use bench::recording::{Began, Recording};
use clap::Subcommand;
use hand_model::kinematics::Tree;
use hand_model::{Arm, Hand};
use session_log::ros2::{self, Names};
use session_log::{Event, Reader, Replay};
use stream::Target;

use super::replay::{bench_of, task};
use crate::terminal::{Outcome, Terminal};

/// `export` commands.
#[derive(Debug, Subcommand)]
pub enum ExportCommand {
    /// A session (MCAP) as a recording for the Rerun viewer: the control stack runs on it again, and what it sees, believes and decides is drawn.
    Rrd {
        /// The session's file.
        session: PathBuf,
        /// The recording; default: beside the session.
        #[arg(long)]
        out: Option<PathBuf>,
    },
    /// A session (MCAP) as a ROS 2 bag (MCAP, profile ros2): joint states, commands and tactile images as standard messages.
    Ros2 {
        /// The session's file.
        session: PathBuf,
        /// The bag; default: beside the session, ending in .ros2.mcap.
        #[arg(long)]
        out: Option<PathBuf>,
    },
}

pub fn run(terminal: &Terminal, command: &ExportCommand) -> Outcome {
    let (session, out) = match command {
        ExportCommand::Rrd { session, out } => (session, out),
        ExportCommand::Ros2 { session, out } => return ros2(terminal, session, out.as_deref()),
    };
    let out = out.clone().unwrap_or_else(|| session.with_extension("rrd"));
    let (ticks, shortfall) = rrd(terminal, session, &out)?;
    if terminal.json {
        println!("{}", serde_json::json!({ "recording": out, "ticks": ticks, "left": shortfall }));
    } else {
        println!("{ticks} ticks in {0}; see them with `ftac view {0}`", out.display());
    }
    Ok(shortfall)
}

fn ros2(terminal: &Terminal, session: &Path, out: Option<&Path>) -> Outcome {
    let out = out.map_or_else(|| session.with_extension("ros2.mcap"), Path::to_owned);
    let (hand, arm) = (Hand::ftac(), Arm::gen3());
    let joints = |tree: &Tree| tree.joints.iter().map(|joint| joint.name.clone()).collect();
    let names = Names {
        arm: joints(&arm.tree),
        servos: hand.parameters.actuator.iter().map(|actuator| actuator.name.clone()).collect(),
        cameras: hand.cameras.iter().map(|camera| camera.name.clone()).collect(),
        torque_constant: hand.parameters.servo.torque_constant,
    };
    let reader = Reader::open(session)?;
    // Nothing half-written stays under the bag's name.
    let partial = out.with_extension("partial");
    let messages = ros2::export(reader, &names, &partial).inspect_err(|_| drop(std::fs::remove_file(&partial)))?;
    std::fs::rename(&partial, &out).with_context(|| out.display().to_string())?;
    let text = format!("{messages} messages in {0}; `ros2 bag play {0}` plays them\n", out.display());
    terminal.print(&serde_json::json!({ "bag": out, "messages": messages }), &text)?;
    Ok((messages == 0).then(|| format!("{}: found nothing measured, expected a session that began", session.display())))
}

/// Makes the recording `out` of a session: how many ticks it has, and why they are not all that the session has, if so.
pub fn rrd(terminal: &Terminal, session: &Path, out: &Path) -> Result<(u64, Option<String>)> {
    let task = task(session)?;
    let bench = bench_of(terminal, &task, session)?;
    let began = began(session)?;
    let (mut source, report) = ReplaySource::new(Replay::new(Reader::open(session)?)?, task.robot == "hardware");
    let partial = out.with_extension("partial.rrd");
    let mut recording = Recording::open(&[Target::File(partial.clone())], &bench, &task, (began, false))?;
    let played = bench.play(&task, &mut source, &mut recording);
    recording.finish()?;
    let (progress, divergence) = report.take().context("the trial ended before the recording began")?;
    let played = played.map(drop).or_else(|error| match error.downcast_ref::<Stopped>() {
        // Where the recording was cut short, or the controller left it, the trial cannot go on.
        Some(_) => Ok(()),
        None => Err(error),
    });
    if progress.ticks == 0 {
        // Nothing to show, whatever went wrong.
        std::fs::remove_file(&partial).with_context(|| partial.display().to_string())?;
        played?;
        anyhow::bail!("{}: found no whole tick, expected a session that began", session.display());
    }
    std::fs::rename(&partial, out).with_context(|| out.display().to_string())?;
    played?;
    let left = divergence.map(|divergence| {
        format!(
            "the recording ends where this program ({}) leaves the session: {divergence}",
            env!("CARGO_PKG_VERSION")
        )
    });
    Ok((progress.ticks, left))
}

/// When the body's time 0 was.
fn began(session: &Path) -> Result<Began> {
    let mut reader = Reader::open(session)?;
    if reader.session().robot != "hardware" {
        return Ok(Began::Never);
    }
    while let Some((times, event)) = reader.next_event()? {
        if let Event::Observation(observation) = event {
            let host = (reader.begun() + times.host).as_nanos() as i64;
            return Ok(Began::At(host - (observation.time * 1e9) as i64));
        }
    }
    Ok(Began::Never)
}
