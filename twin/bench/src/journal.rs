//! Journal of a benchmark: one line per finished unit of work, written before anything else happens, so that a run
//! killed at any moment loses at most the unit in flight.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use ftac_platform::digest::sha256;
use ftac_platform::file_access::check_links;
use ftac_platform::journal::{Journal as Lines, lock_folder};
use hand_model::{RobotModel, RobotSources};
use scenarios::effects::Effect;
use scenarios::record::{AblatedTrial, Condition, TrialRecord};
use scenarios::tries::TryRecord;
use scenarios::{Ablation, Scenario};
use serde::{Deserialize, Serialize};

use crate::provenance::Provenance;
use crate::robot::robot_from_sources;
use external_policy::PolicySource;
use fault_detection::fault::FaultRow;
use robot_backends::driver::RobotDriver;
use robot_backends::{PoseSources, TrialTask, keeps_wall_time};

/// Selection of the trials that are recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RecordingSelection {
    None,
    /// The first trial of every tenth combination.
    #[default]
    Sample,
    /// First trial of each cause of failure under each condition, run again after the benchmark.
    Causes,
    /// Every trial.
    All,
}

/// Request for a run. A resumed run must have the same request.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunRequest {
    /// Number of combinations.
    pub combos: usize,
    pub trials: usize,
    /// Seed of all random draws.
    pub seed: u64,
    /// Backend: `sim`, `direct`, `emulated`, `hardware` or `python`.
    pub robot: String,
    /// Driver of the robot, on the backend `python`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub driver: Option<RobotDriver>,
    /// Shard `i` of `n`, counted from 1.
    pub shard: (usize, usize),
    /// Conditions to run, in order.
    #[serde(default = "all_conditions")]
    pub conditions: Vec<Condition>,
    /// Ablations: capabilities that `touch` is additionally run without.
    #[serde(default)]
    pub ablations: Vec<Ablation>,
    /// Effects of the scenario that are switched off.
    #[serde(default)]
    pub without: Vec<Effect>,
    /// Text of the file with the errors that the controller expects; none for the built-in ones.
    #[serde(default)]
    pub uncertainty: Option<String>,
    /// Policy of the condition `external`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub policy: Option<PolicySource>,
    /// Factor of the scenario's noise.
    #[serde(default = "default_noise_scale")]
    pub noise_scale: f64,
    /// Effort of the verification of pairs outside the grasp pair table; none for the scenario's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub effort: Option<u32>,
    /// Text of the scenario.
    pub scenario: String,
    /// The robot's files; none for the built-in one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot_model: Option<RobotSources>,
    /// Text of the file of an identified robot, used by backend and control stack; none for the nominal robot.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[serde(alias = "individual")]
    pub robot_instance: Option<String>,
    /// Text of the file with the photometric calibration of the pads; none for the built-in one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pads: Option<String>,
    /// Number of the backend's robot instance, unknown to the control stack; none if the backend is as modelled.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[serde(alias = "plant")]
    pub plant_instance: Option<u64>,
    /// True if deciding policies simulate second grasps in rollouts before they choose one.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    #[serde(alias = "foresees")]
    pub looks_ahead: bool,
    /// True if fault detection observes the trials.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    #[serde(alias = "mirrors")]
    pub detects_faults: bool,
    /// Deviations from the files of the scenario's own objects, and operations that are impossible with them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// The scenario's own objects that are excluded, with the reasons.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub left_out: Vec<String>,
    /// Source of the object poses.
    #[serde(flatten)]
    pub places: PoseSources,
    /// True if a GPU renders tactile images. Their bits differ from the CPU's.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub gpu: bool,
    /// Selection of the recorded trials; without influence on results.
    #[serde(default, skip_serializing_if = "is_default")]
    pub record: RecordingSelection,
    /// Command that started the run, or those of the shards that were merged into it; without influence on results.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[serde(alias = "made")]
    pub provenance: Vec<Provenance>,
}

impl RunRequest {
    /// Returns the conditions that are run with noise.
    pub fn noisy_conditions(&self) -> Vec<Condition> {
        self.conditions.iter().copied().filter(|condition| Condition::NOISY.contains(condition)).collect()
    }

    /// True if time passes on the wall clock: trials cannot be repeated, and they need an operator.
    pub fn keeps_wall_time(&self) -> bool {
        keeps_wall_time(&self.robot, self.driver.as_ref())
    }

    /// Returns the task of a unit under one condition; `watched` is true if it is recorded for a viewer.
    pub fn task(&self, unit: WorkUnit, condition: Condition, watched: bool) -> TrialTask {
        TrialTask {
            robot: self.robot.clone(),
            driver: self.driver.clone(),
            seed: self.seed,
            combination: unit.combination,
            trial: unit.trial.unwrap_or(0),
            condition,
            images_throughout: watched,
            combos: self.combos,
            scenario: self.scenario.clone(),
            robot_model: self.robot_model.clone(),
            instance: self.robot_instance.clone(),
            pads: self.pads.clone(),
            looks_ahead: self.looks_ahead,
            detects_faults: self.detects_faults,
            places: self.places,
        }
    }

    /// Returns a digest that identifies the run: the first half of the SHA-256 of all fields that affect results, in
    /// hexadecimal.
    pub fn digest(&self) -> Result<String> {
        let asked = Self { provenance: Vec::new(), record: RecordingSelection::default(), ..self.clone() };
        Ok(sha256(&serde_json::to_vec(&asked)?)[..32].to_owned())
    }

    /// Returns the first field affecting results that differs in another request, or `None` if the other is this run or
    /// another shard of it.
    pub fn first_difference(&self, other: &Self) -> Result<Option<String>> {
        let asked = |of: &Self| {
            serde_json::to_value(Self {
                shard: (1, 1),
                provenance: Vec::new(),
                record: RecordingSelection::default(),
                ..of.clone()
            })
        };
        let (own, its) = (asked(self)?, asked(other)?);
        let names = [&own, &its].into_iter().filter_map(serde_json::Value::as_object).flat_map(|fields| fields.keys());
        Ok(names.into_iter().find(|name| own.get(name.as_str()) != its.get(name.as_str())).cloned())
    }

    /// Returns the robot model of backend and control stack; `path` is the file of an identified robot, for errors.
    pub fn robot_model(&self, path: &Path) -> Result<RobotModel> {
        robot_from_sources(self.robot_model.as_ref(), self.robot_instance.as_deref(), path)
    }

    /// Returns the name of the robot, if it is not the built-in one.
    pub fn robot_name(&self) -> Result<Option<String>> {
        Ok(self
            .robot_model
            .as_ref()
            .map(|sources| RobotModel::from_sources(Some(sources)))
            .transpose()?
            .map(|robot| robot.name))
    }

    /// Returns the scenario of the run, with the request's changes applied.
    pub fn scenario(&self) -> Result<Scenario> {
        let mut scenario = Scenario::parse(&self.scenario, Path::new("run.json"))?;
        scenario.noise = scenario.noise.scaled(self.noise_scale);
        scenario.effects = scenario.effects.scaled(self.noise_scale);
        scenario.effort = self.effort.unwrap_or(scenario.effort);
        scenario.effects = self.without.iter().fold(scenario.effects, |effects, effect| effects.without(*effect));
        Ok(scenario)
    }
}

fn all_conditions() -> Vec<Condition> {
    Condition::BUILT_IN.to_vec()
}

fn is_default(record: &RecordingSelection) -> bool {
    *record == RecordingSelection::default()
}

fn default_noise_scale() -> f64 {
    1.0
}

/// Unit of work: the ideal run of a combination, or one trial (all its conditions, from the same first grasp).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct WorkUnit {
    pub combination: usize,
    /// Number of the trial; `None` is the ideal run.
    pub trial: Option<usize>,
}

/// Records of a finished unit.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct JournalEntry {
    /// [`RunRequest::digest`] of the entry's run; none in journals of older programs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub run: Option<String>,
    /// Unit that the records belong to.
    pub unit: WorkUnit,
    pub records: Vec<TrialRecord>,
    /// Tries of the records.
    #[serde(default)]
    pub tries: Vec<TryRecord>,
    /// Ablations: the same trial with some of the policy's capabilities removed.
    #[serde(default)]
    pub ablated: Vec<AblatedTrial>,
    /// Faults detected in it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[serde(alias = "divergences")]
    pub faults: Vec<FaultRow>,
    /// Wall time of the unit, s.
    pub wall_s: f64,
}

/// An open journal.
pub struct Journal {
    lines: Lines,
    /// The locked folder: only one run writes into it at a time.
    _lock: File,
    /// [`RunRequest::digest`].
    run: String,
    /// Units finished so far.
    pub done: BTreeMap<WorkUnit, JournalEntry>,
}

fn journal_path(folder: &Path) -> PathBuf {
    folder.join("journal.jsonl")
}

impl Journal {
    /// True if `folder` holds the journal of a run.
    pub fn is_at(folder: &Path) -> bool {
        journal_path(folder).exists()
    }

    /// Creates a journal in `folder`, which is created if missing. Refuses a folder that already holds a run.
    pub fn create(folder: &Path, request: &RunRequest) -> Result<Self> {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("--out: cannot create the folder {}", folder.display()))?;
        if Self::is_at(folder) {
            bail!(
                "--out: {} already holds a run; continue it with --resume {0} or name another folder",
                folder.display()
            );
        }
        if folder.join("plan.json").exists() {
            bail!("--out: {} already holds a sweep; name another folder", folder.display());
        }
        let lock = lock_folder(folder, "run").context("--out")?;
        let text = serde_json::to_string_pretty(request)?;
        ftac_platform::data::write_atomically(&folder.join("run.json"), text.as_bytes()).context("--out")?;
        let lines = Lines::open(&journal_path(folder)).context("--out")?;
        Ok(Self { lines, _lock: lock, run: request.digest()?, done: BTreeMap::new() })
    }

    /// Reads the journal of a run without changing it. A last line cut off by an interruption is dropped.
    pub fn read(folder: &Path) -> Result<(BTreeMap<WorkUnit, JournalEntry>, RunRequest)> {
        let run = folder.join("run.json");
        if folder.is_file() {
            bail!("{}: found a file, expected the folder of a run", folder.display());
        }
        if folder.is_dir() {
            check_links(folder)?;
        }
        let text = ftac_platform::file::read_text(&run)
            .with_context(|| format!("{} holds no run (cannot read {})", folder.display(), run.display()))?;
        let request: RunRequest = serde_json::from_str(&text).with_context(|| run.display().to_string())?;
        request.check(&run)?;
        let journal = journal_path(folder);
        let (digest, mut done) = (request.digest()?, BTreeMap::new());
        for (n, entry) in (1..).zip(Lines::read::<JournalEntry>(&journal)?) {
            if let Some(found) = entry.run.as_ref().filter(|run| **run != digest) {
                bail!(
                    "{}: line {n}: found a unit of run {found}, expected one of run {digest}, which {} describes",
                    journal.display(),
                    run.display()
                );
            }
            done.insert(entry.unit, entry);
        }
        Ok((done, request))
    }

    /// Opens the journal of an interrupted run to resume it.
    pub fn resume(folder: &Path) -> Result<(Self, RunRequest)> {
        let lock = lock_folder(folder, "run").context("--resume")?;
        let (done, request) = Self::read(folder).context("--resume")?;
        let lines = Lines::open(&journal_path(folder)).context("--resume")?;
        Ok((Self { lines, _lock: lock, run: request.digest()?, done }, request))
    }

    /// Appends a finished unit.
    pub fn append(&mut self, mut entry: JournalEntry) -> Result<()> {
        entry.run = Some(self.run.clone());
        self.lines.append(&entry)?;
        self.done.insert(entry.unit, entry);
        Ok(())
    }
}

/// Returns the units of a request, in order.
pub fn work_units(request: &RunRequest) -> Vec<WorkUnit> {
    let (shard, of) = request.shard;
    let ideal = request.conditions.contains(&Condition::Ideal).then_some(None);
    let trials = if request.noisy_conditions().is_empty() { 0 } else { request.trials };
    (0..request.combos)
        .filter(|combination| combination % of == shard - 1)
        .flat_map(|combination| {
            ideal.into_iter().chain((0..trials).map(Some)).map(move |trial| WorkUnit { combination, trial })
        })
        .collect()
}
