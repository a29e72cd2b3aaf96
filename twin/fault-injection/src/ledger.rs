//! Outcomes of a fault matrix on disk: one line per injection, written as soon as it is known, so that an interrupted
//! matrix can be resumed.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use control::executor::Phase;
use ftac_platform::journal::{Journal, lock_folder};
use hand_model::RobotSources;
use serde::{Deserialize, Serialize};

use super::InjectionOutcome;
use super::kind::InjectedFault;

/// File of the request: the injections stored in the folder.
const REQUEST_FILE: &str = "faults.json";
/// File of the outcomes.
const OUTCOMES_FILE: &str = "faults.jsonl";

/// Request for a fault matrix.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MatrixRequest {
    /// Version of the program: another version may give other outcomes.
    pub program: String,
    /// The robot's files, if it is not the built-in one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot_model: Option<RobotSources>,
    pub seed: u64,
    /// Number of times that each fault is injected into each phase.
    pub rounds: usize,
    pub kinds: Vec<InjectedFault>,
    #[serde(with = "phases")]
    pub phases: Vec<Phase>,
    /// True if fault detection runs beside each injection.
    #[serde(alias = "mirror")]
    pub detector: bool,
}

/// An outcome with the number of its injection.
#[derive(Debug, Serialize, Deserialize)]
struct Line {
    n: usize,
    #[serde(flatten)]
    outcome: InjectionOutcome,
}

/// An open ledger.
pub struct Ledger {
    pub folder: PathBuf,
    lines: Journal,
    /// The locked folder: only one matrix writes into it at a time.
    _lock: File,
    /// Outcomes so far, by the number of the injection.
    pub done: BTreeMap<usize, InjectionOutcome>,
}

impl Ledger {
    /// Creates a ledger in `folder`, which is created if missing. Refuses a folder that already holds one.
    pub fn create(folder: &Path, request: &MatrixRequest) -> Result<Self> {
        std::fs::create_dir_all(folder).with_context(|| format!("--out: cannot create {}", folder.display()))?;
        let lock = lock_folder(folder, "fault matrix").context("--out")?;
        if folder.join(REQUEST_FILE).exists() {
            bail!(
                "--out: {} already holds a fault matrix; continue with --resume {0} or name another folder",
                folder.display()
            );
        }
        let text = serde_json::to_string_pretty(request)?;
        // The file of outcomes comes first: a folder that holds a request can then be resumed.
        let lines = Journal::open(&folder.join(OUTCOMES_FILE)).context("--out")?;
        ftac_platform::data::write_atomically(&folder.join(REQUEST_FILE), text.as_bytes())?;
        Ok(Self { folder: folder.to_owned(), lines, _lock: lock, done: BTreeMap::new() })
    }

    /// Opens an existing ledger to resume it. A truncated last line is dropped.
    pub fn resume(folder: &Path) -> Result<(Self, MatrixRequest)> {
        let lock = lock_folder(folder, "fault matrix").context("--resume")?;
        let path = folder.join(REQUEST_FILE);
        let text = std::fs::read_to_string(&path).with_context(|| {
            format!("--resume: {} holds no fault matrix (cannot read {})", folder.display(), path.display())
        })?;
        let request: MatrixRequest =
            serde_json::from_str(&text).with_context(|| format!("--resume: {}", path.display()))?;
        let path = folder.join(OUTCOMES_FILE);
        let kept = Journal::read(&path).context("--resume")?;
        let done = kept.into_iter().map(|Line { n, outcome }| (n, outcome)).collect();
        let lines = Journal::open(&path).context("--resume")?;
        Ok((Self { folder: folder.to_owned(), lines, _lock: lock, done }, request))
    }

    /// Appends an outcome.
    pub fn append(&mut self, n: usize, outcome: InjectionOutcome) -> Result<()> {
        self.lines.append(&Line { n, outcome: outcome.clone() })?;
        self.done.insert(n, outcome);
        Ok(())
    }
}

/// Serialises a phase by its name.
pub(super) mod phase {
    use control::executor::Phase;
    use serde::{Deserialize as _, Deserializer, Serializer, de};

    use crate::PHASES;

    pub fn serialize<S: Serializer>(phase: &Phase, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&phase.name())
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Phase, D::Error> {
        let name = String::deserialize(deserializer)?;
        from_name(&name).ok_or_else(|| de::Error::custom(format!("phase: found `{name}`, expected the name of one")))
    }

    pub fn from_name(name: &str) -> Option<Phase> {
        PHASES.into_iter().find(|phase| phase.name() == name)
    }
}

/// Serialises phases by their names.
mod phases {
    use control::executor::Phase;
    use serde::{Deserialize as _, Deserializer, Serializer, de};

    use super::phase::from_name;

    pub fn serialize<S: Serializer>(phases: &[Phase], serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(phases.iter().map(|phase| phase.name()))
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<Phase>, D::Error> {
        let names = Vec::<String>::deserialize(deserializer)?;
        let phase = |name: String| {
            from_name(&name).ok_or_else(|| de::Error::custom(format!("phases: found `{name}`, expected a phase")))
        };
        names.into_iter().map(phase).collect()
    }
}

#[cfg(test)]
mod tests {
    use control::executor::Skill;

    use super::*;

    fn outcome(round: usize) -> InjectionOutcome {
        InjectionOutcome {
            kind: InjectedFault::Overload,
            phase: Phase::run(Skill::Lift, 0),
            round,
            state: "hold".to_owned(),
            as_expected: true,
            stopped_ms: Some(0.1 + 0.2),
            safe_ms: None,
            speed: 1.0 / 3.0,
            checked: 7,
            outside: 0,
            held: 1,
            lost: 0,
            moved: 0.0,
            intact: true,
            diagnosis: None,
        }
    }

    /// Whenever the program is killed, every complete line is read back to the last bit.
    #[test]
    fn an_interrupted_matrix_goes_on() {
        let folder = tempfile::tempdir().expect("a folder");
        let request = MatrixRequest {
            program: "1".to_owned(),
            robot_model: None,
            seed: 3,
            rounds: 2,
            kinds: vec![InjectedFault::Overload],
            phases: vec![Phase::run(Skill::Lift, 0)],
            detector: false,
        };
        let mut ledger = Ledger::create(folder.path(), &request).expect("new");
        assert!(Ledger::resume(folder.path()).is_err(), "another ledger has locked it");
        ledger.append(5, outcome(1)).expect("written");
        ledger.append(2, outcome(0)).expect("written");
        drop(ledger);
        let path = folder.path().join(OUTCOMES_FILE);
        let mut text = std::fs::read_to_string(&path).expect("there");
        text += "{\"n\": 7, \"kind\": \"Over";
        std::fs::write(&path, text).expect("cut off");
        assert!(Ledger::create(folder.path(), &request).is_err(), "it holds one");
        let (ledger, found) = Ledger::resume(folder.path()).expect("goes on");
        assert_eq!(found, request);
        assert_eq!(ledger.done.keys().copied().collect::<Vec<_>>(), [2, 5]);
        assert_eq!(format!("{:?}", ledger.done[&5]), format!("{:?}", outcome(1)));
    }
}
