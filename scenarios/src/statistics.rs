//! Sums trials up: rates per combination, their mean and deviation, tests, the share of variance between combinations, percentiles,
//! densities, the worth of a prediction, `summary.json`.

mod ablation;
mod distribution;
mod mixed;
mod paired;
mod prediction;
mod rates;
mod summary;

pub use ablation::AblationSummary;
pub use distribution::{BoxPlot, MeanSd, box_plot, density, percentile, silverman_bandwidth};
pub use mixed::Mixed;
pub use paired::{Difference, FEWEST_SAMPLES, Interval, McNemar, SPREAD_TOLERANCE, TTest, Untested, paired_t_test};
pub use prediction::{Group, Prediction, Rate, roc_area};
pub use rates::{CombinationRates, combination_rates};
pub use summary::{
    ConditionSummary, DecisionTime, Differences, MedianP95, MixedDifferences, PerCondition, PoseError, RunInfo,
    Summary, Tests, summarise,
};

#[cfg(test)]
mod tests;
