//! Summaries of trials: rates per combination, comparisons of conditions, ablations, `summary.json`.

mod ablation;
mod file;
mod pairs;
mod rates;

pub use ablation::AblationSummary;
pub use file::{
    ConditionSummary, DecisionTime, EffectSizes, MedianP95, MixedEffectSizes, PerCondition, PoseError, RunInfo,
    SignificanceTests, Summary, summarise,
};
pub use pairs::risk_prediction;
pub use rates::{CombinationRates, combination_rates};

#[cfg(test)]
mod tests;
