//! `ftac board`: results of policies on the benchmark in one table, one file a row.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use board::add::{EntryText, save};
use board::check::{Difference, uses_scenario_of_this_program};
use board::entry::{BoardEntry, PolicyKind, SeedUse};
use board::rerun::{Sample, policy_to_run, rerun};
use board::table::{self, BoardGroup, read_board};
use clap::{Args, Subcommand};
use external_policy::{PolicySource, SimulatedTimePassage};
use ftac_platform::data::write_atomically;
use schemars::JsonSchema;
use serde::Serialize;

use crate::terminal::{Outcome, Terminal};

/// Folder of the board in the repository.
const BOARD_FOLDER: &str = "recordings/board";
/// Number of trials that are run again if a policy is named.
const SAMPLE_SIZE: usize = 5;

/// `board` commands.
#[derive(Debug, Subcommand)]
pub enum BoardCommand {
    /// Make a row from finished runs of `bench`: a file with the policy, hashes, shares and the outcome of every trial.
    Add(AddArgs),
    /// List the rows by clean success, in groups that ran the same trials.
    List {
        /// Folder of the rows.
        #[arg(default_value = BOARD_FOLDER)]
        folder: PathBuf,
        /// Print tables in Markdown.
        #[arg(long)]
        markdown: bool,
    },
    /// Write the rows as a page.
    Page {
        /// Folder of the rows.
        #[arg(default_value = BOARD_FOLDER)]
        folder: PathBuf,
        /// The page.
        #[arg(long, default_value = "board.html")]
        out: PathBuf,
    },
    /// Check rows: fields, hashes, and shares that must follow from the outcomes. With a policy or --trials, trials are
    /// run again and compared bit by bit. Exit code 1: a value differs; 2: a file is no row, or cannot be run again.
    Check(CheckArgs),
}

/// Arguments of `board add`.
#[derive(Debug, Args)]
pub struct AddArgs {
    /// Result folders of one run: a finished run, all its shards, or runs of several seeds with the same settings.
    #[arg(required = true, value_name = "RUN")]
    pub folders: Vec<PathBuf>,
    /// Name of the row; the file is named after it.
    #[arg(long)]
    pub name: String,
    /// Condition of the run that the row shows: blind, reflex, touch or external; default: the external policy, or the
    /// only one.
    #[arg(long)]
    pub condition: Option<String>,
    /// Author of the policy.
    #[arg(long)]
    pub by: Option<String>,
    /// Page about the policy: an address that begins with https:// or http://.
    #[arg(long, value_name = "URL")]
    pub link: Option<String>,
    /// State that the policy was not developed on the seeds of the run.
    #[arg(long)]
    pub held_out: bool,
    /// Folder for the file.
    #[arg(long, value_name = "DIR", default_value = BOARD_FOLDER)]
    pub out: PathBuf,
}

/// Arguments of `board check`.
#[derive(Debug, Args)]
pub struct CheckArgs {
    /// Files of rows.
    #[arg(required = true, value_name = "ENTRY")]
    pub entries: Vec<PathBuf>,
    /// Policy of the row, as FILE.py:CLASS: its file is compared, and trials are run again with it.
    #[arg(long, value_name = "FILE:CLASS")]
    pub policy: Option<String>,
    /// Argument for the constructor of the policy's class, as KEY=VALUE (repeatable); default: those of the row.
    #[arg(long, value_name = "KEY=VALUE", requires = "policy")]
    pub policy_arg: Vec<String>,
    /// Number of trials to run again, chosen by --seed; default: 5 with --policy, otherwise none.
    #[arg(long)]
    pub trials: Option<usize>,
    /// Number of threads; default: all cores.
    #[arg(long)]
    pub jobs: Option<usize>,
}

/// JSON output of `board add`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct BoardAddOutput {
    /// File of the row.
    file: PathBuf,
    /// Name of the row.
    name: String,
    /// SHA-256 of the outcomes.
    outcomes: String,
    shares: board::shares::Shares,
    /// Paired comparisons of clean success.
    comparisons: Vec<board::shares::Comparison>,
}

/// JSON output of `board list`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct BoardListOutput {
    /// Rows with the same trials; those of different groups cannot be compared.
    groups: Vec<BoardGroup>,
}

/// JSON output of `board page`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct BoardPageOutput {
    /// The page.
    file: PathBuf,
    /// Number of rows.
    rows: usize,
}

/// A checked row.
#[derive(Debug, Serialize, JsonSchema)]
pub struct CheckedEntry {
    file: PathBuf,
    /// Name of the row.
    name: String,
    /// Number of trials that were run again.
    trials: usize,
    /// Values that differ from the expected ones.
    differences: Vec<Difference>,
    /// Remarks that are no differences.
    notes: Vec<String>,
}

/// JSON output of `board check`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct BoardCheckOutput {
    entries: Vec<CheckedEntry>,
}

/// Runs a `board` command.
pub fn run(terminal: &Terminal, command: &BoardCommand) -> Outcome {
    match command {
        BoardCommand::Add(args) => add(terminal, args),
        BoardCommand::List { folder, markdown } => list(terminal, folder, *markdown),
        BoardCommand::Page { folder, out } => page(terminal, folder, out),
        BoardCommand::Check(args) => check(terminal, args),
    }
}

fn add(terminal: &Terminal, args: &AddArgs) -> Outcome {
    let condition = args.condition.as_deref().map(str::parse).transpose().context("--condition")?;
    let text = EntryText {
        name: args.name.clone(),
        by: args.by.clone(),
        link: args.link.clone(),
        seed_use: if args.held_out { SeedUse::HeldOut } else { SeedUse::Development },
    };
    let entry = board::add(&args.folders, condition, text)?;
    let file = save(&entry, &args.out)?;
    let mut text = format!("{}\n", file.display());
    let _ = writeln!(text, "clean success {}", table::with_interval(&entry.shares.clean));
    for comparison in &entry.comparisons {
        let _ = writeln!(text, "over {} {}", comparison.rival, table::difference_text(comparison));
    }
    let BoardEntry { name, hashes, shares, comparisons, .. } = entry;
    terminal.print(&BoardAddOutput { file, name, outcomes: hashes.outcomes, shares, comparisons }, &text)?;
    Ok(None)
}

/// Names the rows that do not agree with their own outcomes.
fn rows_not_in_order(groups: &[BoardGroup]) -> Option<String> {
    let rows = groups.iter().flat_map(|group| &group.rows).filter(|row| row.differences > 0);
    let files: Vec<String> = rows.map(|row| row.file.display().to_string()).collect();
    let check = "see `ftac board check`";
    (!files.is_empty()).then(|| format!("not in agreement with their own outcomes: {}; {check}", files.join(", ")))
}

fn list(terminal: &Terminal, folder: &Path, markdown: bool) -> Outcome {
    let groups = read_board(folder)?;
    let text = if markdown { table::markdown(&groups) } else { table::text(&groups) };
    let shortfall = rows_not_in_order(&groups);
    terminal.print(&BoardListOutput { groups }, &text)?;
    Ok(shortfall)
}

fn page(terminal: &Terminal, folder: &Path, out: &Path) -> Outcome {
    let groups = read_board(folder)?;
    write_atomically(out, board::page::page(&groups).as_bytes()).context("--out")?;
    let rows = groups.iter().map(|group| group.rows.len()).sum();
    terminal.print(&BoardPageOutput { file: out.to_owned(), rows }, &format!("{rows} rows in {}\n", out.display()))?;
    Ok(rows_not_in_order(&groups))
}

fn check(terminal: &Terminal, args: &CheckArgs) -> Outcome {
    if args.jobs == Some(0) {
        bail!("--jobs: found 0, expected at least 1");
    }
    if args.policy.is_some() && args.entries.len() > 1 {
        bail!("--policy: found {} entries beside it, expected the policy's own", args.entries.len());
    }
    let mut entries = Vec::new();
    for file in &args.entries {
        entries.push(check_entry(terminal, args, file)?);
    }
    let mut text = String::new();
    for entry in &entries {
        let CheckedEntry { file, trials, differences, notes, .. } = entry;
        let again = if *trials > 0 { format!(", {trials} trials run again") } else { String::new() };
        let state = if differences.is_empty() { "in order" } else { "differs" };
        let _ = writeln!(text, "{}: {state}{again}", file.display());
        for difference in differences {
            let _ = writeln!(text, "  {difference}");
        }
        for note in notes {
            let _ = writeln!(text, "  note: {note}");
        }
    }
    let differing = entries.iter().filter(|entry| !entry.differences.is_empty());
    let first = differing.clone().find_map(|entry| Some((entry, entry.differences.first()?)));
    let shortfall = first.map(|(entry, difference)| {
        format!(
            "{} of {} rows differ; the first is {}: {difference}",
            differing.count(),
            entries.len(),
            entry.file.display()
        )
    });
    terminal.print(&BoardCheckOutput { entries }, &text)?;
    Ok(shortfall)
}

/// Checks one entry: by its own content and, as far as asked, by trials that are run again.
fn check_entry(terminal: &Terminal, args: &CheckArgs, file: &Path) -> anyhow::Result<CheckedEntry> {
    let entry = BoardEntry::read(file)?;
    let mut differences = board::verify(&entry, file)?;
    let source = match (&args.policy, entry.policy.kind) {
        (None, _) => None,
        (Some(found), PolicyKind::BuiltIn) => {
            bail!(
                "--policy: found {found}, expected none: {} has the built-in policy {}",
                file.display(),
                entry.policy.condition
            )
        }
        (Some(text), PolicyKind::Python) => {
            let source = PolicySource::parse(text, &args.policy_arg, SimulatedTimePassage::Paused)?;
            let (source, found) = policy_to_run(&entry, source)?;
            differences.extend(found);
            Some(source)
        }
    };
    let sample = args.trials.unwrap_or(if source.is_some() { SAMPLE_SIZE } else { 0 });
    if sample > 0 && source.is_none() && entry.policy.kind == PolicyKind::Python {
        bail!("--trials: found {sample} without --policy FILE.py:CLASS, expected it for {}", file.display());
    }
    let mut notes = notes(&entry);
    let mut trials = 0;
    if sample > 0 && differences.is_empty() {
        let jobs = args.jobs.unwrap_or_else(bench::workers::available_threads);
        let sample = Sample { trials: sample, seed: terminal.seed };
        let again = rerun(&entry, file, source.as_ref(), sample, (jobs, terminal.quiet || terminal.json))?;
        trials = again.trials;
        differences.extend(again.differences);
    } else if sample > 0 {
        notes.push("no trial was run again, because the row differs already".to_owned());
    }
    Ok(CheckedEntry { file: file.to_owned(), name: entry.name, trials, differences, notes })
}

/// Returns remarks on an entry that was made by another program.
fn notes(entry: &BoardEntry) -> Vec<String> {
    let mut notes = Vec::new();
    let (version, own) = (&entry.program.version, env!("CARGO_PKG_VERSION"));
    if version != own {
        notes.push(format!("the row was made by version {version}; this is {own}, whose trials may end otherwise"));
    }
    if !uses_scenario_of_this_program(entry) {
        notes.push(format!("the benchmark's scenario has changed since version {version}"));
    }
    notes
}
