//! Curves over axes and contrasts, with intervals.
//!
//! Trials of one pair of objects are alike, so pairs are what is drawn at random: a rate is the mean over pairs of each pair's share of trials, a
//! contrast the mean over pairs of each pair's mean difference between trials that met the same errors. 95 % intervals are Student's over pairs.

use statrs::distribution::{ContinuousCDF as _, StudentsT};

use crate::outcomes::{Outcome, Outcomes, Place};

/// A mean over pairs of objects and its 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Estimate {
    pub value: f64,
    /// None of a single pair of objects.
    pub low: Option<f64>,
    pub high: Option<f64>,
    /// Trials, or pairs of trials.
    pub n: usize,
}

/// Of each pair's sum and count; none without a trial.
fn estimate(by_pair: impl Iterator<Item = (f64, usize)>) -> Option<Estimate> {
    let (mut means, mut n) = (Vec::new(), 0);
    for (sum, count) in by_pair.filter(|(_, count)| *count > 0) {
        means.push(sum / count as f64);
        n += count;
    }
    let k = means.len() as f64;
    let value = (n > 0).then(|| means.iter().sum::<f64>() / k)?;
    let reach = (means.len() > 1).then(|| {
        let variance = means.iter().map(|mean| (mean - value).powi(2)).sum::<f64>() / (k - 1.0);
        StudentsT::new(0.0, 1.0, k - 1.0).ok().map(|students| students.inverse_cdf(0.975) * (variance / k).sqrt())
    });
    let reach = reach.flatten();
    Some(Estimate { value, low: reach.map(|reach| value - reach), high: reach.map(|reach| value + reach), n })
}

/// Points that have a level of an axis; all without one.
fn points(outcomes: &Outcomes, of: Option<(usize, usize)>) -> Vec<usize> {
    let fits = |point: &usize| of.is_none_or(|(axis, level)| outcomes.level(*point, axis) == level);
    (0..outcomes.points()).filter(fits).collect()
}

/// The rate of an outcome of an arm, over all points or those with a level of an axis.
pub fn rate(outcomes: &Outcomes, of: Option<(usize, usize)>, arm: usize, outcome: Outcome) -> Option<Estimate> {
    let points = points(outcomes, of);
    let rate = estimate((0..outcomes.combos).map(|pair| {
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
    }))?;
    // A share stays one.
    Some(Estimate { low: rate.low.map(|low| low.max(0.0)), high: rate.high.map(|high| high.min(1.0)), ..rate })
}

/// The difference between two trials of each of `points` and places.
fn contrast(
    outcomes: &Outcomes,
    points: &[usize],
    difference: impl Fn(usize, Place) -> Option<(bool, bool)>,
) -> Option<Estimate> {
    estimate((0..outcomes.combos).map(|pair| {
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
    }))
}

/// One arm less another, on the same trials.
pub fn arms(
    outcomes: &Outcomes,
    of: Option<(usize, usize)>,
    (one, other): (usize, usize),
    outcome: Outcome,
) -> Option<Estimate> {
    contrast(outcomes, &points(outcomes, of), |point, place| {
        outcomes.get(point, place, one, outcome).zip(outcomes.get(point, place, other, outcome))
    })
}

/// One level of an axis less another under the same arm, with everything else alike.
pub fn levels(
    outcomes: &Outcomes,
    axis: usize,
    (one, other): (usize, usize),
    arm: usize,
    outcome: Outcome,
) -> Option<Estimate> {
    contrast(outcomes, &points(outcomes, Some((axis, one))), |point, place| {
        let against = outcomes.with_level(point, axis, other);
        outcomes.get(point, place, arm, outcome).zip(outcomes.get(against, place, arm, outcome))
    })
}

/// A row of the table of contrasts.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Contrast {
    /// What is compared, such as `touch - blind`.
    pub what: String,
    /// At which level of which axis; `all points` where at every one.
    pub at: String,
    /// As tables write it.
    pub outcome: &'static str,
    #[serde(flatten)]
    pub estimate: Estimate,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::file::Sweep;
    use crate::plan::Plan;

    fn outcomes() -> Outcomes {
        let text = "version = 1\nname = \"t\"\ncombos = 2\ntrials = 2\n[axes]\npolicy = [\"blind\", \"touch\"]\n\
                    seed = [1, 2]\nnoise_scale = [0.0, 1.0, 2.0]\nwithout = [\"\", \"eyes\"]\n";
        let sweep = Sweep::parse(text, std::path::Path::new("s.toml")).expect("a sweep");
        Outcomes::new(&Plan::of(&sweep).expect("a plan"))
    }

    #[test]
    fn levels_are_found_again() {
        let outcomes = outcomes();
        assert_eq!(outcomes.points(), 6);
        for point in 0..6 {
            assert_eq!((outcomes.level(point, 0), outcomes.level(point, 1)), (point / 2, point % 2));
            assert_eq!(outcomes.with_level(point, 0, 2), 4 + point % 2);
        }
    }

    /// By hand: pair 0 always succeeds with touch and never blind, pair 1 never with either; without noise both always.
    #[test]
    fn rates_and_contrasts_are_over_pairs() {
        let mut outcomes = outcomes();
        let places: Vec<Place> = (0..2).flat_map(|pair| outcomes.places(pair).collect::<Vec<_>>()).collect();
        for point in 0..6 {
            for &place in &places {
                for arm in 0..2 {
                    let won = outcomes.level(point, 0) == 0 || (place[1] == 0 && arm == 1);
                    outcomes.set(point, place, arm, if won { &[Outcome::CleanSuccess] } else { &[] });
                }
            }
        }
        assert_eq!(outcomes.played(), 96);
        let noisy = rate(&outcomes, Some((0, 1)), 1, Outcome::CleanSuccess).expect("played");
        assert_eq!((noisy.value, noisy.n), (0.5, 16));
        // Means 0 and 1: Student's t of one degree of freedom, 12.7 standard errors of 0.5, cut to a share.
        assert_eq!((noisy.low, noisy.high), (Some(0.0), Some(1.0)));
        let gain = arms(&outcomes, None, (1, 0), Outcome::CleanSuccess).expect("played");
        assert!((gain.value - 1.0 / 3.0).abs() < 1e-12 && gain.n == 48, "{gain:?}");
        let reach = 12.706_204_736 * (2.0_f64 / 9.0 / 2.0).sqrt();
        assert!((gain.high.expect("two pairs") - gain.value - reach).abs() < 1e-6, "{gain:?}");
        let lost = levels(&outcomes, 0, (2, 0), 0, Outcome::CleanSuccess).expect("played");
        assert_eq!((lost.value, lost.low, lost.n), (-1.0, Some(-1.0), 16));
        assert_eq!(rate(&outcomes, None, 0, Outcome::Contact).map(|none| none.value), Some(0.0));
    }
}
