//! Submission of a sweep to Slurm: an array of workers, and a job that merges their results when all of them have
//! ended.
//!
//! Workers claim units ([`crate::claim`]), so their number and the loss of some do not matter. Slurm requeues workers
//! that lose their node. A worker whose program fails requeues itself, a few times. If units are missing in the end,
//! the last job submits the sweep again.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, anyhow, bail};
use ftac_platform::child;
use ftac_platform::data::write_atomically;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::claim::Claims;
use crate::folder::SweepFolder;

/// Maximum number of times that a failed worker is requeued, and that a sweep with missing units is submitted again.
pub const MAX_RETRIES: u32 = 3;

/// Resources requested from Slurm.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SlurmOptions {
    pub partition: Option<String>,
    /// Maximum number of workers.
    pub max_jobs: usize,
    /// Number of cores per worker.
    pub cpus: usize,
    /// Memory of a worker, in Slurm's notation.
    pub memory: Option<String>,
    /// Time limit of a worker, in Slurm's notation.
    pub time: Option<String>,
    /// Number of times that the sweep has resubmitted itself.
    pub round: u32,
}

/// Submitted jobs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SlurmJobs {
    /// Number of the workers' array job.
    pub array: u64,
    /// Number of the merge job.
    pub merge: u64,
    /// Number of workers.
    pub workers: usize,
    pub options: SlurmOptions,
}

/// Result of a submission.
#[derive(Debug, Clone, PartialEq)]
pub enum Submission {
    /// Jobs were submitted.
    New(SlurmJobs),
    /// Jobs of this sweep are already in progress.
    Joined(SlurmJobs),
    /// Nothing is left to run.
    Finished,
}

fn folder(sweep: &SweepFolder) -> PathBuf {
    sweep.path.join("slurm")
}

/// Reads the jobs of the last submission; none if there was none.
pub fn jobs(sweep: &SweepFolder) -> Result<Option<SlurmJobs>> {
    let file = folder(sweep).join("jobs.json");
    match fs::read_to_string(&file) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        text => {
            let text = text.with_context(|| file.display().to_string())?;
            serde_json::from_str(&text).map(Some).with_context(|| file.display().to_string())
        }
    }
}

/// Quotes a text as one word of a shell.
fn quoted(text: &str) -> String {
    format!("'{}'", text.replace('\'', "'\\''"))
}

/// Returns the script of the workers.
pub fn array_script(sweep: &SweepFolder, program: &Path, options: &SlurmOptions, workers: usize) -> String {
    let here = quoted(&sweep.path.to_string_lossy());
    let mut text = "#!/bin/bash\n# Workers of a sweep. Each runs unclaimed units until none is left.\n".to_owned();
    let mut ask = |what: &str| {
        let _ = writeln!(text, "#SBATCH {what}");
    };
    ask("--job-name=ftac-sweep");
    ask(&format!("--array=1-{workers}"));
    ask(&format!("--output={}", folder(sweep).join("worker-%A_%a.log").display()));
    ask("--open-mode=append");
    ask("--requeue");
    ask(&format!("--ntasks=1 --cpus-per-task={}", options.cpus));
    for (name, value) in [("partition", &options.partition), ("mem", &options.memory), ("time", &options.time)] {
        if let Some(value) = value {
            ask(&format!("--{name}={value}"));
        }
    }
    let _ = write!(
        text,
        "\n{} sweep run {here} --jobs {} --worker \"$SLURM_ARRAY_TASK_ID/{workers}\"\ncode=$?\n\
         # A unit that failed here may succeed on another node. A faulty unit fails there too, and `ftac sweep status` lists it.\n\
         # Code 130: ended by scancel, or because Slurm needs the node; Slurm then requeues the task itself.\n\
         if [ $code -ne 0 ] && [ $code -ne 130 ] && [ \"${{SLURM_RESTART_COUNT:-0}}\" -lt {MAX_RETRIES} ]; then\n\
         \x20   echo \"worker ended with code $code: requeued\"\n\
         \x20   scontrol requeue \"${{SLURM_ARRAY_JOB_ID}}_${{SLURM_ARRAY_TASK_ID}}\"\nfi\nexit $code\n",
        quoted(&program.to_string_lossy()),
        options.cpus,
    );
    text
}

/// Returns the script that merges the results.
pub fn merge_script(sweep: &SweepFolder, program: &Path, options: &SlurmOptions) -> String {
    let (program, here) = (quoted(&program.to_string_lossy()), quoted(&sweep.path.to_string_lossy()));
    let mut text =
        "#!/bin/bash\n# Joins the results of a sweep's workers when all of them have ended, in any way.\n".to_owned();
    let mut ask = |what: &str| {
        let _ = writeln!(text, "#SBATCH {what}");
    };
    ask("--job-name=ftac-merge");
    ask(&format!("--output={}", folder(sweep).join("merge-%j.log").display()));
    ask("--open-mode=append");
    ask("--requeue");
    ask("--ntasks=1 --cpus-per-task=1");
    if let Some(partition) = &options.partition {
        ask(&format!("--partition={partition}"));
    }
    if options.round < MAX_RETRIES {
        let mut again =
            format!("--max-jobs {} --cpus {} --round {}", options.max_jobs, options.cpus, options.round + 1);
        for (name, value) in [("partition", &options.partition), ("memory", &options.memory), ("time", &options.time)] {
            if let Some(value) = value {
                let _ = write!(again, " --{name} {}", quoted(value));
            }
        }
        let _ = write!(
            text,
            "\n{program} sweep merge {here} && exit 0\n# Units are missing: workers were lost, or failed too often.\nexec {program} sweep submit {here} {again}\n"
        );
    } else {
        let _ = write!(text, "\nexec {program} sweep merge {here}\n");
    }
    text
}

/// Runs a Slurm command. Its error output goes into the error.
fn slurm(program: &str, arguments: &[&str]) -> Result<String> {
    let output = child::command(program).args(arguments).output().map_err(|error| match error.kind() {
        std::io::ErrorKind::NotFound => {
            anyhow!("found no `{program}` on the path, expected Slurm's; without Slurm, `ftac sweep run` runs the sweep on this machine")
        }
        _ => anyhow!("{program}: {error}"),
    })?;
    if !output.status.success() {
        bail!("{program} {}: {}", arguments.join(" "), String::from_utf8_lossy(&output.stderr).trim());
    }
    Ok(String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

/// Submits a script. Returns the number of its job.
fn submit_script(script: &Path, more: &[&str]) -> Result<u64> {
    let script = script.to_string_lossy();
    let said = slurm("sbatch", &[&["--parsable"], more, &[script.as_ref()]].concat())?;
    let number = said.split(';').next().and_then(|number| number.trim().parse().ok());
    number.with_context(|| format!("sbatch: found `{said}`, expected the number of a job"))
}

/// Submits the unfinished units of a sweep, unless jobs of it are in progress.
pub fn submit(sweep: &SweepFolder, program: &Path, options: &SlurmOptions) -> Result<Submission> {
    let left = sweep.plan.units.len() - sweep.finished()?.len();
    if left == 0 {
        return Ok(Submission::Finished);
    }
    let here = folder(sweep);
    fs::create_dir_all(&here).with_context(|| here.display().to_string())?;
    // Of two simultaneous submissions, one waits for the result of the other.
    let claims = Claims::new(&sweep.path)?;
    let mut waited = 0;
    let _claim = loop {
        match claims.try_claim("submission")? {
            Some(claim) => break claim,
            None if waited < 60 => {
                waited += 1;
                std::thread::sleep(std::time::Duration::from_secs(1));
            }
            None => bail!("{}: another submission is under way", sweep.path.display()),
        }
    };
    if let Some(known) = jobs(sweep)? {
        // The merge job submits the sweep again and must not wait for itself.
        let own = claims.holder().job.as_ref().is_some_and(|job| *job == known.merge.to_string());
        if !own && queue(&known)?.iter().any(|task| task.is_under_way()) {
            return Ok(Submission::Joined(known));
        }
    }
    let workers = left.div_ceil(options.cpus.max(1)).min(options.max_jobs).max(1);
    let (array, merge) = (here.join("workers.sh"), here.join("merge.sh"));
    write_atomically(&array, array_script(sweep, program, options, workers).as_bytes())?;
    write_atomically(&merge, merge_script(sweep, program, options).as_bytes())?;
    let first = submit_script(&array, &[])?;
    let second = submit_script(&merge, &[&format!("--dependency=afterany:{first}")]).inspect_err(|_| {
        // Workers without a merge job were not requested.
        let _ = slurm("scancel", &[&first.to_string()]);
    })?;
    let submitted = SlurmJobs { array: first, merge: second, workers, options: options.clone() };
    write_atomically(&here.join("jobs.json"), &serde_json::to_vec_pretty(&submitted)?)?;
    Ok(Submission::New(submitted))
}

/// A job or task as Slurm reports it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub struct SlurmTask {
    /// Identifier, such as `12_3`, or `12_[4-9]` for tasks that have not started.
    pub id: String,
    /// State, such as `RUNNING`.
    pub state: String,
    /// Its node, or the reason for its wait.
    pub reason: String,
    /// Number of tasks that the line stands for.
    pub count: usize,
}

impl SlurmTask {
    /// True if the task has not ended.
    pub fn is_under_way(&self) -> bool {
        const ENDED_STATES: [&str; 8] =
            ["COMPLETED", "CANCELLED", "FAILED", "TIMEOUT", "NODE_FAIL", "OUT_OF_MEMORY", "BOOT_FAIL", "DEADLINE"];
        !ENDED_STATES.iter().any(|state| self.state.starts_with(state))
    }
}

/// Returns Slurm's state of the jobs of a submission; empty for forgotten jobs.
pub fn queue(jobs: &SlurmJobs) -> Result<Vec<SlurmTask>> {
    let ids = format!("{},{}", jobs.array, jobs.merge);
    let said = slurm("squeue", &["--noheader", "--states=all", "--format=%i|%T|%R", "--jobs", &ids]);
    match said {
        Ok(said) => Ok(said.lines().filter_map(task).collect()),
        // Both jobs are forgotten.
        Err(error) if error.to_string().contains("Invalid job id") => Ok(Vec::new()),
        Err(error) => Err(error),
    }
}

fn task(line: &str) -> Option<SlurmTask> {
    let mut parts = line.splitn(3, '|');
    let (id, state, reason) = (parts.next()?, parts.next()?, parts.next()?);
    Some(SlurmTask { id: id.into(), state: state.into(), reason: reason.into(), count: count(id) })
}

/// Counts the tasks of an identifier such as `7_3`, `7_[1-4,9]` or `7_[1-8%2]`.
fn count(id: &str) -> usize {
    let Some((_, list)) = id.split_once("_[") else { return 1 };
    let list = list.trim_end_matches(']').split('%').next().unwrap_or_default();
    list.split(',')
        .map(|part| match part.split_once('-') {
            Some((from, to)) => match (from.parse::<usize>(), to.parse::<usize>()) {
                (Ok(from), Ok(to)) => to.saturating_sub(from) + 1,
                _ => 1,
            },
            None => 1,
        })
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tasks_are_counted() {
        for (id, tasks) in [("7", 1), ("7_3", 1), ("7_[1-4,9]", 5), ("7_[1-8%2]", 8)] {
            assert_eq!(count(id), tasks, "{id}");
        }
        let task = task("7_2|PENDING|(BeginTime)").expect("a task");
        assert!(task.is_under_way() && task.reason == "(BeginTime)");
    }

    #[test]
    fn words_stay_one_word() {
        assert_eq!(quoted("a b"), "'a b'");
        assert_eq!(quoted("it's"), "'it'\\''s'");
    }
}
