//! Forecast of the time that a preparation takes, from a first measurement on this machine.

use super::SEARCH_EFFORT;
use crate::grasp_pair::GraspPair;

/// Maximum number of rollouts of a pair that is planned and tried under errors in both orders, with four first and
/// fourteen second grasps and three fallen poses of the second object. In each order: 60 to choose, 150 for the outcome
/// model and 210 for the fallen poses, 490 after other first grasps, 400 for variations.
const PAIR_ROLLOUTS: f64 = 2.0 * 1310.0;
/// Maximum number of rollouts of a pair that is verified at a level of effort: five races of some 600, for the planned
/// and another first grasp in either order and for new first grasps.
const VERIFICATION_ROLLOUTS: f64 = 5.0 * 600.0;

/// Returns the forecast of a search in `place` (from 0) once the time of a rollout, `seconds`, with all threads of this
/// machine is known. `after` are the places of the searches that follow.
pub fn forecast_search(name: &str, place: usize, after: &[usize], seconds: f64) -> String {
    let most = |place: usize| seconds * SEARCH_EFFORT.max_rollouts(place) as f64;
    let one = most(place);
    let all: f64 = one + after.iter().map(|place| most(*place)).sum::<f64>();
    let rest = match after.len() {
        0 => String::new(),
        n => format!(", with the {n} after it at most {}", format_time(all)),
    };
    format!("a rollout of {name} takes {seconds:.2} s on this machine: this search at most {}{rest}", format_time(one))
}

/// Returns the forecast before `pairs` are planned, if a rollout takes `seconds` on one thread. Each thread plans one
/// pair.
pub fn forecast_pairs(pairs: usize, seconds: Option<f64>, effort: u32) -> String {
    let planned = if pairs == 1 { "planning one pair".to_owned() } else { format!("planning {pairs} pairs") };
    let Some(seconds) = seconds else { return format!("{planned} in physics") };
    let rounds = pairs.div_ceil(rayon::current_num_threads().max(1)) as f64;
    // Level n makes n times the proposals of the first level.
    let verification: f64 = (1..=effort).map(|level| VERIFICATION_ROLLOUTS * f64::from(level)).sum();
    format!(
        "{planned} in physics, a rollout of which takes {seconds:.2} s on this machine: at most {}",
        format_time(rounds * (PAIR_ROLLOUTS + verification) * seconds)
    )
}

/// Describes the reliability of the pairs that did not come with the program: those with a verification by name, the
/// others together.
pub fn describe_verification<'a>(plans: impl Iterator<Item = &'a GraspPair>) -> Vec<String> {
    let (verified, others): (Vec<&GraspPair>, Vec<&GraspPair>) = plans.partition(|plan| plan.verification.is_some());
    let sure = verified.iter().map(|plan| {
        let best = plan.reversed.iter().map(|other| other.best_share()).fold(plan.best_share(), f64::max);
        let draws = plan.verification.iter().map(|proof| proof.holds.len()).max().unwrap_or(0);
        format!(
            "{}: taken one after the other without contact in {:.0} of {draws} drawn trials",
            plan.objects().join(", "),
            best * draws as f64
        )
    });
    let unproven = others.iter().filter(|plan| plan.objects().len() == 2).count();
    let rest = (unproven > 0).then(|| {
        format!("{unproven} pairs were tried under errors of their aim alone: --effort 1 searches for grasps that hold in drawn trials")
    });
    sure.chain(rest).collect()
}

/// Formats a time for people.
fn format_time(seconds: f64) -> String {
    match seconds {
        short if short < 90.0 => format!("{short:.0} s"),
        minutes if minutes < 90.0 * 60.0 => format!("{:.0} min", minutes / 60.0),
        hours => format!("{:.1} h", hours / 3600.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A machine that is twice as slow gets twice the forecast, and the searches that follow are added.
    #[test]
    fn times_follow_the_measurement() {
        let one = forecast_search("mug", 0, &[], 0.1);
        let most = 0.1 * SEARCH_EFFORT.max_rollouts(0) as f64;
        assert!(one.ends_with(&format!("at most {}", format_time(most))), "{one}");
        let all = forecast_search("mug", 0, &[1, 1], 0.2);
        let sum = 0.2 * (SEARCH_EFFORT.max_rollouts(0) + 2 * SEARCH_EFFORT.max_rollouts(1)) as f64;
        assert!(all.contains("2 after it") && all.ends_with(&format_time(sum)), "{all}");
        assert_eq!([format_time(40.0), format_time(600.0), format_time(7200.0)], ["40 s", "10 min", "2.0 h"]);
    }
}
