//! Combinations of objects drawn from a scenario.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::generator::split_mix;
use crate::scenario::Scenario;

/// Objects of a trial, in the order in which they are to be picked.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Combination {
    /// Position in the draw, from 0.
    pub id: usize,
    /// Names of the objects.
    pub objects: Vec<String>,
}

/// Returns the first `n` of all combinations, shuffled by `seed`; a combination takes one name from each of the
/// scenario's lists. If fewer than `n` combinations exist, the draw ends early. A shorter draw is a prefix of a longer
/// one. Combinations with the user's objects come first, until each of these is in one.
pub fn draw_combinations(scenario: &Scenario, n: usize, seed: u64) -> impl Iterator<Item = Combination> {
    let longer = |all: Vec<Vec<String>>, (_, names): (&str, &[String])| -> Vec<Vec<String>> {
        let with = |before: &Vec<String>| {
            let before = before.clone();
            names.iter().map(move |name| before.iter().chain([name]).cloned().collect())
        };
        all.iter().flat_map(with).collect()
    };
    let mut all = scenario.object_lists().into_iter().fold(vec![Vec::new()], longer);
    let mut rng = ChaCha8Rng::seed_from_u64(split_mix(seed));
    for last in (1..all.len()).rev() {
        let other = ((u128::from(rng.next_u64()) * (last as u128 + 1)) >> 64) as usize;
        all.swap(last, other);
    }
    let mut all = own_objects_first(scenario, all);
    all.truncate(n);
    all.into_iter().enumerate().map(|(id, objects)| Combination { id, objects })
}

/// Moves combinations to the front: for each of the user's objects that is in none of those moved before, the first
/// combination that contains it. The rest keep their order.
fn own_objects_first(scenario: &Scenario, all: Vec<Vec<String>>) -> Vec<Vec<String>> {
    let (mut front, mut rest) = (Vec::<Vec<String>>::new(), all);
    for object in &scenario.object {
        if front.iter().any(|objects| objects.contains(&object.name)) {
            continue;
        }
        if let Some(place) = rest.iter().position(|objects| objects.contains(&object.name)) {
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

    /// The user's objects appear in the first combinations for every seed. The other combinations are drawn as without
    /// this rule.
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
            assert_eq!([&drawn[0].objects[1], &drawn[1].objects[1]], ["my_ball", "my_other"], "seed {seed}");
            let distinct: HashSet<_> = drawn.iter().map(|pair| &pair.objects).collect();
            assert_eq!(distinct.len(), 16);
            assert_eq!(drawn[..2], draw_combinations(&own, 2, seed).collect::<Vec<_>>());
            let plain = Scenario { object: Vec::new(), ..own.clone() };
            let without: Vec<_> = draw_combinations(&plain, 16, seed).map(|pair| pair.objects).collect();
            let moved = |objects: &Vec<String>| drawn[..2].iter().any(|own| own.objects == *objects);
            let rest: Vec<_> = without.into_iter().filter(|objects| !moved(objects)).collect();
            assert_eq!(drawn[2..].iter().map(|pair| pair.objects.clone()).collect::<Vec<_>>(), rest);
        }
    }

    #[test]
    fn draws_are_distinct_repeatable_and_nested() {
        let scenario = Scenario::benchmark();
        let long: Vec<_> = draw_combinations(&scenario, 60, 1).collect();
        let short: Vec<_> = draw_combinations(&scenario, 10, 1).collect();
        assert_eq!(long[..10], short);
        let distinct: HashSet<_> = long.iter().map(|pair| &pair.objects).collect();
        assert_eq!(distinct.len(), 60);
        assert_ne!(short, draw_combinations(&scenario, 10, 2).collect::<Vec<_>>());
        assert_eq!(draw_combinations(&scenario, 100_000, 1).count(), scenario.combination_count());
    }

    /// A combination takes one name from each nonempty list, in the lists' order.
    #[test]
    fn a_list_of_one_two_or_three() {
        let benchmark = Scenario::benchmark();
        let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
        let one = Scenario { first: names(&["egg", "lemon"]), second: Vec::new(), ..benchmark };
        let two = Scenario { second: names(&["pear", "gem", "egg"]), ..one.clone() };
        let three = Scenario { third: names(&["can_66", "vase"]), ..two.clone() };
        for (scenario, count) in [(&one, 2), (&two, 6), (&three, 12)] {
            let drawn: Vec<_> = draw_combinations(scenario, 100, 1).collect();
            assert_eq!((drawn.len(), scenario.combination_count()), (count, count));
            for combination in &drawn {
                assert_eq!(combination.objects.len(), scenario.object_lists().len());
                let of_lists = combination.objects.iter().zip(scenario.object_lists());
                assert!(of_lists.into_iter().all(|(name, (_, names))| names.contains(name)));
            }
            assert_eq!(drawn.iter().map(|one| &one.objects).collect::<HashSet<_>>().len(), count);
        }
    }
}
