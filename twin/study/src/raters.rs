//! Agreement of people's labels with the rules, and of people with each other.

use serde::Serialize;

use crate::classification::Classification;
use crate::labels::{Agreement, Labels, agreement};
use crate::taxonomy::Category;

/// Agreement of two raters on the grasps that both rated.
#[derive(Debug, Serialize)]
pub struct RaterPair {
    /// An annotator.
    pub first: String,
    /// Another one, or `rules`.
    pub second: String,
    /// On the 19 types.
    pub types: Agreement,
    /// On the three broad types.
    pub categories: Agreement,
}

impl RaterPair {
    /// The pair in a line of words.
    pub fn text(&self) -> String {
        let kappa = |found: &Agreement| found.kappa.map_or("none".into(), |kappa| format!("{kappa:.3}"));
        format!(
            "{} and {}: {} grasps, types agree {:.1} %, kappa {}; broad types {:.1} %, kappa {}",
            self.first,
            self.second,
            self.types.items,
            100.0 * self.types.observed,
            kappa(&self.types),
            100.0 * self.categories.observed,
            kappa(&self.categories)
        )
    }
}

/// Agreement of every annotator with the rules and with every annotator before; pairs with no grasp in common are left out.
pub fn agreements(classification: &Classification, annotators: &[Labels]) -> Vec<RaterPair> {
    let taxonomy = &classification.taxonomy;
    let label = |labels: &Labels, id: &str| labels.labels.get(id).and_then(|name| taxonomy.find(name));
    let mut pairs = Vec::new();
    let mut compare = |first: &str, second: &str, rated: Vec<(usize, usize)>| {
        let category = |kind: usize| taxonomy.types[kind].category as usize;
        let broad: Vec<(usize, usize)> = rated.iter().map(|(a, b)| (category(*a), category(*b))).collect();
        let found = (agreement(&rated, taxonomy.types.len()), agreement(&broad, Category::ALL.len()));
        if let (Some(types), Some(categories)) = found {
            pairs.push(RaterPair { first: first.into(), second: second.into(), types, categories });
        }
    };
    let grasps = || classification.grasps.iter();
    for (n, labels) in annotators.iter().enumerate() {
        let rated = grasps().filter_map(|grasp| Some((label(labels, &grasp.id)?, grasp.decision.kind)));
        compare(&labels.annotator, "rules", rated.collect());
        for other in &annotators[..n] {
            let rated = grasps().filter_map(|grasp| Some((label(other, &grasp.id)?, label(labels, &grasp.id)?)));
            compare(&other.annotator, &labels.annotator, rated.collect());
        }
    }
    pairs
}
