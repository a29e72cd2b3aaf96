//! Summaries of trials: rates per combination, comparisons of conditions, ablations, `summary.json`.

mod ablation;
mod file;
mod pairs;
mod rates;

pub use ablation::AblationSummary;
pub use file::{
    ConditionSummary, DecisionTime, Differences, MedianP95, MixedDifferences, PerCondition, PoseError, RunInfo,
    Summary, Tests, summarise,
};
pub use pairs::risk_prediction;
pub use rates::{CombinationRates, combination_rates};

#[cfg(test)]
mod tests;
