//! Repetition of a sample of an entry's trials. The same seed gives the same bits, so every outcome is compared exactly.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use anyhow::{Context as _, Result, bail};
use bench::builtin::bench_from_request;
use bench::trial::NoWatcher;
use bench::workers;
use external_policy::{DecisionLevel, ExternalPolicy, PolicyIntroduction, PolicySource};
use progress::interrupt::{Interrupt, Interrupted};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use scenarios::record::{Condition, TrialRecord};

use crate::add::{acting_image_side, argument_files};
use crate::check::{Difference, uses_scenario_of_this_program};
use crate::entry::BoardEntry;
use crate::error::BoardError;
use crate::outcomes::{OutcomePlace, Outcomes, RecordedOutcome};

/// Sample of the trials to run again.
#[derive(Debug, Clone, Copy)]
pub struct Sample {
    /// Number of trials; all, if the entry has fewer.
    pub trials: usize,
    /// Seed of the choice.
    pub seed: u64,
}

/// Result of a repetition.
#[derive(Debug, Clone, Default)]
pub struct Repetition {
    /// Number of trials that were run again, each under every condition of the entry.
    pub trials: usize,
    /// Differences from the entry, in the order of its outcomes.
    pub differences: Vec<Difference>,
}

/// Returns the policy to run, with the entry's arguments where `source` has none of that name, and its differences from
/// the entry's. A difference means that its trials need not be run.
pub fn policy_to_run(
    entry: &BoardEntry,
    mut source: PolicySource,
) -> Result<(PolicySource, Vec<Difference>), BoardError> {
    let facts = &entry.policy;
    let mut differences = Vec::new();
    let none = || "none".to_owned();
    let hash = facts.sha256.clone().unwrap_or_else(none);
    if hash != source.sha256 {
        let expected = format!("{}, the SHA-256 of {}", source.sha256, source.file.display());
        differences.push(Difference::new("policy.sha256", hash, expected));
    }
    let class = facts.class.clone().unwrap_or_else(none);
    if class != source.class {
        differences.push(Difference::new("policy.class", class, &source.class));
    }
    for (name, value) in &facts.arguments {
        source.arguments.entry(name.clone()).or_insert_with(|| value.clone());
    }
    let files = argument_files(&source)?;
    for (name, value) in &source.arguments {
        let (found, expected) = (facts.argument_files.get(name), files.get(name));
        if found != expected {
            let hash = |hash: Option<&String>| hash.cloned().unwrap_or_else(|| "no file".to_owned());
            differences.push(Difference::new(format!("policy.argument_files.{name}"), hash(found), hash(expected)));
        } else if found.is_none() && facts.arguments.get(name) != Some(value) {
            let found = facts.arguments.get(name).map_or_else(none, ToString::to_string);
            differences.push(Difference::new(format!("policy.arguments.{name}"), found, value));
        }
    }
    Ok((source, differences))
}

/// Runs a sample of the entry's trials again, on `jobs` threads. `policy` is that of an entry with a Python policy, from
/// [`policy_to_run`]; `path` is used in errors only.
pub fn rerun(
    entry: &BoardEntry,
    path: &Path,
    policy: Option<&PolicySource>,
    sample: Sample,
    (jobs, quiet): (usize, bool),
) -> Result<Repetition> {
    if !uses_scenario_of_this_program(entry) {
        bail!(
            "{}: hashes.scenario: found {}, expected {}: the benchmark's scenario has changed since version {}, \
             whose program can run the trials again",
            path.display(),
            entry.hashes.scenario,
            entry.settings.scenario_digest(),
            entry.program.version
        );
    }
    let (outcomes, conditions) = (entry.outcome_map(path)?, entry.conditions());
    let (combinations, trials) = (entry.work.combinations, entry.work.trials);
    let chosen = choose(entry, sample);
    let total = chosen.values().map(Vec::len).sum();
    let bar = progress::resumed_bar(total as u64, 0, "trials", quiet);
    let interrupt = Interrupt::catch()?;
    let mut result = Repetition { trials: total, differences: Vec::new() };
    let mut done = 0;
    for (seed, places) in chosen {
        let mut request = entry.settings.to_request(seed, (combinations, trials), &conditions);
        request.policy = policy.cloned();
        let mut bench = bench_from_request(&request, quiet).with_context(|| path.display().to_string())?;
        let pairs = bench.grasp_pairs.pairs.len();
        if pairs < combinations {
            bail!(
                "{}: work.combinations: found {combinations}, expected at most {pairs}, the feasible ones",
                path.display()
            );
        }
        bench.continues_after_faults = request.policy.is_none();
        if let Some(source) = policy.filter(|_| conditions.contains(&Condition::External)) {
            source.check()?;
            let external = ExternalPolicy::start(source.clone())?;
            result.differences.extend(introduction_difference(entry, &external.introduction));
            bench.external_policy = Some(external);
        }
        let found: Mutex<Vec<Difference>> = Mutex::default();
        workers::for_each(jobs, &places, |n, (combination, trial)| {
            if interrupt.happened() {
                let resume_hint = "no file was changed".to_owned();
                bail!(Interrupted { done: done + n, total, pieces: "trials were run again", resume_hint });
            }
            let results = bench
                .run_each_condition(*combination, *trial, &conditions, &[], &mut NoWatcher)
                .with_context(|| format!("seed {seed}, combination {combination}, trial {trial}"))?;
            let differences = compare(&outcomes, seed, &results.records)?;
            found.lock().unwrap_or_else(PoisonError::into_inner).extend(differences);
            bar.inc(1);
            Ok(())
        })?;
        done += places.len();
        let mut found = found.into_inner().unwrap_or_else(PoisonError::into_inner);
        found.sort();
        result.differences.extend(found);
    }
    bar.finish_and_clear();
    Ok(result)
}

/// Chooses trials without repetition: (combination, trial) by seed.
fn choose(entry: &BoardEntry, sample: Sample) -> BTreeMap<u64, Vec<(usize, usize)>> {
    let mut all = Vec::new();
    for seed in &entry.work.seeds {
        for combination in 0..entry.work.combinations {
            all.extend((0..entry.work.trials).map(|trial| (*seed, combination, trial)));
        }
    }
    let mut rng = ChaCha8Rng::seed_from_u64(sample.seed);
    let count = sample.trials.min(all.len());
    for n in 0..count {
        let other = rng.random_range(n..all.len());
        all.swap(n, other);
    }
    all.truncate(count);
    all.sort_unstable();
    let mut chosen: BTreeMap<u64, Vec<(usize, usize)>> = BTreeMap::new();
    for (seed, combination, trial) in all {
        chosen.entry(seed).or_default().push((combination, trial));
    }
    chosen
}

/// Returns the difference of the policy's introduction from the entry, if there is one.
fn introduction_difference(entry: &BoardEntry, introduction: &PolicyIntroduction) -> Option<Difference> {
    let facts = &entry.policy;
    let (found, expected) = ((facts.level, facts.image_side), (introduction.level, acting_image_side(introduction)));
    let words = |(level, side): (DecisionLevel, Option<usize>)| {
        format!(
            "{level:?}, images {}",
            side.map_or("as the level has them".to_owned(), |side| format!("of {side} pixels"))
        )
        .to_lowercase()
    };
    (found != expected).then(|| Difference::new("policy.level", words(found), words(expected)))
}

/// Compares the records of a trial with the outcomes of the entry.
fn compare(outcomes: &Outcomes, seed: u64, records: &[TrialRecord]) -> Result<Vec<Difference>> {
    let mut differences = Vec::new();
    for record in records {
        let (combination, trial, condition) = (record.combination, record.trial, record.condition);
        let place = OutcomePlace { seed, condition, combination, trial };
        let found = outcomes.get(&place).with_context(|| format!("{place}: found no outcome"))?;
        let now = RecordedOutcome::from_record(record)?;
        if found.kind != now.kind {
            differences.push(Difference::new(format!("{place}: outcome"), found.kind.name(), now.kind.name()));
        }
        if found.seconds.to_bits() != now.seconds.to_bits() {
            differences.push(Difference::new(format!("{place}: seconds"), found.seconds, now.seconds));
        }
        if found.record != now.record {
            differences.push(Difference::new(format!("{place}: record"), &found.record, &now.record));
        }
    }
    Ok(differences)
}

#[cfg(test)]
mod tests {
    use external_policy::SimulatedTimePassage;

    use super::*;
    use crate::add::tests::touch_entry;
    use crate::test_runs::record;

    #[test]
    fn a_sample_is_seeded_and_has_no_trial_twice() {
        let entry = touch_entry();
        let places = |trials, seed| choose(&entry, Sample { trials, seed });
        assert_eq!(places(5, 1), places(5, 1));
        assert_ne!(places(5, 1), places(5, 2));
        assert_eq!(places(5, 1)[&1].len(), 5);
        let all = places(100, 1)[&1].clone();
        assert_eq!(all.len(), 12);
        assert!(all.windows(2).all(|pair| pair[0] < pair[1]), "{all:?}");
    }

    /// Each column that differs is named with its trial.
    #[test]
    fn other_outcomes_are_named() {
        let entry = touch_entry();
        let outcomes = entry.outcome_map(Path::new("row.toml")).expect("outcomes");
        let same = record(1, 1, Condition::Touch, true, false);
        assert_eq!(compare(&outcomes, 1, std::slice::from_ref(&same)).expect("compared"), []);
        let lost = record(1, 1, Condition::Touch, false, false);
        let words = |records: &[TrialRecord]| -> Vec<String> {
            compare(&outcomes, 1, records).expect("compared").iter().map(ToString::to_string).collect()
        };
        let found = words(&[lost]);
        assert_eq!(found[0], "seed 1, combination 1, trial 1, touch: outcome: found clean, expected failed");
        assert!(found[1].starts_with("seed 1, combination 1, trial 1, touch: record: found "), "{found:?}");
        let longer = TrialRecord { sim_seconds: f64::from_bits(same.sim_seconds.to_bits() + 1), ..same };
        assert!(words(&[longer])[0].contains("touch: seconds: found 15.333333333333334, expected "));
    }

    #[test]
    fn another_policy_file_is_a_difference() {
        let folder = tempfile::tempdir().expect("a folder");
        let [file, weights] = ["mine.py", "weights.npz"].map(|name| folder.path().join(name));
        std::fs::write(&file, "class Mine: ...").expect("written");
        std::fs::write(&weights, "abc").expect("written");
        let name = format!("{}:Mine", file.display());
        let parse = |arguments: &[String]| {
            PolicySource::parse(&name, arguments, SimulatedTimePassage::Paused).expect("a policy")
        };
        let argument = format!("weights={}", weights.display());
        let source = parse(&[argument.clone(), "gain=0.5".to_owned()]);
        let mut entry = touch_entry();
        entry.policy.sha256 = Some(source.sha256.clone());
        entry.policy.class = Some("Mine".to_owned());
        entry.policy.arguments = source.arguments.clone();
        entry.policy.argument_files = argument_files(&source).expect("hashes");
        let differences = |source: PolicySource| -> Vec<String> {
            let (_, found) = policy_to_run(&entry, source).expect("compared");
            found.iter().map(|difference| difference.field.clone()).collect()
        };
        assert_eq!(differences(parse(&[])), Vec::<String>::new());
        assert_eq!(differences(parse(&["gain=0.6".to_owned()])), ["policy.arguments.gain"]);
        std::fs::write(&weights, "abd").expect("written");
        assert_eq!(differences(parse(&[argument])), ["policy.argument_files.weights"]);
        std::fs::write(&file, "class Mine: pass").expect("written");
        let found = differences(parse(&[]));
        assert_eq!(found, ["policy.sha256", "policy.argument_files.weights"]);
    }
}
