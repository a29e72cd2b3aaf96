//! `ftac export`: recorded sessions in the formats of other programs.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use bench::body::Stopped;
use bench::body::replayed::ReplaySource;
use bench::recording::{Began, Recording};
use clap::Subcommand;
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
}

pub fn run(terminal: &Terminal, command: &ExportCommand) -> Outcome {
    let ExportCommand::Rrd { session, out } = command;
    let out = out.clone().unwrap_or_else(|| session.with_extension("rrd"));
    let (ticks, shortfall) = rrd(terminal, session, &out)?;
    if terminal.json {
        println!("{}", serde_json::json!({ "recording": out, "ticks": ticks, "left": shortfall }));
    } else {
        println!("{ticks} ticks in {0}; see them with `ftac view {0}`", out.display());
    }
    Ok(shortfall)
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
