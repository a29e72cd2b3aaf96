//! Entries from finished runs of `ftac bench`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use external_policy::{DecisionLevel, PolicyIntroduction, PolicySource, SimulatedTimePassage};
use ftac_platform::DataError;
use ftac_platform::data::write_atomically;
use ftac_platform::digest::sha256;
use ftac_platform::file::{MAX_TEXT_SIZE, read_regular};
use scenarios::record::Condition;
use serde_json::Value;

use crate::entry::{BoardEntry, Hashes, OutcomeTable, PolicyFacts, PolicyKind, SCHEMA, SeedUse, Work};
use crate::error::BoardError;
use crate::outcomes::{outcomes_digest, write_rows};
use crate::runs::Runs;
use crate::settings::Settings;
use crate::shares::{comparisons, shares};

/// Part of an entry that no run knows.
#[derive(Debug, Clone)]
pub struct EntryText {
    /// Name of the row.
    pub name: String,
    /// Author of the policy.
    pub by: Option<String>,
    /// Page about the policy.
    pub link: Option<String>,
    /// Use of the seeds before the run.
    pub seed_use: SeedUse,
}

/// Makes the entry of one policy from the runs in `folders`: one run, its shards, or runs of several seeds with the same
/// settings. Without `condition`, the runs must have only one policy, or an external one.
pub fn add(folders: &[PathBuf], condition: Option<Condition>, text: EntryText) -> Result<BoardEntry, BoardError> {
    let runs = Runs::read(folders)?;
    let own = runs.own_condition(condition)?;
    let request = &runs.request;
    let settings = Settings::from_request(request, &runs.folder)?;
    let outcomes = runs.outcomes(own)?;
    let seeds: Vec<u64> = runs.by_seed.keys().copied().collect();
    let conditions: BTreeSet<Condition> = outcomes.keys().map(|place| place.condition).collect();
    let mut tables = Vec::new();
    for seed in &seeds {
        for condition in &conditions {
            let rows = write_rows(&outcomes, *seed, *condition);
            tables.push(OutcomeTable { seed: *seed, condition: *condition, rows });
        }
    }
    let scenario = settings.scenario_digest();
    let hashes = Hashes { settings: settings.digest(&scenario)?, scenario, outcomes: outcomes_digest(&outcomes, own) };
    let missing = || runs.unsuitable("conditions", format!("no trial of {own}"), "trials");
    let entry = BoardEntry {
        schema: SCHEMA,
        name: text.name,
        by: text.by,
        link: text.link,
        policy: policy_facts(&runs, own)?,
        program: runs.program()?,
        work: Work { seed_use: text.seed_use, combinations: request.combos, trials: request.trials, seeds },
        settings,
        hashes,
        shares: shares(&outcomes, own).ok_or_else(missing)?,
        comparisons: comparisons(&outcomes, own),
        outcomes: tables,
    };
    entry.validate(Path::new("the entry"))?;
    Ok(entry)
}

/// Writes the entry into `folder`, which is created, under a name made from the row's. Refuses to replace a file.
pub fn save(entry: &BoardEntry, folder: &Path) -> Result<PathBuf, BoardError> {
    let text = entry.to_text()?;
    let path = folder.join(file_name(&entry.name));
    if path.exists() {
        return Err(BoardError::Option {
            option: "--out",
            found: format!("the file {}", path.display()),
            expected: "none: choose another --name, or remove the file".to_owned(),
        });
    }
    std::fs::create_dir_all(folder).map_err(|source| DataError::Write { path: folder.to_owned(), source })?;
    write_atomically(&path, text.as_bytes())?;
    Ok(path)
}

/// Returns the file name of a row: its letters and digits in lower case, with `-` between the words.
fn file_name(name: &str) -> String {
    let words = name.split(|letter: char| !letter.is_alphanumeric()).filter(|word| !word.is_empty());
    let name = words.collect::<Vec<_>>().join("-").to_lowercase();
    format!("{}.toml", if name.is_empty() { "row" } else { &name })
}

/// Describes the policy of the row.
fn policy_facts(runs: &Runs, own: Condition) -> Result<PolicyFacts, BoardError> {
    if own != Condition::External {
        return Ok(PolicyFacts {
            kind: PolicyKind::BuiltIn,
            condition: own,
            level: DecisionLevel::Choose,
            sees_images: own == Condition::Touch,
            image_side: None,
            file: None,
            class: None,
            sha256: None,
            arguments: BTreeMap::new(),
            argument_files: BTreeMap::new(),
        });
    }
    let Some(source) = &runs.request.policy else {
        return Err(runs.unsuitable("policy", "none", "one for the condition external"));
    };
    if source.pace != SimulatedTimePassage::Paused {
        let expected = "paused: results on the wall clock depend on the computer";
        return Err(runs.unsuitable("policy.pace", "wall", expected));
    }
    let Some(introduction) = &source.introduction else {
        let expected = "its level, from a run of this program's version: run it again";
        return Err(runs.unsuitable("policy.introduction", "none", expected));
    };
    let image_side = acting_image_side(introduction);
    Ok(PolicyFacts {
        kind: PolicyKind::Python,
        condition: own,
        level: introduction.level,
        // A policy that chooses always gets the images.
        sees_images: introduction.level == DecisionLevel::Choose || image_side.is_some(),
        image_side,
        file: Some(bare_name(&source.file)),
        class: Some(source.class.clone()),
        sha256: Some(source.sha256.clone()),
        arguments: source.arguments.clone(),
        argument_files: argument_files(source)?,
    })
}

/// Returns the side of the images of a policy that acts, pixels; none for one that chooses, whose images have their own
/// size.
pub(crate) fn acting_image_side(introduction: &PolicyIntroduction) -> Option<usize> {
    introduction.images.filter(|_| introduction.level == DecisionLevel::Act)
}

/// Returns a path without its folder.
fn bare_name(file: &Path) -> String {
    file.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Returns the SHA-256 of every file that an argument names, by the argument's name.
pub(crate) fn argument_files(source: &PolicySource) -> Result<BTreeMap<String, String>, BoardError> {
    let mut hashes = BTreeMap::new();
    for (name, value) in &source.arguments {
        let Value::String(text) = value else { continue };
        let path = Path::new(text);
        if path.is_file() {
            let bytes =
                read_regular(path, MAX_TEXT_SIZE).map_err(|source| DataError::Io { path: path.to_owned(), source })?;
            hashes.insert(name.clone(), sha256(&bytes));
        }
    }
    Ok(hashes)
}

#[cfg(test)]
pub(crate) mod tests {
    use serde_json::json;

    use bench::journal::JournalEntry;

    use super::*;
    use crate::shares::IntervalKind;
    use crate::test_runs::{request, write_run};

    fn text(name: &str) -> EntryText {
        let link = Some("https://example.org/touch".to_owned());
        EntryText { name: name.to_owned(), by: Some("A. Author".to_owned()), link, seed_use: SeedUse::Development }
    }

    /// Returns the entry of touch in a run of six combinations with two trials each, made up.
    pub(crate) fn touch_entry() -> BoardEntry {
        let folder = tempfile::tempdir().expect("a folder");
        write_run(folder.path(), &request(&json!({})), 0, |_| {});
        add(&[folder.path().to_owned()], Some(Condition::Touch), text("Touch")).expect("an entry")
    }

    fn error(folders: &[&Path], condition: Option<Condition>) -> String {
        let folders: Vec<PathBuf> = folders.iter().map(|folder| (*folder).to_owned()).collect();
        add(&folders, condition, text("x")).expect_err("refused").to_string()
    }

    #[test]
    fn a_run_becomes_an_entry() {
        let entry = touch_entry();
        let clean = entry.shares.clean;
        assert_eq!((clean.count, clean.of, clean.interval), (11, 12, IntervalKind::Combinations));
        assert_eq!((entry.work.seeds.as_slice(), entry.work.combinations, entry.work.trials), (&[1][..], 6, 2));
        let blind = &entry.comparisons[0];
        assert_eq!((blind.rival, blind.won, blind.lost), (Condition::Blind, 6, 1));
        assert!(entry.shares.time_ratio.is_some_and(|ratio| ratio > 1.4 && ratio < 1.5));
        assert!(entry.policy.sees_images && entry.settings.scenario.is_none());
    }

    /// Shards make one run, and runs of several seeds one row.
    #[test]
    fn shards_and_seeds_are_merged() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut folders = Vec::new();
        for (seed, shard) in [(1, [1, 1]), (2, [1, 2]), (2, [2, 2])] {
            let path = folder.path().join(format!("{seed}-{}", shard[0]));
            write_run(&path, &request(&json!({ "seed": seed, "shard": shard })), 0, |_| {});
            folders.push(path);
        }
        let entry = add(&folders, Some(Condition::Touch), text("Touch")).expect("an entry");
        assert_eq!((entry.work.seeds.as_slice(), entry.shares.clean.of), (&[1, 2][..], 24));
        let words = error(&[&folders[0], &folders[1]], Some(Condition::Touch));
        assert!(words.contains("found 9 of 18 units of work") && words.contains("all shards of seed 2"), "{words}");
        assert!(error(&[&folders[0], &folders[0]], None).contains("found a second result for seed 1"));
        let other = folder.path().join("other");
        write_run(&other, &request(&json!({ "seed": 3, "noise_scale": 0.5 })), 0, |_| {});
        let words = error(&[&folders[0], &other], Some(Condition::Touch));
        assert!(words.contains("other: noise_scale: found another value, expected that of"), "{words}");
    }

    #[test]
    fn unfinished_runs_are_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        write_run(folder.path(), &request(&json!({})), 2, |_| {});
        let words = error(&[folder.path()], Some(Condition::Touch));
        assert!(words.contains("found 16 of 18 units of work, expected all of them: `ftac bench --resume"), "{words}");
        let none = folder.path().join("none");
        assert!(error(&[&none], None).contains("holds no run"));
    }

    #[test]
    fn outcomes_that_do_not_fit_the_request_are_refused() {
        let refused = |change: &dyn Fn(&mut JournalEntry), words: &str| {
            let folder = tempfile::tempdir().expect("a folder");
            write_run(folder.path(), &request(&json!({})), 0, change);
            let found = error(&[folder.path()], Some(Condition::Touch));
            assert!(found.contains(words), "{found}");
        };
        refused(&|entry| entry.records.truncate(1), "expected one record of each condition of run.json: blind, touch");
        refused(
            &|entry| entry.records[0].trial += 1,
            "combination 0, ideal run: found [combination 0, trial 1, ideal]",
        );
        refused(&|entry| entry.records[0].clean_success ^= true, "expected columns that agree");
        let rename = |entry: &mut JournalEntry| {
            if entry.unit.trial == Some(1) {
                entry.records[0].first = "cup".to_owned();
            }
        };
        refused(&rename, "found cup, can_50, expected egg, can_50");
    }

    #[test]
    fn a_row_needs_one_policy() {
        let folder = tempfile::tempdir().expect("a folder");
        write_run(folder.path(), &request(&json!({})), 0, |_| {});
        assert!(error(&[folder.path()], None).contains("--condition: found none, expected one of blind, touch"));
        assert!(
            error(&[folder.path()], Some(Condition::Reflex)).contains("found reflex, expected one of blind, touch")
        );
        assert!(error(&[folder.path()], Some(Condition::Ideal)).contains("found ideal"));
    }

    /// A Python policy is described by its file, class and introduction. One that the run did not describe, or that
    /// computed on the wall clock, is refused.
    #[test]
    fn python_policies_are_described() {
        let folder = tempfile::tempdir().expect("a folder");
        let weights = folder.path().join("weights.npz");
        std::fs::write(&weights, "abc").expect("written");
        let policy = |changes: Value| {
            let mut policy = json!({
                "file": "/home/a/mine.py", "class": "Mine", "sha256": sha256(b"class"),
                "arguments": { "weights": weights, "gain": 0.5 },
                "introduction": { "name": "Mine", "level": "act", "images": 64 },
            });
            changes.as_object().expect("changes").iter().for_each(|(name, value)| policy[name] = value.clone());
            request(&json!({ "conditions": ["blind", "external"], "policy": policy }))
        };
        let run = folder.path().join("run");
        write_run(&run, &policy(json!({})), 0, |_| {});
        let entry = add(&[run], None, text("Mine")).expect("an entry");
        let facts = &entry.policy;
        assert_eq!((facts.file.as_deref(), facts.image_side, facts.sees_images), (Some("mine.py"), Some(64), true));
        assert_eq!(facts.argument_files, BTreeMap::from([("weights".to_owned(), sha256(b"abc"))]));
        let text = entry.to_text().expect("text");
        assert_eq!(BoardEntry::parse(&text, Path::new("row.toml")).expect("an entry"), entry);
        for (name, changes, words) in [
            ("old", json!({ "introduction": null }), "policy.introduction: found none"),
            ("wall", json!({ "pace": "wall" }), "policy.pace: found wall, expected paused"),
        ] {
            let run = folder.path().join(name);
            write_run(&run, &policy(changes), 0, |_| {});
            let words_found = error(&[&run], None);
            assert!(words_found.contains(words), "{words_found}");
        }
    }

    #[test]
    fn a_file_is_named_by_the_row_and_not_replaced() {
        let folder = tempfile::tempdir().expect("a folder");
        let out = folder.path().join("rows");
        let entry = BoardEntry { name: "Touch, seeds 1/2".into(), ..touch_entry() };
        let path = save(&entry, &out).expect("saved");
        assert_eq!(path, out.join("touch-seeds-1-2.toml"));
        let words = save(&entry, &out).expect_err("refused").to_string();
        assert!(words.starts_with("--out: found the file") && words.contains("--name"), "{words}");
        assert_eq!(std::fs::read_dir(&out).expect("a folder").count(), 1);
        assert_eq!(file_name("../../x"), "x.toml");
    }
}
