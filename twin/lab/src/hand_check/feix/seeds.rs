//! Grasp types over many seeds, since a result for one seed is not significant.

use std::sync::Arc;

use hand_model::Hand;
use schemars::JsonSchema;
use serde::Serialize;

use super::{GraspTypeResult, run};

/// Results of one type over the seeds.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct TypeOverSeeds {
    /// Number of the type, 1 to 33.
    pub number: usize,
    /// Name in the taxonomy.
    pub name: &'static str,
    /// Number of seeds with which it is held.
    pub held: usize,
    /// Number of seeds with which it is formed.
    pub formed: usize,
    /// Number of seeds tried.
    pub seeds: usize,
    /// Numbers of attempts: fewest, median and most.
    pub tries: [usize; 3],
    /// Largest tension of any cable over the seeds, N: least, median, most.
    pub tension: [f64; 3],
}

/// Runs the search for types (all if `numbers` is empty) with `seeds` seeds from `first` on. Returns the summaries, and
/// the results of the first seed. `done` is called after each type of each seed.
pub fn over_seeds(
    hand: &Arc<Hand>,
    (first, seeds): (u64, u64),
    tries: usize,
    numbers: &[usize],
    done: impl Fn() + Sync,
) -> (Vec<TypeOverSeeds>, Vec<GraspTypeResult>) {
    let runs: Vec<Vec<GraspTypeResult>> =
        (first..first.saturating_add(seeds)).map(|seed| run(hand, seed, tries, numbers, &done)).collect();
    let types = runs.first().map_or(0, Vec::len);
    let found = (0..types).map(|n| summary(&runs.iter().filter_map(|run| run.get(n)).collect::<Vec<_>>()));
    (found.collect(), runs.into_iter().next().unwrap_or_default())
}

/// Summarizes one type's results, of at least one seed.
fn summary(results: &[&GraspTypeResult]) -> TypeOverSeeds {
    let count = |test: fn(&GraspTypeResult) -> bool| results.iter().filter(|result| test(result)).count();
    let mut tries: Vec<usize> = results.iter().map(|result| result.tries).collect();
    tries.sort_unstable();
    let mut tension: Vec<f64> =
        results.iter().map(|result| result.attempt.tensions.into_iter().fold(0.0, f64::max)).collect();
    tension.sort_by(f64::total_cmp);
    let (middle, last) = (results.len() / 2, results.len() - 1);
    TypeOverSeeds {
        number: results[0].number,
        name: results[0].name,
        held: count(|result| result.held),
        formed: count(|result| result.formed),
        seeds: results.len(),
        tries: [tries[0], tries[middle], tries[last]],
        tension: [tension[0], tension[middle], tension[last]],
    }
}

/// Returns the table as text.
pub fn table(types: &[TypeOverSeeds]) -> String {
    let mut text = format!("{:27} {:>8} {:>18} {:>16}\n", "", "held", "tries", "strongest pull N");
    for TypeOverSeeds { number, name, held, seeds, tries, tension, .. } in types {
        let tries = format!("{} [{}, {}]", tries[1], tries[0], tries[2]);
        let tension = format!("{:.0} [{:.0}, {:.0}]", tension[1], tension[0], tension[2]);
        text += &format!("{number:>2} {name:24} {held:>2} of {seeds:<2} {tries:>18} {tension:>16}\n");
    }
    let always = types.iter().filter(|kind| kind.held == kind.seeds).count();
    text + &format!("{always} of {} held with every seed\n", types.len())
}
