//! Statements in the paper's text beside its figure, and the commands that reproduce the paper's demonstrations without
//! figures.

use std::collections::HashMap;

use maud::{Markup, html};
use scenarios::summary::Summary;
use scenarios::{Condition, TrialRecord};
use statistics::{PairedDifference, SuccessRate};

use super::CollisionCount;
use crate::comparisons::format_with_interval;
use crate::html::{ColumnAlignment, HtmlTable, format_number};
use crate::paper;

/// Events that the paper shows without figures, each with the command that runs it.
const SHOWN_EVENTS: [(&str, &str); 5] = [
    (
        "Four balls, one of them pushed while it is grasped (its illustration of the methods)",
        "ftac transport --scenario scenarios/data/transport/four_balls.toml --out DIR",
    ),
    ("Objects beside their detected poses", "ftac bench --scenario scenarios/data/wrong_position.toml"),
    ("Balls of another size than planned for", "ftac bench --scenario scenarios/data/wrong_size.toml"),
    ("A finger without power", "ftac bench --scenario scenarios/data/disabled_digits.toml"),
    ("Hand, pads and grasps", "ftac hand check; ftac optics eval; ftac grasps classify"),
];

/// Returns the end of the section.
pub fn section(summary: &Summary, records: &[TrialRecord]) -> Markup {
    html! {
        (table(summary, records))
        p {
            "These commands reproduce the paper's demonstrations without figures, from the repository’s root; BENCHMARKS.md there begins with \
            every figure that the paper states and this project measures. Recordings in DIR are shown by " code { "ftac view DIR" } "."
        }
        dl.terms { @for (shown, command) in SHOWN_EVENTS { dt { (shown) } dd { code { (command) } } } }
    }
}

fn table(summary: &Summary, records: &[TrialRecord]) -> HtmlTable {
    let head = [
        ("statement of the paper", ColumnAlignment::Words),
        ("paper", ColumnAlignment::Words),
        ("ours", ColumnAlignment::Words),
    ];
    let mut table = HtmlTable::new("What the paper’s text states beside its figure", &head);
    let mut row = |statement: &str, paper: String, ours: String| table.row(&[statement, &paper, &ours]);
    row(
        "combinations, and trials of each",
        format!("{} × {}", paper::COMBINATION_COUNT, paper::TRIALS_PER_COMBINATION),
        format!("{} × {}", summary.combos, summary.trials_per_combo),
    );
    let touch = || records.iter().filter(|record| record.condition == Condition::Touch);
    let collided: Vec<&TrialRecord> =
        touch().filter(|record| CollisionCount::Predicted.collided(record) == Some(true)).collect();
    if !collided.is_empty() {
        let clear = collided.iter().filter(|record| CollisionCount::Predicted.succeeded(record) == Some(true)).count();
        let rate = SuccessRate::new(clear as u64, collided.len() as u64);
        row(
            "after a predicted collision, touch switches to a strategy without one",
            "always".to_owned(),
            format!(
                "{clear} of {} trials: {} [{}, {}]",
                collided.len(),
                format_number(rate.rate.unwrap_or(f64::NAN), 3),
                format_number(rate.low, 3),
                format_number(rate.high, 3)
            ),
        );
    }
    if let (Some(median), Some(last)) = (summary.decision_ms.p50, summary.decision_ms.p99) {
        row(
            "duration of the switch",
            format!("about {:.0} ms", paper::DECISION_MS),
            format!(
                "slowest decision of a trial: median {} ms, 99th percentile {} ms",
                format_number(median, 1),
                format_number(last, 1)
            ),
        );
    }
    let longer = paired_times(records);
    if !longer.is_empty() {
        row(
            "time that touch adds to a trial without a collision",
            format!("about {:.0} s", paper::TOUCH_TIME_S),
            format!(
                "{} s, {} trials that are clean blind, and with touch at the first try",
                format_with_interval(&PairedDifference::from_pairs(&longer).difference, 1),
                longer.len()
            ),
        );
    }
    table
}

/// Returns times of trials with touch and blind, s, for which both are clean and touch needed no further try.
fn paired_times(records: &[TrialRecord]) -> Vec<(f64, f64)> {
    let clean = |condition: Condition| {
        records
            .iter()
            .filter(move |record| record.condition == condition && record.clean_success && record.retries == 0)
    };
    let id = |record: &TrialRecord| (record.combination, record.trial);
    let blind: HashMap<_, f64> = clean(Condition::Blind).map(|record| (id(record), record.sim_seconds)).collect();
    clean(Condition::Touch).filter_map(|record| Some((record.sim_seconds, *blind.get(&id(record))?))).collect()
}

#[cfg(test)]
mod tests {
    use maud::Render as _;
    use scenarios::summary::{RunInfo, summarise};

    use super::*;
    use crate::tests::synthetic_records;

    /// In six trials with a predicted collision touch finds a collision-free path in four; its clean trials take 3 s
    /// longer.
    #[test]
    fn switches_and_times_are_counted() {
        let mut records = synthetic_records(6, 1);
        for record in records.iter_mut().filter(|record| record.condition == Condition::Touch) {
            record.plan_separation_mm = Some(-1.0);
            record.chosen_separation_mm = (record.combination > 0).then_some(record.combination as f64 - 1.5);
            (record.clean_success, record.retries) = (true, u32::from(record.combination == 5));
            record.sim_seconds += 3.0;
        }
        let info = RunInfo { seed: 1, robot: "sim".into(), wall_s: 1.0, decision_budget: None };
        let text = table(&summarise(&records, &[], &info), &records).render().into_string();
        assert!(text.contains("4 of 6 trials: 0.667 [0.300, 0.903]"), "{text}");
        let clean = records.iter().filter(|record| record.condition == Condition::Blind && record.clean_success);
        let pairs = clean.filter(|record| record.combination != 5).count();
        assert!(pairs > 0 && text.contains(&format!("3.0 s, {pairs} trials")), "{text}");
    }
}
