//! Grasps by kind, each with its best one.

use std::collections::BTreeMap;

use serde::Serialize;

/// A kind of grasp: how many there are of it, and the one with the largest wrench margin.
#[derive(Debug, Clone, Serialize)]
pub struct Kind<'a, G> {
    /// What makes the kind, in words.
    #[serde(rename = "kind")]
    pub name: String,
    /// Grasps of this kind.
    pub count: usize,
    /// The best of them.
    pub best: &'a G,
}

/// The kinds among `grasps` by `name`, the most frequent first; the best is the first of the largest `margin`.
pub fn kinds<'a, G>(
    grasps: impl IntoIterator<Item = &'a G>,
    name: impl Fn(&G) -> String,
    margin: impl Fn(&G) -> f64,
) -> Vec<Kind<'a, G>> {
    let mut found: BTreeMap<String, Kind<'a, G>> = BTreeMap::new();
    for grasp in grasps {
        let name = name(grasp);
        let kind = found.entry(name.clone()).or_insert(Kind { name, count: 0, best: grasp });
        kind.count += 1;
        if margin(grasp) > margin(kind.best) {
            kind.best = grasp;
        }
    }
    let mut kinds: Vec<Kind<'a, G>> = found.into_values().collect();
    kinds.sort_by(|a, b| b.count.cmp(&a.count).then_with(|| a.name.cmp(&b.name)));
    kinds
}
