//! Panels c and d of the paper's figure on adaptive behaviours: collisions and successes by two counts, beside the
//! paper's values.

mod count;
mod statements;

use maud::{Markup, html};
use scenarios::summary::Summary;
use scenarios::{Condition, TrialRecord};
use serde_json::Value;
use statistics::{PairedDifference, TTest, paired_t_test};

use self::count::{CollisionCount, RateSample};
use super::chart::color;
use super::comparisons::format_with_interval;
use super::figure::{Figure, Group};
use super::findings::format_test;
use super::html::{ColumnAlignment, HtmlTable, count_with_noun, format_number, format_probability};
use super::{paper, run};

/// A panel with at least one condition that was run.
pub struct Panel {
    letter: char,
    /// Name of the rate, beside the letter.
    rate: &'static str,
    /// Conditions with their samples; the test asks whether the second has the larger mean.
    sides: Vec<PanelSide>,
    /// One test per count that both conditions have.
    tests: Vec<(CollisionCount, TTest)>,
    pub figure: Figure,
}

/// A condition of a panel.
struct PanelSide {
    condition: Condition,
    /// The paper's name of its rate.
    rate_name: &'static str,
    /// The paper's mean and standard deviation.
    paper: (f64, f64),
    samples: Vec<RateSample>,
}

/// Predicate of a counted trial; `None` if it does not apply to a trial.
type CountedPredicate = fn(CollisionCount, &TrialRecord) -> Option<bool>;

/// Returns the panels that can be drawn from `records`.
pub fn drawable_panels(records: &[TrialRecord]) -> Vec<Panel> {
    let collisions = [
        (Condition::Ideal, "collision rate, perfect execution", paper::COLLISION_IDEAL),
        (Condition::Blind, "collision rate, real-world execution", paper::COLLISION_BLIND),
    ];
    let successes = [
        (Condition::Blind, "success rate without tactile feedback", paper::SUCCESS_BLIND),
        (Condition::Touch, "success rate with tactile feedback", paper::SUCCESS_TOUCH),
    ];
    let both = [
        ('c', "collision rate", collisions, CollisionCount::collided as CountedPredicate),
        ('d', "success rate", successes, CollisionCount::succeeded),
    ];
    both.into_iter()
        .filter_map(|(letter, rate, sides, counted)| {
            let side = |(condition, words, paper)| PanelSide {
                condition,
                rate_name: words,
                paper,
                samples: CollisionCount::ALL
                    .into_iter()
                    .filter_map(|count| RateSample::from_records(records, condition, count, counted))
                    .collect(),
            };
            let sides: Vec<PanelSide> = sides.map(side).into_iter().filter(|side| !side.samples.is_empty()).collect();
            (!sides.is_empty()).then(|| Panel::new(letter, rate, sides))
        })
        .collect()
}

impl Panel {
    fn new(letter: char, rate: &'static str, sides: Vec<PanelSide>) -> Self {
        let tests = match &sides[..] {
            [less, more] => CollisionCount::ALL
                .into_iter()
                .filter_map(|count| Some((count, paired_t_test(&more.sample(count)?.paired(less.sample(count)?)))))
                .collect(),
            _ => Vec::new(),
        };
        let figure = figure(letter, rate, &sides, &tests);
        Self { letter, rate, sides, tests, figure }
    }

    /// Returns the name of its file.
    pub fn file(&self) -> String {
        format!("panel_{}.svg", self.letter)
    }

    fn test(&self, count: CollisionCount) -> Option<&TTest> {
        self.tests.iter().find(|(of, _)| *of == count).map(|(_, test)| test)
    }
}

impl PanelSide {
    fn sample(&self, count: CollisionCount) -> Option<&RateSample> {
        self.samples.iter().find(|sample| sample.count == count)
    }

    /// Returns its columns: the paper's, then one per count.
    fn groups(&self) -> impl Iterator<Item = (Option<CollisionCount>, Group)> {
        let paper = Group {
            name: format!("{}: paper", self.condition),
            color: color("soft"),
            dots: Vec::new(),
            count: paper::COMBINATION_COUNT,
            mean_sd: Some(self.paper),
        };
        let ours = self.samples.iter().map(|sample| {
            let group = Group {
                name: format!("{}: {}", self.condition, sample.count.name()),
                color: color(self.condition.name()),
                dots: sample.rates.iter().map(|one| (one.rate, one.name.clone())).collect(),
                count: sample.rates.len(),
                mean_sd: Some(sample.mean_sd()),
            };
            (Some(sample.count), group)
        });
        std::iter::once((None, paper)).chain(ours)
    }
}

/// Formats the paper's test as in the paper.
fn paper_test() -> String {
    format!(
        "t({:.0}) = {}, p = {}",
        paper::DEGREES_OF_FREEDOM,
        format_number(paper::T_STATISTIC, 1),
        format_probability(paper::P_VALUE)
    )
}

fn figure(letter: char, rate: &str, sides: &[PanelSide], tests: &[(CollisionCount, TTest)]) -> Figure {
    let columns: Vec<(usize, Option<CollisionCount>, Group)> = sides
        .iter()
        .enumerate()
        .flat_map(|(n, side)| side.groups().map(move |(count, group)| (n, count, group)))
        .collect();
    let place =
        |side: usize, count: Option<CollisionCount>| columns.iter().position(|(n, of, _)| (*n, *of) == (side, count));
    let paper = (None, format!("paper: {}", paper_test()));
    let ours = tests
        .iter()
        .filter_map(|(count, test)| Some((Some(*count), format!("{}: {}", count.name(), format_test(test)?))));
    let brackets = std::iter::once(paper)
        .chain(ours)
        .filter_map(|(count, text)| Some((place(0, count)?, place(1, count)?, text)))
        .collect();
    let means =
        columns.iter().filter_map(|(.., group)| Some(format!("{} {}", group.name, format_number(group.mean_sd?.0, 3))));
    Figure {
        title: format!("Panel {letter}: {rate} of each object combination"),
        axis: rate.to_owned(),
        description: format!("Box plots of the {rate}; means: {}", means.collect::<Vec<_>>().join("; ")),
        groups: columns.into_iter().map(|(.., group)| group).collect(),
        brackets,
    }
}

/// Returns the section of the page; empty if no panel can be drawn.
pub fn section(panels: &[Panel], summary: &Summary, records: &[TrialRecord], about: &Value) -> Markup {
    html! { @if !panels.is_empty() {
        h2 id="paper" { "Beside the paper: its figure on adaptive behaviours" }
        p {
            "The paper predicts a collision: the object in the hand, at its pose estimate, overlaps the next one in its planned place. "
            em { "Contact" } " counts what happened in the trial, an unwanted contact in physics; success is then clean success. " em { "Predicted" }
            " counts as the paper does: a trial collides if the object in the hand, at its pose estimate at the first decision, overlaps the second one in its \
            place at the planned grasp, and succeeds if it does not at the executed grasp. Trials without a pose estimate of the first object in the \
            hand have no prediction."
        }
        @if !panels.iter().any(|panel| panel.sides.iter().any(|side| side.sample(CollisionCount::Predicted).is_some())) {
            p.short { "Nothing is predicted: the records of this run lack the columns plan_separation_mm and chosen_separation_mm." }
        }
        div.figures { @for panel in panels { figure {
            (panel.figure.draw())
            figcaption {
                "Panel " (panel.letter) " of the paper’s figure: " (panel.rate) ". A dot is one of "
                (count_with_noun(summary.combos, "combination")) "; box, diamond, whiskers and shading as in the figures below. Grey: the paper’s mean, with \
                whiskers of one standard deviation, as no more is given. Brackets: paired one-sided t-tests. Also as "
                a href=(panel.file()) { (panel.file()) } "."
            }
        } } }
        (table(panels))
        @if let Some(command) = about.get("command").and_then(run::command_line) {
            p { "All simulated values are from one run: " code { (command) } "." }
        }
        (statements::section(summary, records))
    } }
}

/// Returns both panels in numbers.
fn table(panels: &[Panel]) -> HtmlTable {
    let head = [
        ("panel", ColumnAlignment::Words),
        ("rate", ColumnAlignment::Words),
        ("paper: M (SD)", ColumnAlignment::Numbers),
        ("ours, contact: mean [95 %] (SD)", ColumnAlignment::Numbers),
        ("ours, predicted: mean [95 %] (SD)", ColumnAlignment::Numbers),
        ("trials predicted", ColumnAlignment::Numbers),
    ];
    let mut table = HtmlTable::new("Panels c and d in numbers: over combinations, bootstrap intervals", &head);
    let dash = || "–".to_owned();
    for panel in panels {
        for side in &panel.sides {
            let ours = |count: CollisionCount| {
                side.sample(count).map_or_else(dash, |sample| {
                    let rates: Vec<(f64, f64)> = sample.rates.iter().map(|one| (one.rate, 0.0)).collect();
                    format!(
                        "{} ({})",
                        format_with_interval(&PairedDifference::from_pairs(&rates).difference, 3),
                        format_number(sample.mean_sd().1, 3)
                    )
                })
            };
            let predicted =
                side.sample(CollisionCount::Predicted).map_or_else(dash, |sample| sample.trials.to_string());
            let (mean, sd) = side.paper;
            table.row(&[
                panel.letter.to_string(),
                format!("{} ({})", side.rate_name, side.condition),
                format!("{} ({})", format_number(mean, 3), format_number(sd, 3)),
                ours(CollisionCount::Contact),
                ours(CollisionCount::Predicted),
                predicted,
            ]);
        }
        if let [less, more] = &panel.sides[..] {
            let test = |count: CollisionCount| {
                let why = |test: &TTest| format!("none: {}", test.reason().unwrap_or_default());
                panel.test(count).map_or_else(dash, |test| format_test(test).unwrap_or_else(|| why(test)))
            };
            let question = format!("more {} than {}?", more.condition, less.condition);
            let [contact, predicted] = CollisionCount::ALL.map(test);
            table.row(&[panel.letter.to_string(), question, paper_test(), contact, predicted, dash()]);
        }
    }
    table
}
