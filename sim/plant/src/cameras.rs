//! Cameras that fail.

use serde::{Deserialize, Serialize};

/// What comes of a pad whose camera fails.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Blindness {
    /// No frames.
    Missing,
    /// Black frames.
    Black,
}
