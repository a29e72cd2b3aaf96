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
/// shorter draw is the beginning of a longer one. Where the scenario has objects of a user's own, pairs with them come first, until each
/// is in one.
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
    let mut pairs = own_first(scenario, pairs);
    pairs.truncate(n);
    pairs.into_iter().enumerate().map(|(id, (first, second))| Combination { id, first, second })
}

/// The pairs in their order, but for each of the scenario's own objects in turn that is in none before, the first with it to the front.
fn own_first(scenario: &Scenario, pairs: Vec<(String, String)>) -> Vec<(String, String)> {
    let (mut front, mut rest) = (Vec::<(String, String)>::new(), pairs);
    let has = |(first, second): &(String, String), name: &String| first == name || second == name;
    for object in &scenario.object {
        if front.iter().any(|pair| has(pair, &object.name)) {
            continue;
        }
        if let Some(place) = rest.iter().position(|pair| has(pair, &object.name)) {
            front.push(rest.remove(place));
        }
    }
    front.extend(rest);
    front
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    /// One own object among the benchmark's is in the first combination, whatever the seed; the others are drawn as without the rule.
    #[test]
    fn own_objects_are_drawn_first() {
        let ball = "mass = 0.1\nfriction = 0.6\nsymmetry = \"full\"\nshape.sphere.diameter = 0.05\n";
        let text = format!(
            "version = 1\nname = \"mine\"\nextends = \"benchmark\"\n\
             first = [\"golf_ball\", \"egg\", \"lemon\", \"ball_45\"]\nsecond = [\"can_66\", \"my_ball\", \"pear\", \"my_other\"]\n\
             [[object]]\nname = \"my_ball\"\n{ball}[[object]]\nname = \"my_other\"\n{ball}"
        );
        let own = Scenario::parse(&text, std::path::Path::new("mine.toml")).expect("a scenario");
        for seed in 0..20 {
            let drawn: Vec<_> = draw_combinations(&own, 16, seed).collect();
            assert_eq!([&drawn[0].second, &drawn[1].second], ["my_ball", "my_other"], "seed {seed}");
            let distinct: HashSet<_> = drawn.iter().map(|pair| (&pair.first, &pair.second)).collect();
            assert_eq!(distinct.len(), 16);
            assert_eq!(drawn[..2], draw_combinations(&own, 2, seed).collect::<Vec<_>>());
            let plain = Scenario { object: Vec::new(), ..own.clone() };
            let without: Vec<_> = draw_combinations(&plain, 16, seed).map(|pair| (pair.first, pair.second)).collect();
            let moved =
                |pair: &(String, String)| drawn[..2].iter().any(|own| (&own.first, &own.second) == (&pair.0, &pair.1));
            let rest: Vec<_> = without.into_iter().filter(|pair| !moved(pair)).collect();
            assert_eq!(
                drawn[2..].iter().map(|pair| (pair.first.clone(), pair.second.clone())).collect::<Vec<_>>(),
                rest
            );
        }
    }

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
