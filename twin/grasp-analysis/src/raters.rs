//! Agreement of people's labels with the rules, and of people with each other.

use schemars::JsonSchema;
use serde::Serialize;

use crate::classification::Classification;
use crate::labels::{Agreement, Labels, agreement};
use dexterous_grasping::taxonomy::Category;

/// Agreement of two raters on the grasps that both rated.
#[derive(Debug, Serialize, JsonSchema)]
pub struct RaterPair {
    /// Name of an annotator.
    pub first: String,
    /// Name of another annotator, or `rules`.
    pub second: String,
    /// Agreement on the 19 types.
    pub types: Agreement,
    /// Agreement on the three broad types.
    pub categories: Agreement,
}

impl RaterPair {
    /// Formats the pair as one line of text.
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

/// Computes the agreement of every annotator with the rules and with every earlier annotator. Pairs with no grasp in
/// common are left out.
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

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use dexterous_grasping::synthesis::held::HeldGrasp;
    use hand_model::Hand;
    use nalgebra::Point3;

    use super::*;
    use dexterous_grasping::taxonomy::attributes::ObjectForm;

    use crate::classification::DuplicateGrasp;
    use crate::summary::ClassificationSummary;
    use crate::test_grasp::grasp;

    /// Six grasps of two objects.
    fn classified() -> Classification {
        let corner = |n: u32| Point3::from([0, 1, 2].map(|axis| if n >> axis & 1 == 1 { 0.02 } else { -0.02 }));
        let (hand, form) = (Hand::ftac(), ObjectForm::from_points(&(0..8).map(corner).collect::<Vec<_>>()));
        let mut made = Classification::default();
        for name in ["cube", "die"] {
            made.add_object(name);
            for chain in 0..3 {
                let bend = 0.2 + 0.3 * chain as f64;
                let held = HeldGrasp { chain, ..grasp(bend, &[(None, [0.0, 0.0, -1.0], 2.0)]) };
                made.add(&hand, &form, held).expect("new");
            }
        }
        let twice = made.add(&hand, &form, HeldGrasp { chain: 2, ..grasp(0.2, &[]) });
        assert_eq!(twice, Err(DuplicateGrasp("die/2".into())));
        made
    }

    /// Every grasp is counted once, under its object and its type.
    #[test]
    fn counts_add_up() {
        let made = classified();
        let summary = ClassificationSummary::from_classification(&made);
        assert_eq!(
            (summary.grasps, &summary.distribution.objects[..]),
            (6, &["cube".to_owned(), "die".to_owned()][..])
        );
        assert_eq!(summary.types.iter().map(|kind| kind.grasps).sum::<usize>(), 6);
        assert_eq!(summary.categories.iter().sum::<usize>(), 6);
        assert_eq!(Category::ALL.map(|category| made.count(category)), summary.categories);
        let clear: usize = summary.types.iter().map(|kind| kind.clear).sum();
        assert_eq!(clear + summary.ambiguous, 6);
        assert_eq!(summary.types.iter().map(|kind| kind.fit).sum::<usize>() + summary.unfit, 6);
        assert_eq!(summary.figures(&made, Vec::new()).decisions.len(), 6);
        assert_eq!(made.object(made.find("die/1").expect("there")), "die");
    }

    /// One annotator agrees with the rules on all grasps. The other labels a single grasp and gets it wrong.
    #[test]
    fn everyone_is_compared_with_everyone_before() {
        let made = classified();
        let labels = |annotator: &str, labels: BTreeMap<String, String>| Labels {
            version: crate::labels::VERSION,
            annotator: annotator.into(),
            labels,
        };
        let all = made.grasps.iter().map(|grasp| (grasp.id.clone(), made.type_name(grasp).to_owned())).collect();
        let right = labels("right", all);
        let first = &made.grasps[0];
        let other = made.taxonomy.types.iter().find(|kind| kind.name != made.type_name(first)).expect("19 types");
        let wrong = labels("wrong", BTreeMap::from([(first.id.clone(), other.name.clone())]));
        let nobody = labels("nobody", BTreeMap::new());
        let pairs = agreements(&made, &[right, wrong, nobody]);
        let found: Vec<(&str, &str, usize, f64)> = pairs
            .iter()
            .map(|pair| (pair.first.as_str(), pair.second.as_str(), pair.types.items, pair.types.observed))
            .collect();
        assert_eq!(found, [("right", "rules", 6, 1.0), ("wrong", "rules", 1, 0.0), ("right", "wrong", 1, 0.0)]);
    }
}
