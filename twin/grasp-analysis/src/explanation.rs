//! Explanation of a grasp's type: every condition of the best and of the second best type, with the margin by which it
//! is met.

use std::fmt::Write as _;

use schemars::JsonSchema;
use serde::Serialize;

use crate::classification::{Classification, ClassifiedGrasp};
use dexterous_grasping::taxonomy::rules::CheckedCondition;

/// Reasons for the type of a grasp.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Explanation<'a> {
    /// Name of the grasp.
    id: &'a str,
    /// Grasp type of the paper.
    #[serde(rename = "type")]
    kind: &'a str,
    /// Margin by which all of its conditions are met. Negative if they are not.
    margin: f64,
    /// True if the type is not clear.
    ambiguous: bool,
    /// One entry per condition of the type.
    conditions: Vec<CheckedCondition>,
    /// Second best type.
    second: &'a str,
    second_margin: f64,
    /// One entry per condition of the second best type.
    second_conditions: Vec<CheckedCondition>,
}

impl<'a> Explanation<'a> {
    pub fn new(classification: &'a Classification, grasp: &'a ClassifiedGrasp) -> Self {
        let (types, decision) = (&classification.taxonomy.types, &grasp.decision);
        let conditions = |kind: usize| classification.rules.explain(kind, &grasp.attributes);
        Self {
            id: &grasp.id,
            kind: &types[decision.kind].name,
            margin: decision.margin,
            ambiguous: decision.ambiguous,
            conditions: conditions(decision.kind),
            second: &types[decision.second.0].name,
            second_margin: decision.second.1,
            second_conditions: conditions(decision.second.0),
        }
    }
}

/// Formats the reasons as text with a line per condition.
pub fn text(classification: &Classification, grasp: &ClassifiedGrasp) -> String {
    let (types, decision, rules) = (&classification.taxonomy.types, &grasp.decision, &classification.rules);
    let verdict = if decision.ambiguous { ", ambiguous" } else { "" };
    let mut text = format!("{}: {} (margin {:.2}{verdict})\n", grasp.id, types[decision.kind].name, decision.margin);
    for kind in [decision.kind, decision.second.0] {
        if kind != decision.kind {
            let _ = writeln!(text, "next best: {} (margin {:.2})", types[kind].name, decision.second.1);
        }
        for check in rules.explain(kind, &grasp.attributes) {
            let mark = if check.margin < 0.0 {
                "no "
            } else if check.margin < rules.clear {
                "bare"
            } else {
                "yes"
            };
            let _ = writeln!(
                text,
                "  {mark:4} {:16} {:6.2}, asked {:12} margin {:5.2}  {}",
                check.attribute, check.value, check.bounds, check.margin, check.reason
            );
        }
    }
    text
}
