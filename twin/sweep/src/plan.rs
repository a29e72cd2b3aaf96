//! The plan of a sweep: points, runs and units of work.
//!
//! A point has one value of each axis but seed, policy and ablation. A run is a point under one seed. Its trials are
//! split into units of a few minutes. Each unit is named by its content: the trials, the request and the version of the
//! tables.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::{Context as _, Result, bail};
use bench::journal;
use bench::journal::{RecordingSelection, RunRequest, WorkUnit as TrialUnit};
use ftac_platform::data::DataError;
use ftac_platform::digest::sha256;
use robot_backends::PoseSources;
use scenarios::{Ablation, Condition};
use serde::{Deserialize, Serialize};

use crate::axis::{self, AxisField, AxisLevel, PlannedAxis, RunDraft};
use crate::columns;
use crate::file::Sweep;

/// Cost of trials, as measured on the machine named in the file.
const COST_TOML: &str = include_str!("../data/cost.toml");

/// Largest number of trials of a sweep.
pub(crate) const MAX_TRIALS: f64 = 1e8;

/// Time and disk space of trials.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrialCost {
    /// Time of a trial under each condition, s of one core.
    trial_s: BTreeMap<String, f64>,
    /// Factor of that time on robot backends other than the simulated one.
    other_body: f64,
    /// Time of a run before its first trial, s of one core.
    run_s: f64,
    /// Size of a trial with its tries in the units' files, bytes.
    bytes: f64,
}

impl TrialCost {
    /// Returns the built-in costs.
    pub fn builtin() -> Result<Self, DataError> {
        ftac_platform::data::parse_toml(COST_TOML, Path::new("data/cost.toml"))
    }

    fn trial_time(&self, condition: Condition) -> f64 {
        self.trial_s.get(condition.name()).copied().unwrap_or(1.0)
    }

    /// Returns the time of a unit of the benchmark, s of one core.
    fn unit_s(&self, request: &RunRequest, unit: TrialUnit) -> f64 {
        let body = if request.robot == "sim" { 1.0 } else { self.other_body };
        body * match unit.trial {
            None => self.trial_time(Condition::Ideal),
            Some(_) => {
                let conditions_s: f64 =
                    request.noisy_conditions().into_iter().map(|condition| self.trial_time(condition)).sum();
                conditions_s + request.ablations.len() as f64 * self.trial_time(Condition::Touch)
            }
        }
    }
}

/// A run: all trials of a point under one seed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SweepRun {
    /// Number of the point.
    pub point: usize,
    /// Index of the value of each axis, in the order of [`SweepPlan::axes`].
    pub at: Vec<usize>,
    /// Request of the run.
    pub request: RunRequest,
}

/// A unit of work: some of a run's trials.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SweepUnit {
    /// Name by content, hexadecimal.
    pub id: String,
    /// Index of the run.
    pub run: usize,
    /// Index of the first of the run's trials.
    pub from: usize,
    /// Number of trials.
    pub count: usize,
}

/// All work of a sweep.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SweepPlan {
    /// Version of the tables.
    pub version: u32,
    pub name: String,
    /// All axes but seed, policy and ablation.
    pub axes: Vec<PlannedAxis>,
    pub seeds: Vec<u64>,
    pub policies: Vec<Condition>,
    pub ablations: Vec<Ablation>,
    pub combos: usize,
    pub trials: usize,
    /// Expected time of all units on one core, s.
    pub core_s: f64,
    /// Distinct texts of the runs' scenarios. A run's request holds the index of its text.
    pub scenarios: Vec<String>,
    pub runs: Vec<SweepRun>,
    pub units: Vec<SweepUnit>,
}

impl SweepPlan {
    /// Plans a sweep.
    pub fn from_sweep(sweep: &Sweep) -> Result<Self> {
        let cost = TrialCost::builtin()?;
        let varied = |axis: &&crate::file::SweepAxis| {
            !matches!(axis.field, AxisField::Seed | AxisField::Policy | AxisField::Ablation)
        };
        let axes: Vec<_> = sweep.axes.iter().filter(varied).collect();
        let policies = match sweep.levels(&AxisField::Policy) {
            Some(levels) => axis::policies(levels, &sweep.file)?,
            None => vec![Condition::Blind, Condition::Reflex, Condition::Touch],
        };
        let ablations = axis::ablations(sweep.levels(&AxisField::Ablation).unwrap_or_default(), &sweep.file)?;
        let seeds = sweep.levels(&AxisField::Seed).map_or_else(|| vec![AxisLevel::Whole(1)], <[AxisLevel]>::to_vec);
        let request = RunRequest {
            combos: sweep.combos,
            trials: sweep.trials,
            seed: 1,
            robot: "sim".to_owned(),
            driver: None,
            shard: (1, 1),
            conditions: policies.clone(),
            ablations: ablations.clone(),
            without: Vec::new(),
            uncertainty: None,
            noise_scale: 1.0,
            effort: None,
            scenario: scenarios::scenario::BENCHMARK_TOML.to_owned(),
            policy: None,
            robot_model: None,
            robot_instance: None,
            pads: None,
            plant_instance: None,
            looks_ahead: false,
            detects_faults: false,
            notes: Vec::new(),
            left_out: Vec::new(),
            places: PoseSources::default(),
            gpu: false,
            record: RecordingSelection::default(),
            provenance: Vec::new(),
        };
        let mut plan = Self {
            version: columns::VERSION,
            name: sweep.name.clone(),
            axes: columns_of(&axes),
            seeds: Vec::new(),
            policies,
            ablations,
            combos: sweep.combos,
            trials: sweep.trials,
            core_s: 0.0,
            scenarios: Vec::new(),
            runs: Vec::new(),
            units: Vec::new(),
        };
        let start = RunDraft { file: sweep.file.clone(), request, scenario_settings: Vec::new() };
        let sizes: Vec<usize> = axes.iter().map(|axis| axis.levels.len()).collect();
        let trials = [&sizes[..], &[seeds.len(), plan.combos, plan.trials]].concat().into_iter();
        let trials: f64 = trials.map(|size| size as f64).product();
        if trials > MAX_TRIALS {
            bail!(
                "{}: found {trials:.0} trials of each policy, expected at most {MAX_TRIALS:.0}",
                sweep.file.display()
            );
        }
        for (point, at) in grid(&sizes).enumerate() {
            let mut draft = start.clone();
            for (axis, level) in axes.iter().zip(&at) {
                draft = draft.with(&axis.field, &axis.levels[*level])?;
            }
            let request = draft.finish()?;
            for seed in &seeds {
                let seeded =
                    RunDraft { file: sweep.file.clone(), request: request.clone(), scenario_settings: Vec::new() };
                let request = seeded.with(&AxisField::Seed, seed)?.request;
                plan.add_run(SweepRun { point, at: at.clone(), request }, sweep.unit_minutes, &cost)?;
            }
        }
        plan.seeds = plan.runs.iter().map(|run| run.request.seed).collect::<BTreeSet<_>>().into_iter().collect();
        if plan.units.is_empty() {
            bail!("{}: found an empty sweep, expected at least one trial", sweep.file.display());
        }
        let mut ids = BTreeSet::new();
        if let Some(unit) = plan.units.iter().find(|unit| !ids.insert(&unit.id)) {
            let point = plan.runs[unit.run].point;
            bail!(
                "{}: axes: found the trials of point {point} twice, expected points that differ",
                sweep.file.display()
            );
        }
        plan.core_s += plan.runs.len() as f64 * cost.run_s;
        Ok(plan)
    }

    /// Adds a run, split into units.
    fn add_run(&mut self, mut run: SweepRun, minutes: f64, cost: &TrialCost) -> Result<()> {
        let trials = journal::work_units(&run.request);
        let seconds: Vec<f64> = trials.iter().map(|unit| cost.unit_s(&run.request, *unit)).collect();
        let digest = run.request.digest()?;
        let all: f64 = seconds.iter().sum();
        // The units have equal length, so that the last one is not a small remainder.
        let pieces = ((all / (60.0 * minutes)).ceil() as usize).clamp(1, trials.len().max(1));
        for piece in 0..pieces {
            let [from, to] = [piece, piece + 1].map(|n| n * trials.len() / pieces);
            if to > from {
                let id = unit_name(&digest, from, to - from);
                self.units.push(SweepUnit { id, run: self.runs.len(), from, count: to - from });
            }
        }
        self.core_s += all;
        let scenario = self.scenarios.iter().position(|text| *text == run.request.scenario);
        let scenario = scenario.unwrap_or_else(|| {
            self.scenarios.push(run.request.scenario.clone());
            self.scenarios.len() - 1
        });
        run.request.scenario = scenario.to_string();
        self.runs.push(run);
        Ok(())
    }

    /// Returns the request of a run with its scenario.
    pub fn request(&self, run: usize) -> Result<RunRequest> {
        let run = self.runs.get(run).with_context(|| format!("the plan has no run {run}"))?;
        let number: Option<usize> = run.request.scenario.parse().ok();
        let text = number.and_then(|number| self.scenarios.get(number));
        let text = text.with_context(|| format!("the plan has no scenario {}", run.request.scenario))?;
        Ok(RunRequest { scenario: text.clone(), ..run.request.clone() })
    }

    /// Returns the trials of a unit.
    pub fn trials(&self, unit: &SweepUnit) -> Result<Vec<TrialUnit>> {
        let all = journal::work_units(&self.request(unit.run)?);
        all.get(unit.from..unit.from + unit.count).map(<[_]>::to_vec).context("the plan's units do not fit its runs")
    }

    /// Returns the final number of rows of the trials' table.
    pub fn rows(&self) -> usize {
        let noisy = self.policies.iter().filter(|policy| **policy != Condition::Ideal).count();
        let ideal = usize::from(noisy < self.policies.len());
        self.runs.len() * self.combos * (ideal + self.trials * (noisy + self.ablations.len()))
    }

    /// Returns the number of points.
    pub fn points(&self) -> usize {
        self.axes.iter().map(|axis| axis.levels.len()).product()
    }

    /// Returns the expected size of the units' files, bytes.
    pub fn bytes(&self) -> Result<f64> {
        Ok(self.rows() as f64 * TrialCost::builtin()?.bytes)
    }

    /// Serialises the plan for its file.
    pub fn to_json(&self) -> Result<String> {
        Ok(serde_json::to_string(self)?)
    }

    /// Returns a digest of the sweep's units.
    pub fn digest(&self) -> String {
        let ids: Vec<&str> = self.units.iter().map(|unit| unit.id.as_str()).collect();
        short_digest(ids.join(" "))
    }

    /// Describes the first difference that makes another plan a different sweep; none if it is the same.
    pub fn first_difference(&self, other: &Self) -> Option<String> {
        if self.units == other.units && self.axes == other.axes {
            return None;
        }
        let numbers = [
            ("combos", self.combos, other.combos),
            ("trials", self.trials, other.trials),
            ("axes", self.axes.len(), other.axes.len()),
            ("seeds", self.seeds.len(), other.seeds.len()),
            ("policies", self.policies.len(), other.policies.len()),
            ("ablations", self.ablations.len(), other.ablations.len()),
        ];
        if let Some((what, found, expected)) = numbers.into_iter().find(|(_, found, expected)| found != expected) {
            return Some(format!("{what}: found {found}, expected {expected}"));
        }
        for (own, its) in self.axes.iter().zip(&other.axes) {
            if own != its {
                let list = |axis: &PlannedAxis| {
                    let levels: Vec<String> = axis.levels.iter().map(ToString::to_string).collect();
                    format!("{} = [{}]", axis.name, levels.join(", "))
                };
                return Some(format!("axes: found {}, expected {}", list(own), list(its)));
            }
        }
        let known: BTreeSet<&str> = other.units.iter().map(|unit| unit.id.as_str()).collect();
        let new = self.units.iter().filter(|unit| !known.contains(unit.id.as_str())).count();
        Some(format!("found {new} of {} units that are not among its {}", self.units.len(), other.units.len()))
    }
}

/// Returns every combination of one index for each of `sizes`, the last index fastest.
fn grid(sizes: &[usize]) -> impl Iterator<Item = Vec<usize>> {
    let count: usize = sizes.iter().product();
    (0..count).map(move |mut n| {
        let mut at = vec![0; sizes.len()];
        for (place, size) in at.iter_mut().zip(sizes).rev() {
            (*place, n) = (n % size, n / size);
        }
        at
    })
}

/// Names the columns of the axes by the last word of the path if that is unique.
fn columns_of(axes: &[&crate::file::SweepAxis]) -> Vec<PlannedAxis> {
    let short = |name: &str| name.rsplit('.').next().unwrap_or(name).to_owned();
    axes.iter()
        .map(|axis| {
            let own = short(&axis.name);
            let alone = axes.iter().filter(|other| short(&other.name) == own).count() == 1;
            let column = if alone { own } else { axis.name.replace('.', "_") };
            PlannedAxis { name: axis.name.clone(), column: format!("axis_{column}"), levels: axis.levels.clone() }
        })
        .collect()
}

/// Returns a unit's name, from its content and not its position in a plan.
fn unit_name(request: &str, from: usize, count: usize) -> String {
    short_digest(format!("{} {request} {from} {count}", columns::VERSION))
}

/// Returns the first half of the SHA-256 of `bytes`, hexadecimal.
pub fn short_digest(bytes: impl AsRef<[u8]>) -> String {
    sha256(bytes.as_ref())[..32].to_owned()
}
