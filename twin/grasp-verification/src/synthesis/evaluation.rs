//! Evaluation of the synthesis: rates with intervals, negative controls, and the prediction of holding by each metric.
//!
//! Metrics and controls use plain closings, of which nothing is selected: every chain's one sample is closed if
//! possible, and every closed grasp takes every check. The gain of further closings is a rate of its own.

use std::collections::BTreeMap;
use std::time::Instant;

use anyhow::Result;
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::Serialize;
use statistics::{SuccessRate, roc_area};

use super::checks;
use super::closing::ClosedGrasp;
use super::synthesizer::{ChainResult, CheckedGrasp, Synthesizer};

/// Friction coefficient of the slippery control.
const SLIPPERY_FRICTION: f64 = 0.1;

/// Evaluation of the synthesis on one object, as `eval` prints it.
#[derive(Debug, Clone, Serialize, JsonSchema)]
pub struct Evaluation {
    pub object: String,
    /// Chains that ended in a closed grasp.
    pub found: SuccessRate,
    /// Rates of (a) the friction-cone margin, (b) penetration, (c) the holding test and all three at the plain closing,
    /// and of all three after all closings tried, out of all chains.
    pub verified: BTreeMap<&'static str, SuccessRate>,
    /// Negative controls: the holding test on the grasps that passed it, without tension and with little friction. Both
    /// should fail.
    pub controls: BTreeMap<&'static str, SuccessRate>,
    /// Area under the ROC curve of each metric for holding, over the closed grasps.
    pub roc_area: BTreeMap<&'static str, Option<f64>>,
    /// Wall time, s.
    pub wall_s: f64,
}

impl Evaluation {
    /// Formats the evaluation as text.
    pub fn text(&self) -> String {
        let row = |name: &str, rate: &SuccessRate| match rate.rate {
            Some(p) => {
                let (p, low, high) = (100.0 * p, 100.0 * rate.low, 100.0 * rate.high);
                format!("{name:24} {:5} of {:5} = {p:5.1} % [{low:.1}, {high:.1}]\n", rate.count, rate.of)
            }
            None => format!("{name:24} nothing to count\n"),
        };
        let mut text = format!("{}: rates with Wilson 95 % intervals, {:.1} s\n", self.object, self.wall_s);
        text += &row("closed", &self.found);
        self.verified.iter().for_each(|(name, rate)| text += &row(name, rate));
        self.controls.iter().for_each(|(name, rate)| text += &row(&format!("control {name}: held"), rate));
        for (name, area) in &self.roc_area {
            text += &format!("ROC area of {name:12} {}\n", area.map_or("-".into(), |area| format!("{area:.3}")));
        }
        text
    }
}

/// Results of one closed grasp.
pub(super) struct EvaluationRow {
    /// Verdicts of the checks (a), (b), (c).
    pub verdicts: [bool; 3],
    /// Metrics, in the order of the evaluation's names.
    pub metrics: Vec<f64>,
    /// True if the grasp still held without tension, and with little friction. `None` if it did not pass (c).
    pub controls: Option<[bool; 2]>,
}

/// Metric names, in the order of `EvaluationRow::metrics`. All are higher for better grasps.
const METRIC_NAMES: [&str; 5] = ["margin", "energy", "balance", "total_force", "contacts"];

fn row(checked: &CheckedGrasp) -> EvaluationRow {
    let verdicts = checked.verdicts();
    let terms = &checked.sample.terms;
    let touches = &checked.closed.touches;
    let controls = verdicts[2].then(|| controls(&checked.closed, checked.mass));
    let force = touches.iter().map(|touch| touch.force).sum();
    let metrics = vec![checked.margin, -terms.total, -terms.balance, force, touches.len() as f64];
    EvaluationRow { verdicts, metrics, controls }
}

/// Runs the negative controls on a closed grasp of an object of `mass` (kg): returns true if it holds without tension,
/// and with little friction.
pub(super) fn controls(closed: &ClosedGrasp, mass: f64) -> [bool; 2] {
    let mut slippery = closed.clone();
    slippery.scene.set_friction(SLIPPERY_FRICTION);
    [checks::run_hold_test(&closed.slack(), mass).held, checks::run_hold_test(&slippery, mass).held]
}

/// Runs `chains` chains and evaluates them.
pub fn evaluate(synthesizer: &Synthesizer<'_>, chains: u64) -> Result<Evaluation> {
    let start = Instant::now();
    let run = |chain| {
        let result: ChainResult = synthesizer.run(chain)?;
        let row = result.plain.as_ref().ok().map(row);
        Ok((row, result.grasp().is_ok_and(CheckedGrasp::verified)))
    };
    let rows: Vec<(Option<EvaluationRow>, bool)> = (0..chains).into_par_iter().map(run).collect::<Result<_>>()?;
    let in_the_end = rows.iter().filter(|(_, verified)| *verified).count() as u64;
    let rows: Vec<Option<EvaluationRow>> = rows.into_iter().map(|(row, _)| row).collect();
    let mut evaluation = summarize(&synthesizer.subject.model.name, &rows, &METRIC_NAMES);
    evaluation.verified.insert("all, closings tried", SuccessRate::new(in_the_end, chains));
    evaluation.wall_s = start.elapsed().as_secs_f64();
    Ok(evaluation)
}

/// Summarizes `rows`, with `None` for a grasp that did not close. `metrics` are the names of the rows' metrics.
pub(super) fn summarize(object: &str, rows: &[Option<EvaluationRow>], metrics: &[&'static str]) -> Evaluation {
    let (all, closed) = (rows.len() as u64, rows.iter().flatten().collect::<Vec<&EvaluationRow>>());
    let rate = |passed: &dyn Fn(&EvaluationRow) -> bool| {
        SuccessRate::new(closed.iter().filter(|row| passed(row)).count() as u64, all)
    };
    let control = |n: usize| {
        let tried: Vec<bool> = closed.iter().filter_map(|row| row.controls.map(|held| held[n])).collect();
        SuccessRate::new(tried.iter().filter(|held| **held).count() as u64, tried.len() as u64)
    };
    let area = |n: usize| roc_area(&closed.iter().map(|row| (row.metrics[n], row.verdicts[2])).collect::<Vec<_>>());
    Evaluation {
        object: object.into(),
        found: SuccessRate::new(closed.len() as u64, all),
        verified: BTreeMap::from([
            ("a", rate(&|row| row.verdicts[0])),
            ("b", rate(&|row| row.verdicts[1])),
            ("c", rate(&|row| row.verdicts[2])),
            ("all", rate(&|row| row.verdicts == [true; 3])),
        ]),
        controls: BTreeMap::from([("no_tension", control(0)), ("friction_0.1", control(1))]),
        roc_area: metrics.iter().enumerate().map(|(n, name)| (*name, area(n))).collect(),
        wall_s: 0.0,
    }
}
