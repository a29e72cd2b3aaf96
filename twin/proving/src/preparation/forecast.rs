//! How long a preparation will take, foretold from a first measurement on this machine.

use super::EFFORT;
use crate::plan::Plan;

/// Rehearsals of a pair that is planned and tried under errors in both orders, at most, with four first and fourteen second grasps and three
/// ways in which the second object can have fallen: 60 to choose, 150 for the odds and 210 for what fell, 490 after other first grasps, 400 for
/// variations.
const PAIR: f64 = 2.0 * 1310.0;
/// Rehearsals of a pair that is proven at a level of effort, at most: five races of some 600, for the planned and another first grasp in either order and
/// for new first grasps.
const PROOF: f64 = 5.0 * 600.0;

/// What the first search of several says once it knows that a rehearsal takes `seconds` with all threads of this machine; `after` are the
/// searches that follow. Each search is of what comes in this place, from 0.
pub fn of_search(name: &str, place: usize, after: &[usize], seconds: f64) -> String {
    let most = |place: usize| seconds * EFFORT.rehearsals(place) as f64;
    let one = most(place);
    let all: f64 = one + after.iter().map(|place| most(*place)).sum::<f64>();
    let rest = match after.len() {
        0 => String::new(),
        n => format!(", with the {n} after it at most {}", time(all)),
    };
    format!("a rehearsal of {name} takes {seconds:.2} s on this machine: this search at most {}{rest}", time(one))
}

/// What is said before `pairs` are planned, a rehearsal of which takes `seconds` on one thread; each thread plans a pair.
pub fn of_plans(pairs: usize, seconds: Option<f64>, effort: u32) -> String {
    let planned = if pairs == 1 { "planning one pair".to_owned() } else { format!("planning {pairs} pairs") };
    let Some(seconds) = seconds else { return format!("{planned} in physics") };
    let rounds = pairs.div_ceil(rayon::current_num_threads().max(1)) as f64;
    // Each level has as many proposals again as the one before.
    let proofs: f64 = (1..=effort).map(|level| PROOF * f64::from(level)).sum();
    format!(
        "{planned} in physics, a rehearsal of which takes {seconds:.2} s on this machine: at most {}",
        time(rounds * (PAIR + proofs) * seconds)
    )
}

/// Words on how sure pairs are that did not come with a plan: those with a proof by name, the others together.
pub fn of_proofs<'a>(plans: impl Iterator<Item = &'a Plan>) -> Vec<String> {
    let (proven, others): (Vec<&Plan>, Vec<&Plan>) = plans.partition(|plan| plan.proof.is_some());
    let sure = proven.iter().map(|plan| {
        let best = plan.reversed.iter().map(|other| other.best()).fold(plan.best(), f64::max);
        let draws = plan.proof.iter().map(|proof| proof.holds.len()).max().unwrap_or(0);
        format!(
            "{}: taken one after the other without contact in {:.0} of {draws} drawn trials",
            plan.objects().join(", "),
            best * draws as f64
        )
    });
    let unproven = others.iter().filter(|plan| plan.objects().len() == 2).count();
    let rest = (unproven > 0).then(|| {
        format!("{unproven} pairs were tried under errors of their aim alone: --effort 1 looks for grasps that hold in trials as they are drawn")
    });
    sure.chain(rest).collect()
}

/// A time as people say it.
fn time(seconds: f64) -> String {
    match seconds {
        short if short < 90.0 => format!("{short:.0} s"),
        minutes if minutes < 90.0 * 60.0 => format!("{:.0} min", minutes / 60.0),
        hours => format!("{:.1} h", hours / 3600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Twice as slow a machine is foretold twice the time; what follows is added.
    #[test]
    fn times_follow_the_measurement() {
        let one = of_search("mug", 0, &[], 0.1);
        let most = 0.1 * EFFORT.rehearsals(0) as f64;
        assert!(one.ends_with(&format!("at most {}", time(most))), "{one}");
        let all = of_search("mug", 0, &[1, 1], 0.2);
        let sum = 0.2 * (EFFORT.rehearsals(0) + 2 * EFFORT.rehearsals(1)) as f64;
        assert!(all.contains("2 after it") && all.ends_with(&time(sum)), "{all}");
        assert_eq!([time(40.0), time(600.0), time(7200.0)], ["40 s", "10 min", "2.0 h"]);
    }
}
