//! Results of a benchmark, on the terminal.

use std::path::Path;

use anyhow::Result;
use scenarios::record::Condition;
use scenarios::summary::Summary;
use statistics::{MIN_SAMPLES, NoTestReason};

use crate::terminal::Terminal;

/// Returns the shortfall of the results, if any. Conditions are compared only from [`MIN_SAMPLES`] combinations on.
pub fn shortfall(summary: &Summary) -> Option<String> {
    if !summary.left_out.is_empty() {
        return Some(summary.left_out.join("; "));
    }
    let ideal = summary.conditions.ideal.contact_rate.mean.unwrap_or(0.0);
    let clean = |condition: Condition| summary.conditions.get(condition).clean_success_rate.mean;
    if ideal > 0.0 {
        return Some(format!("{:.1} % of the ideal runs had an unwanted contact, expected none", 100.0 * ideal));
    }
    let mut rivals = [Condition::Blind, Condition::Reflex].into_iter().filter(|_| summary.combos >= MIN_SAMPLES);
    rivals.find_map(|rival| match (clean(rival), clean(Condition::Touch)) {
        (Some(rate), Some(touch)) if touch < rate => {
            Some(format!("touch succeeded cleanly less often ({touch:.3}) than {rival} ({rate:.3})"))
        }
        _ => None,
    })
}

/// True if `folder` holds a recording.
fn has_recording(folder: &Path) -> bool {
    telemetry::viewer::recordings(&folder.join("recordings")).is_ok()
}

fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or("-".to_owned(), |value| format!("{value:.digits$}"))
}

/// Prints the summary of a benchmark.
pub fn print_summary(terminal: &Terminal, summary: &Summary, folder: &Path) -> Result<()> {
    if terminal.json {
        println!("{}", serde_json::to_string(summary)?);
        return Ok(());
    }
    println!(
        "{:8} {:>6} {:>17} {:>17} {:>17} {:>9}",
        "", "trials", "contact M (SD)", "success M (SD)", "clean M (SD)", "time (s)"
    );
    for condition in summary.conditions.conditions_with_trials() {
        let c = summary.conditions.get(condition);
        let pair = |m: &statistics::MeanSd| format!("{} ({})", number(m.mean, 3), number(m.sd, 3));
        println!(
            "{:8} {:>6} {:>17} {:>17} {:>17} {:>9}",
            condition.name(),
            c.trials,
            pair(&c.contact_rate),
            pair(&c.success_rate),
            pair(&c.clean_success_rate),
            number(c.trial_s.mean, 1)
        );
    }
    for (name, t) in [
        ("contact: blind over ideal", &summary.t_test.contact),
        ("success: touch over blind", &summary.t_test.success),
        ("clean success: touch over blind", &summary.t_test.clean_success),
        ("clean success: touch over reflex", &summary.t_test.touch_over_reflex),
    ] {
        match (t.p, t.reason()) {
            (Some(p), _) => println!("{name:32} t({}) = {}, p = {p:.2e}", t.df, number(t.t, 2)),
            (None, Some(reason)) if t.untested != Some(NoTestReason::NotRun) => {
                println!("{name:32} not tested: {reason}")
            }
            _ => {}
        }
    }
    for ablation in &summary.ablations {
        let interval = ablation.success.low.zip(ablation.success.high);
        println!(
            "{:34} success {}{}{}",
            ablation.ablation.label(),
            number(ablation.success.value, 3),
            interval.map_or_else(String::new, |(low, high)| format!(" [{low:.3}, {high:.3}]")),
            ablation
                .against_full
                .value
                .map_or_else(String::new, |value| format!(", {value:+.3} against the whole hand"))
        );
    }
    if summary.conditions.touch.trials > 0 {
        print_touch(summary);
    }
    println!(
        "wall time {:.0} s, real-time factor {}",
        summary.wall_s,
        number(Some(summary.real_time_factor.unwrap_or(f64::NAN)), 1)
    );
    println!(
        "results in {}: report.html, summary.json, trials.csv, tries.csv{}",
        folder.display(),
        if has_recording(folder) {
            format!("; see a trial with `ftac view {}`", folder.display())
        } else {
            String::new()
        }
    );
    Ok(())
}

/// Prints the decision times of touch and the errors of its pose estimates.
fn print_touch(summary: &Summary) {
    let over = summary.decision_ms.over_budget.filter(|over| *over > 0);
    println!(
        "decision {} ms p50, {} ms p99{}",
        number(summary.decision_ms.p50, 1),
        number(summary.decision_ms.p99, 1),
        over.map_or(String::new(), |over| format!("; in {over} trials longer than the scenario allows")),
    );
    println!(
        "pose error {} mm median, {} mm p95; {} deg median, {} deg p95",
        number(summary.pose_error.mm.median, 2),
        number(summary.pose_error.mm.p95, 2),
        number(summary.pose_error.deg.median, 1),
        number(summary.pose_error.deg.p95, 1)
    );
}
