//! The report of a sweep: `report.html` with curves and contrasts, both also as tables. Also the page of a replay on
//! more cores.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use ftac_platform::data::write_atomically;
use maud::html;
use report::html::{ColumnAlignment, HtmlTable, count_with_noun, format_duration, format_number, whole_page};
use schemars::JsonSchema;
use serde::Serialize;

use crate::axis::{AxisLevel, PlannedAxis};
use crate::curve::{self, Contrast, RateEstimate};
use crate::figure::{Figure, Line};
use crate::folder::SweepFolder;
use crate::makespan::{Assumptions, CORE_COUNTS, MakespanPoint, replay};
use crate::outcomes::{Outcomes, ReportedOutcome};
use crate::plan::MAX_TRIALS;

/// A finished report.
pub struct SweepReport {
    pub text: String,
    pub results: Results,
    pub folder: PathBuf,
}

/// Rates and contrasts of a sweep.
#[derive(Debug, Clone, Serialize, JsonSchema)]
pub struct Results {
    /// Name of the sweep.
    sweep: String,
    /// Number of trials that were run.
    pub trials: usize,
    /// Number of finished units.
    units: usize,
    /// Number of units of the sweep.
    of_units: usize,
    /// One rate per entry.
    curves: Vec<CurveRow>,
    /// Differences, paired by trial.
    contrasts: Vec<Contrast>,
}

/// Rate at one level of an axis.
#[derive(Debug, Clone, Serialize, JsonSchema)]
pub struct CurveRow {
    /// The axis.
    axis: String,
    /// Its value.
    level: String,
    /// Policy, or ablation of touch.
    arm: String,
    /// clean_success, success or contact.
    outcome: &'static str,
    #[serde(flatten)]
    estimate: RateEstimate,
}

/// Makes the report of the finished units.
pub fn report(folder: &SweepFolder, out: &Path) -> Result<SweepReport> {
    let outcomes = Outcomes::read(folder, true)?;
    let plan = &folder.plan;
    let trials = outcomes.trial_count();
    if trials == 0 {
        bail!("{}: no trial is finished", folder.path.display());
    }
    let curves = curves(&outcomes, &plan.axes);
    let contrasts = contrasts(&outcomes, &plan.axes);
    let (finished, units) = (folder.finished()?.len(), plan.units.len());
    let page = html! {
        p.byline {
            (count_with_noun(plan.points(), "point")) ", " (count_with_noun(plan.seeds.len(), "seed")) ", " (count_with_noun(plan.combos, "pair")) " of objects, "
            (count_with_noun(plan.trials, "trial")) " of each pair; " (count_with_noun(trials, "trial")) " under one policy each"
        }
        @if finished < units { ul.warnings { li { (units - finished) " of " (units) " units of work are missing" } } }
        h2 { "Rates" }
        (overall(&outcomes))
        @for (axis, figures) in figures(&outcomes, &plan.axes) {
            h2 { (axis.name) }
            div.figures { @for figure in figures { figure { (figure.draw()) } } }
        }
        h2 { "Contrasts" }
        (contrast_table(&contrasts))
        h2 { "Method" }
        p { (METHOD_TEXT) }
    };
    std::fs::create_dir_all(out).with_context(|| out.display().to_string())?;
    write_atomically(&out.join("report.html"), whole_page(&format!("Sweep: {}", plan.name), &page).as_bytes())?;
    let rows = curves.iter().map(|row| ([&*row.axis, &row.level, &row.arm, row.outcome], &row.estimate));
    write_atomically(&out.join("curves.csv"), &comma_separated((["axis", "level", "arm", "outcome"], "value"), rows)?)?;
    let rows = contrasts.iter().map(|row| ([&*row.what, &row.at, row.outcome], &row.estimate));
    write_atomically(
        &out.join("contrasts.csv"),
        &comma_separated((["contrast", "at", "outcome"], "difference"), rows)?,
    )?;
    let mut text =
        format!("{trials} trials in {finished} of {units} units\n\n{:44} {:>7}  {:>18} {:>9}\n", "", "", "95 %", "n");
    for (arm, name) in outcomes.arms.iter().enumerate() {
        if let Some(rate) = curve::rate(&outcomes, None, arm, ReportedOutcome::CleanSuccess) {
            let _ = writeln!(text, "{}", line(&format!("clean success, {name}"), &rate));
        }
    }
    for contrast in
        contrasts.iter().filter(|row| row.at == ALL_POINTS && row.outcome == ReportedOutcome::CleanSuccess.name())
    {
        let _ = writeln!(text, "{}", line(&format!("clean success, {}", contrast.what), &contrast.estimate));
    }
    let results = Results { sweep: plan.name.clone(), trials, units: finished, of_units: units, curves, contrasts };
    Ok(SweepReport { text, results, folder: out.to_owned() })
}

/// Label of a contrast over all points.
const ALL_POINTS: &str = "all points";

const METHOD_TEXT: &str = "A rate is the mean over pairs of objects of each pair's share of trials; a contrast \
    is the mean over pairs of each pair's mean difference between trials with the same errors (the same point but for what is compared, seed, \
    pair and trial). Intervals are 95 % by Student's t over pairs of objects, because trials of one pair are correlated; there is none for fewer than five pairs, or of pairs \
    that are all equal. Many contrasts are shown: of \
    twenty without any effect one excludes 0 by chance.";

fn line(what: &str, estimate: &RateEstimate) -> String {
    let interval = match (estimate.low, estimate.high) {
        (Some(low), Some(high)) => format!("{low:.3} to {high:.3}"),
        _ => "-".to_owned(),
    };
    format!("{what:44} {:>7.3}  {interval:>18} {:>9}", estimate.value, estimate.n)
}

fn interval(estimate: &RateEstimate) -> String {
    match (estimate.low, estimate.high) {
        (Some(low), Some(high)) => format!("{} to {}", format_number(low, 3), format_number(high, 3)),
        _ => "–".to_owned(),
    }
}

fn overall(outcomes: &Outcomes) -> HtmlTable {
    let head = [
        ("policy", ColumnAlignment::Words),
        ("trials", ColumnAlignment::Numbers),
        ("clean success", ColumnAlignment::Numbers),
        ("95 %", ColumnAlignment::Numbers),
        ("success", ColumnAlignment::Numbers),
        ("unwanted contact", ColumnAlignment::Numbers),
    ];
    let mut table = HtmlTable::new("All points together", &head);
    for (arm, name) in outcomes.arms.iter().enumerate() {
        let rates = ReportedOutcome::ALL.map(|outcome| curve::rate(outcomes, None, arm, outcome));
        if let [Some(clean), Some(success), Some(contact)] = rates {
            let rate = |rate: RateEstimate| format_number(rate.value, 3);
            table.row(&[
                name.clone(),
                clean.n.to_string(),
                rate(clean),
                interval(&clean),
                rate(success),
                rate(contact),
            ]);
        }
    }
    table
}

fn curves(outcomes: &Outcomes, axes: &[PlannedAxis]) -> Vec<CurveRow> {
    let mut rows = Vec::new();
    for (n, axis) in axes.iter().enumerate() {
        for (level, value) in axis.levels.iter().enumerate() {
            for (arm, name) in outcomes.arms.iter().enumerate() {
                for outcome in ReportedOutcome::ALL {
                    rows.extend(curve::rate(outcomes, Some((n, level)), arm, outcome).map(|estimate| CurveRow {
                        axis: axis.name.clone(),
                        level: value.to_string(),
                        arm: name.clone(),
                        outcome: outcome.name(),
                        estimate,
                    }));
                }
            }
        }
    }
    rows
}

/// Draws clean success and contact over each axis with several levels.
fn figures<'a>(outcomes: &Outcomes, axes: &'a [PlannedAxis]) -> Vec<(&'a PlannedAxis, [Figure; 2])> {
    let figure = |n: usize, axis: &PlannedAxis, outcome: ReportedOutcome| {
        let numbers: Option<Vec<f64>> = axis.levels.iter().map(AxisLevel::number).collect();
        let place = |level: usize| numbers.as_ref().map_or(level as f64 + 1.0, |numbers| numbers[level]);
        let rate = |arm: usize, level: usize| curve::rate(outcomes, Some((n, level)), arm, outcome);
        let points =
            |arm: usize| (0..axis.levels.len()).filter_map(|level| Some((place(level), rate(arm, level)?))).collect();
        let lines =
            outcomes.arms.iter().enumerate().map(|(arm, name)| Line { name: name.clone(), points: points(arm) });
        Figure {
            title: format!("{} over {}", outcome.label(), axis.name),
            axis: axis.name.clone(),
            categories: numbers.is_none().then(|| axis.levels.iter().map(ToString::to_string).collect()),
            lines: lines.filter(|line| !line.points.is_empty()).collect(),
        }
    };
    let shown = axes.iter().enumerate().filter(|(_, axis)| axis.levels.len() > 1);
    shown
        .map(|(n, axis)| {
            (axis, [ReportedOutcome::CleanSuccess, ReportedOutcome::Contact].map(|outcome| figure(n, axis, outcome)))
        })
        .collect()
}

fn contrasts(outcomes: &Outcomes, axes: &[PlannedAxis]) -> Vec<Contrast> {
    let mut rows = Vec::new();
    let mut places = vec![(None, ALL_POINTS.to_owned())];
    for (n, axis) in axes.iter().enumerate().filter(|(_, axis)| axis.levels.len() > 1) {
        places.extend(
            axis.levels.iter().enumerate().map(|(level, value)| (Some((n, level)), format!("{} = {value}", axis.name))),
        );
    }
    let touch = outcomes.arms.iter().position(|arm| arm == "touch");
    // The base is touch if it was run, else the first arm.
    let base = touch.unwrap_or(0);
    for (arm, name) in outcomes.arms.iter().enumerate().filter(|(arm, _)| *arm != base) {
        for (of, at) in &places {
            for outcome in ReportedOutcome::ALL {
                rows.extend(curve::contrast_arms(outcomes, *of, (base, arm), outcome).map(|estimate| Contrast {
                    what: format!("{} - {name}", outcomes.arms[base]),
                    at: at.clone(),
                    outcome: outcome.name(),
                    estimate,
                }));
            }
        }
    }
    for (n, axis) in axes.iter().enumerate() {
        for level in 1..axis.levels.len() {
            for (arm, name) in outcomes.arms.iter().enumerate() {
                for outcome in ReportedOutcome::ALL {
                    rows.extend(curve::contrast_levels(outcomes, n, (level, 0), arm, outcome).map(|estimate| {
                        Contrast {
                            what: format!("{}: {} - {}", axis.name, axis.levels[level], axis.levels[0]),
                            at: name.clone(),
                            outcome: outcome.name(),
                            estimate,
                        }
                    }));
                }
            }
        }
    }
    rows
}

fn contrast_table(contrasts: &[Contrast]) -> HtmlTable {
    let head = [
        ("contrast", ColumnAlignment::Words),
        ("at", ColumnAlignment::Words),
        ("outcome", ColumnAlignment::Words),
        ("difference", ColumnAlignment::Numbers),
        ("95 %", ColumnAlignment::Numbers),
        ("pairs of trials", ColumnAlignment::Numbers),
    ];
    let mut table = HtmlTable::new("Paired by trial; all outcomes are in contrasts.csv", &head);
    for row in contrasts.iter().filter(|row| row.outcome == ReportedOutcome::CleanSuccess.name()) {
        let cells = [
            row.what.clone(),
            row.at.clone(),
            ReportedOutcome::CleanSuccess.label().to_owned(),
            format_number(row.estimate.value, 3),
            interval(&row.estimate),
            row.estimate.n.to_string(),
        ];
        table.row(&cells);
    }
    table
}

/// Formats a table as CSV, one estimate per row with its value in the column `value`.
fn comma_separated<'a, const N: usize>(
    (head, value): ([&str; N], &str),
    rows: impl Iterator<Item = ([&'a str; N], &'a RateEstimate)>,
) -> Result<Vec<u8>> {
    let maybe = |value: Option<f64>| value.map_or(String::new(), |value| value.to_string());
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(head.into_iter().chain([value, "low", "high", "n"]))?;
    for (words, of) in rows {
        let numbers = [of.value.to_string(), maybe(of.low), maybe(of.high), of.n.to_string()];
        writer.write_record(words.into_iter().chain(numbers.iter().map(String::as_str)))?;
    }
    Ok(writer.into_inner()?)
}

/// Replays the recorded times of a sweep's units on more cores and writes `makespan.html`. The times are repeated until
/// there are `trials`; `join` neighbouring units are taken as one.
pub fn makespan(folder: &SweepFolder, trials: Option<usize>, join: usize) -> Result<(Vec<MakespanPoint>, String)> {
    let file = folder.path.join("merged/units.csv");
    let text = std::fs::read_to_string(&file)
        .with_context(|| format!("{}: found no times, expected those of `ftac sweep merge`", file.display()))?;
    let mut recorded = Vec::new();
    for (n, row) in text.lines().enumerate().skip(1) {
        let cells: Vec<&str> = row.split(',').collect();
        let count = cells.get(3).and_then(|cell| cell.parse::<usize>().ok());
        let seconds = cells.get(4).and_then(|cell| cell.parse::<f64>().ok()).filter(|seconds| seconds.is_finite());
        match count.zip(seconds) {
            Some(unit) => recorded.push(unit),
            None => bail!("{}:{}: found `{row}`, expected unit,point,seed,trials,seconds", file.display(), n + 1),
        }
    }
    let own: usize = recorded.iter().map(|(count, _)| count).sum();
    if own == 0 {
        bail!("{}: found no finished unit, expected at least one", file.display());
    }
    if let Some(found) = trials.filter(|found| !(1..=MAX_TRIALS as usize).contains(found)) {
        bail!("--trials: found {found}, expected 1 to {MAX_TRIALS}");
    }
    let wanted = trials.unwrap_or(own).max(own);
    let mut units = Vec::new();
    let mut count = 0;
    for (trials, seconds) in recorded.iter().cycle() {
        if count >= wanted {
            break;
        }
        units.push(*seconds);
        count += trials;
    }
    let units: Vec<f64> = units.chunks(join).map(|units| units.iter().sum()).collect();
    let assumed = Assumptions::TYPICAL;
    let points: Vec<MakespanPoint> = CORE_COUNTS.iter().map(|cores| replay(&units, *cores, &assumed)).collect();
    let work: f64 = units.iter().sum();
    let longest = units.iter().copied().fold(0.0, f64::max);
    let mut said =
        format!("{:>6} {:>16} {:>11} {:>8} {:>14}\n", "cores", "makespan", "efficiency", "tail", "operations/s");
    let head = [
        ("cores", ColumnAlignment::Numbers),
        ("makespan", ColumnAlignment::Numbers),
        ("efficiency", ColumnAlignment::Numbers),
        ("tail", ColumnAlignment::Numbers),
        ("file system, operations/s", ColumnAlignment::Numbers),
    ];
    let mut table = HtmlTable::new("Replay", &head);
    for point in &points {
        let cells = [
            point.cores.to_string(),
            format_duration(point.makespan_s),
            format_number(point.efficiency, 3),
            format_number(point.tail, 3),
            format_number(point.operations_per_s, 2),
        ];
        table.row(&cells);
        let _ = writeln!(
            said,
            "{:>6} {:>16} {:>11.3} {:>8.3} {:>14.2}",
            point.cores,
            format_duration(point.makespan_s),
            point.efficiency,
            point.tail,
            point.operations_per_s
        );
    }
    let useful = points.iter().filter(|point| point.efficiency >= 0.8).map(|point| point.cores).max();
    let limit = useful.map_or("On none of these numbers of cores".to_owned(), |cores| format!("Up to {cores} cores"));
    let start = assumed.start_s;
    let body = html! {
        p {
            (format_duration(work)) " of work in " (count_with_noun(units.len(), "unit")) " (" (count_with_noun(count, "trial")) "), the longest " (format_duration(longest)) ". "
            (limit) " at least 80 % of the cores' time is work; with more, each worker has too few units: the end is one unit's time, and "
            (count_with_noun(CORE_COUNTS[CORE_COUNTS.len() - 1], "worker")) " begin only after " (start) " s of start."
        }
        (table)
        h2 { "Assumptions" }
        ul {
            li {
                "Times are those recorded during the run of the units, in the plan's order"
                @if wanted > own { ", repeated until there are as many trials" }
                @if join > 1 { ", " (join) " neighbours taken as one unit" }
                "; they are valid for this kind of core under this load."
            }
            li { "A worker starts " (start) " s after its submission; hours in a real queue are not included." }
            li {
                (assumed.operations) " metadata operations of the file system per unit (claim, two temporary files, renames, removal), and one search per \
                worker in the folder, " (assumed.looks) " operations per unit of the plan; the server does " (assumed.operations_per_s)
                " per second, one after the other."
            }
            li { "No node is lost. A lost one costs its unit in progress, and the wait until Slurm requeues it." }
        }
    };
    let out = folder.path.join("makespan.html");
    write_atomically(&out, whole_page(&format!("More cores: {}", folder.plan.name), &body).as_bytes())?;
    let _ = writeln!(said, "page: {}", out.display());
    Ok((points, said))
}
