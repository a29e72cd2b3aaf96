//! `summary.json`: what a benchmark comes to.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::ablation::Ablation;
use super::distribution::{MeanSd, percentile};
use super::paired::{Effect, McNemar, TTest, paired_t_test};
use super::rates::{CombinationRates, combination_rates, pair_up};
use crate::record::{AblatedTrial, Condition, TrialRecord};
use crate::referee::FailureCause;

/// The collision and success part of a condition in `summary.json`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct ConditionSummary {
    /// Trials run.
    pub trials: usize,
    /// Over combinations.
    pub collision_rate: MeanSd,
    /// Over combinations.
    pub success_rate: MeanSd,
    /// Trials in which the policy left the planned strategy.
    pub switched: usize,
    /// Failed trials by cause.
    pub failures: BTreeMap<FailureCause, usize>,
}

/// One value per condition.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct PerCondition<T> {
    /// No noise, policy `blind`.
    pub ideal: T,
    /// Noise, policy `blind`.
    pub blind: T,
    /// Noise, policy `touch`.
    pub touch: T,
}

/// The two tests.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Tests {
    /// Do more collisions happen in `blind` than in `ideal`?
    pub collision: TTest,
    /// Do more trials succeed in `touch` than in `blind`?
    pub success: TTest,
}

/// What the paper does not report of its two comparisons.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Effects {
    /// Collisions, `blind` less `ideal`, over combinations.
    pub collision: Effect,
    /// Success, `touch` less `blind`, over combinations.
    pub success: Effect,
    /// Success of `touch` against `blind`, trial by trial.
    pub mcnemar: McNemar,
}

/// Decision latency, ms.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct DecisionTime {
    /// Median.
    pub p50: Option<f64>,
    /// 99th percentile.
    pub p99: Option<f64>,
}

/// Median and 95th percentile.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct MedianP95 {
    pub median: Option<f64>,
    /// 95th percentile.
    pub p95: Option<f64>,
}

/// Error of the in-hand pose estimate.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct PoseError {
    /// Position, mm.
    pub mm: MedianP95,
    /// Orientation, deg.
    pub deg: MedianP95,
    /// Position of the plan's guess before touch, mm.
    pub prior_mm: MedianP95,
}

/// What a summary needs to know besides the records.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunInfo {
    /// Of the benchmark.
    pub seed: u64,
    /// `sim`, `hardware` or `emulated`.
    pub robot: String,
    /// Wall-clock time of the run, s.
    pub wall_s: f64,
}

/// `summary.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Different combinations.
    pub combos: usize,
    /// Most trials of a combination under one condition.
    pub trials_per_combo: usize,
    /// Of the benchmark.
    pub seed: u64,
    /// `sim`, `hardware` or `emulated`.
    pub robot: String,
    /// Rates and failures.
    pub conditions: PerCondition<ConditionSummary>,
    /// Paired over combinations, one-sided.
    pub t_test: Tests,
    /// Effect sizes with intervals, the exact test by trials, power for fewer combinations.
    #[serde(default)]
    pub effects: Effects,
    /// The policy `touch` with less of the senses, where that was run.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub ablations: Vec<Ablation>,
    /// Over all trials that decided.
    pub decision_ms: DecisionTime,
    /// Over all trials that estimated.
    pub pose_error: PoseError,
    /// Simulated time over wall-clock time, all threads together; none of a run that took no time.
    pub real_time_factor: Option<f64>,
    /// Wall-clock time of the run, s.
    pub wall_s: f64,
}

/// Sums records up; `ablated` are trials with less of the senses, if any.
pub fn summarise(records: &[TrialRecord], ablated: &[AblatedTrial], run: &RunInfo) -> Summary {
    let per_condition = Condition::ALL.map(|condition| combination_rates(records, condition));
    let [ideal, blind, touch] = &per_condition;
    let collision = |rates: &CombinationRates| rates.collision_rate;
    let success = |rates: &CombinationRates| rates.success_rate;
    let summary = |condition: Condition, rates: &[CombinationRates]| condition_summary(records, condition, rates);
    let column = |pick: fn(&TrialRecord) -> Option<f64>| -> Vec<f64> { records.iter().filter_map(pick).collect() };
    let spread = |values: Vec<f64>| MedianP95 { median: percentile(&values, 50.0), p95: percentile(&values, 95.0) };
    let decisions = column(|record| record.decision_ms);
    let combinations: std::collections::BTreeSet<usize> = records.iter().map(|record| record.combination).collect();
    let all = records.iter().chain(ablated.iter().map(|trial| &trial.record));
    let sim_seconds: f64 = all.map(|record| record.sim_seconds).sum();
    Summary {
        combos: combinations.len(),
        trials_per_combo: per_condition.iter().flatten().map(|rates| rates.trials).max().unwrap_or(0),
        seed: run.seed,
        robot: run.robot.clone(),
        conditions: PerCondition {
            ideal: summary(Condition::Ideal, ideal),
            blind: summary(Condition::Blind, blind),
            touch: summary(Condition::Touch, touch),
        },
        t_test: Tests {
            collision: paired_t_test(&pair_up(blind, ideal, collision)),
            success: paired_t_test(&pair_up(touch, blind, success)),
        },
        effects: Effects {
            collision: Effect::of(&pair_up(blind, ideal, collision)),
            success: Effect::of(&pair_up(touch, blind, success)),
            mcnemar: McNemar::of_success(records, Condition::Touch, Condition::Blind),
        },
        ablations: Ablation::all(records, ablated),
        decision_ms: DecisionTime { p50: percentile(&decisions, 50.0), p99: percentile(&decisions, 99.0) },
        pose_error: PoseError {
            mm: spread(column(|record| record.pose_error_mm)),
            deg: spread(column(|record| record.pose_error_deg)),
            prior_mm: spread(column(|record| record.prior_error_mm)),
        },
        real_time_factor: (run.wall_s > 0.0).then(|| sim_seconds / run.wall_s),
        wall_s: run.wall_s,
    }
}

fn condition_summary(records: &[TrialRecord], condition: Condition, rates: &[CombinationRates]) -> ConditionSummary {
    let mut failures = BTreeMap::new();
    let (mut trials, mut switched) = (0, 0);
    for record in records.iter().filter(|record| record.condition == condition) {
        trials += 1;
        switched += usize::from(record.switched);
        if let Some(cause) = record.cause {
            *failures.entry(cause).or_default() += 1;
        }
    }
    let over = |pick: fn(&CombinationRates) -> f64| MeanSd::of(&rates.iter().map(pick).collect::<Vec<f64>>());
    ConditionSummary {
        trials,
        collision_rate: over(|rates| rates.collision_rate),
        success_rate: over(|rates| rates.success_rate),
        switched,
        failures,
    }
}
