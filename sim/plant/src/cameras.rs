//! Camera failures.

use serde::{Deserialize, Serialize};

/// Failure mode of a pad's camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CameraFailure {
    /// No frames.
    Missing,
    /// Black frames.
    Black,
}
