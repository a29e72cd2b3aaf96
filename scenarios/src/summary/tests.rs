use statistics::MeanSd;

use super::*;
use crate::record::Condition;
use crate::record::tests::record;
use crate::referee::FailureCause;

fn close(found: f64, expected: f64, relative: f64) {
    assert!((found / expected - 1.0).abs() < relative, "found {found}, expected {expected}");
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
