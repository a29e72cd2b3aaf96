//! Counts of grasps by object and type.

use dexterous_grasping::taxonomy::rules::RuleDecision;
use dexterous_grasping::taxonomy::{Category, Taxonomy};
use schemars::JsonSchema;
use serde::Serialize;

/// Number of grasps of each object and type, and number of ambiguous ones.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Distribution {
    /// Objects in order of first appearance.
    pub objects: Vec<String>,
    /// Number of grasps by object, then by type.
    pub counts: Vec<Vec<usize>>,
    /// Number of ambiguous grasps by object.
    pub ambiguous: Vec<usize>,
}

impl Distribution {
    /// Counts (object, decision) pairs.
    pub fn from_decisions<'a>(
        taxonomy: &Taxonomy,
        decisions: impl Iterator<Item = (&'a str, &'a RuleDecision)>,
    ) -> Self {
        let mut found = Self { objects: Vec::new(), counts: Vec::new(), ambiguous: Vec::new() };
        for (object, decision) in decisions {
            let n = found.objects.iter().position(|known| known == object).unwrap_or_else(|| {
                found.objects.push(object.to_owned());
                found.counts.push(vec![0; taxonomy.types.len()]);
                found.ambiguous.push(0);
                found.objects.len() - 1
            });
            found.counts[n][decision.kind] += 1;
            found.ambiguous[n] += usize::from(decision.ambiguous);
        }
        found
    }

    /// Returns the number of grasps of each type over all objects.
    pub fn totals(&self) -> Vec<usize> {
        let types = self.counts.first().map_or(0, Vec::len);
        (0..types).map(|kind| self.counts.iter().map(|row| row[kind]).sum()).collect()
    }

    /// Returns the number of grasps of each category over all objects.
    pub fn categories(&self, taxonomy: &Taxonomy) -> [usize; 3] {
        let totals = self.totals();
        Category::ALL.map(|category| {
            taxonomy.types.iter().zip(&totals).filter(|(kind, _)| kind.category == category).map(|(_, n)| n).sum()
        })
    }
}
