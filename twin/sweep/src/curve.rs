//! Curves over axes and contrasts, with confidence intervals.
//!
//! Trials of one pair of objects are correlated, so the pair is the unit of sampling. A rate is the mean over pairs of
//! each pair's share of trials. A contrast is the mean over pairs of each pair's mean difference between trials with
//! the same errors. The 95 % intervals are Student's t over pairs, clipped to the possible range. There is none for
//! fewer than [`MIN_SAMPLES`] pairs, or if all pairs are equal.

use statistics::{CONSTANT_SD_TOLERANCE, MIN_SAMPLES, MeanSd};
use statrs::distribution::{ContinuousCDF as _, StudentsT};

use crate::outcomes::{Outcomes, ReportedOutcome, TrialPlace};

/// A mean over pairs of objects and its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, schemars::JsonSchema)]
pub struct RateEstimate {
    /// Mean over pairs of objects.
    pub value: f64,
    /// Lower end of the 95 % interval.
    pub low: Option<f64>,
    /// Upper end of the 95 % interval.
    pub high: Option<f64>,
    /// Number of trials, or of pairs of trials.
    pub n: usize,
}

/// Estimates the mean from each pair's sum and count; the possible values are those in `range`. None without a trial.
fn estimate(by_pair: impl Iterator<Item = (f64, usize)>, range: [f64; 2]) -> Option<RateEstimate> {
    let (mut means, mut n) = (Vec::new(), 0);
    for (sum, count) in by_pair.filter(|(_, count)| *count > 0) {
        means.push(sum / count as f64);
        n += count;
    }
    let k = means.len() as f64;
    let all = MeanSd::from_values(&means);
    let value = all.mean?;
    let sd = all.sd.filter(|sd| means.len() >= MIN_SAMPLES && *sd > CONSTANT_SD_TOLERANCE);
    let reach = sd.and_then(|sd| {
        StudentsT::new(0.0, 1.0, k - 1.0).ok().map(|students| students.inverse_cdf(0.975) * sd / k.sqrt())
    });
    let [low, high] = [-1.0, 1.0].map(|side| reach.map(|reach| (value + side * reach).clamp(range[0], range[1])));
    Some(RateEstimate { value, low, high, n })
}

/// Returns the points with a given level of an axis, or all points.
fn points(outcomes: &Outcomes, of: Option<(usize, usize)>) -> Vec<usize> {
    let fits = |point: &usize| of.is_none_or(|(axis, level)| outcomes.level(*point, axis) == level);
    (0..outcomes.points()).filter(fits).collect()
}

/// Estimates the rate of an outcome for an arm, over all points or those with a given level of an axis.
pub fn rate(
    outcomes: &Outcomes,
    of: Option<(usize, usize)>,
    arm: usize,
    outcome: ReportedOutcome,
) -> Option<RateEstimate> {
    let points = points(outcomes, of);
    let shares = (0..outcomes.combos).map(|pair| {
        let (mut hits, mut count) = (0_usize, 0);
        for point in &points {
            for place in outcomes.places(pair) {
                if let Some(hit) = outcomes.get(*point, place, arm, outcome) {
                    hits += usize::from(hit);
                    count += 1;
                }
            }
        }
        (hits as f64, count)
    });
    estimate(shares, [0.0, 1.0])
}

/// Estimates the mean difference between two trials at each of `points` and each place.
fn contrast(
    outcomes: &Outcomes,
    points: &[usize],
    difference: impl Fn(usize, TrialPlace) -> Option<(bool, bool)>,
) -> Option<RateEstimate> {
    let differences = (0..outcomes.combos).map(|pair| {
        let (mut sum, mut count) = (0_i64, 0);
        for point in points {
            for place in outcomes.places(pair) {
                if let Some((one, other)) = difference(*point, place) {
                    sum += i64::from(one) - i64::from(other);
                    count += 1;
                }
            }
        }
        (sum as f64, count)
    });
    estimate(differences, [-1.0, 1.0])
}

/// Estimates the contrast of two arms (`one` less `other`) on the same trials.
pub fn contrast_arms(
    outcomes: &Outcomes,
    of: Option<(usize, usize)>,
    (one, other): (usize, usize),
    outcome: ReportedOutcome,
) -> Option<RateEstimate> {
    contrast(outcomes, &points(outcomes, of), |point, place| {
        outcomes.get(point, place, one, outcome).zip(outcomes.get(point, place, other, outcome))
    })
}

/// Estimates the contrast of two levels of an axis (`one` less `other`) under the same arm, with everything else equal.
pub fn contrast_levels(
    outcomes: &Outcomes,
    axis: usize,
    (one, other): (usize, usize),
    arm: usize,
    outcome: ReportedOutcome,
) -> Option<RateEstimate> {
    contrast(outcomes, &points(outcomes, Some((axis, one))), |point, place| {
        let against = outcomes.with_level(point, axis, other);
        outcomes.get(point, place, arm, outcome).zip(outcomes.get(against, place, arm, outcome))
    })
}

/// A row of the table of contrasts.
#[derive(Debug, Clone, PartialEq, serde::Serialize, schemars::JsonSchema)]
pub struct Contrast {
    /// Compared arms or levels, such as `touch - blind`.
    pub what: String,
    /// Axis and level of the comparison, or `all points`.
    pub at: String,
    /// Name of the outcome in tables.
    pub outcome: &'static str,
    #[serde(flatten)]
    pub estimate: RateEstimate,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::file::Sweep;
    use crate::plan::SweepPlan;

    fn outcomes(pairs: usize) -> Outcomes {
        let text = "version = 1\nname = \"t\"\ncombos = PAIRS\ntrials = 2\n[axes]\npolicy = [\"blind\", \"touch\"]\n\
                    seed = [1, 2]\nnoise_scale = [0.0, 1.0, 2.0]\nwithout = [\"\", \"detector\"]\n";
        let sweep =
            Sweep::parse(&text.replace("PAIRS", &pairs.to_string()), std::path::Path::new("s.toml")).expect("a sweep");
        Outcomes::new(&SweepPlan::from_sweep(&sweep).expect("a plan"))
    }

    #[test]
    fn levels_are_found_again() {
        let outcomes = outcomes(2);
        assert_eq!(outcomes.points(), 6);
        for point in 0..6 {
            assert_eq!((outcomes.level(point, 0), outcomes.level(point, 1)), (point / 2, point % 2));
            assert_eq!(outcomes.with_level(point, 0, 2), 4 + point % 2);
        }
    }

    /// Fills in results: even pairs always succeed with touch and never blind, odd pairs never with either. Without
    /// noise all succeed.
    fn add_outcomes(outcomes: &mut Outcomes) {
        for pair in 0..outcomes.combos {
            let places: Vec<TrialPlace> = outcomes.places(pair).collect();
            for (point, place) in (0..6).flat_map(|point| places.iter().map(move |place| (point, *place))) {
                for arm in 0..2 {
                    let won = outcomes.level(point, 0) == 0 || (pair % 2 == 0 && arm == 1);
                    outcomes.set(point, place, arm, if won { &[ReportedOutcome::CleanSuccess] } else { &[] });
                }
            }
        }
    }

    #[test]
    fn rates_and_contrasts_are_over_pairs() {
        let mut outcomes = outcomes(6);
        add_outcomes(&mut outcomes);
        assert_eq!(outcomes.trial_count(), 288);
        let noisy = rate(&outcomes, Some((0, 1)), 1, ReportedOutcome::CleanSuccess).expect("run");
        assert_eq!((noisy.value, noisy.n), (0.5, 48));
        // The means are 0 and 1 in turn: Student's t of five degrees of freedom is 2.5706, the variance 0.3; clipped to
        // a share.
        assert_eq!((noisy.low, noisy.high), (Some(0.0), Some(1.0)));
        let gain = contrast_arms(&outcomes, None, (1, 0), ReportedOutcome::CleanSuccess).expect("run");
        assert!((gain.value - 1.0 / 3.0).abs() < 1e-12 && gain.n == 144, "{gain:?}");
        let reach = 2.570_581_8 * (0.3_f64 * 4.0 / 9.0 / 6.0).sqrt();
        assert!((gain.high.expect("six pairs") - gain.value - reach).abs() < 1e-6, "{gain:?}");
        let noise = contrast_levels(&outcomes, 0, (2, 0), 1, ReportedOutcome::CleanSuccess).expect("run");
        assert_eq!((noise.value, noise.low, noise.high.map(|high| high < 0.1)), (-0.5, Some(-1.0), Some(true)));
    }

    /// Six pairs with equal differences, and any four pairs, have a mean but no interval.
    #[test]
    fn no_interval_comes_out_of_nothing() {
        let mut six = outcomes(6);
        add_outcomes(&mut six);
        let lost = contrast_levels(&six, 0, (2, 0), 0, ReportedOutcome::CleanSuccess).expect("run");
        assert_eq!((lost.value, lost.low, lost.high, lost.n), (-1.0, None, None, 48));
        assert_eq!(
            rate(&six, None, 0, ReportedOutcome::Contact).map(|none| (none.value, none.high)),
            Some((0.0, None))
        );
        let mut four = outcomes(4);
        add_outcomes(&mut four);
        let gain = contrast_arms(&four, None, (1, 0), ReportedOutcome::CleanSuccess).expect("run");
        assert_eq!((gain.low, gain.high), (None, None));
    }
}
