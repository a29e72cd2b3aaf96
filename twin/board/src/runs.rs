//! Finished runs of `ftac bench` with the same settings: their trials, complete and as the requests ask for them.

use std::collections::BTreeMap;
use std::path::PathBuf;

use bench::journal::{Journal, JournalEntry, RunRequest, WorkUnit, work_units};
use scenarios::record::Condition;

use crate::entry::ProgramFacts;
use crate::error::BoardError;
use crate::outcomes::{OutcomePlace, Outcomes, RecordedOutcome};

/// Finished runs of the same settings.
pub(crate) struct Runs {
    /// First folder, for errors.
    pub(crate) folder: PathBuf,
    /// Request of the first run, as one shard, with the provenance of all.
    pub(crate) request: RunRequest,
    /// Finished units by seed.
    pub(crate) by_seed: BTreeMap<u64, BTreeMap<WorkUnit, JournalEntry>>,
}

impl Runs {
    /// Reads and checks the runs in `folders`.
    pub(crate) fn read(folders: &[PathBuf]) -> Result<Self, BoardError> {
        let mut runs: Option<Self> = None;
        for folder in folders {
            let (done, request) = Journal::read(folder).map_err(BoardError::Run)?;
            let runs = runs.get_or_insert_with(|| Self {
                folder: folder.clone(),
                request: RunRequest { shard: (1, 1), provenance: Vec::new(), ..request.clone() },
                by_seed: BTreeMap::new(),
            });
            let same_seed = RunRequest { seed: runs.request.seed, ..request.clone() };
            if let Some(field) = runs.request.first_difference(&same_seed).map_err(BoardError::Run)? {
                return Err(BoardError::Unsuitable {
                    folder: folder.clone(),
                    found: "another value".to_owned(),
                    expected: format!(
                        "that of {}: a row has one setting of everything but the seed",
                        runs.folder.display()
                    ),
                    field,
                });
            }
            runs.request.provenance.extend(request.provenance);
            let units = runs.by_seed.entry(request.seed).or_default();
            for (unit, entry) in done {
                if units.insert(unit, entry).is_some() {
                    return Err(BoardError::Unsuitable {
                        folder: folder.clone(),
                        field: unit_name(unit),
                        found: format!("a second result for seed {}", request.seed),
                        expected: "each trial in one folder".to_owned(),
                    });
                }
            }
        }
        let runs = runs.ok_or_else(|| BoardError::Option {
            option: "RUN",
            found: "nothing".to_owned(),
            expected: "the result folder of a run".to_owned(),
        })?;
        runs.check_units(folders)?;
        Ok(runs)
    }

    /// Makes the error of a field of the runs.
    pub(crate) fn unsuitable(&self, field: impl Into<String>, found: impl Into<String>, expected: &str) -> BoardError {
        let (field, found) = (field.into(), found.into());
        BoardError::Unsuitable { folder: self.folder.clone(), field, found, expected: expected.to_owned() }
    }

    /// Checks that every unit of every seed is finished, and has exactly the records that the request asks for.
    fn check_units(&self, folders: &[PathBuf]) -> Result<(), BoardError> {
        let all = work_units(&self.request);
        let noisy = self.request.noisy_conditions();
        for (seed, done) in &self.by_seed {
            let finished = all.iter().filter(|unit| done.contains_key(unit)).count();
            if finished < all.len() {
                let hint = match folders {
                    [only] => format!("`ftac bench --resume {}` finishes it", only.display()),
                    _ => format!(
                        "name the folders of all shards of seed {seed}, and finish each with `ftac bench --resume`"
                    ),
                };
                return Err(BoardError::Unfinished { folder: self.folder.clone(), finished, total: all.len(), hint });
            }
            for (unit, entry) in done {
                if !all.contains(unit) {
                    return Err(self.unsuitable(unit_name(*unit), "a result", "none: run.json has no such trial"));
                }
                let expected = if unit.trial.is_some() { &noisy[..] } else { &[Condition::Ideal] };
                let ids = expected.iter().map(|condition| (unit.combination, unit.trial.unwrap_or(0), *condition));
                let found = entry.records.iter().map(|record| (record.combination, record.trial, record.condition));
                if !found.clone().eq(ids) {
                    let found: Vec<String> = entry.records.iter().map(|record| record.id().to_string()).collect();
                    let names: Vec<&str> = expected.iter().map(|condition| condition.name()).collect();
                    let expected = format!("one record of each condition of run.json: {}", names.join(", "));
                    return Err(self.unsuitable(unit_name(*unit), format!("[{}]", found.join("; ")), &expected));
                }
            }
        }
        Ok(())
    }

    /// Returns the condition of the row.
    pub(crate) fn own_condition(&self, named: Option<Condition>) -> Result<Condition, BoardError> {
        let available = self.request.noisy_conditions();
        match named {
            Some(found) if !available.contains(&found) => Err(BoardError::ConditionMissing { found, available }),
            Some(found) => Ok(found),
            None if available.contains(&Condition::External) => Ok(Condition::External),
            None => match available[..] {
                [only] => Ok(only),
                _ => Err(BoardError::ConditionNotNamed { available }),
            },
        }
    }

    /// Returns the outcomes of the row's policy and of the built-in ones. Every seed must have the same objects.
    pub(crate) fn outcomes(&self, own: Condition) -> Result<Outcomes, BoardError> {
        let (mut outcomes, mut objects) = (Outcomes::new(), BTreeMap::new());
        for (seed, done) in &self.by_seed {
            for (unit, entry) in done.iter().filter(|(unit, _)| unit.trial.is_some()) {
                for record in entry.records.iter().filter(|record| is_kept(record.condition, own)) {
                    let names: Vec<String> = record.objects().into_iter().map(str::to_owned).collect();
                    let first = objects.entry(unit.combination).or_insert_with(|| names.clone());
                    if *first != names {
                        let expected = format!("{}, as in the other trials", first.join(", "));
                        return Err(self.unsuitable(record.id().to_string(), names.join(", "), &expected));
                    }
                    let outcome = RecordedOutcome::from_record(record).map_err(|error| {
                        self.unsuitable(record.id().to_string(), error.to_string(), "columns that agree")
                    })?;
                    let (combination, trial, condition) = (record.combination, record.trial, record.condition);
                    outcomes.insert(OutcomePlace { seed: *seed, condition, combination, trial }, outcome);
                }
            }
        }
        Ok(outcomes)
    }

    /// Returns the program of the runs, which must be the same for all.
    pub(crate) fn program(&self) -> Result<ProgramFacts, BoardError> {
        let Some(first) = self.request.provenance.first() else {
            return Err(self.unsuitable("provenance", "none", "that of a program of version 0.1.0 or later"));
        };
        for other in &self.request.provenance {
            let name = |version: &str, commit: &Option<String>| {
                format!("{version} ({})", commit.as_deref().unwrap_or("no commit"))
            };
            let (found, expected) = (name(&other.version, &other.commit), name(&first.version, &first.commit));
            if found != expected {
                return Err(self.unsuitable("provenance", found, &format!("{expected} for all runs of a row")));
            }
        }
        let machine = first.machine.clone();
        Ok(ProgramFacts { version: first.version.clone(), commit: first.commit.clone(), machine })
    }
}

/// True if the outcomes of `condition` are part of a row of `own`: a built-in policy can be run again by everyone.
fn is_kept(condition: Condition, own: Condition) -> bool {
    condition == own || condition != Condition::External
}

fn unit_name(unit: WorkUnit) -> String {
    let trial = unit.trial.map_or("ideal run".to_owned(), |trial| format!("trial {trial}"));
    format!("combination {}, {trial}", unit.combination)
}
