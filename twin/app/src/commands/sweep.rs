//! `ftac sweep`: many benchmarks along parameter axes, on this machine or on Slurm.

pub mod output;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use clap::{Args, Subcommand};
use sweep::file::Sweep;
use sweep::folder::{Failure, SweepFolder};
use sweep::merge::{MergeResult, merge};
use sweep::plan::SweepPlan;
use sweep::slurm::{self, SlurmTask, Submission};
use sweep::status::status;
use sweep::work::{self, WorkerOptions};

use self::output::{
    FailedAttempt, FailedUnit, MakespanOutput, MergeOutput, StatusOutput, SubmitOutput, SweepPlanOutput, SweepRunOutput,
};
use super::bench::parse_part;
use crate::terminal::{Outcome, Terminal};

/// `sweep` commands.
#[derive(Debug, Subcommand)]
pub enum SweepCommand {
    /// Estimate the size of a sweep: points, trials, units of work, time and disk space.
    Plan {
        /// Sweep file (TOML).
        file: PathBuf,
    },
    /// Run a sweep on this machine; the same command resumes after an interruption, and joins other processes that run
    /// it.
    Run(RunArgs),
    /// Submit a sweep to Slurm: an array of workers, and a job that merges their results.
    Submit(SubmitArgs),
    /// Report the progress of a sweep, and the state of its Slurm jobs.
    Status {
        /// Result folder.
        folder: PathBuf,
    },
    /// Merge the results of all finished units: a Parquet file per point, and a digest of the results.
    Merge {
        /// Result folder.
        folder: PathBuf,
    },
    /// Simulate the makespan of a sweep on 1 to 1,000 cores from the recorded times of its units, and write it as a
    /// page.
    Makespan {
        /// Result folder of a sweep with finished units.
        folder: PathBuf,
        /// Repeat its units until there are this many trials.
        #[arg(long)]
        trials: Option<usize>,
        /// Merge this many neighbouring units into one, to see the effect of longer units.
        #[arg(long, default_value_t = 1)]
        join: usize,
    },
}

/// Arguments of `sweep run`.
#[derive(Debug, Args)]
pub struct RunArgs {
    /// Sweep file (TOML), or result folder of a sweep to resume.
    pub path: PathBuf,
    /// Result folder; required with a file.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Number of threads, each of which runs a unit; default: all cores.
    #[arg(long)]
    pub jobs: Option<usize>,
    /// Act as worker i of n, as `i/n`: do not wait for units that others run, and do not merge.
    #[arg(long)]
    pub worker: Option<String>,
}

/// Arguments of `sweep submit`.
#[derive(Debug, Args)]
pub struct SubmitArgs {
    /// Sweep file (TOML), or result folder of a sweep to resume.
    pub path: PathBuf,
    /// Result folder, shared by all nodes; required with a file.
    #[arg(long)]
    pub out: Option<PathBuf>,
    /// Slurm partition; default: that of the cluster.
    #[arg(long)]
    pub partition: Option<String>,
    /// Maximum number of workers.
    #[arg(long, default_value_t = 100)]
    pub max_jobs: usize,
    /// Cores per worker, which is also the number of units that it runs at once.
    #[arg(long, default_value_t = 1)]
    pub cpus: usize,
    /// Memory per worker, such as 2G; default: that of the cluster.
    #[arg(long)]
    pub memory: Option<String>,
    /// Time limit of a worker, such as 4:00:00; default: that of the partition. A worker that reaches it is not
    /// requeued; the sweep is submitted again.
    #[arg(long)]
    pub time: Option<String>,
    /// Number of times that the sweep has resubmitted itself.
    #[arg(long, default_value_t = 0, hide = true)]
    pub round: u32,
}

/// Runs a `sweep` command.
pub fn run(terminal: &Terminal, command: &SweepCommand) -> Outcome {
    let plans = matches!(command, SweepCommand::Plan { .. } | SweepCommand::Run(_) | SweepCommand::Submit(_));
    if plans && terminal.seed != 1 {
        bail!(
            "--seed: found {}, expected none: the seeds of a sweep are in its file, as `seed` in [axes]",
            terminal.seed
        );
    }
    match command {
        SweepCommand::Plan { file } => run_plan(terminal, file),
        SweepCommand::Run(args) => run_sweep(terminal, args),
        SweepCommand::Submit(args) => submit(terminal, args),
        SweepCommand::Status { folder } => print_status(terminal, folder),
        SweepCommand::Merge { folder } => run_merge(terminal, folder),
        SweepCommand::Makespan { folder, trials, join } => makespan(terminal, folder, *trials, *join),
    }
}

/// Formats a duration for people.
fn format_duration(seconds: f64) -> String {
    report::html::format_duration(seconds)
}

fn run_plan(terminal: &Terminal, file: &Path) -> Outcome {
    let plan = SweepPlan::from_sweep(&Sweep::read(file)?)?;
    let cores = bench::workers::available_threads();
    let (units, rows, bytes) = (plan.units.len(), plan.rows(), plan.bytes()?);
    let here = plan.core_s / cores.min(units) as f64;
    let mut text = format!("{}\n\n", plan.name);
    for axis in &plan.axes {
        let levels: Vec<String> = axis.levels.iter().take(12).map(ToString::to_string).collect();
        let more = if axis.levels.len() > 12 { ", ..." } else { "" };
        let _ = writeln!(text, "{:28} {:>6}  {}{more}", axis.name, axis.levels.len(), levels.join(", "));
    }
    let names: Vec<&str> = plan.policies.iter().map(|policy| policy.name()).collect();
    let _ = writeln!(text, "{:28} {:>6}", "seed", plan.seeds.len());
    let _ = writeln!(text, "{:28} {:>6}  {}", "policy", names.len(), names.join(", "));
    if !plan.ablations.is_empty() {
        let names: Vec<&str> = plan.ablations.iter().map(|ablation| ablation.name()).collect();
        let _ = writeln!(text, "{:28} {:>6}  {}", "ablation", names.len(), names.join(", "));
    }
    let _ = writeln!(text, "{:28} {:>6}", "pairs of objects", plan.combos);
    let _ = writeln!(text, "{:28} {:>6}", "trials of a pair", plan.trials);
    let _ = writeln!(
        text,
        "\n{} points, {rows} trials (one under one policy each), {units} units of work\nabout {} of one core, {} on the {cores} of this machine; about {:.0} MB",
        plan.points(),
        format_duration(plan.core_s),
        format_duration(here),
        bytes / 1e6
    );
    let units: Vec<&str> = plan.units.iter().map(|unit| unit.id.as_str()).collect();
    let planned = SweepPlanOutput {
        name: &plan.name,
        points: plan.points(),
        trials: rows,
        units,
        core_s: plan.core_s,
        wall_s: here,
        bytes,
        sweep: plan.digest(),
    };
    terminal.print(&planned, &text)?;
    Ok(None)
}

/// Opens the requested result folder: from a sweep file and `--out`, or an existing one.
fn open_folder(path: &Path, out: Option<&Path>) -> Result<SweepFolder> {
    match (path.is_dir(), out) {
        (true, None) => SweepFolder::open(path),
        (true, Some(out)) => bail!(
            "--out: found {} beside the folder {}, expected it with a sweep's file only",
            out.display(),
            path.display()
        ),
        (false, Some(out)) => SweepFolder::join(out, SweepPlan::from_sweep(&Sweep::read(path)?)?),
        (false, None) => bail!("--out: found nothing, expected the folder for the results of {}", path.display()),
    }
}

fn run_sweep(terminal: &Terminal, args: &RunArgs) -> Outcome {
    if args.jobs == Some(0) {
        bail!("--jobs: found 0, expected at least 1");
    }
    let worker = args.worker.as_deref().map(|text| parse_part(text, "--worker")).transpose()?;
    let folder = open_folder(&args.path, args.out.as_deref())?;
    let jobs = args.jobs.unwrap_or_else(bench::workers::available_threads);
    let quiet = terminal.quiet || terminal.json;
    let done = work::work(&folder, WorkerOptions { jobs, quiet, worker })?;
    let mut text = format!(
        "{} of {} units are finished, {} of them run by this worker in {}\n",
        done.finished,
        done.total_units,
        done.run_here,
        format_duration(done.wall_s)
    );
    let mut shortfall = done.failed.first().map(|(unit, reason)| {
        let of = done.failed.len();
        format!("{of} of {} units failed; the first is {unit}: {reason}", done.total_units)
    });
    // One of many workers leaves merging to the job that runs after them.
    let mut joined = None;
    if worker.is_none() && done.finished > 0 {
        let merged = merge(&folder, quiet)?;
        text += &format_merged(&folder, &merged);
        shortfall = shortfall.or_else(|| merge_shortfall(&merged));
        joined = Some(MergeOutput::from_merged(merged));
    }
    let output = SweepRunOutput {
        folder: folder.path,
        run: done.run_here,
        finished: done.finished,
        units: done.total_units,
        failed: done.failed.into_iter().map(|(unit, reason)| FailedUnit { unit, reason }).collect(),
        wall_s: done.wall_s,
        merged: joined,
    };
    terminal.print(&output, &text)?;
    Ok(shortfall)
}

fn format_merged(folder: &SweepFolder, merged: &MergeResult) -> String {
    let mut text = String::new();
    for (unit, reason) in &merged.broken {
        let _ =
            writeln!(text, "unit {unit} is broken: {reason}; it is kept in {}", folder.path.join("corrupt").display());
    }
    let _ = writeln!(
        text,
        "{} trials and {} tries in {}; digest {}\na page: `ftac report {}`",
        merged.trials,
        merged.tries,
        folder.path.join("merged").display(),
        merged.digest,
        folder.path.display()
    );
    text
}

/// Returns the shortfall of merged results, if units are missing.
fn merge_shortfall(merged: &MergeResult) -> Option<String> {
    (merged.missing > 0).then(|| format!("{} of {} units are missing", merged.missing, merged.missing + merged.units))
}

fn run_merge(terminal: &Terminal, path: &Path) -> Outcome {
    let folder = SweepFolder::open(path)?;
    let merged = merge(&folder, terminal.quiet || terminal.json)?;
    let (text, shortfall) = (format_merged(&folder, &merged), merge_shortfall(&merged));
    terminal.print(&MergeOutput::from_merged(merged), &text)?;
    Ok(shortfall)
}

fn submit(terminal: &Terminal, args: &SubmitArgs) -> Outcome {
    for (name, value) in [("--max-jobs", args.max_jobs), ("--cpus", args.cpus)] {
        if value == 0 {
            bail!("{name}: found 0, expected at least 1");
        }
    }
    let folder = open_folder(&args.path, args.out.as_deref())?;
    // Jobs start in another working directory: the path must be absolute.
    let folder = SweepFolder { path: folder.path.canonicalize().context("--out")?, ..folder };
    let options = slurm::SlurmOptions {
        partition: args.partition.clone(),
        max_jobs: args.max_jobs,
        cpus: args.cpus,
        memory: args.memory.clone(),
        time: args.time.clone(),
        round: args.round,
    };
    let program = std::env::current_exe().context("the program's own path")?;
    let submitted = slurm::submit(&folder, &program, &options)?;
    let (what, jobs, text) = match &submitted {
        Submission::New(jobs) => {
            let text = format!(
                "{} workers are job {1}, job {2} merges their results; see `ftac sweep status {3}`; `scancel {2} {1}` ends it\n",
                jobs.workers,
                jobs.array,
                jobs.merge,
                folder.path.display()
            );
            ("submitted", Some(jobs), text)
        }
        Submission::Joined(jobs) => (
            "joined",
            Some(jobs),
            format!("jobs {} and {} of this sweep are under way already\n", jobs.array, jobs.merge),
        ),
        Submission::Finished => {
            let path = folder.path.display();
            ("finished", None, format!("all units are finished; merge them with `ftac sweep merge {path}`\n"))
        }
    };
    let handed = SubmitOutput {
        folder: folder.path,
        outcome: what,
        array: jobs.map(|jobs| jobs.array),
        merge: jobs.map(|jobs| jobs.merge),
        workers: jobs.map(|jobs| jobs.workers),
    };
    terminal.print(&handed, &text)?;
    Ok(None)
}

fn print_status(terminal: &Terminal, path: &Path) -> Outcome {
    let folder = SweepFolder::open(path)?;
    let now = status(&folder)?;
    let jobs = slurm::jobs(&folder)?;
    let tasks: Result<Vec<SlurmTask>> = jobs.as_ref().map_or_else(|| Ok(Vec::new()), slurm::queue);
    let number = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.0}"));
    let mut text = format!(
        "{}\n{:>8} of {} units finished, {} running, {} failed\n{:>8} of {} trials, {} a minute, {} left\n",
        folder.plan.name,
        now.finished,
        now.total_units,
        now.running,
        now.failed.len(),
        now.trials,
        now.total_trials,
        number(now.trials_per_minute),
        now.left_s.map_or("-".to_owned(), format_duration)
    );
    for (unit, failure) in &now.failed {
        let _ = writeln!(text, "unit {unit} failed on {}: {}", failure.by, failure.reason);
    }
    let mut unheard = None;
    match &tasks {
        Ok(tasks) => {
            for task in tasks {
                let _ = writeln!(text, "job {:14} {:12} {:>4} {}", task.id, task.state, task.count, task.reason);
            }
        }
        Err(error) => {
            unheard = Some(format!("{error:#}"));
            let _ = writeln!(text, "Slurm does not report the state of its jobs: {error:#}");
        }
    }
    let failed = |(unit, Failure { reason, by })| FailedAttempt { unit, reason, by };
    let standing = StatusOutput {
        name: folder.plan.name,
        finished: now.finished,
        units: now.total_units,
        running: now.running,
        failed: now.failed.into_iter().map(failed).collect(),
        trials: now.trials,
        of_trials: now.total_trials,
        trials_per_minute: now.trials_per_minute,
        left_s: now.left_s,
        jobs: tasks.unwrap_or_default(),
        slurm_error: unheard,
    };
    terminal.print(&standing, &text)?;
    Ok(None)
}

fn makespan(terminal: &Terminal, path: &Path, trials: Option<usize>, join: usize) -> Outcome {
    if join == 0 {
        bail!("--join: found 0, expected at least 1");
    }
    let folder = SweepFolder::open(path)?;
    let (points, text) = sweep::page::makespan(&folder, trials, join)?;
    terminal.print(&MakespanOutput { points }, &text)?;
    Ok(None)
}

/// Runs `ftac report` on a sweep's folder.
pub fn report(terminal: &Terminal, path: &Path, out: Option<&Path>) -> Outcome {
    let folder = SweepFolder::open(path)?;
    let made = sweep::page::report(&folder, out.unwrap_or(path))?;
    let text = format!("{}results in {}: report.html, curves.csv, contrasts.csv\n", made.text, made.folder.display());
    terminal.print(&made.results, &text)?;
    Ok(None)
}
