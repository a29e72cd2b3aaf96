//! Exploration of the landscape of a set of grasps: every grasp cools to its minimum, minima are sorted into basins,
//! and barriers are measured.

use std::io::Write as _;
use std::path::Path;

use indicatif::{ProgressBar, ProgressStyle};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::Serialize;

use super::Landscape as _;
use super::attraction::{AttractionSettings, chain_rng};
use super::grasps::{GraspLandscape, GraspState};
use super::mapping::{JournalError, Mapping, MappingParameters};
use crate::classification::Classification;

/// Number of steps in which a grasp cools to its minimum.
const COOLING_STEPS: usize = 800;
/// Distance at which a chain counts as arrived, in units of [`GraspState`]'s distance: 0.7 is 0.15 rad in every joint
/// together with 12 mm in the object's position.
const ARRIVAL_DISTANCE: f64 = 0.7;
const MAX_IDLE_STEPS: usize = 120;
const CHAIN_COUNT: usize = 2;
const MAX_PULL_DOUBLINGS: u32 = 5;
const NEIGHBOR_COUNT: usize = 6;

/// Number of basins at a temperature and a pull.
#[derive(Debug, Serialize, JsonSchema)]
pub struct SweepPoint {
    /// Temperature of the chains, in units of the energy.
    pub temperature: f64,
    /// Pull between two grasps.
    pub pull: f64,
    pub basins: usize,
}

/// Number of basins of a few minima over temperature and pull, and over seeds.
#[derive(Debug, Serialize, JsonSchema)]
pub struct BasinSweep {
    /// Number of minima that were sorted.
    pub minima: usize,
    pub grid: Vec<SweepPoint>,
    /// Number of basins with each seed.
    pub over_seeds: Vec<usize>,
}

/// Minimum below a grasp.
#[derive(Debug, Clone)]
pub struct GraspMinimum {
    /// Index of the grasp in its classification.
    pub grasp: usize,
    /// State in which it came to rest.
    pub state: GraspState,
}

/// Returns the settings of the chains that explore at `temperature`.
pub fn attraction(pull: f64, temperature: f64) -> AttractionSettings {
    AttractionSettings {
        pull,
        temperature,
        near: ARRIVAL_DISTANCE,
        max_idle_steps: MAX_IDLE_STEPS,
        chains: CHAIN_COUNT,
    }
}

/// Returns the parameters with which chains of `attraction` sort minima and measure barriers. `subject` describes the
/// landscape.
pub fn mapping_parameters(attraction: AttractionSettings, seed: u64, subject: String) -> MappingParameters {
    MappingParameters { attraction, doublings: MAX_PULL_DOUBLINGS, neighbors: NEIGHBOR_COUNT, seed, subject }
}

/// Merges lists of grasps, one per object, into one list in which the objects take turns: (index of the list, grasp).
pub fn interleave(by_object: &[Vec<usize>]) -> Vec<(usize, usize)> {
    let longest = by_object.iter().map(Vec::len).max().unwrap_or(0);
    let round = |k: usize| {
        by_object.iter().enumerate().filter_map(move |(object, own)| own.get(k).map(|grasp| (object, *grasp)))
    };
    (0..longest).flat_map(round).collect()
}

/// Finds the minima below the `chosen` grasps: (index of the object in the landscape, index of the grasp). A grasp with
/// fewer than two links in contact has no minimum of its own and is left out.
pub fn find_minima(
    landscape: &GraspLandscape,
    classification: &Classification,
    chosen: &[(usize, usize)],
    temperature: f64,
    seed: u64,
) -> Vec<GraspMinimum> {
    chosen
        .par_iter()
        .enumerate()
        .filter_map(|(n, &(object, grasp))| {
            let mut rng = chain_rng(seed, [n as u64, 0, 0, 7]);
            let held = &classification.grasps[grasp].grasp;
            let state = landscape.minimum(object, held, temperature, COOLING_STEPS, &mut rng)?;
            Some(GraspMinimum { grasp, state })
        })
        .collect()
}

/// Sorts all minima and measures all barriers. Resumes from `journal` if that holds an interrupted run.
pub fn explore(
    landscape: &GraspLandscape,
    states: &[GraspState],
    plan: MappingParameters,
    journal: &Path,
    progress: &ProgressBar,
) -> Result<Mapping<GraspState>, JournalError> {
    let mut map = Mapping::resume(plan, journal, |state| landscape.energy(state))?;
    progress.set_length(states.len() as u64);
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} {msg} [{elapsed} < {eta}]") {
        progress.set_style(style);
    }
    for state in states.iter().skip(map.sorted) {
        progress.set_position(map.sorted as u64);
        progress.set_message(format!("minima in {} basins", map.basins.len()));
        map.sort(landscape, state.clone())?;
    }
    progress.set_length(map.basins.len() as u64);
    while map.measure(landscape)? {
        progress.set_position(map.measured() as u64);
        progress.set_message("basins' barriers");
    }
    progress.finish_and_clear();
    Ok(map)
}

/// Counts the basins of `states`, a few of the minima, over temperature and pull, and over seeds.
pub fn sweep_basins(
    landscape: &GraspLandscape,
    states: &[GraspState],
    plan: &MappingParameters,
    progress: &ProgressBar,
) -> Result<BasinSweep, JournalError> {
    let count = |temperature: f64, pull: f64, seed: u64| -> Result<usize, JournalError> {
        let attraction = AttractionSettings { temperature, pull, ..plan.attraction };
        let mut map = Mapping::new(MappingParameters { attraction, seed, ..plan.clone() });
        for state in states {
            map.sort(landscape, state.clone())?;
        }
        let basins = map.basins.len();
        progress.suspend(|| {
            writeln!(std::io::stderr(), "temperature {temperature}, pull {pull:.3}, seed {seed}: {basins} basins").ok()
        });
        Ok(basins)
    };
    let AttractionSettings { pull, temperature, .. } = plan.attraction;
    let mut grid = Vec::new();
    for heat in [0.5, 1.0, 2.0] {
        for weight in [0.25, 0.5, 1.0, 2.0, 4.0] {
            let basins = count(heat * temperature, weight * pull, plan.seed)?;
            grid.push(SweepPoint { temperature: heat * temperature, pull: weight * pull, basins });
        }
    }
    let over_seeds = (0..5).map(|k| count(temperature, pull, plan.seed + k)).collect::<Result<Vec<_>, _>>()?;
    Ok(BasinSweep { minima: states.len(), grid, over_seeds })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Short lists run out. Nothing is lost, and the order within a list stays.
    #[test]
    fn objects_take_turns() {
        let lists = [vec![1, 2, 3], vec![], vec![10]];
        assert_eq!(interleave(&lists), [(0, 1), (2, 10), (0, 2), (0, 3)]);
    }
}
