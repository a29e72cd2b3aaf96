//! Thresholds of the detectors. Their data file lists the unit and the source of each.

use serde::Deserialize;

/// Error in a file of limits.
#[derive(Debug, thiserror::Error)]
#[error("data/residual_limits.toml: {0}")]
pub struct LimitsError(#[from] toml::de::Error);

/// All limits; see `data/residual_limits.toml`.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DetectionLimits {
    #[serde(rename = "version")]
    _version: u32,
    pub cable: CableLimits,
    pub hand: HandLimits,
    pub step: StepLimits,
    pub camera: CameraLimits,
}

/// Limits for cables and servos.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CableLimits {
    pub slack_share: f64,
    pub slack: f64,
    pub least: f64,
    pub longest_slip: f64,
    pub shortest_slip: f64,
    pub pushed_closed: f64,
    pub taut: f64,
    pub taut_share: f64,
    pub slack_time: f64,
    pub gripping: f64,
    pub firm: f64,
    pub jolt: f64,
    pub closing: f64,
    pub weak_still: f64,
    pub weak_step: f64,
    pub weak_decay: [f64; 2],
    pub weak_before: f64,
    pub weak_free: [f64; 4],
    pub weak_share: f64,
    pub weak_least: f64,
    pub weak_pulled: f64,
    pub weak_slows: f64,
    pub weak_bears: f64,
    pub weak_lags: f64,
}

/// Limits for loads on the hand.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HandLimits {
    pub memory: f64,
    pub stop: f64,
    pub hard: f64,
    pub contact: f64,
    pub contact_time: f64,
    pub contact_level: f64,
    pub arriving: f64,
    pub leaving: f64,
    pub payload: f64,
    pub payload_time: f64,
    pub lost_share: f64,
    pub lost_least: f64,
    pub let_go: f64,
    pub empty: [f64; 2],
    pub lost_time: f64,
    pub carrying: f64,
    pub free_share: f64,
    pub free_time: f64,
    pub gone_time: f64,
}

/// Limits for steps of the force on the hand. Each pair holds the value without and with expected contact.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StepLimits {
    pub lag: f64,
    pub least: f64,
    pub most: f64,
    pub heaviest: f64,
    pub even: [f64; 2],
    pub level: [f64; 2],
    pub rest: [f64; 2],
}

/// Limits for cameras.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraLimits {
    pub silent: f64,
    pub silent_real: f64,
    pub missed: u32,
    pub missed_real: u32,
    pub colour: f64,
    pub drifted: u32,
    pub black: f64,
}

impl DetectionLimits {
    /// Returns the built-in limits.
    pub fn standard() -> Result<Self, LimitsError> {
        Ok(toml::from_str(include_str!("../data/residual_limits.toml"))?)
    }
}
