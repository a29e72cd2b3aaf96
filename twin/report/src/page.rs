//! The sections of the page.

use std::path::Path;

use anyhow::Result;
use scenarios::statistics::{Interval, MeanSd, Summary, TTest, combination_rates};
use scenarios::{Condition, TrialRecord};
use serde_json::Value;

use super::figure::Figure;
use super::findings::{Rate, combination_lines, outcome};
use super::html::{Column, Table, counted, duration, escape, number, probability};
use super::{ablation, definitions, failures, heat_map, paper, pictures, prediction, run, style};

/// A difference counts as shown below this chance of its being none.
const LEVEL: f64 = 0.05;

/// The paper that the benchmark is from.
const SOURCE: &str = "<p class=\"byline\">The benchmark is that of Zhao et al., <i>Embedding high-resolution touch across robotic hands \
     enables adaptive human-like grasping</i>, Nature Machine Intelligence, 2025, \
     <a href=\"https://doi.org/10.1038/s42256-025-01053-3\">doi:10.1038/s42256-025-01053-3</a>, in an independent simulation.</p>\n";

/// Sorts a table by a column that is clicked on, upwards and downwards in turn.
const SORTING: &str = "<script>document.querySelectorAll('thead th').forEach(h=>{h.title='sort';h.onclick=()=>{const k=h.cellIndex,\
     b=h.closest('table').tBodies[0],v=r=>{const t=r.cells[k].textContent.replace('\u{2212}','-'),n=parseFloat(t);return n===n?n:t},\
     d=h.dataset.d=h.dataset.d=='1'?-1:1;[...b.rows].sort((x,y)=>{const p=v(x),q=v(y);return d*(p<q?-1:p>q?1:0)}).forEach(r=>\
     b.append(r))}})</script>\n";

/// The whole page; `folder` may hold recordings, `figures` are contact and clean success.
pub fn render(
    summary: &Summary,
    records: &[TrialRecord],
    run: &Value,
    (folder, figures): (&Path, [&Figure; 2]),
) -> Result<String> {
    let mut html = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>Multi-object benchmark: {0}, seed {1}</title>\n<style>{2}{3}</style>\n</head>\n<body>\n<main>\n\
         <h1>Multi-object benchmark of the F-TAC Hand</h1>\n{SOURCE}<p class=\"byline\">{4}, {5} each, robot: {0}, seed {1}</p>\n",
        escape(&summary.robot),
        summary.seed,
        style::FIGURE,
        style::PAGE,
        counted(summary.combos, "object combination"),
        counted(summary.trials_per_combo, "trial"),
    );
    html += &run::warnings(run);
    html += &verdict(summary, records);
    html += &pictures::section(folder, records)?;
    html += &rates(summary, records);
    html += &tests(summary);
    html += &figure_section(figures, summary);
    html += &heat_map::section(records);
    html += &prediction::section(records);
    html += &ablation::section(summary, records);
    html += &facts(summary);
    html += &failures::section(summary, records, folder);
    html += &combinations(summary, records);
    html += &run::section(run);
    html += definitions::DIFFERENCES;
    html += definitions::SECTION;
    html += "</main>\n";
    html += SORTING;
    html += "</body>\n</html>\n";
    Ok(html)
}

/// A number that may be missing.
fn maybe(value: Option<f64>, decimals: usize) -> String {
    number(value.unwrap_or(f64::NAN), decimals)
}

fn percent(rate: Option<f64>) -> String {
    format!("{} %", maybe(rate.map(|rate| rate * 100.0), 1))
}

/// What came out, in words.
fn verdict(summary: &Summary, records: &[TrialRecord]) -> String {
    if records.is_empty() {
        return "<p class=\"verdict short\">No finished trial yet: there is nothing to report.</p>\n".to_string();
    }
    let conditions = &summary.conditions;
    let tested = |test: &TTest| outcome(test).unwrap_or_else(|| "too few combinations to test".to_string());
    let (contact, clean) = (&summary.t_test.contact, &summary.t_test.clean_success);
    let findings = [
        finding(
            clean,
            "Touch raises clean success over blind",
            "That touch raises clean success over blind is not shown",
        ),
        finding(
            &summary.t_test.touch_over_reflex,
            "its images are needed for that",
            "that its images are needed, and not only its further tries, is not shown",
        ),
        finding(contact, "errors cause unwanted contacts", "that errors cause unwanted contacts is not shown"),
    ];
    let short = if findings.iter().all(|(shown, _)| *shown) { "" } else { " short" };
    let words = findings.map(|(_, text)| text).join("; ");
    let Interval { value, low, high } = summary.differences.clean_success.difference;
    let gain = match (value, low, high) {
        (Some(value), Some(low), Some(high)) => format!(
            "; touch less blind {} points, 95 % {} to {}",
            number(100.0 * value, 1),
            number(100.0 * low, 1),
            number(100.0 * high, 1)
        ),
        _ => String::new(),
    };
    format!(
        "<p class=\"verdict{short}\"><strong>{words}.</strong> With the same errors, {} of trials succeeded cleanly with touch, {} blind, \
         and {} with further tries but no tactile image ({}{gain}; the paper: 100 % and 53.5 %). Without errors the plan met an unwanted \
         contact in {} of trials; with errors, blind, in {} ({}; the paper: 0.0 % and 46.5 %), with touch in {}.</p>\n",
        percent(conditions.touch.clean_success_rate.mean),
        percent(conditions.blind.clean_success_rate.mean),
        percent(conditions.reflex.clean_success_rate.mean),
        escape(&tested(clean)),
        percent(conditions.ideal.contact_rate.mean),
        percent(conditions.blind.contact_rate.mean),
        escape(&tested(contact)),
        percent(conditions.touch.contact_rate.mean),
    )
}

/// Whether a test shows something, and the words for that.
fn finding(test: &TTest, shown: &'static str, not_shown: &'static str) -> (bool, &'static str) {
    if test.p.is_some_and(|p| p < LEVEL) { (true, shown) } else { (false, not_shown) }
}

/// The conditions beside the paper's.
fn rates(summary: &Summary, records: &[TrialRecord]) -> String {
    let columns = [
        ("condition", Column::Words),
        ("trials", Column::Numbers),
        ("n", Column::Numbers),
        ("contact rate: mean (SD)", Column::Numbers),
        ("paper: M (SD)", Column::Numbers),
        ("success rate: mean (SD)", Column::Numbers),
        ("clean success rate: mean (SD)", Column::Numbers),
        ("paper’s success: M (SD)", Column::Numbers),
        ("predicted risk", Column::Numbers),
        ("time of a trial (s)", Column::Numbers),
    ];
    let caption = format!(
        "Rates over combinations (n), each the share of its trials; the paper’s over {} combinations of {} trials. \
         A dash: not reported.",
        paper::COMBINATIONS,
        paper::TRIALS
    );
    let mut table = Table::new(&caption, &columns);
    let published = |rate: Option<(f64, f64)>| {
        rate.map_or("–".to_string(), |(mean, sd)| format!("{} ({})", number(mean, 3), number(sd, 3)))
    };
    for condition in summary.conditions.listed() {
        let ours = summary.conditions.of(condition);
        let theirs = paper::rates(condition);
        let cell = |rate: Rate| {
            let MeanSd { mean, sd } = rate.over_all(ours);
            format!("{} ({})", maybe(mean, 3), maybe(sd, 3))
        };
        table.row(&[
            condition.name().to_string(),
            ours.trials.to_string(),
            combination_rates(records, condition).len().to_string(),
            cell(Rate::Contact),
            published(theirs.contact),
            cell(Rate::Success),
            cell(Rate::CleanSuccess),
            published(theirs.success),
            maybe(ours.risk_rate.mean, 3),
            maybe(ours.trial_s.mean, 1),
        ]);
    }
    format!("<h2 id=\"rates\">Contact and success</h2>\n{}", table.finish())
}

/// The tests beside the paper's.
fn tests(summary: &Summary) -> String {
    let head = [
        ("question", Column::Words),
        ("difference of means", Column::Numbers),
        ("t", Column::Numbers),
        ("df", Column::Numbers),
        ("p", Column::Numbers),
        ("paper", Column::Numbers),
    ];
    let mut table = Table::new("Paired one-sided t-tests over combinations", &head);
    let published = format!("t({:.0}) = {}, p = {}", paper::DF, number(paper::T, 1), probability(paper::P));
    let conditions = &summary.conditions;
    let rows = [
        (
            "more contacts blind than ideal?",
            conditions.blind.contact_rate.mean.zip(conditions.ideal.contact_rate.mean),
            &summary.t_test.contact,
            published.clone(),
        ),
        (
            "more success with touch than blind?",
            conditions.touch.success_rate.mean.zip(conditions.blind.success_rate.mean),
            &summary.t_test.success,
            String::from("–"),
        ),
        (
            "more clean success with touch than blind?",
            conditions.touch.clean_success_rate.mean.zip(conditions.blind.clean_success_rate.mean),
            &summary.t_test.clean_success,
            published,
        ),
        (
            "more clean success with touch than reflex?",
            conditions.touch.clean_success_rate.mean.zip(conditions.reflex.clean_success_rate.mean),
            &summary.t_test.touch_over_reflex,
            String::from("–"),
        ),
    ];
    for (question, means, test, paper) in rows {
        table.row(&[
            question.to_string(),
            maybe(means.map(|(a, b)| a - b), 3),
            maybe(test.t, 2),
            test.p.map_or("–".to_string(), |_| test.df.to_string()),
            probability(test.p.unwrap_or(f64::NAN)),
            paper,
        ]);
    }
    table.finish() + &differences(summary)
}

/// Beyond the paper: how large the differences are, and how few combinations would have shown them.
fn differences(summary: &Summary) -> String {
    let head = [
        ("difference", Column::Words),
        ("mean [95 %]", Column::Numbers),
        ("effect size d_z [95 %]", Column::Numbers),
        ("power with fewer combinations", Column::Words),
    ];
    let mut table = Table::new("Paired differences over combinations, with bootstrap intervals", &head);
    let interval = |of: &Interval, decimals: usize| {
        format!("{} [{}, {}]", maybe(of.value, decimals), maybe(of.low, decimals), maybe(of.high, decimals))
    };
    let rows = [
        ("contacts, blind less ideal", &summary.differences.contact),
        ("success, touch less blind", &summary.differences.success),
        ("clean success, touch less blind", &summary.differences.clean_success),
        ("clean success, touch less reflex", &summary.differences.touch_over_reflex),
    ];
    for (name, difference) in rows {
        let power: Vec<String> =
            difference.power.iter().map(|(n, power)| format!("{n}: {}", number(*power, 2))).collect();
        let cells = [interval(&difference.difference, 3), interval(&difference.d_z, 2), power.join(", ")];
        table.row(&[name.to_string(), cells[0].clone(), cells[1].clone(), cells[2].clone()]);
    }
    let counts = &summary.differences.mcnemar;
    let trials = format!(
        "<p>Trial by trial: {} succeeded both blind and with touch, {} only with touch, {} only blind, {} neither way \
         (McNemar’s exact test, one-sided: p {}).</p>\n",
        counts.both,
        counts.first_only,
        counts.second_only,
        counts.neither,
        probability(counts.p.unwrap_or(f64::NAN)),
    );
    table.finish() + &mixed(summary) + &trials
}

/// Trials within combinations: whether combinations differ, or only their trials.
fn mixed(summary: &Summary) -> String {
    let head = [
        ("difference, trial by trial", Column::Words),
        ("mean [95 %]", Column::Numbers),
        ("SD between combinations", Column::Numbers),
        ("SD within them", Column::Numbers),
        ("share between", Column::Numbers),
        ("pairs of trials", Column::Numbers),
    ];
    let mut table = Table::new("Mixed model: paired trials within combinations", &head);
    let of = &summary.differences.mixed;
    for (name, mixed) in [
        ("clean success, touch less blind", &of.clean_success),
        ("clean success, touch less reflex", &of.touch_over_reflex),
        ("contacts, blind less touch", &of.contact),
    ] {
        let mean = &mixed.difference;
        table.row(&[
            name.to_string(),
            format!("{} [{}, {}]", maybe(mean.value, 3), maybe(mean.low, 3), maybe(mean.high, 3)),
            maybe(mixed.between_sd, 3),
            maybe(mixed.within_sd, 3),
            maybe(mixed.intraclass, 2),
            mixed.trials.to_string(),
        ]);
    }
    table.finish()
}

fn figure_section(figures: [&Figure; 2], summary: &Summary) -> String {
    let captions = [("contact.svg", "ideal with blind"), ("clean_success.svg", "blind with touch")];
    let mut html = "<h2 id=\"figures\">Figures</h2>\n<div class=\"figures\">\n".to_string();
    for (figure, (file, compared)) in figures.into_iter().zip(captions) {
        html += &format!(
            "<figure>\n{}<figcaption>{}: a dot is one of {} (its name shows under the pointer); the box spans the 25th to the \
             75th percentile, the thick line is the median, the diamond the mean, whiskers reach from minimum to maximum; the \
             shading is a kernel density estimate, each scaled to the same width. Dots of equal rate that fill a row go \
             on above and below it. The bracket compares {compared} (paired, one-sided). Also as \
             <a href=\"{file}\">{file}</a>.</figcaption>\n</figure>\n",
            figure.inline(),
            escape(&figure.title),
            counted(summary.combos, "combination"),
        );
    }
    html + "</div>\n"
}

/// Speed and accuracy.
fn facts(summary: &Summary) -> String {
    let unit = |value: Option<f64>, decimals: usize, unit: &str| match value {
        Some(value) => format!("{} {unit}", number(value, decimals)),
        None => "–".to_string(),
    };
    let (time, pose) = (&summary.decision_ms, &summary.pose_error);
    let facts = [
        (format!("Decision, median (paper: about {:.0} ms)", paper::DECISION_MS), unit(time.p50, 1, "ms")),
        ("Decision, 99th percentile".to_string(), unit(time.p99, 1, "ms")),
        ("Pose error, position, median".to_string(), unit(pose.mm.median, 2, "mm")),
        ("Pose error, position, 95th percentile".to_string(), unit(pose.mm.p95, 2, "mm")),
        ("Pose error, angle, median".to_string(), unit(pose.deg.median, 1, "°")),
        ("Pose error, angle, 95th percentile".to_string(), unit(pose.deg.p95, 1, "°")),
        ("The plan’s guess before touch, median".to_string(), unit(pose.prior_mm.median, 2, "mm")),
        ("The plan’s guess before touch, 95th percentile".to_string(), unit(pose.prior_mm.p95, 2, "mm")),
        ("Real-time factor, all threads together".to_string(), unit(summary.real_time_factor, 2, "×")),
        ("Wall time".to_string(), duration(summary.wall_s)),
    ];
    let mut html = "<h2 id=\"speed\">Speed and accuracy</h2>\n<dl class=\"facts\">\n".to_string();
    for (term, value) in facts {
        html += &format!("<div><dt>{}</dt><dd>{}</dd></div>\n", escape(&term), escape(&value));
    }
    html + "</dl>\n"
}

/// A line per combination.
fn combinations(summary: &Summary, records: &[TrialRecord]) -> String {
    let mut head = vec![
        ("no.".to_string(), Column::Words),
        ("first object".to_string(), Column::Words),
        ("second object".to_string(), Column::Words),
    ];
    let listed = || summary.conditions.listed();
    for rate in ["contact", "clean success"] {
        head.extend(listed().map(|condition| (format!("{rate}, {condition}"), Column::Numbers)));
    }
    head.push(("switched".to_string(), Column::Numbers));
    let head: Vec<(&str, Column)> = head.iter().map(|(name, column)| (name.as_str(), *column)).collect();
    let caption = "Rates of every combination, worst first: by clean success with touch, then blind";
    let mut table = Table::new(caption, &head);
    for line in combination_lines(records) {
        let mut cells = vec![line.combination.to_string(), line.first.clone(), line.second.clone()];
        for rate in [Rate::Contact, Rate::CleanSuccess] {
            // By their place in `Condition::ALL`, in whose order they are listed.
            let rates = Condition::ALL.into_iter().zip(&line.rates);
            let rates = rates.filter(|(condition, _)| listed().any(|listed| listed == *condition));
            cells.extend(rates.map(|(_, rates)| maybe(rates.as_ref().map(|rates| rate.of(rates)), 2)));
        }
        cells.push(maybe(line.switched, 2));
        table.row(&cells);
    }
    format!("<h2 id=\"combinations\">Every combination</h2>\n{}", table.finish())
}
