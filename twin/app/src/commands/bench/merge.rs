//! `ftac report` of benchmarks: rebuilds the results of a run, or merges its shards.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use bench::journal::{Journal, JournalEntry, WorkUnit};
use bench::results;
use scenarios::record::Condition;
use scenarios::summary::Summary;
use sweep::folder::SweepFolder;

use super::summary_output::print_summary;
use crate::options::output_file::is_same_place;
use crate::terminal::{Outcome, Terminal};

/// Runs `ftac report`: rebuilds the results of a run, or merges the shards of one.
pub fn report(terminal: &Terminal, folders: &[PathBuf], out: Option<&Path>) -> Outcome {
    let (mut journal, mut request) = Journal::read(&folders[0])?;
    for folder in &folders[1..] {
        let (other, its) = Journal::read(folder)?;
        if let Some(what) = request.first_difference(&its)? {
            bail!(
                "{}: its {what} differs from that of {}; only shards of one run can be merged",
                folder.display(),
                folders[0].display()
            );
        }
        request.provenance.extend(its.provenance);
        journal.extend(other);
    }
    request.shard = (1, 1);
    let target = match (out, folders) {
        (Some(out), _) => out,
        (None, [only]) => only,
        _ => bail!("--out: several folders need a folder for the merged result"),
    };
    let is_source = folders.iter().any(|folder| is_same_place(folder, target));
    if folders.len() > 1 && is_source {
        bail!("--out: found {}, one of the shards, expected another folder", target.display());
    }
    if !is_source && (Journal::is_at(target) || SweepFolder::is_at(target)) {
        bail!("--out: {} already holds a run or a sweep; name another folder", target.display());
    }
    std::fs::create_dir_all(target).with_context(|| target.display().to_string())?;
    // A finished run has recorded its wall time. For a part of a run, the times of its trials are summed.
    let ended = folders.first().filter(|_| folders.len() == 1).and_then(|folder| finished_wall_time(folder, &journal));
    let wall = ended.unwrap_or_else(|| journal.values().map(|entry| entry.wall_s).sum());
    let summary = results::write_results(&journal, &request, target, wall, None)?;
    print_summary(terminal, &summary, target)?;
    Ok(None)
}

/// Returns the wall time of the run in `folder`, s, if it ended with exactly these trials.
fn finished_wall_time(folder: &Path, journal: &BTreeMap<WorkUnit, JournalEntry>) -> Option<f64> {
    let text = std::fs::read_to_string(folder.join("summary.json")).ok()?;
    let summary: Summary = serde_json::from_str(&text).ok()?;
    let trials: usize = Condition::ALL.map(|condition| summary.conditions.get(condition).trials).iter().sum();
    let kept: usize = journal.values().map(|entry| entry.records.len()).sum();
    (trials == kept).then_some(summary.wall_s)
}
