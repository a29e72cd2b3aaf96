//! Quality of predicted probabilities: rates with intervals, the ROC curve, calibration.

use schemars::JsonSchema;
use serde::Serialize;

use crate::paired::MIN_SAMPLES;

/// Standard normal quantile of a two-sided 95 % interval.
const Z_95: f64 = 1.959_963_984_540_054;
/// Number of groups of a calibration curve.
const GROUP_COUNT: usize = 6;

/// A rate with its Wilson 95 % interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub struct SuccessRate {
    /// Number of successes.
    pub count: u64,
    /// Number of trials.
    pub of: u64,
    /// Rate `count / of`; none without trials.
    pub rate: Option<f64>,
    /// Lower end of the interval.
    pub low: f64,
    /// Upper end of the interval.
    pub high: f64,
}

impl SuccessRate {
    /// Computes the rate of `count` successes in `of` trials.
    pub fn new(count: u64, of: u64) -> Self {
        if of == 0 {
            return Self { count, of, rate: None, low: 0.0, high: 1.0 };
        }
        let (n, p) = (of as f64, count as f64 / of as f64);
        let scale = 1.0 / (1.0 + Z_95 * Z_95 / n);
        let center = scale * (p + Z_95 * Z_95 / (2.0 * n));
        let half = scale * Z_95 * (p * (1.0 - p) / n + Z_95 * Z_95 / (4.0 * n * n)).sqrt();
        Self { count, of, rate: Some(p), low: (center - half).max(0.0), high: (center + half).min(1.0) }
    }
}

/// Computes the area under the ROC curve of scores, each paired with whether the event happened. It is the probability
/// that an event scores higher than a non-event, with ties counting half. None unless both outcomes occur.
pub fn roc_area(scored: &[(f64, bool)]) -> Option<f64> {
    let curve = roc(scored)?;
    Some(curve.windows(2).map(|pair| (pair[1][0] - pair[0][0]) * (pair[0][1] + pair[1][1]) / 2.0).sum())
}

/// Computes the ROC curve from (0, 0) to (1, 1): false positive rate and true positive rate as the threshold falls.
/// None unless both outcomes occur.
pub fn roc(scored: &[(f64, bool)]) -> Option<Vec<[f64; 2]>> {
    let mut falling = scored.to_vec();
    falling.sort_by(|a, b| b.0.total_cmp(&a.0));
    let happened = scored.iter().filter(|(_, happened)| *happened).count();
    let not = scored.len() - happened;
    if happened == 0 || not == 0 {
        return None;
    }
    let (mut curve, mut hits, mut alarms) = (vec![[0.0, 0.0]], 0, 0);
    for equal in falling.chunk_by(|a, b| a.0 == b.0) {
        let here = equal.iter().filter(|(_, happened)| *happened).count();
        hits += here;
        alarms += equal.len() - here;
        curve.push([alarms as f64 / not as f64, hits as f64 / happened as f64]);
    }
    Some(curve)
}

/// Group of similar predictions, with their outcomes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CalibrationGroup {
    /// Mean of the predictions.
    pub predicted: f64,
    pub observed: SuccessRate,
}

/// Quality of a set of predictions.
#[derive(Debug, Clone, PartialEq)]
pub struct PredictionQuality {
    /// Each prediction, paired with whether the event happened.
    pub scored: Vec<(f64, bool)>,
    /// ROC curve, see [`roc`].
    pub roc: Vec<[f64; 2]>,
    /// Area under it, see [`roc_area`].
    pub area: f64,
    /// 95 % interval of the area; none with fewer than [`MIN_SAMPLES`] of either outcome, or if all scores of one
    /// outcome are higher than all of the other.
    pub interval: Option<[f64; 2]>,
    /// Calibration curve: groups as equal in number as ties allow, the lowest predictions first.
    pub groups: Vec<CalibrationGroup>,
}

impl PredictionQuality {
    /// Evaluates predictions, each paired with whether it came true; none unless both outcomes occur. The interval is
    /// Hanley and McNeil's (Radiology 143, 1982).
    pub fn from_scored(mut scored: Vec<(f64, bool)>) -> Option<Self> {
        scored.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (roc, area) = (roc(&scored)?, roc_area(&scored)?);
        let happened = scored.iter().filter(|(_, happened)| *happened).count() as f64;
        let not = scored.len() as f64 - happened;
        let (one, two) = (area / (2.0 - area), 2.0 * area * area / (1.0 + area));
        let variance = area * (1.0 - area) + (happened - 1.0) * (one - area * area) + (not - 1.0) * (two - area * area);
        let enough = happened.min(not) >= MIN_SAMPLES as f64;
        let half = Z_95 * (variance.max(0.0) / (happened * not)).sqrt();
        let least = scored.len().div_ceil(GROUP_COUNT);
        let mut groups: Vec<Vec<(f64, bool)>> = Vec::new();
        for equal in scored.chunk_by(|a, b| a.0 == b.0) {
            match groups.last_mut().filter(|last| last.len() < least) {
                Some(last) => last.extend(equal),
                None => groups.push(equal.to_vec()),
            }
        }
        let groups = groups.iter().map(|group| CalibrationGroup {
            predicted: group.iter().map(|(predicted, _)| predicted).sum::<f64>() / group.len() as f64,
            observed: SuccessRate::new(
                group.iter().filter(|(_, happened)| *happened).count() as u64,
                group.len() as u64,
            ),
        });
        Some(Self {
            groups: groups.collect(),
            roc,
            area,
            interval: (enough && half > 0.0).then(|| [(area - half).max(0.0), (area + half).min(1.0)]),
            scored,
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Wilson intervals from tables: 0 of 10, 5 of 10, 287 of 512.
    #[test]
    fn wilson_intervals() {
        for (count, of, low, high) in [(0, 10, 0.0, 0.2775), (5, 10, 0.2366, 0.7634), (287, 512, 0.5173, 0.6029)] {
            let rate = SuccessRate::new(count, of);
            assert!((rate.low - low).abs() < 5e-4 && (rate.high - high).abs() < 5e-4, "{rate:?}");
        }
        assert_eq!(SuccessRate::new(0, 0).rate, None);
    }

    #[test]
    fn areas_under_known_curves() {
        let scored = [(0.1, false), (0.4, false), (0.35, true), (0.8, true)];
        assert_eq!(roc_area(&scored), Some(0.75));
        assert_eq!(roc_area(&[(1.0, true), (1.0, false)]), Some(0.5));
        assert_eq!(roc_area(&[(1.0, true)]), None);
    }

    /// Hanley and McNeil's own example: an area of 0.893 from 51 and 58 cases has a standard error of 0.032.
    #[test]
    fn the_interval_of_the_area_is_hanleys() {
        let rated = |rating: u32, normal: usize, abnormal: usize| {
            let at = |happened, times| std::iter::repeat_n((f64::from(rating), happened), times);
            at(false, normal).chain(at(true, abnormal))
        };
        let counts = [(1, 33, 3), (2, 6, 2), (3, 6, 2), (4, 11, 11), (5, 2, 33)];
        let scored =
            counts.into_iter().flat_map(|(rating, normal, abnormal)| rated(rating, normal, abnormal)).collect();
        let prediction = PredictionQuality::from_scored(scored).expect("both outcomes");
        let (area, [low, high]) = (prediction.area, prediction.interval.expect("enough of both"));
        assert!(
            (area - 0.893).abs() < 5e-4 && ((high - low) / (2.0 * Z_95) - 0.032).abs() < 1e-3,
            "{area} {low} {high}"
        );
    }

    /// Regression: two of each outcome, and twenty of each that are perfectly separated, once had an area of 1 with an
    /// interval from 1 to 1.
    #[test]
    fn no_certainty_about_the_area_comes_out_of_nothing() {
        let apart = |n: usize| (0..n).flat_map(|_| [(0.1, false), (0.9, true)]).collect::<Vec<_>>();
        for scored in [apart(20), vec![(0.1, false), (0.4, true), (0.3, false), (0.2, true)]] {
            let prediction = PredictionQuality::from_scored(scored).expect("both outcomes");
            assert_eq!(prediction.interval, None, "{}", prediction.area);
        }
    }

    proptest! {
        /// The area is the share of pairs in the right order. Groups contain every prediction once, in rising order.
        #[test]
        fn area_and_groups_are_of_all_predictions(scored in prop::collection::vec((0u8..12, any::<bool>()), 2..80)) {
            let scored: Vec<(f64, bool)> = scored.into_iter().map(|(n, happened)| (f64::from(n) / 11.0, happened)).collect();
            let wins = |a: f64, b: f64| if a > b { 1.0 } else { 0.5 * f64::from(u8::from(a == b)) };
            let with = |wanted: bool| scored.iter().filter(move |(_, happened)| *happened == wanted).map(|(score, _)| *score);
            let pairs = (with(true).count() * with(false).count()) as f64;
            let sum: f64 = with(true).flat_map(|a| with(false).map(move |b| wins(a, b))).sum();
            let Some(prediction) = PredictionQuality::from_scored(scored.clone()) else {
                prop_assert_eq!(pairs, 0.0);
                return Ok(());
            };
            prop_assert!((prediction.area - sum / pairs).abs() < 1e-12);
            prop_assert_eq!(prediction.groups.iter().map(|group| group.observed.of).sum::<u64>(), scored.len() as u64);
            prop_assert!(prediction.groups.len() <= GROUP_COUNT);
            prop_assert!(prediction.groups.windows(2).all(|pair| pair[0].predicted < pair[1].predicted));
        }
    }
}
