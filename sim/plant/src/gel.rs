//! Covers that give way.

use serde::{Deserialize, Serialize};

/// Viscoelastic behaviour of the covers.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gel {
    /// Time in which the gel takes up its depth, s.
    pub relaxation: f64,
    /// Shear of the surface under tangential load over the depth under the same normal load.
    pub shear: f64,
}
