//! A sweep of synthetic results, to measure the cost of reporting a million trials.
//!
//! ```sh
//! FTAC_SYNTHETIC=/tmp/million cargo test --release --workspace --lib a_million_made_up_trials -- --ignored --nocapture
//! ftac report /tmp/million
//! ```

use std::path::{Path, PathBuf};

use bench::trial::TrialResults;
use scenarios::record::{AblatedTrial, Condition, PoseErrors, TrialRecord};

use crate::columns::{TableKind, VERSION};
use crate::file::Sweep;
use crate::folder::SweepFolder;
use crate::merge::merge;
use crate::outcomes::Outcomes;
use crate::plan::{SweepPlan, SweepUnit};
use crate::rows::UnitTables;

const SWEEP: &str = "version = 1\nname = \"made up, for measuring\"\ncombos = 60\ntrials = 10\nunit_minutes = 30.0\n[axes]\n\
                     policy = [\"blind\", \"reflex\", \"touch\"]\nseed = { from = 1, to = SEEDS, steps = SEEDS }\n\
                     noise_scale = { from = 0.0, to = 2.0, steps = 11 }\n";

fn record(combination: usize, trial: usize, condition: Condition, draw: u64) -> TrialRecord {
    let lost = draw % 5 < 2;
    TrialRecord {
        combination,
        trial,
        condition,
        first: format!("object_{}", combination % 30),
        second: format!("object_{}", combination % 28),
        contact: draw.is_multiple_of(7),
        contact_with: None,
        contact_s: None,
        contact_n: None,
        success: !lost,
        clean_success: !lost && !draw.is_multiple_of(7),
        cause: None,
        switched: draw.is_multiple_of(3),
        retries: (draw % 3) as u32,
        reason: format!("score {:.3}", draw as f64 / 1e3),
        disturbance: String::new(),
        risk: Some(draw as f64 / 1e4),
        plan_separation_mm: Some(draw as f64 / 1e2 - 5.0),
        chosen_separation_mm: None,
        pose_error_mm: None,
        pose_error_deg: None,
        prior_error_mm: None,
        sim_seconds: 14.0 + draw as f64 / 1e3,
        decision_ms: None,
        third: String::new(),
        later_pose_errors: PoseErrors::default(),
    }
}

fn unit(folder: &SweepFolder, unit: &SweepUnit) {
    let mut rows = UnitTables::new(&folder.plan, unit).expect("rows");
    for (n, trial) in folder.plan.trials(unit).expect("trials").into_iter().enumerate() {
        let records = folder.plan.policies.iter().map(|&condition| {
            let draw = (unit.from + n) as u64 * 2_654_435_761 % 9_973 + condition as u64 * 17;
            record(trial.combination, trial.trial.unwrap_or(0), condition, draw)
        });
        let ablated = Vec::<AblatedTrial>::new();
        rows.add(&TrialResults { records: records.collect(), ablated, ..TrialResults::default() }).expect("added");
    }
    let metadata =
        [("ftac.schema", VERSION.to_string()), ("ftac.unit", unit.id.clone()), ("ftac.seconds", "100".to_owned())];
    let [tries, trials] = [rows.tries, rows.trials].map(|table| table.to_parquet(&metadata).expect("a file"));
    folder.store_unit(&unit.id, &tries, &trials).expect("kept");
}

fn sweep(path: &Path, seeds: usize) -> SweepFolder {
    let text = SWEEP.replace("SEEDS", &seeds.to_string());
    let plan =
        SweepPlan::from_sweep(&Sweep::parse(&text, Path::new("made-up.toml")).expect("a sweep")).expect("a plan");
    let folder = SweepFolder::join(path, plan).expect("a folder");
    folder.plan.units.iter().for_each(|one| unit(&folder, one));
    folder
}

/// All stored results are recovered, and the digest does not depend on the order in which units were run.
#[test]
fn what_is_kept_is_reported() {
    let [one, other] = [(); 2].map(|()| tempfile::tempdir().expect("a folder"));
    let folder = sweep(one.path(), 2);
    let merged = merge(&folder, true).expect("merged");
    assert_eq!((merged.trials, merged.missing, merged.broken.len()), (folder.plan.rows(), 0, 0));
    let outcomes = Outcomes::read(&folder, true).expect("read");
    assert_eq!(outcomes.trial_count(), 2 * 11 * 600 * 3);
    let made = crate::page::report(&folder, one.path()).expect("a report");
    assert_eq!(made.results.trials, 2 * 11 * 600 * 3);
    let reversed = SweepFolder::join(other.path(), folder.plan.clone()).expect("a folder");
    reversed.plan.units.iter().rev().for_each(|one| unit(&reversed, one));
    assert_eq!(merge(&reversed, true).expect("merged").digest, merged.digest);
    // A missing unit changes the result.
    std::fs::remove_file(reversed.unit_path(TableKind::Trials, &folder.plan.units[0].id)).expect("removed");
    let less = merge(&reversed, true).expect("merged");
    assert!(less.missing == 1 && less.digest != merged.digest);
}

#[test]
#[ignore = "writes a million trials to the folder FTAC_SYNTHETIC"]
fn a_million_made_up_trials() {
    let path = PathBuf::from(std::env::var_os("FTAC_SYNTHETIC").expect("FTAC_SYNTHETIC names a folder"));
    let folder = sweep(&path, 51);
    let merged = merge(&folder, true).expect("merged");
    println!("{} trials in {}", merged.trials, path.display());
}
