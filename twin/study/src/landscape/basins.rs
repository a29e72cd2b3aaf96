//! What a mapped landscape of grasps shows: which grasps share a basin, of which broad type most of them are, and how the number
//! of basins grows with the number of grasps.

use std::fmt::Write as _;

use serde_json::{Value, json};

use super::calibration::Calibration;
use super::disconnectivity::Tree;
use super::exploration::Minimum;
use super::grasps::GraspState;
use super::mapping::{Basin, Mapping};
use crate::classification::{Classification, ClassifiedGrasp};
use crate::taxonomy::Category;

/// A mapped landscape with the grasps behind its minima.
pub struct MappedGrasps<'a> {
    pub classification: &'a Classification,
    /// Their minima, in the order in which they were sorted.
    pub minima: &'a [Minimum],
    /// Basins and barriers.
    pub map: &'a Mapping<GraspState>,
    /// The tree of the basins.
    pub tree: &'a Tree,
}

impl<'a> MappedGrasps<'a> {
    /// The grasps in a basin.
    pub fn members(&self, basin: &Basin<GraspState>) -> Vec<&'a ClassifiedGrasp> {
        basin.members.iter().map(|n| self.grasp(*n)).collect()
    }

    /// The grasp of minimum number `n`.
    fn grasp(&self, n: usize) -> &'a ClassifiedGrasp {
        &self.classification.grasps[self.minima[n].grasp]
    }

    /// The broad type of most grasps of a basin; of equal counts the first in the table.
    pub fn majority(&self, basin: &Basin<GraspState>) -> Category {
        let grasps = self.members(basin);
        let count = |category: &Category| {
            grasps.iter().filter(|grasp| self.classification.category(grasp) == *category).count()
        };
        let best = Category::ALL.iter().rev().max_by_key(|category| count(category));
        best.copied().unwrap_or(Category::Power)
    }

    /// The grasp whose minimum is the basin's.
    pub fn lowest(&self, basin: &Basin<GraspState>) -> &'a ClassifiedGrasp {
        let own = basin.members.iter().copied();
        let is_minimum = |n: &usize| self.map.basins.iter().any(|basin| basin.minimum == self.minima[*n].state);
        self.grasp(own.clone().find(is_minimum).or(own.min()).unwrap_or(0))
    }

    /// (grasps, basins): basins after the first grasps, their number doubling: objects take turns, so that each has its share at any time.
    pub fn growth(&self) -> Vec<(usize, usize)> {
        let mut counts: Vec<usize> = (0..).map(|k| self.map.sorted >> k).take_while(|n| *n > 5).collect();
        counts.reverse();
        // A basin's first member founded it.
        let founded =
            |n: usize| self.map.basins.iter().filter(|basin| basin.members.first().is_some_and(|m| *m < n)).count();
        counts.into_iter().map(|n| (n, founded(n))).collect()
    }

    /// The figures as `landscape.json` has them.
    pub fn json(&self, calibration: &Calibration, sweep: Option<Value>) -> Value {
        let basins: Vec<_> = self
            .map
            .basins
            .iter()
            .map(|basin| {
                let own = self.members(basin);
                let mut objects: Vec<&str> = own.iter().map(|grasp| self.classification.object(grasp)).collect();
                objects.sort_unstable();
                objects.dedup();
                let ids: Vec<&String> = own.iter().map(|grasp| &grasp.id).collect();
                let majority = self.majority(basin);
                json!({ "energy": basin.energy, "members": ids, "objects": objects, "majority": majority })
            })
            .collect();
        let shared =
            basins.iter().filter(|basin| basin["objects"].as_array().is_some_and(|objects| objects.len() > 1)).count();
        let count = |category| self.map.basins.iter().filter(|basin| self.majority(basin) == category).count();
        let singles = self.map.basins.iter().filter(|basin| basin.members.len() == 1).count();
        let attraction = &self.map.plan.attraction;
        let growth: Vec<Value> =
            self.growth().into_iter().map(|(grasps, basins)| json!({ "grasps": grasps, "basins": basins })).collect();
        json!({
            "grasps": self.minima.len(), "basins": self.map.basins.len(), "growth": growth,
            "basins_of_one": singles, "basins_with_several_objects": shared,
            "power": count(Category::Power), "intermediate": count(Category::Intermediate),
            "precision": count(Category::Precision), "trees": self.tree.roots.len(),
            "pull": attraction.pull, "temperature": attraction.temperature,
            "thresholds": calibration.thresholds, "pairs": calibration.pairs,
            "merges": self.tree.merges, "barriers": self.map.edges(), "list": basins, "sweep": sweep,
        })
    }
}

/// The figures of [`MappedGrasps::json`] in words.
pub fn text(found: &Value) -> String {
    let mut text = format!(
        "{} grasps in {} basins (paper 79 over six objects): {} power, {} intermediate, {} precision; {} hold several objects\n",
        found["grasps"],
        found["basins"],
        found["power"],
        found["intermediate"],
        found["precision"],
        found["basins_with_several_objects"]
    );
    let _ = writeln!(
        text,
        "pull {}, temperature {}; trees without a known way between them: {}",
        found["pull"], found["temperature"], found["trees"]
    );
    if let Some(rows) = found["growth"].as_array() {
        let growth: Vec<String> = rows.iter().map(|row| format!("{} of {}", row["basins"], row["grasps"])).collect();
        let (growth, singles) = (growth.join(", "), &found["basins_of_one"]);
        let _ = writeln!(text, "basins of the first grasps: {growth}; of one grasp only: {singles}");
    }
    let sweep = &found["sweep"];
    if let Some(grid) = sweep["grid"].as_array() {
        let _ = writeln!(text, "basins of {} minima:", sweep["minima"]);
        let _ = writeln!(text, "{:>12} {:>10} {:>7}", "temperature", "pull", "basins");
        for row in grid {
            let number = |key: &str| row[key].as_f64().unwrap_or(f64::NAN);
            let _ = writeln!(text, "{:12.3} {:10.3} {:>7}", number("temperature"), number("pull"), row["basins"]);
        }
        let _ = writeln!(text, "over seeds: {}", sweep["over_seeds"]);
    }
    text
}
