//! Runs made up for tests: their folders hold a request and a journal, as `ftac bench` writes them.

use std::path::Path;

use bench::journal::{Journal, JournalEntry, RunRequest, work_units};
use bench::provenance::Provenance;
use scenarios::record::{Condition, TrialRecord};
use serde_json::{Value, json};

/// Returns the record of a trial.
pub(crate) fn record(
    combination: usize,
    trial: usize,
    condition: Condition,
    success: bool,
    contact: bool,
) -> TrialRecord {
    let seconds = 10.0 + combination as f64 / 3.0 + if condition == Condition::Blind { 0.0 } else { 5.0 };
    serde_json::from_value(json!({
        "combination": combination, "trial": trial, "condition": condition, "first": "egg", "second": "can_50",
        "contact": contact, "success": success, "clean_success": success && !contact, "switched": false, "retries": 0,
        "reason": "planned", "sim_seconds": seconds,
    }))
    .expect("a record")
}

/// Returns a request with `changes`.
pub(crate) fn request(changes: &Value) -> RunRequest {
    let mut run = json!({
        "combos": 6, "trials": 2, "seed": 1, "robot": "sim", "shard": [1, 1],
        "conditions": ["ideal", "blind", "touch"], "scenario": scenarios::scenario::BENCHMARK_TOML,
    });
    for (name, value) in changes.as_object().expect("changes") {
        run[name] = value.clone();
    }
    let request: RunRequest = serde_json::from_value(run).expect("a request");
    let provenance = Provenance { command: Vec::new(), version: "0.1.0".into(), machine: "a".into(), commit: None };
    RunRequest { provenance: vec![provenance], ..request }
}

/// Returns the records of a unit: touch is clean but in the first trial of combination 0, blind in every second
/// combination.
pub(crate) fn entry(request: &RunRequest, unit: bench::journal::WorkUnit) -> JournalEntry {
    let conditions = match unit.trial {
        None => vec![Condition::Ideal],
        Some(_) => request.noisy_conditions(),
    };
    let trial = unit.trial.unwrap_or(0);
    let records = conditions.into_iter().map(|condition| {
        let touch = (unit.combination, trial) != (0, 0);
        let clean = if condition == Condition::Blind { unit.combination.is_multiple_of(2) } else { touch };
        record(unit.combination, trial, condition, true, !clean)
    });
    JournalEntry {
        run: None,
        unit,
        records: records.collect(),
        tries: Vec::new(),
        ablated: Vec::new(),
        faults: Vec::new(),
        wall_s: 1.0,
    }
}

/// Writes a run with all units of `request` but the last `missing`, each changed by `change`.
pub(crate) fn write_run(folder: &Path, request: &RunRequest, missing: usize, change: impl Fn(&mut JournalEntry)) {
    let mut journal = Journal::create(folder, request).expect("a journal");
    let units = work_units(request);
    for unit in &units[..units.len() - missing] {
        let mut entry = entry(request, *unit);
        change(&mut entry);
        journal.append(entry).expect("appended");
    }
}
