//! Results of a mapped landscape of grasps: the grasps that share a basin, the broad type of most of them, and the
//! growth of the number of basins with the number of grasps.

use std::fmt::Write as _;

use schemars::JsonSchema;
use serde::Serialize;

use super::calibration::PullCalibration;
use super::disconnectivity::{BranchMerge, DisconnectivityTree};
use super::exploration::{BasinSweep, GraspMinimum};
use super::grasps::GraspState;
use super::mapping::{Basin, Mapping};
use crate::classification::{Classification, ClassifiedGrasp};
use dexterous_grasping::taxonomy::Category;

/// Number of basins of the first grasps.
#[derive(Debug, Serialize, JsonSchema)]
struct Growth {
    grasps: usize,
    /// Number of basins of the energy landscape.
    basins: usize,
}

/// A basin with its grasps.
#[derive(Debug, Serialize, JsonSchema)]
struct BasinFigures {
    /// Energy of its minimum, in units of the landscape.
    energy: f64,
    /// Names of its grasps.
    members: Vec<String>,
    /// Names of their objects.
    objects: Vec<String>,
    /// Broad type of most of them.
    majority: Category,
}

/// Figures of a mapped landscape, as written to `landscape.json`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct LandscapeFigures {
    grasps: usize,
    /// Number of basins of the energy landscape.
    basins: usize,
    /// Number of basins found with growing numbers of grasps.
    growth: Vec<Growth>,
    /// Number of basins with one grasp.
    basins_of_one: usize,
    basins_with_several_objects: usize,
    /// Number of basins of power grasps.
    power: usize,
    /// Number of basins of intermediate grasps.
    intermediate: usize,
    /// Number of basins of precision grasps.
    precision: usize,
    /// Number of trees.
    trees: usize,
    /// Pull alpha between two grasps.
    pull: f64,
    /// Temperature of the chains, in units of the energy.
    temperature: f64,
    /// Pulls at which chains between two grasps arrive.
    thresholds: Vec<f64>,
    /// Number of pairs of grasps whose threshold was searched for.
    pairs: usize,
    /// Merges of basins, with the energies at which they join.
    merges: Vec<BranchMerge>,
    /// Two basins and the height of the barrier between them, in units of the energy.
    barriers: Vec<(usize, usize, f64)>,
    /// One entry per basin.
    list: Vec<BasinFigures>,
    /// Basins over temperature, pull and seeds.
    sweep: Option<BasinSweep>,
}

/// Mapped landscape with the grasps behind its minima.
pub struct MappedGrasps<'a> {
    pub classification: &'a Classification,
    /// Minima of the grasps, in the order in which they were sorted.
    pub minima: &'a [GraspMinimum],
    /// Basins and barriers.
    pub map: &'a Mapping<GraspState>,
    /// Tree of the basins.
    pub tree: &'a DisconnectivityTree,
}

impl<'a> MappedGrasps<'a> {
    /// Returns the grasps in a basin.
    pub fn members(&self, basin: &Basin<GraspState>) -> Vec<&'a ClassifiedGrasp> {
        basin.members.iter().map(|n| self.grasp(*n)).collect()
    }

    /// Returns the grasp of minimum number `n`.
    fn grasp(&self, n: usize) -> &'a ClassifiedGrasp {
        &self.classification.grasps[self.minima[n].grasp]
    }

    /// Returns the broad type of most grasps of a basin. If counts are equal, the first in the table wins.
    pub fn majority(&self, basin: &Basin<GraspState>) -> Category {
        let grasps = self.members(basin);
        let count = |category: &Category| {
            grasps.iter().filter(|grasp| self.classification.category(grasp) == *category).count()
        };
        let best = Category::ALL.iter().rev().max_by_key(|category| count(category));
        best.copied().unwrap_or(Category::Power)
    }

    /// Returns the grasp whose minimum is the basin's.
    pub fn lowest(&self, basin: &Basin<GraspState>) -> &'a ClassifiedGrasp {
        let own = basin.members.iter().copied();
        let is_minimum = |n: &usize| self.map.basins.iter().any(|basin| basin.minimum == self.minima[*n].state);
        self.grasp(own.clone().find(is_minimum).or(own.min()).unwrap_or(0))
    }

    /// Returns (grasps, basins): the number of basins after the first grasps, whose number doubles. Objects take turns,
    /// so that each has its share at any time.
    pub fn growth(&self) -> Vec<(usize, usize)> {
        let mut counts: Vec<usize> = (0..).map(|k| self.map.sorted >> k).take_while(|n| *n > 5).collect();
        counts.reverse();
        // A basin's first member founded it.
        let founded =
            |n: usize| self.map.basins.iter().filter(|basin| basin.members.first().is_some_and(|m| *m < n)).count();
        counts.into_iter().map(|n| (n, founded(n))).collect()
    }

    fn basin(&self, basin: &Basin<GraspState>) -> BasinFigures {
        let own = self.members(basin);
        let mut objects: Vec<String> = own.iter().map(|grasp| self.classification.object(grasp).to_owned()).collect();
        objects.sort_unstable();
        objects.dedup();
        let members = own.iter().map(|grasp| grasp.id.clone()).collect();
        BasinFigures { energy: basin.energy, members, objects, majority: self.majority(basin) }
    }

    /// Returns the figures, with those of the `calibration` of its pull.
    pub fn figures(&self, calibration: PullCalibration, sweep: Option<BasinSweep>) -> LandscapeFigures {
        let basins: Vec<_> = self.map.basins.iter().map(|basin| self.basin(basin)).collect();
        let shared = basins.iter().filter(|basin| basin.objects.len() > 1).count();
        let count = |category| self.map.basins.iter().filter(|basin| self.majority(basin) == category).count();
        let singles = self.map.basins.iter().filter(|basin| basin.members.len() == 1).count();
        let attraction = &self.map.parameters.attraction;
        let growth = self.growth().into_iter().map(|(grasps, basins)| Growth { grasps, basins });
        LandscapeFigures {
            grasps: self.minima.len(),
            basins: self.map.basins.len(),
            growth: growth.collect(),
            basins_of_one: singles,
            basins_with_several_objects: shared,
            power: count(Category::Power),
            intermediate: count(Category::Intermediate),
            precision: count(Category::Precision),
            trees: self.tree.roots.len(),
            pull: attraction.pull,
            temperature: attraction.temperature,
            thresholds: calibration.thresholds,
            pairs: calibration.pairs,
            merges: self.tree.merges.clone(),
            barriers: self.map.edges(),
            list: basins,
            sweep,
        }
    }
}

impl LandscapeFigures {
    /// Formats the figures as text.
    pub fn text(&self) -> String {
        let mut text = format!(
            "{} grasps in {} basins (paper 79 over six objects): {} power, {} intermediate, {} precision; {} hold several objects\n",
            self.grasps, self.basins, self.power, self.intermediate, self.precision, self.basins_with_several_objects
        );
        let _ = writeln!(
            text,
            "pull {:?}, temperature {:?}; trees without a known way between them: {}",
            self.pull, self.temperature, self.trees
        );
        let growth: Vec<String> = self.growth.iter().map(|row| format!("{} of {}", row.basins, row.grasps)).collect();
        let (growth, singles) = (growth.join(", "), self.basins_of_one);
        let _ = writeln!(text, "basins of the first grasps: {growth}; of one grasp only: {singles}");
        if let Some(sweep) = &self.sweep {
            let _ = writeln!(text, "basins of {} minima:", sweep.minima);
            let _ = writeln!(text, "{:>12} {:>10} {:>7}", "temperature", "pull", "basins");
            for row in &sweep.grid {
                let _ = writeln!(text, "{:12.3} {:10.3} {:>7}", row.temperature, row.pull, row.basins);
            }
            let _ = writeln!(text, "over seeds: {:?}", sweep.over_seeds);
        }
        text
    }
}
