//! Outcomes of every trial of a sweep, one byte each: a grid over points, seeds, pairs of objects, trials and arms.
//!
//! An arm is a policy, or `touch` without one of its capabilities. A million trials take a megabyte.

use std::collections::BTreeMap;

use anyhow::{Context as _, Result, bail};

use crate::columns::{ColumnKind, TableColumn, TableKind};
use crate::folder::SweepFolder;
use crate::merge::{merge, point_path};
use crate::plan::SweepPlan;
use crate::table::{ColumnValues, ParquetReader};

/// Outcome of a trial that a report counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum ReportedOutcome {
    CleanSuccess,
    Success,
    Contact,
}

impl ReportedOutcome {
    pub const ALL: [Self; 3] = [Self::CleanSuccess, Self::Success, Self::Contact];

    /// Returns the name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::CleanSuccess => "clean_success",
            Self::Success => "success",
            Self::Contact => "contact",
        }
    }

    /// Returns the name in words.
    pub fn label(self) -> &'static str {
        match self {
            Self::CleanSuccess => "clean success",
            Self::Success => "success",
            Self::Contact => "unwanted contact",
        }
    }

    fn bit(self) -> u8 {
        match self {
            Self::CleanSuccess => 2,
            Self::Success => 4,
            Self::Contact => 8,
        }
    }
}

/// Bit that is set if a trial was run.
const FINISHED_BIT: u8 = 1;

/// Grid of outcomes.
#[derive(Debug, Clone)]
pub struct Outcomes {
    /// Names of the arms: policies in the benchmark's order, then ablations.
    pub arms: Vec<String>,
    /// Number of levels of each axis.
    sizes: Vec<usize>,
    seeds: usize,
    pub combos: usize,
    trials: usize,
    bits: Vec<u8>,
}

/// Place of a trial in the grid apart from its arm and axes: [seed, combination, trial].
pub type TrialPlace = [usize; 3];

impl Outcomes {
    /// Creates the empty grid of a plan.
    pub fn new(plan: &SweepPlan) -> Self {
        let policies = plan.policies.iter().map(|policy| policy.name().to_owned());
        let arms: Vec<String> =
            policies.chain(plan.ablations.iter().map(|ablation| ablation.name().to_owned())).collect();
        let size = plan.points() * plan.seeds.len() * plan.combos * plan.trials * arms.len();
        Self {
            sizes: plan.axes.iter().map(|axis| axis.levels.len()).collect(),
            seeds: plan.seeds.len(),
            combos: plan.combos,
            trials: plan.trials,
            bits: vec![0; size],
            arms,
        }
    }

    /// Reads all outcomes of a sweep. Its units are merged first, unless this was done after the last of them was
    /// finished.
    pub fn read(folder: &SweepFolder, quiet: bool) -> Result<Self> {
        let times = std::fs::read_to_string(folder.path.join("merged/units.csv")).unwrap_or_default();
        if times.lines().count().saturating_sub(1) != folder.finished()?.len() || times.is_empty() {
            merge(folder, quiet)?;
        }
        let mut outcomes = Self::new(&folder.plan);
        let seeds: BTreeMap<i64, usize> =
            folder.plan.seeds.iter().enumerate().map(|(n, seed)| (seed.cast_signed(), n)).collect();
        let arms: BTreeMap<Vec<u8>, usize> =
            outcomes.arms.iter().enumerate().map(|(n, arm)| (arm.clone().into_bytes(), n)).collect();
        for point in 0..folder.plan.points() {
            let file = point_path(folder, TableKind::Trials, point);
            outcomes
                .add(&ParquetReader::open(&file)?, point, &seeds, &arms)
                .with_context(|| file.display().to_string())?;
        }
        Ok(outcomes)
    }

    /// Adds the file of one point.
    fn add(
        &mut self,
        reader: &ParquetReader,
        point: usize,
        seeds: &BTreeMap<i64, usize>,
        arms: &BTreeMap<Vec<u8>, usize>,
    ) -> Result<()> {
        let columns = columns();
        for group in reader.groups(&columns)? {
            let group = group?;
            let [seed, combination, trial, policy, ablation, contact, success, clean] = &group.values[..] else {
                bail!("found {} columns", group.values.len());
            };
            let (ColumnValues::Whole(seed), ColumnValues::Whole(combination), ColumnValues::Whole(trial)) =
                (seed, combination, trial)
            else {
                bail!("columns of another kind");
            };
            let (ColumnValues::Text(policy), ColumnValues::Text(ablation)) = (policy, ablation) else {
                bail!("columns of another kind");
            };
            let (ColumnValues::Flag(contact), ColumnValues::Flag(success), ColumnValues::Flag(clean)) =
                (contact, success, clean)
            else {
                bail!("columns of another kind");
            };
            for row in 0..group.rows {
                let whole = |values: &[Option<i64>]| values[row].and_then(|value| usize::try_from(value).ok());
                let arm = ablation[row].as_ref().or(policy[row].as_ref()).and_then(|name| arms.get(name.data()));
                let seed = seed[row].and_then(|seed| seeds.get(&seed));
                let (Some(arm), Some(seed), Some(combination), Some(trial)) =
                    (arm, seed, whole(combination), whole(trial))
                else {
                    bail!("row {row}: found a trial that the plan does not have");
                };
                let at = self.at(point, [*seed, combination, trial], *arm);
                let at = at.with_context(|| format!("row {row}: found a trial that the plan does not have"))?;
                let bit = |flag: &[Option<bool>], outcome: ReportedOutcome| {
                    if flag[row] == Some(true) { outcome.bit() } else { 0 }
                };
                self.bits[at] = FINISHED_BIT
                    | bit(contact, ReportedOutcome::Contact)
                    | bit(success, ReportedOutcome::Success)
                    | bit(clean, ReportedOutcome::CleanSuccess);
            }
        }
        Ok(())
    }

    fn at(&self, point: usize, [seed, combination, trial]: TrialPlace, arm: usize) -> Option<usize> {
        let fits = combination < self.combos && trial < self.trials;
        let at =
            (((point * self.seeds + seed) * self.combos + combination) * self.trials + trial) * self.arms.len() + arm;
        fits.then_some(at).filter(|at| *at < self.bits.len())
    }

    /// Sets the outcomes of a trial.
    #[cfg(test)]
    pub fn set(&mut self, point: usize, place: TrialPlace, arm: usize, outcomes: &[ReportedOutcome]) {
        let at = self.at(point, place, arm).expect("in the grid");
        self.bits[at] = outcomes.iter().fold(FINISHED_BIT, |bits, outcome| bits | outcome.bit());
    }

    /// Returns an outcome of a trial; none if the trial was not run.
    pub fn get(&self, point: usize, place: TrialPlace, arm: usize, outcome: ReportedOutcome) -> Option<bool> {
        let bits = *self.bits.get(self.at(point, place, arm)?)?;
        (bits & FINISHED_BIT != 0).then_some(bits & outcome.bit() != 0)
    }

    /// Returns the number of trials that were run.
    pub fn trial_count(&self) -> usize {
        self.bits.iter().filter(|bits| **bits != 0).count()
    }

    /// Returns the number of points: the product of the numbers of levels of all axes.
    pub fn points(&self) -> usize {
        self.sizes.iter().product()
    }

    /// Returns the index of a point's level of an axis.
    pub fn level(&self, point: usize, axis: usize) -> usize {
        let later: usize = self.sizes[axis + 1..].iter().product();
        point / later % self.sizes[axis]
    }

    /// Returns the point that differs from `point` in the level of one axis.
    pub fn with_level(&self, point: usize, axis: usize, level: usize) -> usize {
        let later: usize = self.sizes[axis + 1..].iter().product();
        point + later * level - later * self.level(point, axis)
    }

    /// Returns the places of one pair of objects: every seed and trial.
    pub fn places(&self, combination: usize) -> impl Iterator<Item = TrialPlace> + '_ {
        (0..self.seeds).flat_map(move |seed| (0..self.trials).map(move |trial| [seed, combination, trial]))
    }
}

/// Returns the columns to read.
fn columns() -> Vec<TableColumn> {
    let all = [
        ("seed", ColumnKind::Whole),
        ("combination", ColumnKind::Whole),
        ("trial", ColumnKind::Whole),
        ("policy", ColumnKind::Text),
        ("ablation", ColumnKind::Text),
        ("contact", ColumnKind::Flag),
        ("success", ColumnKind::Flag),
        ("clean_success", ColumnKind::Flag),
    ];
    all.map(|(name, kind)| TableColumn { name: name.into(), kind, description: "" }).to_vec()
}
