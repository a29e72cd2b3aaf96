//! Tests of the report as a whole, on synthetic records.

use std::collections::BTreeSet;

use scenarios::summary::{RunInfo, summarise};
use scenarios::{Condition, FailureCause};
use serde_json::json;

use super::*;

/// Creates a benchmark in which blind trials collide more often the higher the combination's number is.
pub(crate) fn synthetic_records(combinations: usize, trials: usize) -> Vec<TrialRecord> {
    const OBJECTS: [&str; 6] = ["egg", "can_50", "tennis_ball", "mug <small>", "box & lid", "bottle"];
    let mut records = Vec::new();
    for combination in 0..combinations {
        for trial in 0..trials {
            for condition in Condition::BUILT_IN {
                if condition == Condition::Ideal && trial > 0 {
                    continue;
                }
                let bad = (trial * 7 + combination * 3) % 10 < (combination * 37) % 11;
                let contact = condition == Condition::Blind && bad;
                let lost = condition == Condition::Touch && combination % 9 == 4 && trial == 3;
                let success = !lost && (!contact || trial == 5);
                records.push(TrialRecord {
                    combination,
                    trial,
                    condition,
                    first: OBJECTS[combination % 6].into(),
                    second: OBJECTS[(combination * 5 + 1) % 6].into(),
                    contact,
                    contact_with: contact.then_some(scenarios::referee::ContactWith::HeldObject),
                    contact_s: contact.then_some(9.5),
                    contact_n: contact.then_some(1.5),
                    success,
                    clean_success: success && !contact,
                    cause: match () {
                        () if success => None,
                        () if lost => Some(FailureCause::Slipped),
                        () if trial % 2 == 0 => Some(FailureCause::FirstDropped),
                        () => Some(FailureCause::SecondNotPicked),
                    },
                    switched: condition == Condition::Touch && bad,
                    retries: 0,
                    disturbance: String::new(),
                    risk: (condition == Condition::Blind)
                        .then(|| f64::from(u8::from(contact)) * 0.6 + 0.02 * trial as f64),
                    reason: "synthetic".into(),
                    // The prediction is correct; touch finds a collision-free path.
                    plan_separation_mm: (condition != Condition::Reflex).then_some(if contact { -2.0 } else { 4.0 }),
                    chosen_separation_mm: (condition == Condition::Touch).then_some(4.0),
                    pose_error_mm: (condition == Condition::Touch).then_some(0.5 + 0.31 * trial as f64),
                    pose_error_deg: (condition == Condition::Touch).then_some(1.0 + 0.7 * trial as f64),
                    prior_error_mm: (condition == Condition::Touch).then_some(7.5 + 0.8 * trial as f64),
                    sim_seconds: 14.2,
                    decision_ms: (condition == Condition::Touch).then_some(38.0 + 3.0 * trial as f64),
                    third: String::new(),
                    later_pose_errors: Default::default(),
                });
            }
        }
    }
    records
}

/// Writes the report of `records` into `folder` and reads it back: page, contact figure, figure of clean success.
fn report_in(folder: &Path, records: &[TrialRecord]) -> [String; 3] {
    let summary =
        summarise(records, &[], &RunInfo { seed: 42, robot: "sim".into(), wall_s: 754.6, decision_budget: None });
    let run = json!({
        "command": ["ftac", "bench", "--out", "<here>"], "seed": 42, "robot": "sim",
        "versions": {"ftac": "0.1.0", "rapier3d-f64": "0.36.1"}, "wall_s": 754.6, "jobs": 16,
    });
    write_report(folder, &summary, records, &run).unwrap();
    ["report.html", "contact.svg", "clean_success.svg"].map(|name| std::fs::read_to_string(folder.join(name)).unwrap())
}

fn report(records: &[TrialRecord]) -> [String; 3] {
    let folder = tempfile::tempdir().unwrap();
    let files = report_in(folder.path(), records);
    let written: BTreeSet<_> =
        std::fs::read_dir(folder.path()).unwrap().map(|file| file.unwrap().file_name()).collect();
    let mut expected: BTreeSet<_> = ["report.html", "contact.svg", "clean_success.svg"].map(Into::into).into();
    expected.extend(["panel_c.svg", "panel_d.svg"].into_iter().filter(|name| files[0].contains(name)).map(Into::into));
    if files[0].contains("risk.svg") {
        expected.insert("risk.svg".into());
    }
    assert_eq!(written, expected);
    files
}

/// Counts the dots in a drawing that have the colour of a name of the style sheet.
fn dots(svg: &str, name: &str) -> usize {
    let colour = format!("fill=\"var(--{name})\"");
    svg.split("<circle ").skip(1).filter(|dot| dot.split_once('>').unwrap().0.contains(&colour)).count()
}

#[test]
fn every_combination_is_a_dot_of_every_condition() {
    let [page, contact, clean] = report(&synthetic_records(60, 10));
    for svg in [&contact, &clean] {
        for condition in Condition::BUILT_IN {
            assert_eq!(dots(svg, condition.name()), 60, "{condition}");
        }
    }
    let before_risk = page.split_once("id=\"risk\"").unwrap().0;
    // Two figures of four conditions; two panels of two conditions by two counts.
    assert_eq!(before_risk.matches("<circle ").count(), 480 + 480);
}

/// Panels c and d show the simulated values by both counts beside the paper's. A run without predicted separations
/// reports that they are missing.
#[test]
fn the_papers_panels_are_drawn_by_both_counts() {
    let section = |records: &[TrialRecord]| {
        let [page, ..] = report(records);
        page.split_once("<h2 id=\"paper\">").unwrap().1.split_once("<h2").unwrap().0.to_owned()
    };
    let records = synthetic_records(60, 10);
    let drawn = section(&records);
    for column in
        ["ideal: paper", "ideal: contact", "ideal: predicted", "blind: predicted", "touch: paper", "touch: contact"]
    {
        assert!(drawn.contains(column), "{column}: {drawn}");
    }
    let summary =
        summarise(&records, &[], &RunInfo { seed: 1, robot: "sim".into(), wall_s: 1.0, decision_budget: None });
    let t = summary.t_test.contact.t.unwrap();
    for words in
        ["0.465 (0.306)", "0.535 (0.306)", "paper: t(59) = 11.8, p = 2.1×10⁻¹⁷", &format!("predicted: t(59) = {t:.1}")]
    {
        assert!(drawn.contains(words), "{words}: {drawn}");
    }
    assert!(!drawn.contains("Nothing is predicted") && drawn.contains("four_balls.toml"));
    let without = records.into_iter().map(|record| TrialRecord { plan_separation_mm: None, ..record });
    let drawn = section(&without.collect::<Vec<_>>());
    assert!(
        drawn.contains("Nothing is predicted")
            && !drawn.contains("blind: predicted")
            && drawn.contains("blind: contact")
    );
}

#[test]
fn the_summarys_numbers_are_on_the_page() {
    let records = synthetic_records(60, 10);
    let [page, ..] = report(&records);
    let summary =
        summarise(&records, &[], &RunInfo { seed: 42, robot: "sim".into(), wall_s: 754.6, decision_budget: None });
    let blind = &summary.conditions.blind;
    let mut expected: Vec<String> = [blind.contact_rate, blind.success_rate, blind.clean_success_rate]
        .map(|of| format!("<td class=\"number\">{:.3} ({:.3})</td>", of.mean.unwrap(), of.sd.unwrap()))
        .to_vec();
    expected.push(format!("{:.2}</td><td class=\"number\">59</td>", summary.t_test.success.t.unwrap()));
    expected.push(format!("{:.1} ms", summary.decision_ms.p99.unwrap()));
    expected.push(format!("{:.2} mm", summary.pose_error.mm.p95.unwrap()));
    expected
        .extend(["0.465 (0.306)", "0.535 (0.306)", "2.1×10⁻¹⁷", "12 min 34 s", "ftac bench --out"].map(String::from));
    let dropped = blind.failures[&FailureCause::FirstDropped];
    expected.push(format!("first dropped</th><td class=\"number\">0</td><td class=\"number\">{dropped}</td>"));
    for part in expected {
        assert!(page.contains(&part), "{part} is not on the page");
    }
    assert!(page.contains("<strong>Touch raises clean success over blind; that its images are needed"), "{page}");
}

/// An external policy has its column, row and boxes if it was run, and none otherwise.
#[test]
fn a_policy_of_ones_own_is_one_more_condition() {
    let mut records = synthetic_records(6, 2);
    assert!(!report(&records)[0].contains("clean success, external"));
    let touch = records.iter().filter(|record| record.condition == Condition::Touch);
    let own: Vec<_> = touch.map(|record| TrialRecord { condition: Condition::External, ..record.clone() }).collect();
    records.extend(own);
    let [page, contact, _] = report(&records);
    assert!(page.contains("clean success, external") && page.contains(">external</th>"), "{page}");
    assert_eq!(dots(&contact, "yours"), 6);
}

#[test]
fn the_worst_combination_comes_first() {
    let lines = findings::combination_lines(&synthetic_records(60, 10));
    let touch: Vec<f64> = lines.iter().map(|line| line.rates[3].as_ref().unwrap().clean_success_rate).collect();
    assert_eq!(lines.len(), 60);
    assert!(touch.is_sorted() && touch[0] < 1.0);
}

/// A prediction that is always right has an area of 1, and groups of trials without and with contacts.
#[test]
fn the_quality_of_the_predicted_risk_is_shown() {
    let [page, ..] = report(&synthetic_records(60, 10));
    let section = page.split_once("id=\"risk\"").unwrap().1.split_once("<h2").unwrap().0;
    assert!(
        section.contains("area 1.000 (too few trials, or no misranked pair: no interval)")
            && section.contains("observed 0 of"),
        "{section}"
    );
    let blind = synthetic_records(60, 10).iter().filter(|record| record.condition == Condition::Blind).count();
    assert!(section.contains(&format!("in {blind} blind trials")), "{section}");
    let without: Vec<_> =
        synthetic_records(6, 2).into_iter().map(|record| TrialRecord { risk: None, ..record }).collect();
    assert!(report(&without)[0].contains("cannot be compared"));
}

#[test]
fn what_others_named_cannot_break_the_page() {
    let [page, contact, _] = report(&synthetic_records(12, 2));
    assert!(page.contains("mug &lt;small&gt;") && !page.contains("<small>") && !page.contains("<here>"));
    assert!(contact.contains("box &amp; lid") && !contact.contains("box & lid"));
    for file in [&page, &contact] {
        assert!(!file.contains("src=\"http") && !file.contains("<script src") && !file.contains("NaN"));
    }
}

#[test]
fn little_or_nothing_still_makes_a_report() {
    let [page, ..] = report(&[]);
    assert!(page.contains("No finished trial yet"));
    for (combinations, trials) in [(1, 1), (1, 10), (2, 1)] {
        let [page, svg, _] = report(&synthetic_records(combinations, trials));
        assert!(page.ends_with("</html>") && !page.contains("NaN") && !svg.contains("NaN"));
    }
}

/// Every non-empty subset of the conditions makes a report that names only the conditions that were run, and compares
/// only pairs of them.
#[test]
fn nothing_is_said_of_conditions_that_were_not_run() {
    let all = synthetic_records(6, 2);
    for subset in 1..16_usize {
        let set: Vec<Condition> = (0..4).filter(|n| subset >> n & 1 == 1).map(|n| Condition::BUILT_IN[n]).collect();
        let records: Vec<_> = all.iter().filter(|record| set.contains(&record.condition)).cloned().collect();
        let [page, contact, clean] = report(&records);
        let data = page.split_once("<h2 id=\"differs\">").unwrap().0;
        for condition in Condition::BUILT_IN {
            let finished = set.contains(&condition);
            assert_eq!(
                data.contains(&format!("<th scope=\"row\">{condition}</th>")),
                finished,
                "{condition} in {set:?}"
            );
            assert_eq!(dots(&contact, condition.name()) > 0, finished, "{condition} in {set:?}");
            assert_eq!(dots(&clean, condition.name()) > 0, finished, "{condition} in {set:?}");
            let named = data.contains(&format!("clean success, {condition}"));
            assert_eq!(named, finished, "{condition} in {set:?}");
        }
        let compared = |one, other| set.contains(&one) && set.contains(&other);
        let touched = compared(Condition::Touch, Condition::Blind);
        assert_eq!(data.contains("more clean success with touch than blind?"), touched, "{set:?}");
        assert_eq!(data.contains("McNemar"), touched, "{set:?}");
        assert_eq!(
            data.contains("more contacts blind than ideal?"),
            compared(Condition::Blind, Condition::Ideal),
            "{set:?}"
        );
        assert!(!data.contains("no data") && !page.contains("NaN") && !data.contains("not run"), "{set:?}");
    }
}

/// Regression test: two combinations that agree once gave the verdict "its images are needed for that" on p < 10⁻³⁰⁰.
#[test]
fn two_combinations_have_no_verdict() {
    for (combinations, reason) in
        [(2, "2 of at least 5 combinations"), (6, "the differences of all 6 combinations are equal")]
    {
        let mut records = synthetic_records(combinations, 2);
        for record in &mut records {
            record.clean_success = record.condition == Condition::Touch;
            record.success = record.clean_success;
            record.contact = record.condition == Condition::Blind;
        }
        let [page, ..] = report(&records);
        assert!(page.contains(&format!("<strong>No verdict: {reason}.</strong>")), "{page}");
        let data = page.split_once("<h2 id=\"differs\">").unwrap().0;
        assert!(!data.contains("10⁻³⁰⁰") && !data.contains("images are needed"), "{data}");
        assert!(data.contains(&format!("none: {reason}")), "{data}");
    }
}

#[test]
fn a_report_replaces_the_one_before() {
    let folder = tempfile::tempdir().unwrap();
    let before = report_in(folder.path(), &synthetic_records(2, 1));
    let after = report_in(folder.path(), &synthetic_records(3, 1));
    assert_ne!(before[0], after[0]);
    let missing = folder.path().join("missing");
    let summary = summarise(&[], &[], &RunInfo { seed: 1, robot: "sim".into(), wall_s: 0.0, decision_budget: None });
    let error = write_report(&missing, &summary, &[], &Value::Null).unwrap_err();
    assert!(error.to_string().contains("contact.svg"), "{error}");
}

#[test]
#[ignore = "leaves a report for inspection in the temporary folder"]
fn sample() {
    let folder = std::env::temp_dir().join("ftac-report-sample");
    std::fs::create_dir_all(&folder).unwrap();
    report_in(&folder, &synthetic_records(60, 10));
}
