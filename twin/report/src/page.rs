//! The sections of the page.

use std::collections::BTreeSet;

use scenarios::statistics::{Interval, MeanSd, Summary, TTest, combination_rates};
use scenarios::{Condition, FailureCause, TrialRecord};
use serde_json::Value;

use super::figure::Figure;
use super::findings::{Rate, combination_lines, harmless_collisions, of_condition, outcome};
use super::html::{Column, Table, counted, duration, escape, number, probability};
use super::{ablation, definitions, paper, run, style};

/// A difference counts as shown below this chance of its being none.
const LEVEL: f64 = 0.05;

/// The whole page; `figures` are collision and success.
pub fn render(summary: &Summary, records: &[TrialRecord], run: &Value, figures: [&Figure; 2]) -> String {
    let mut html = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <title>Multi-object benchmark: {0}, seed {1}</title>\n<style>{2}{3}</style>\n</head>\n<body>\n<main>\n\
         <h1>Multi-object benchmark</h1>\n<p class=\"byline\">{4}, {5} each, robot: {0}, seed {1}</p>\n",
        escape(&summary.robot),
        summary.seed,
        style::FIGURE,
        style::PAGE,
        counted(summary.combos, "object combination"),
        counted(summary.trials_per_combo, "trial"),
    );
    html += &verdict(summary, records);
    html += &rates(summary, records);
    html += &tests(summary);
    html += &figure_section(figures, summary);
    html += &ablation::section(summary, records);
    html += &facts(summary);
    html += &failures(summary, records);
    html += &combinations(records);
    html += &run::section(run);
    html += definitions::SECTION;
    html += "</main>\n</body>\n</html>\n";
    html
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
    let shown = |test: &TTest| test.p.is_some_and(|p| p < LEVEL);
    let tested = |test: &TTest| outcome(test).unwrap_or_else(|| "too few combinations to test".to_string());
    let (collision, success) = (&summary.t_test.collision, &summary.t_test.success);
    let finding = match (shown(collision), shown(success)) {
        (true, true) => {
            "Both of the paper’s findings hold here: disturbances cause collisions, and touch raises success."
        }
        (true, false) => {
            "Of the paper’s two findings one holds here: disturbances cause collisions, but that touch raises success is not shown."
        }
        (false, true) => {
            "Of the paper’s two findings one holds here: touch raises success, but that disturbances cause collisions is not shown."
        }
        (false, false) => "Neither of the paper’s two findings is shown by this run.",
    };
    let short = if shown(collision) && shown(success) { "" } else { " short" };
    format!(
        "<p class=\"verdict{short}\"><strong>{finding}</strong> Without errors the plan collided in {} of trials; with errors, \
         blind, in {} ({}; the paper: 0.0 % and 46.5 %), with touch in {}. With the same errors, {} of trials succeeded blind and {} with touch \
         ({}; the paper: 53.5 % and 100 %).</p>\n",
        percent(conditions.ideal.collision_rate.mean),
        percent(conditions.blind.collision_rate.mean),
        escape(&tested(collision)),
        percent(conditions.touch.collision_rate.mean),
        percent(conditions.blind.success_rate.mean),
        percent(conditions.touch.success_rate.mean),
        escape(&tested(success)),
    )
}

/// The three conditions beside the paper's.
fn rates(summary: &Summary, records: &[TrialRecord]) -> String {
    let columns = [
        ("condition", Column::Words),
        ("trials", Column::Numbers),
        ("n", Column::Numbers),
        ("collision rate: mean", Column::Numbers),
        ("SD", Column::Numbers),
        ("paper: M (SD)", Column::Numbers),
        ("success rate: mean", Column::Numbers),
        ("SD", Column::Numbers),
        ("paper: M (SD)", Column::Numbers),
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
    for condition in Condition::ALL {
        let ours = of_condition(summary, condition);
        let theirs = paper::rates(condition);
        let cells = |MeanSd { mean, sd }: MeanSd| [maybe(mean, 3), maybe(sd, 3)];
        let [collision, collision_sd] = cells(Rate::Collision.over_all(ours));
        let [success, success_sd] = cells(Rate::Success.over_all(ours));
        table.row(&[
            condition.name().to_string(),
            ours.trials.to_string(),
            combination_rates(records, condition).len().to_string(),
            collision,
            collision_sd,
            published(theirs.collision),
            success,
            success_sd,
            published(theirs.success),
        ]);
    }
    format!("<h2 id=\"rates\">Collision and success</h2>\n{}", table.finish())
}

/// The two tests beside the paper's.
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
            "more collisions blind than ideal?",
            conditions.blind.collision_rate.mean.zip(conditions.ideal.collision_rate.mean),
            &summary.t_test.collision,
        ),
        (
            "more success with touch than blind?",
            conditions.touch.success_rate.mean.zip(conditions.blind.success_rate.mean),
            &summary.t_test.success,
        ),
    ];
    for (question, means, test) in rows {
        table.row(&[
            question.to_string(),
            maybe(means.map(|(a, b)| a - b), 3),
            maybe(test.t, 2),
            test.p.map_or("–".to_string(), |_| test.df.to_string()),
            probability(test.p.unwrap_or(f64::NAN)),
            published.clone(),
        ]);
    }
    table.finish() + &effects(summary)
}

/// Beyond the paper: how large the differences are, and how few combinations would have shown them.
fn effects(summary: &Summary) -> String {
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
        ("collisions, blind less ideal", &summary.effects.collision),
        ("success, touch less blind", &summary.effects.success),
    ];
    for (name, effect) in rows {
        let power: Vec<String> = effect.power.iter().map(|(n, power)| format!("{n}: {}", number(*power, 2))).collect();
        let cells = [interval(&effect.difference, 3), interval(&effect.d_z, 2), power.join(", ")];
        table.row(&[name.to_string(), cells[0].clone(), cells[1].clone(), cells[2].clone()]);
    }
    let counts = &summary.effects.mcnemar;
    let trials = format!(
        "<p>Trial by trial: {} succeeded both blind and with touch, {} only with touch, {} only blind, {} neither way \
         (McNemar’s exact test, one-sided: p {}).</p>\n",
        counts.both,
        counts.first_only,
        counts.second_only,
        counts.neither,
        probability(counts.p.unwrap_or(f64::NAN)),
    );
    table.finish() + &trials
}

fn figure_section(figures: [&Figure; 2], summary: &Summary) -> String {
    let captions = [("collision.svg", "ideal with blind"), ("success.svg", "blind with touch")];
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

/// Why trials failed.
fn failures(summary: &Summary, records: &[TrialRecord]) -> String {
    let by_condition = Condition::ALL.map(|condition| of_condition(summary, condition));
    let causes: BTreeSet<FailureCause> = by_condition.iter().flat_map(|one| one.failures.keys().copied()).collect();
    let mut head = vec![("cause", Column::Words)];
    head.extend(Condition::ALL.map(|condition| (condition.name(), Column::Numbers)));
    let mut table = Table::new("Failed trials by cause", &head);
    let mut row = |name: String, counts: [usize; 3]| {
        let mut cells = vec![name];
        cells.extend(counts.map(|count| count.to_string()));
        table.row(&cells);
    };
    for cause in causes {
        row(cause.to_string(), by_condition.map(|one| one.failures.get(&cause).copied().unwrap_or(0)));
    }
    let failed = |condition: Condition| records.iter().filter(|r| r.condition == condition && !r.success).count();
    row("all failed trials".to_string(), Condition::ALL.map(failed));
    row("all trials".to_string(), by_condition.map(|one| one.trials));
    let harmless: Vec<String> = Condition::ALL
        .into_iter()
        .map(|condition| (condition, harmless_collisions(records, condition)))
        .filter(|(_, (collided, _))| *collided > 0)
        .map(|(condition, (collided, succeeded))| format!("{condition}: {succeeded} of {collided}"))
        .collect();
    let note = match harmless.is_empty() {
        true => "No trial had a collision.".to_string(),
        false => format!("Trials that succeeded in spite of a collision: {}.", harmless.join("; ")),
    };
    format!("<h2 id=\"failures\">Why trials failed</h2>\n{}<p>{}</p>\n", table.finish(), escape(&note))
}

/// A line per combination.
fn combinations(records: &[TrialRecord]) -> String {
    let mut head = vec![
        ("no.".to_string(), Column::Words),
        ("first object".to_string(), Column::Words),
        ("second object".to_string(), Column::Words),
    ];
    for rate in ["collision", "success"] {
        head.extend(Condition::ALL.map(|condition| (format!("{rate}, {condition}"), Column::Numbers)));
    }
    head.push(("switched".to_string(), Column::Numbers));
    let head: Vec<(&str, Column)> = head.iter().map(|(name, column)| (name.as_str(), *column)).collect();
    let caption = "Rates of every combination, worst first: by success with touch, then by success blind";
    let mut table = Table::new(caption, &head);
    for line in combination_lines(records) {
        let mut cells = vec![line.combination.to_string(), line.first.clone(), line.second.clone()];
        for rate in [Rate::Collision, Rate::Success] {
            cells.extend(line.rates.iter().map(|rates| maybe(rates.as_ref().map(|rates| rate.of(rates)), 2)));
        }
        cells.push(maybe(line.switched, 2));
        table.row(&cells);
    }
    format!("<h2 id=\"combinations\">Every combination</h2>\n{}", table.finish())
}
