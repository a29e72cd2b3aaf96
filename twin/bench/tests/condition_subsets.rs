//! Every non-empty set of the conditions is run and resumed with every `--record`. A run without touch once ended with
//! "Zero width not allowed" at its first recorded trial.

use hand_model::RobotModel;
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::sync::OnceLock;

use bench::builtin::make_bench;
use bench::journal::{Journal, RecordingSelection, RunRequest};
use bench::provenance::Provenance;
use bench::run::{self, RunOptions};
use bench::trial::Bench;
use scenarios::Scenario;
use scenarios::record::{Condition, read_trials};
use scenarios::summary::Summary;

const RECORDING_SELECTIONS: [RecordingSelection; 4] =
    [RecordingSelection::None, RecordingSelection::Sample, RecordingSelection::Causes, RecordingSelection::All];
/// Seed with which the first blind trial fails, so that there is a cause to record.
const SEED: u64 = 1;

fn bench() -> &'static Bench {
    static BENCH: OnceLock<Bench> = OnceLock::new();
    BENCH.get_or_init(|| make_bench(&RobotModel::ftac_gen3(), Scenario::benchmark(), 1, SEED, true).expect("a bench"))
}

fn request(conditions: &[Condition], record: RecordingSelection) -> RunRequest {
    RunRequest {
        combos: 1,
        trials: 1,
        seed: SEED,
        robot: "sim".into(),
        driver: None,
        shard: (1, 1),
        conditions: conditions.to_vec(),
        ablations: Vec::new(),
        without: Vec::new(),
        uncertainty: None,
        policy: None,
        noise_scale: 1.0,
        effort: None,
        scenario: scenarios::scenario::BENCHMARK_TOML.into(),
        robot_model: None,
        robot_instance: None,
        pads: None,
        plant_instance: None,
        looks_ahead: false,
        detects_faults: false,
        places: Default::default(),
        gpu: false,
        record,
        provenance: vec![Provenance::now()],
        notes: Vec::new(),
        left_out: Vec::new(),
    }
}

fn run_request(request: &RunRequest, journal: Journal, folder: &Path) -> Summary {
    let options = RunOptions {
        jobs: 1,
        record: request.record,
        film: false,
        quiet: true,
        live: false,
        open_factory: &|_| Ok(None),
    };
    run::run(bench(), request, journal, folder, &options)
        .unwrap_or_else(|error| panic!("{:?} with --record {:?}: {error:#}", request.conditions, request.record))
}

/// Reads trials.csv without the column of wall-clock times.
fn trials(folder: &Path) -> Vec<scenarios::TrialRecord> {
    let file = fs::File::open(folder.join("trials.csv")).expect("trials.csv");
    let mut trials = read_trials(file).expect("rows");
    trials.iter_mut().for_each(|trial| trial.decision_ms = None);
    trials
}

/// Runs, checks the results, and runs the last unit again from the journal.
fn run_and_resumed(conditions: &[Condition], record: RecordingSelection) {
    let folder = tempfile::tempdir().expect("a folder");
    let folder = folder.path();
    let asked = request(conditions, record);
    let summary = run_request(&asked, Journal::create(folder, &asked).expect("a journal"), folder);
    let what = format!("{conditions:?} with --record {record:?}");
    let rows = trials(folder);
    let found: BTreeSet<Condition> = rows.iter().map(|row| row.condition).collect();
    assert_eq!(found, conditions.iter().copied().collect(), "{what}");
    assert_eq!(summary.conditions.conditions_with_trials(), conditions, "{what}");
    let recordings = || -> BTreeSet<String> {
        let names = fs::read_dir(folder.join("recordings")).expect("a folder");
        names.map(|entry| entry.expect("a file").file_name().to_string_lossy().into_owned()).collect()
    };
    let failed: BTreeSet<_> = rows.iter().filter_map(|row| Some((row.condition, row.cause?))).collect();
    let (noisy, ideal) =
        (conditions.iter().any(|one| *one != Condition::Ideal), conditions.contains(&Condition::Ideal));
    let expected = match record {
        RecordingSelection::None => 0,
        // The ideal run is not a trial.
        RecordingSelection::Sample => usize::from(noisy),
        RecordingSelection::Causes => failed.len(),
        RecordingSelection::All => usize::from(noisy) + usize::from(ideal),
    };
    let first = recordings();
    let of = |names: &BTreeSet<String>, end: &str| names.iter().filter(|name| name.ends_with(end)).count();
    assert_eq!(of(&first, ".rrd"), expected, "{what}: {first:?}");
    if matches!(record, RecordingSelection::Sample | RecordingSelection::All) && noisy {
        // The condition with the most senses is shown.
        let shown = conditions.iter().max().expect("one");
        assert_eq!(of(&first, &format!("_{shown}.png")), 1, "{what}: {first:?}");
    }
    // Killed before its last unit, the run resumes as it was started.
    let journal = fs::read_to_string(folder.join("journal.jsonl")).expect("a journal");
    let kept: String = journal.split_inclusive('\n').take(journal.lines().count() - 1).collect();
    fs::write(folder.join("journal.jsonl"), kept).expect("written");
    fs::remove_dir_all(folder.join("recordings")).expect("removed");
    let (journal, again) = Journal::resume(folder).expect("resumed");
    assert_eq!(again, asked, "{what}");
    run_request(&again, journal, folder);
    assert_eq!(trials(folder), rows, "{what}");
    assert!(recordings().is_subset(&first), "{what}");
    assert_eq!(recordings().is_empty(), expected == 0, "{what}: {first:?}");
}

/// Covers each condition alone, and each `--record`.
#[test]
fn a_run_without_touch_is_recorded_and_resumed() {
    use Condition::{Blind, Ideal, Reflex};
    run_and_resumed(&[Blind], RecordingSelection::Causes);
    run_and_resumed(&[Reflex], RecordingSelection::Sample);
    run_and_resumed(&[Ideal], RecordingSelection::None);
    run_and_resumed(&[Ideal, Blind], RecordingSelection::All);
}

#[test]
#[ignore = "the whole table: 15 sets of conditions with 4 ways to record take minutes"]
fn every_set_of_conditions_with_every_record() {
    for set in 1..16_usize {
        let conditions: Vec<Condition> = (0..4).filter(|n| set >> n & 1 == 1).map(|n| Condition::BUILT_IN[n]).collect();
        RECORDING_SELECTIONS.into_iter().for_each(|record| run_and_resumed(&conditions, record));
    }
}
