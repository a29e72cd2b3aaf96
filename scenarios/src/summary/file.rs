//! Results of a benchmark: `summary.json`.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use statistics::{McNemar, MeanSd, MixedEffects, PairedDifference, TTest, paired_t_test, percentile};

use super::ablation::AblationSummary;
use super::pairs::{paired_outcomes, risk_prediction};
use super::rates::{CombinationRates, combination_rates, pair_up};
use crate::record::{AblatedTrial, Condition, TrialRecord};
use crate::referee::FailureCause;

/// Results of one condition in `summary.json`.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct ConditionSummary {
    /// Trials run.
    pub trials: usize,
    /// Rate of trials with an unwanted contact; mean and standard deviation over combinations.
    pub contact_rate: MeanSd,
    /// Another name of `contact_rate`.
    pub collision_rate: MeanSd,
    /// Rate of success; mean and standard deviation over combinations.
    pub success_rate: MeanSd,
    /// Rate of clean success; mean and standard deviation over combinations.
    pub clean_success_rate: MeanSd,
    /// Predicted risk of the planned second grasp; mean and standard deviation over combinations.
    pub risk_rate: MeanSd,
    /// Duration of a trial, s; mean and standard deviation over combinations.
    pub trial_s: MeanSd,
    /// Trials in which the policy left the planned strategy.
    pub switched: usize,
    /// Failed trials by cause.
    pub failures: BTreeMap<FailureCause, usize>,
}

/// One value per condition.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(bound(serialize = "T: Serialize + Default + PartialEq"))]
#[schemars(bound = "T: JsonSchema + Serialize + Default + PartialEq")]
pub struct PerCondition<T> {
    /// No noise, policy `blind`.
    pub ideal: T,
    /// Noise, policy `blind`.
    pub blind: T,
    /// Noise, policy `touch` without images.
    #[serde(default)]
    pub reflex: T,
    /// Noise, policy `touch`.
    pub touch: T,
    /// Noise, external policy; left out if there was none.
    #[serde(default, skip_serializing_if = "is_default")]
    #[serde(alias = "own")]
    pub external: T,
}

fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

impl<T> PerCondition<T> {
    /// Returns the value of `condition`.
    pub fn get(&self, condition: Condition) -> &T {
        match condition {
            Condition::Ideal => &self.ideal,
            Condition::Blind => &self.blind,
            Condition::Reflex => &self.reflex,
            Condition::Touch => &self.touch,
            Condition::External => &self.external,
        }
    }
}

impl PerCondition<ConditionSummary> {
    /// Returns the conditions with at least one trial, in order. The others are not reported.
    pub fn conditions_with_trials(&self) -> Vec<Condition> {
        Condition::ALL.into_iter().filter(|condition| self.get(*condition).trials > 0).collect()
    }
}

/// One-sided paired t-tests over combinations.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct SignificanceTests {
    /// Tests for more contacts in `blind` than in `ideal`.
    #[serde(rename = "collision")]
    pub contact: TTest,
    /// Tests for more successes in `touch` than in `blind`.
    pub success: TTest,
    /// Tests for more clean successes in `touch` than in `blind`.
    pub clean_success: TTest,
    /// Tests for more clean successes in `touch` than in `reflex`.
    pub touch_over_reflex: TTest,
}

/// Effect sizes of the comparisons, which the paper does not report.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct EffectSizes {
    /// Contacts, `blind` less `ideal`, over combinations.
    pub contact: PairedDifference,
    /// Success, `touch` less `blind`, over combinations.
    pub success: PairedDifference,
    /// Clean success, `touch` less `blind`, over combinations.
    pub clean_success: PairedDifference,
    /// Clean success, `touch` less `reflex`, over combinations.
    pub touch_over_reflex: PairedDifference,
    /// Success of `touch` against `blind`, trial by trial.
    pub mcnemar: McNemar,
    /// Mixed-model differences of paired trials within combinations.
    #[serde(default)]
    pub mixed: MixedEffectSizes,
}

/// Differences of outcomes, trial by trial, with the variance between combinations separated from that within them.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct MixedEffectSizes {
    /// Clean success, `touch` less `blind`.
    pub clean_success: MixedEffects,
    /// Clean success, `touch` less `reflex`.
    pub touch_over_reflex: MixedEffects,
    /// Unwanted contact, `blind` less `touch`.
    pub contact: MixedEffects,
}

/// Decision latency, ms.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct DecisionTime {
    /// Median.
    pub p50: Option<f64>,
    /// 99th percentile.
    pub p99: Option<f64>,
    /// Number of trials whose slowest decision exceeded the scenario's decision time.
    #[serde(default)]
    pub over_budget: Option<usize>,
}

/// Median and 95th percentile.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct MedianP95 {
    pub median: Option<f64>,
    /// 95th percentile.
    pub p95: Option<f64>,
}

/// Error of the in-hand pose estimate.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct PoseError {
    /// Position error, mm.
    pub mm: MedianP95,
    /// Orientation error, deg.
    pub deg: MedianP95,
    /// Position error of the prior, the planned pose before touch, mm.
    pub prior_mm: MedianP95,
}

/// Facts about the run that a summary needs besides the records.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunInfo {
    /// Seed of the benchmark.
    pub seed: u64,
    /// `sim`, `hardware` or `emulated`.
    pub robot: String,
    /// Wall-clock time of the run, s.
    pub wall_s: f64,
    /// Decision time that the scenario allows, s.
    pub decision_budget: Option<f64>,
}

/// Contents of `summary.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Summary {
    /// Number of different combinations.
    pub combos: usize,
    /// Greatest number of trials of a combination under one condition.
    pub trials_per_combo: usize,
    /// Seed of the benchmark.
    pub seed: u64,
    /// `sim`, `hardware` or `emulated`.
    pub robot: String,
    /// Rates and failures of each condition.
    pub conditions: PerCondition<ConditionSummary>,
    /// One-sided t-tests, paired over combinations.
    pub t_test: SignificanceTests,
    /// Effect sizes with intervals, the exact test over trials, and the power with fewer combinations.
    #[serde(default)]
    pub differences: EffectSizes,
    /// Ablations of the policy `touch`, if they were run.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub ablations: Vec<AblationSummary>,
    /// Area under the ROC curve of the predicted risk as a classifier of contact, over blind trials; none unless trials
    /// with and without contact exist.
    pub risk_auc: Option<f64>,
    /// Decision latency over all trials of `touch`.
    pub decision_ms: DecisionTime,
    /// In-hand pose error over all trials of `touch` that made an estimate.
    pub pose_error: PoseError,
    /// Simulated time divided by wall-clock time, all threads together; none for a run that took no time.
    pub real_time_factor: Option<f64>,
    /// Wall-clock time of the run, s.
    pub wall_s: f64,
    /// Name of the robot model, if it is not the built-in one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub robot_model: Option<String>,
    /// The user's objects that were left out, with the reasons.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub left_out: Vec<String>,
    /// Deviations of objects from their files, and operations that were impossible with them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
}

/// Summarises the records. `ablated` holds the trials of ablations, if any.
pub fn summarise(records: &[TrialRecord], ablated: &[AblatedTrial], run: &RunInfo) -> Summary {
    let per_condition = Condition::ALL.map(|condition| combination_rates(records, condition));
    let [ideal, blind, reflex, touch, own] = &per_condition;
    let contact = |rates: &CombinationRates| rates.contact_rate;
    let success = |rates: &CombinationRates| rates.success_rate;
    let clean = |rates: &CombinationRates| rates.clean_success_rate;
    let summary = |condition: Condition, rates: &[CombinationRates]| condition_summary(records, condition, rates);
    let column = |pick: fn(&TrialRecord) -> Option<f64>| -> Vec<f64> {
        records.iter().filter(|record| record.condition == Condition::Touch).filter_map(pick).collect()
    };
    let spread = |values: Vec<f64>| MedianP95 { median: percentile(&values, 50.0), p95: percentile(&values, 95.0) };
    let later = |unit: usize| -> Vec<f64> {
        let touch = records.iter().filter(|record| record.condition == Condition::Touch);
        touch.flat_map(|record| record.later_pose_errors.0.iter().flatten().map(move |error| error[unit])).collect()
    };
    let decisions = column(|record| record.decision_ms);
    let combinations: std::collections::BTreeSet<usize> = records.iter().map(|record| record.combination).collect();
    let all = records.iter().chain(ablated.iter().map(|trial| &trial.record));
    let sim_seconds: f64 = all.map(|record| record.sim_seconds).sum();
    let paired = |first, second, outcome: fn(&TrialRecord) -> bool| paired_outcomes(records, first, second, outcome);
    Summary {
        combos: combinations.len(),
        trials_per_combo: per_condition.iter().flatten().map(|rates| rates.trials).max().unwrap_or(0),
        seed: run.seed,
        robot: run.robot.clone(),
        conditions: PerCondition {
            ideal: summary(Condition::Ideal, ideal),
            blind: summary(Condition::Blind, blind),
            reflex: summary(Condition::Reflex, reflex),
            touch: summary(Condition::Touch, touch),
            external: summary(Condition::External, own),
        },
        t_test: SignificanceTests {
            contact: paired_t_test(&pair_up(blind, ideal, contact)),
            success: paired_t_test(&pair_up(touch, blind, success)),
            clean_success: paired_t_test(&pair_up(touch, blind, clean)),
            touch_over_reflex: paired_t_test(&pair_up(touch, reflex, clean)),
        },
        differences: EffectSizes {
            contact: PairedDifference::from_pairs(&pair_up(blind, ideal, contact)),
            success: PairedDifference::from_pairs(&pair_up(touch, blind, success)),
            clean_success: PairedDifference::from_pairs(&pair_up(touch, blind, clean)),
            touch_over_reflex: PairedDifference::from_pairs(&pair_up(touch, reflex, clean)),
            mcnemar: McNemar::from_pairs(paired(Condition::Touch, Condition::Blind, |record| record.success)),
            mixed: MixedEffectSizes {
                clean_success: MixedEffects::from_pairs(paired(Condition::Touch, Condition::Blind, |record| {
                    record.clean_success
                })),
                touch_over_reflex: MixedEffects::from_pairs(paired(Condition::Touch, Condition::Reflex, |record| {
                    record.clean_success
                })),
                contact: MixedEffects::from_pairs(paired(Condition::Blind, Condition::Touch, |record| record.contact)),
            },
        },
        ablations: AblationSummary::all(records, ablated),
        risk_auc: risk_prediction(records).map(|prediction| prediction.area),
        decision_ms: DecisionTime {
            p50: percentile(&decisions, 50.0),
            p99: percentile(&decisions, 99.0),
            over_budget: run.decision_budget.map(|budget| decisions.iter().filter(|ms| **ms > 1e3 * budget).count()),
        },
        pose_error: PoseError {
            mm: spread([column(|record| record.pose_error_mm), later(0)].concat()),
            deg: spread([column(|record| record.pose_error_deg), later(1)].concat()),
            prior_mm: spread(column(|record| record.prior_error_mm)),
        },
        real_time_factor: (run.wall_s > 0.0).then(|| sim_seconds / run.wall_s),
        wall_s: run.wall_s,
        robot_model: None,
        left_out: Vec::new(),
        notes: Vec::new(),
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
    let over = |pick: fn(&CombinationRates) -> f64| MeanSd::from_values(&rates.iter().map(pick).collect::<Vec<f64>>());
    ConditionSummary {
        trials,
        contact_rate: over(|rates| rates.contact_rate),
        collision_rate: over(|rates| rates.contact_rate),
        success_rate: over(|rates| rates.success_rate),
        clean_success_rate: over(|rates| rates.clean_success_rate),
        risk_rate: MeanSd::from_values(&rates.iter().filter_map(|rates| rates.risk_rate).collect::<Vec<f64>>()),
        trial_s: over(|rates| rates.trial_s),
        switched,
        failures,
    }
}
