use super::*;
use crate::record::Condition;
use crate::record::tests::record;
use crate::referee::FailureCause;

fn close(found: f64, expected: f64, relative: f64) {
    assert!((found / expected - 1.0).abs() < relative, "found {found}, expected {expected}");
}

#[test]
fn the_t_test_agrees_with_a_known_example() {
    // differences 1 2 3 4 5: mean 3, sd sqrt(2.5), t = 3 / sqrt(0.5); p from the closed form for 4 degrees of freedom
    let pairs = [(1.0, 0.0), (3.0, 1.0), (5.0, 2.0), (7.0, 3.0), (9.0, 4.0)];
    let test = paired_t_test(&pairs);
    close(test.t.unwrap(), 3.0 / 0.5_f64.sqrt(), 1e-12);
    assert_eq!(test.df, 4);
    let x = 18.0_f64 / (4.0 + 18.0);
    let p = 0.5 * (1.0 - x.sqrt() * (1.0 + 0.5 * (1.0 - x)));
    close(test.p.unwrap(), p, 1e-9);
    let swapped = paired_t_test(&pairs.map(|(a, b)| (b, a)));
    close(swapped.p.unwrap(), 1.0 - p, 1e-9);
}

#[test]
fn the_papers_own_figures_come_out() {
    // 60 combinations with M = 0.465 and SD = 0.306 against zeros
    let half = 0.306 * (59.0_f64 / 60.0).sqrt();
    let pairs: Vec<(f64, f64)> = (0..60).map(|n| (0.465 + if n % 2 == 0 { half } else { -half }, 0.0)).collect();
    let firsts: Vec<f64> = pairs.iter().map(|pair| pair.0).collect();
    close(MeanSd::of(&firsts).sd.unwrap(), 0.306, 1e-12);
    let test = paired_t_test(&pairs);
    assert_eq!((test.df, (test.t.unwrap() * 10.0).round()), (59, 118.0));
    let p = test.p.unwrap();
    println!("t({}) = {}, p = {p:e}", test.df, test.t.unwrap());
    assert!((1.5e-17..3e-17).contains(&p), "{p:e}");
}

/// Two combinations with equal differences once had p < 10^-300, which the report took for proof.
#[test]
fn no_significance_comes_out_of_nothing() {
    let untested = |pairs: &[(f64, f64)]| {
        let test = paired_t_test(pairs);
        assert_eq!((test.t, test.p), (None, None), "{pairs:?}");
        assert_eq!(test.df, pairs.len().saturating_sub(1));
        (test.untested.unwrap(), test.reason().unwrap())
    };
    assert_eq!(untested(&[(1.0, 0.0); 2]), (Untested::TooFew, "2 of at least 5 combinations".to_owned()));
    assert_eq!(untested(&[(1.0, 0.0), (0.9, 0.1), (1.0, 0.2), (0.9, 0.0)]).0, Untested::TooFew);
    for equal in [(1.0, 0.0), (0.0, 1.0), (0.3, 0.3)] {
        assert_eq!(untested(&[equal; 60]).0, Untested::NoSpread);
    }
    assert_eq!(untested(&[]), (Untested::NotPlayed, "not played".to_owned()));
    let tested = paired_t_test(&[(1.0, 0.0), (0.9, 0.1), (1.0, 0.2), (0.9, 0.0), (0.8, 0.0)]);
    assert!(tested.p.is_some_and(|p| p < 0.05) && tested.reason().is_none());
}

#[test]
fn percentiles_lie_between_neighbours() {
    let values = [4.0, 1.0, 3.0, 2.0];
    assert_eq!(percentile(&values, 0.0), Some(1.0));
    assert_eq!(percentile(&values, 50.0), Some(2.5));
    assert_eq!(percentile(&values, 25.0), Some(1.75));
    assert_eq!(percentile(&values, 100.0), Some(4.0));
    assert_eq!(percentile(&[7.0], 99.0), Some(7.0));
    assert_eq!(percentile(&[], 50.0), None);
}

#[test]
fn boxes_and_densities() {
    let plot = box_plot(&[1.0, 2.0, 3.0, 4.0, 5.0, 100.0]).unwrap();
    assert_eq!((plot.low, plot.q1, plot.median, plot.q3, plot.high), (1.0, 2.25, 3.5, 4.75, 5.0));
    assert_eq!(plot.outliers, [100.0]);
    let values = [0.1, 0.2, 0.25, 0.7];
    let at: Vec<f64> = (0..4000).map(|n| f64::from(n) * 1e-3 - 1.5).collect();
    let integral: f64 = density(&values, silverman_bandwidth(&values, 0.01), &at).iter().sum::<f64>() * 1e-3;
    close(integral, 1.0, 1e-3);
    assert_eq!(silverman_bandwidth(&[0.5; 6], 0.02), 0.02);
}

#[test]
fn a_summary_has_what_the_design_demands() {
    let mut records = Vec::new();
    for combination in 0..8 {
        for trial in 0..10 {
            records.push(record(combination, trial, Condition::Ideal));
            let mut blind = record(combination, trial, Condition::Blind);
            blind.contact = trial < 2 * (combination % 4);
            blind.success = !blind.contact;
            blind.cause = blind.contact.then_some(FailureCause::SecondNotPicked);
            records.push(blind);
            let mut touch = record(combination, trial, Condition::Touch);
            touch.decision_ms = Some(100.0 + trial as f64);
            touch.pose_error_mm = Some(2.0);
            records.push(touch);
        }
    }
    let summary =
        summarise(&records, &[], &RunInfo { seed: 9, robot: "sim".into(), wall_s: 6.0, decision_budget: None });
    assert_eq!((summary.combos, summary.trials_per_combo, summary.seed), (8, 10, 9));
    close(summary.conditions.blind.contact_rate.mean.unwrap(), 0.3, 1e-12);
    close(summary.conditions.blind.contact_rate.sd.unwrap(), (0.4_f64 / 7.0).sqrt(), 1e-12);
    assert_eq!(summary.conditions.touch.success_rate, MeanSd { mean: Some(1.0), sd: Some(0.0) });
    assert_eq!(summary.conditions.blind.failures[&FailureCause::SecondNotPicked], 24);
    let t = 0.3 / (0.4_f64 / 7.0 / 8.0).sqrt();
    close(summary.t_test.contact.t.unwrap(), t, 1e-9);
    close(summary.t_test.success.t.unwrap(), t, 1e-9);
    assert_eq!(summary.decision_ms.p50, Some(104.5));
    assert_eq!(summary.pose_error.mm, MedianP95 { median: Some(2.0), p95: Some(2.0) });
    assert_eq!(summary.pose_error.deg.median, None);
    close(summary.real_time_factor.unwrap(), 240.0 * 0.3 / 6.0, 1e-9);
}

#[test]
fn a_summary_of_nothing_is_empty() {
    let summary = summarise(&[], &[], &RunInfo { seed: 0, robot: "sim".into(), wall_s: 0.0, decision_budget: None });
    assert_eq!((summary.combos, summary.trials_per_combo, summary.real_time_factor), (0, 0, None));
    assert_eq!(summary.conditions.ideal.contact_rate, MeanSd { mean: None, sd: None });
}
