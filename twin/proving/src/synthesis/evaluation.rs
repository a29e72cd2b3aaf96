//! How well synthesis works: rates with intervals, negative controls, and how well each metric predicts that a grasp holds.
//!
//! Metrics and controls look at plain closings, of which nothing is selected: every chain's one sample is closed if it can be,
//! and every closed grasp takes every check. What further closings add is a rate of its own.

use std::collections::BTreeMap;
use std::time::Instant;

use anyhow::Result;
use rayon::prelude::*;
use scenarios::statistics::{Rate, roc_area};
use serde::Serialize;
use sim::hand_scene::Pull;

use super::checks;
use super::synthesizer::{ChainResult, Checked, Synthesizer};

/// Friction coefficient of the slippery control.
const SLIPPERY: f64 = 0.1;

/// What `eval` prints.
#[derive(Debug, Clone, Serialize)]
pub struct Evaluation {
    pub object: String,
    /// Chains that ended in a closed grasp.
    pub found: Rate,
    /// (a), (b), (c) and all three at the plain closing, and all three after all closings tried, of all chains.
    pub verified: BTreeMap<&'static str, Rate>,
    /// The holding test on the grasps that passed it, without tension and with little friction: should fail.
    pub controls: BTreeMap<&'static str, Rate>,
    /// Area under the ROC curve of each metric for holding, over the closed grasps.
    pub roc_area: BTreeMap<&'static str, Option<f64>>,
    /// s.
    pub wall_s: f64,
}

impl Evaluation {
    /// The evaluation in words.
    pub fn text(&self) -> String {
        let row = |name: &str, rate: &Rate| match rate.rate {
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

struct Row {
    verdicts: [bool; 3],
    metrics: [f64; 5],
    controls: Option<[bool; 2]>,
}

/// Metric names, in the order of `Row::metrics`; all are higher for better grasps.
const METRICS: [&str; 5] = ["margin", "energy", "balance", "total_force", "contacts"];

fn row(checked: &Checked) -> Row {
    let verdicts = checked.verdicts();
    let terms = &checked.sample.terms;
    let touches = &checked.closed.touches;
    let controls = verdicts[2].then(|| {
        let slack = Pull { tensions: [0.0; 5], ..checked.closed.pull };
        let mut slippery = checked.closed.scene.clone();
        slippery.set_friction(SLIPPERY);
        [
            checks::hold(&checked.closed.scene, &slack, checked.mass).held,
            checks::hold(&slippery, &checked.closed.pull, checked.mass).held,
        ]
    });
    let force = touches.iter().map(|touch| touch.force).sum();
    let metrics = [checked.margin, -terms.total, -terms.balance, force, touches.len() as f64];
    Row { verdicts, metrics, controls }
}

/// Runs `chains` chains and evaluates them.
pub fn evaluate(synthesizer: &Synthesizer, chains: u64) -> Result<Evaluation> {
    let start = Instant::now();
    let run = |chain| {
        let result: ChainResult = synthesizer.run(chain)?;
        let row = result.plain.as_ref().ok().map(row);
        Ok((row, result.grasp().is_ok_and(Checked::verified)))
    };
    let rows: Vec<(Option<Row>, bool)> = (0..chains).into_par_iter().map(run).collect::<Result<_>>()?;
    let closed: Vec<&Row> = rows.iter().filter_map(|(row, _)| row.as_ref()).collect();
    let in_the_end = rows.iter().filter(|(_, verified)| *verified).count() as u64;
    let rate =
        |passed: &dyn Fn(&Row) -> bool| Rate::new(closed.iter().filter(|row| passed(row)).count() as u64, chains);
    let control = |n: usize| {
        let tried: Vec<bool> = closed.iter().filter_map(|row| row.controls.map(|held| held[n])).collect();
        Rate::new(tried.iter().filter(|held| **held).count() as u64, tried.len() as u64)
    };
    let area = |n: usize| roc_area(&closed.iter().map(|row| (row.metrics[n], row.verdicts[2])).collect::<Vec<_>>());
    Ok(Evaluation {
        object: synthesizer.subject.model.name.clone(),
        found: Rate::new(closed.len() as u64, chains),
        verified: BTreeMap::from([
            ("a", rate(&|row| row.verdicts[0])),
            ("b", rate(&|row| row.verdicts[1])),
            ("c", rate(&|row| row.verdicts[2])),
            ("all", rate(&|row| row.verdicts == [true; 3])),
            ("all, closings tried", Rate::new(in_the_end, chains)),
        ]),
        controls: BTreeMap::from([("no_tension", control(0)), ("friction_0.1", control(1))]),
        roc_area: METRICS.iter().enumerate().map(|(n, name)| (*name, area(n))).collect(),
        wall_s: start.elapsed().as_secs_f64(),
    })
}
