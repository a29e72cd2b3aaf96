//! The metastability threshold: the pull below which chains between two minima no longer arrive.
//!
//! The pull is lowered from a value that certainly suffices until none of a number of trials arrives: first in coarse
//! steps, then in 3 % steps from the last sufficient value. The threshold of a landscape is the median over pairs of
//! its minima.

use rayon::prelude::*;

use super::Landscape;
use super::attraction::{AttractionSettings, attract, chain_rng};

const COARSE_FACTOR: f64 = 0.7;
const FINE_FACTOR: f64 = 0.97;
/// Share of the initial pull below which the search stops, because there is no significant barrier.
const MIN_PULL_SHARE: f64 = 1e-3;

/// Finds the threshold of one pair. Returns `None` if no chain arrives even at the initial `settings.pull`.
pub fn threshold<L: Landscape>(
    landscape: &L,
    [a, b]: [&L::State; 2],
    settings: &AttractionSettings,
    trials: usize,
    seed: u64,
    pair: u64,
) -> Option<f64> {
    let mut round = 0;
    let mut arrives = |pull: f64| {
        round += 1;
        let settings = AttractionSettings { pull, ..*settings };
        (0..trials).any(|trial| {
            let mut rng = chain_rng(seed, [pair, round, trial as u64, 2]);
            let (from, to) = if trial % 2 == 0 { (a, b) } else { (b, a) };
            attract(landscape, from, to, &settings, &mut rng).is_some()
        })
    };
    let mut pull = settings.pull;
    if !arrives(pull) {
        return None;
    }
    for factor in [COARSE_FACTOR, FINE_FACTOR] {
        while pull > MIN_PULL_SHARE * settings.pull && arrives(pull * factor) {
            pull *= factor;
        }
    }
    Some(pull)
}

/// Finds the thresholds of `pairs` of states, sorted, without pairs that are out of reach.
pub fn thresholds<L: Landscape>(
    landscape: &L,
    pairs: &[(L::State, L::State)],
    settings: &AttractionSettings,
    trials: usize,
    seed: u64,
) -> Vec<f64> {
    let mut found: Vec<f64> = pairs
        .par_iter()
        .enumerate()
        .filter_map(|(n, (a, b))| threshold(landscape, [a, b], settings, trials, seed, n as u64))
        .collect();
    found.sort_by(f64::total_cmp);
    found
}

#[cfg(test)]
mod tests {
    use super::super::multi_well::MultiWell;
    use super::*;

    /// At low temperature a chain crosses the saddle if the pull exceeds the steepest slope on the way, max |W'|. The
    /// slope is smaller from the higher side, and temperature helps, so the threshold is somewhat below it.
    #[test]
    fn threshold_is_near_the_steepest_slope() {
        let wells = MultiWell::uneven();
        let settings = AttractionSettings { pull: 8.0, temperature: 0.005, near: 0.1, max_idle_steps: 300, chains: 1 };
        let found = threshold(&wells, [&[-1.0, -1.0], &[1.0, -1.0]], &settings, 20, 1, 0).expect("8 suffices");
        let slope = |t: f64| (t * t - 1.0) * (4.0 * t - 0.3);
        let (up, down) = (-100..=100)
            .map(|k| slope(f64::from(k) / 100.0))
            .fold((0.0_f64, 0.0_f64), |(a, b), s| (a.max(s), b.max(-s)));
        let steepest = up.min(down);
        assert!(found < steepest && found > 0.5 * steepest, "{found} {steepest}");
    }
}
