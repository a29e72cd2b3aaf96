//! Compliant covers.

use serde::{Deserialize, Serialize};

/// Viscoelastic behaviour of the covers.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GelViscoelasticity {
    /// Relaxation time of the gel, s.
    pub relaxation: f64,
    /// Ratio of the shear displacement under a tangential load to the depth under an equal normal load.
    pub shear: f64,
}
