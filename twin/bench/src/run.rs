//! `ftac bench`: the multi-object benchmark, parallel, journaled and resumable.

mod causes;
mod film;

use std::path::Path;
use std::sync::Mutex;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use report;
use report::film::{Film, STRIP_LAYOUT};
use scenarios::record::{Condition, TrialRecord};
use scenarios::summary::Summary;

use crate::fault_watch;
use crate::journal::{Journal, JournalEntry, RecordingSelection, RunRequest, WorkUnit, work_units};
use crate::recording::{Recording, TimeOrigin};
use crate::trial::filming::{self, Filming, Watchers};
use crate::trial::{Bench, TrialResults, Watcher};
use crate::{results, workers};
use progress::interrupt::{Interrupt, Interrupted};
use robot_backends::BackendFactory;

/// Typical size of the recording of a trial with touch, bytes. Two objects that are picked up in one try each take 2.7 MB,
/// every further try some more.
const RECORDING_BYTES: f64 = 3e6;

/// Options of a run.
#[derive(Clone, Copy)]
pub struct RunOptions<'a> {
    /// Number of threads.
    pub jobs: usize,
    /// Selection of the recorded trials.
    pub record: RecordingSelection,
    /// True to film the first trial, on a simulated backend.
    pub film: bool,
    /// True to show no progress bar.
    pub quiet: bool,
    /// True to stream to a viewer as well as to files.
    pub live: bool,
    /// Opens a factory of backends that cannot be cloned; the argument is true for a recorded unit. `None` for
    /// simulated backends.
    pub open_factory: &'a (dyn Fn(bool) -> Result<Option<Box<dyn BackendFactory>>> + Sync),
}

fn is_recorded(request: &RunRequest, options: &RunOptions, unit: WorkUnit) -> bool {
    let selected = match options.record {
        RecordingSelection::None | RecordingSelection::Causes => false,
        RecordingSelection::Sample => unit.trial == Some(0) && unit.combination.is_multiple_of(10),
        RecordingSelection::All => true,
    };
    // A trial on real devices cannot be repeated, so it is always recorded.
    selected || options.live || request.keeps_wall_time()
}

/// Runs one unit. Its recording, if `options` request one, goes below `folder`.
pub fn run_unit(
    bench: &Bench,
    request: &RunRequest,
    unit: WorkUnit,
    folder: &Path,
    options: &RunOptions,
) -> Result<TrialResults> {
    let record = is_recorded(request, options, unit);
    run_unit_in_place(bench, request, (unit, &unit_name(unit)), folder, options, record)
}

/// Runs one unit and records it under `name` if `record`.
fn run_unit_in_place(
    bench: &Bench,
    request: &RunRequest,
    (unit, name): (WorkUnit, &str),
    folder: &Path,
    options: &RunOptions,
    record: bool,
) -> Result<TrialResults> {
    let condition = shown_condition(request, unit);
    if let Some(place) = (options.open_factory)(record)? {
        return run_conditions(bench, request, (unit, name), folder, options, (place, record));
    }
    let filmed = options.film && film::is_filmed(unit);
    let mut cameras = if filmed { film::cameras(bench, request, condition) } else { Vec::new() };
    let run_trial = |watcher: &mut dyn Watcher| {
        let mut watchers = Watchers(vec![watcher]);
        watchers.0.extend(cameras.iter_mut().map(|camera| camera as _));
        match unit.trial {
            Some(trial) => {
                let conditions = request.noisy_conditions();
                bench.run_each_condition(unit.combination, trial, &conditions, &request.ablations, &mut watchers)
            }
            None => bench.run_ideal(unit.combination, &mut watchers).map(TrialResults::from),
        }
    };
    let results = if record {
        run_recorded(bench, request, (unit, name), folder, options, (condition, run_trial))
    } else {
        run_with_watchers(bench, request, None, condition, run_trial)
    };
    if filmed && results.is_ok() {
        film::write(bench, unit, cameras, folder)?;
    }
    results
}

/// Runs `run_trial`, records it under `name`, and writes stills of it.
fn run_recorded(
    bench: &Bench,
    request: &RunRequest,
    (unit, name): (WorkUnit, &str),
    folder: &Path,
    options: &RunOptions,
    (condition, run_trial): (Condition, impl FnOnce(&mut dyn Watcher) -> Result<TrialResults>),
) -> Result<TrialResults> {
    let targets = recording_targets(name, folder, options.live);
    let mut recording =
        Recording::open(&targets, bench, &request.task(unit, condition, false), (TimeOrigin::Never, false))?;
    let mut filming = Filming::new(bench, condition, 4.0);
    let results = run_with_watchers(bench, request, Some(&mut recording), condition, |watcher| {
        run_trial(&mut Watchers(vec![watcher, &mut filming]))
    });
    recording.finish()?;
    if unit.trial.is_some() && results.is_ok() {
        write_film_strip(bench, unit, &filming.film, &report::pictures::strip_file(folder, name, condition))?;
    }
    results
}

/// Runs `run_trial` with `recording` as its watcher, and with fault detection if `request` asks for it. `condition` labels
/// the faults of a trial that stops.
fn run_with_watchers(
    bench: &Bench,
    request: &RunRequest,
    recording: Option<&mut Recording>,
    condition: Condition,
    run_trial: impl FnOnce(&mut dyn Watcher) -> Result<TrialResults>,
) -> Result<TrialResults> {
    let (results, named) = fault_watch::run_with_detector(
        bench,
        recording,
        (request.detects_faults, request.keeps_wall_time(), condition),
        run_trial,
    );
    Ok(TrialResults { faults: named.unwrap_or_default(), ..results? })
}

/// Writes stills of a recorded trial to `file`; none if the trial ended before its first frame.
fn write_film_strip(bench: &Bench, unit: WorkUnit, film: &Film, file: &Path) -> Result<()> {
    if film.frames.is_empty() {
        return Ok(());
    }
    let (count, size) = STRIP_LAYOUT;
    let strip = filming::film_stage(bench, unit.combination)?.strip(film, count, size);
    report::picture::save(&strip, file)
}

/// Runs the conditions of a unit on backends that cannot be cloned, each with its own recording if `record`.
fn run_conditions(
    bench: &Bench,
    request: &RunRequest,
    (unit, name): (WorkUnit, &str),
    folder: &Path,
    options: &RunOptions,
    (mut place, record): (Box<dyn BackendFactory>, bool),
) -> Result<TrialResults> {
    let conditions = if unit.trial.is_some() { request.noisy_conditions() } else { vec![Condition::Ideal] };
    let mut results = TrialResults::default();
    for condition in conditions {
        let task = request.task(unit, condition, record);
        let began = if task.keeps_wall_time() { TimeOrigin::Now } else { TimeOrigin::Never };
        let run_trial = |watcher: &mut dyn Watcher| bench.run(&task, place.as_mut(), watcher).map(TrialResults::from);
        let one = match record {
            false => run_with_watchers(bench, request, None, condition, run_trial)?,
            true => {
                let targets = recording_targets(&condition_recording_name(name, condition), folder, options.live);
                let mut recording = Recording::open(&targets, bench, &task, (began, false))?;
                let one = run_with_watchers(bench, request, Some(&mut recording), condition, run_trial);
                recording.finish()?;
                one?
            }
        };
        results.records.extend(one.records);
        results.tries.extend(one.tries);
        results.faults.extend(one.faults);
    }
    Ok(results)
}

/// Returns the condition that the recording of a unit shows: the one with the most senses and decisions among those
/// run.
fn shown_condition(request: &RunRequest, unit: WorkUnit) -> Condition {
    let last = request.noisy_conditions().last().copied();
    unit.trial.and(last).unwrap_or(Condition::Ideal)
}

/// Returns the name of a unit's recording.
fn unit_name(unit: WorkUnit) -> String {
    let trial = unit.trial.map_or("ideal".to_owned(), |trial| format!("trial_{trial}"));
    format!("combination_{:02}_{trial}", unit.combination)
}

/// Returns the name of a recording that shows only one condition of the unit.
fn condition_recording_name(name: &str, condition: Condition) -> String {
    format!("{name}_{condition}")
}

/// Returns the targets of the recording `name` of the run in `folder`.
fn recording_targets(name: &str, folder: &Path, live: bool) -> Vec<telemetry::RecordingTarget> {
    let file = folder.join("recordings").join(format!("{name}.rrd"));
    let viewer = live.then_some(telemetry::RecordingTarget::Spawn);
    std::iter::once(telemetry::RecordingTarget::File(file)).chain(viewer).collect()
}

/// Returns the command that continues the run in `folder`. Programs of others have to be named again.
fn resume_command(request: &RunRequest, folder: &Path) -> String {
    let mut words = ["ftac", "bench", "--resume"].map(str::to_owned).to_vec();
    words.push(folder.display().to_string());
    if let Some(policy) = &request.policy {
        words.extend(["--policy".to_owned(), policy.python_class().name()]);
    }
    if let Some(driver) = &request.driver {
        words.extend(["--robot".to_owned(), driver.class.name()]);
    }
    report::run::shell_line(&words)
}

/// Runs the unfinished units of `request`; the journal keeps every finished one.
pub fn run(
    bench: &Bench,
    request: &RunRequest,
    journal: Journal,
    folder: &Path,
    options: &RunOptions,
) -> Result<Summary> {
    let begun = Instant::now();
    let all = work_units(request);
    std::fs::create_dir_all(folder.join("recordings")).with_context(|| folder.display().to_string())?;
    let open: Vec<WorkUnit> = all.iter().copied().filter(|unit| !journal.done.contains_key(unit)).collect();
    let resumed = all.len() - open.len();
    if options.film && !open.iter().any(|unit| film::is_filmed(*unit)) {
        bail!("--film: found the first trial finished, expected a run that has yet to do it");
    }
    let recorded = open.iter().filter(|unit| is_recorded(request, options, **unit)).count();
    if recorded > 0 && !options.quiet {
        let megabytes = 1e-6 * RECORDING_BYTES * recorded as f64;
        eprintln!("{} of {} units are recorded, some {megabytes:.0} MB", recorded, open.len());
    }
    let bar = progress::resumed_bar(all.len() as u64, resumed as u64, "units", options.quiet);
    let journal = Mutex::new(journal);
    // On hardware each trial ends in order by itself.
    let interrupt = (!request.keeps_wall_time()).then(Interrupt::catch).transpose()?;
    let outcome = workers::for_each(options.jobs, &open, |_, unit| {
        if interrupt.as_ref().is_some_and(Interrupt::happened) {
            let resume_hint = format!("continue with `{}`", resume_command(request, folder));
            bail!(Interrupted { done: 0, total: all.len(), pieces: "units of work are finished", resume_hint });
        }
        let start = Instant::now();
        let results = run_unit(bench, request, *unit, folder, options).with_context(|| {
            let trial = unit.trial.map_or("ideal run".to_owned(), |trial| format!("trial {trial}"));
            format!("combination {}, {trial}", unit.combination)
        })?;
        let TrialResults { records, tries, ablated, faults: divergences } = results;
        let wall_s = start.elapsed().as_secs_f64();
        let entry = JournalEntry { run: None, unit: *unit, records, tries, ablated, faults: divergences, wall_s };
        let mut journal = journal.lock().map_err(|_| anyhow::anyhow!("a worker panicked"))?;
        journal.append(entry.clone()).map_err(|error| save_to_temporary(&entry, error))?;
        bar.inc(1);
        bar.set_message(shares_so_far(&journal));
        Ok(())
    });
    bar.finish_and_clear();
    let journal = journal.into_inner().map_err(|_| anyhow::anyhow!("a worker panicked"))?;
    outcome.map_err(|error| match error.downcast::<Interrupted>() {
        // The other threads have finished their units meanwhile.
        Ok(interrupted) => Interrupted { done: journal.done.len(), ..interrupted }.into(),
        Err(error) => error,
    })?;
    // A resumed run counts the time of work, without pauses.
    let worked = journal.done.values().map(|entry| entry.wall_s).sum::<f64>() / options.jobs.max(1) as f64;
    // If nothing was left to do, the results are only written anew.
    let earlier = open.is_empty().then(|| results::earlier_wall_time(folder)).flatten();
    let wall_s = earlier.unwrap_or_else(|| begun.elapsed().as_secs_f64().max(worked));
    // The earlier computing time of a resumed run is unknown.
    let spent = (resumed == 0).then(|| bench.profile.seconds());
    let all: f64 = spent.iter().flatten().map(|(_, seconds)| seconds).sum();
    if let Some(spent) = spent.as_ref().filter(|_| !options.quiet && all > 0.0) {
        let parts: Vec<String> =
            spent.iter().map(|(part, seconds)| format!("{} {:.1} %", part.name(), 100.0 * seconds / all)).collect();
        eprintln!("time of all threads: {}", parts.join(", "));
    }
    if options.record == RecordingSelection::Causes {
        causes::record_causes(bench, request, &journal.done, folder, options)?;
    }
    results::write_results(&journal.done, request, folder, wall_s, spent.as_deref())
}

/// Saves an entry that could not be appended to the journal among the temporary files, and adds its path to the error.
fn save_to_temporary(entry: &JournalEntry, error: anyhow::Error) -> anyhow::Error {
    let file = std::env::temp_dir().join(format!(
        "ftac_combination_{:02}_trial_{}_{}.json",
        entry.unit.combination,
        entry.unit.trial.map_or("ideal".to_owned(), |trial| trial.to_string()),
        std::process::id()
    ));
    let text = serde_json::to_string(entry).unwrap_or_default();
    match std::fs::write(&file, &text) {
        Ok(()) => error.context(format!("its result is in {}", file.display())),
        Err(_) => error.context(format!("its result is {text}")),
    }
}

/// Returns clean success and contact of the conditions that have run.
fn shares_so_far(journal: &Journal) -> String {
    let records: Vec<&TrialRecord> = journal.done.values().flat_map(|entry| &entry.records).collect();
    let shares = |pick: fn(&TrialRecord) -> bool| -> String {
        let share = |condition: &Condition| {
            let of: Vec<_> = records.iter().filter(|record| record.condition == *condition).collect();
            let hits = of.iter().filter(|record| pick(record)).count();
            (!of.is_empty()).then(|| format!(" {condition} {:.0}%", 100.0 * hits as f64 / of.len() as f64))
        };
        let told = [Condition::Blind, Condition::Reflex, Condition::Touch, Condition::External];
        told.iter().filter_map(share).collect()
    };
    format!("clean success:{}  contact:{}", shares(|record| record.clean_success), shares(|record| record.contact))
}
