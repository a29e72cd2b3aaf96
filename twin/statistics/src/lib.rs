//! Statistics of trials and predictions.
//!
//! [`distribution`]: means, percentiles, box plots, densities. [`paired`]: paired differences with intervals, effect
//! sizes, power and tests. [`mixed`]: paired differences in groups. [`prediction`]: rates with intervals, the ROC
//! curve, calibration.
//!
//! With fewer than [`MIN_SAMPLES`] samples, there is no test and no interval.

pub mod distribution;
pub mod mixed;
pub mod paired;
pub mod prediction;

pub use distribution::{BoxPlot, MeanSd, box_plot, density, percentile, silverman_bandwidth};
pub use mixed::MixedEffects;
pub use paired::{
    CONSTANT_SD_TOLERANCE, ConfidenceInterval, MIN_SAMPLES, McNemar, NoTestReason, PairedDifference, TTest,
    paired_t_test,
};
pub use prediction::{CalibrationGroup, PredictionQuality, SuccessRate, roc_area};

#[cfg(test)]
mod tests;
