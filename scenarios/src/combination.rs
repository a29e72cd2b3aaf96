//! Pairs of objects, drawn from a scenario.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::noise::split_mix;
use crate::scenario::Scenario;

/// Two objects in the order in which they are to be picked up.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Combination {
    /// Position in the draw, from 0.
    pub id: usize,
    /// Name of the first object.
    pub first: String,
    /// Name of the second object.
    pub second: String,
}

/// The first `n` combinations of all ordered pairs (first, second), shuffled by `seed`: fewer pairs end the draw early, and a
/// shorter draw is the beginning of a longer one.
pub fn draw_combinations(scenario: &Scenario, n: usize, seed: u64) -> impl Iterator<Item = Combination> {
    let mut pairs: Vec<(String, String)> = scenario
        .first
        .iter()
        .flat_map(|first| scenario.second.iter().map(move |second| (first.clone(), second.clone())))
        .collect();
    let mut rng = ChaCha8Rng::seed_from_u64(split_mix(seed));
    for last in (1..pairs.len()).rev() {
        let other = ((u128::from(rng.next_u64()) * (last as u128 + 1)) >> 64) as usize;
        pairs.swap(last, other);
    }
    pairs.into_iter().take(n).enumerate().map(|(id, (first, second))| Combination { id, first, second })
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn draws_are_distinct_repeatable_and_nested() {
        let scenario = Scenario::benchmark();
        let long: Vec<_> = draw_combinations(&scenario, 60, 1).collect();
        let short: Vec<_> = draw_combinations(&scenario, 10, 1).collect();
        assert_eq!(long[..10], short);
        let distinct: HashSet<_> = long.iter().map(|pair| (&pair.first, &pair.second)).collect();
        assert_eq!(distinct.len(), 60);
        assert_ne!(short, draw_combinations(&scenario, 10, 2).collect::<Vec<_>>());
        assert_eq!(draw_combinations(&scenario, 100_000, 1).count(), scenario.combinations());
    }
}
