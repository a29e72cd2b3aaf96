//! The proven grasps and plans that come with the program.

use std::path::Path;

use anyhow::Result;
use grasping::Repertoire;

use crate::plan::Plans;

/// The benchmark's repertoire of pick-ups.
pub fn repertoire() -> Result<Repertoire> {
    Ok(Repertoire::parse(include_str!("../data/repertoire.json"), Path::new("data/repertoire.json"))?)
}

/// The benchmark's 60 combinations, planned without noise.
pub fn plans() -> Result<Plans> {
    Plans::parse(include_str!("../data/plans.json"), Path::new("data/plans.json"))
}
