//! Labels that people assign to grasps on the annotation page, and the agreement of two sets of labels.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use dexterous_grasping::taxonomy::Taxonomy;
use ftac_platform::data::DataError;

/// Version of the file that the annotation page exports.
pub const VERSION: u32 = 1;

/// The annotation page's export.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Labels {
    pub version: u32,
    pub annotator: String,
    /// Name of the type by grasp.
    pub labels: BTreeMap<String, String>,
}

impl Labels {
    /// Reads an export. Every label must be a type of `taxonomy`, for a grasp of `known`.
    pub fn parse(text: &str, path: &Path, taxonomy: &Taxonomy, known: &BTreeSet<&str>) -> Result<Self, DataError> {
        let labels: Self = serde_json::from_str(text).map_err(|error| DataError::Line {
            path: path.into(),
            line: error.line(),
            found: format!("something else ({error})"),
            expected: "the JSON export of the annotation page".into(),
        })?;
        let fault = |field: &str, found: String, expected: &str| Err(DataError::field(path, field, found, expected));
        if labels.version != VERSION {
            return fault("version", labels.version.to_string(), &VERSION.to_string());
        }
        if labels.labels.is_empty() {
            return fault("labels", "none".into(), "at least one");
        }
        for (grasp, kind) in &labels.labels {
            if !known.contains(grasp.as_str()) {
                return fault("labels", format!("{grasp:?}"), "a grasp of the repertoire");
            }
            if taxonomy.find(kind).is_none() {
                return fault(&format!("labels.{grasp}"), format!("{kind:?}"), "one of the types' names");
            }
        }
        Ok(labels)
    }
}

/// Agreement of two raters on the same items.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub struct Agreement {
    /// Number of items rated by both.
    pub items: usize,
    /// Share of equal ratings.
    pub observed: f64,
    /// Share expected by chance from the raters' own frequencies.
    pub expected: f64,
    /// Cohen's kappa, (observed - expected) / (1 - expected); `None` if chance alone would always agree.
    pub kappa: Option<f64>,
}

/// Computes Cohen's kappa of pairs of ratings with `kinds` classes. Returns `None` without pairs.
pub fn agreement(pairs: &[(usize, usize)], kinds: usize) -> Option<Agreement> {
    if pairs.is_empty() {
        return None;
    }
    let n = pairs.len() as f64;
    let (mut first, mut second) = (vec![0.0; kinds], vec![0.0; kinds]);
    for &(a, b) in pairs {
        first[a] += 1.0 / n;
        second[b] += 1.0 / n;
    }
    let observed = pairs.iter().filter(|(a, b)| a == b).count() as f64 / n;
    let expected: f64 = first.iter().zip(&second).map(|(a, b)| a * b).sum();
    let kappa = (expected < 1.0 - 1e-12).then(|| (observed - expected) / (1.0 - expected));
    Some(Agreement { items: pairs.len(), observed, expected, kappa })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A textbook example: 20 yes/yes, 5 yes/no, 10 no/yes, 15 no/no give 0.4.
    #[test]
    fn kappa_of_a_textbook_example() {
        let times = |n: usize, pair: (usize, usize)| std::iter::repeat_n(pair, n);
        let pairs: Vec<_> =
            times(20, (0, 0)).chain(times(5, (0, 1))).chain(times(10, (1, 0))).chain(times(15, (1, 1))).collect();
        let found = agreement(&pairs, 2).expect("pairs");
        assert!((found.observed - 0.7).abs() < 1e-12 && (found.expected - 0.5).abs() < 1e-12);
        assert!((found.kappa.expect("defined") - 0.4).abs() < 1e-12);
    }

    #[test]
    fn ends_of_the_scale() {
        let kappa = |pairs: &[(usize, usize)]| agreement(pairs, 3).and_then(|found| found.kappa);
        assert!((kappa(&[(0, 0), (1, 1), (2, 2)]).expect("defined") - 1.0).abs() < 1e-12);
        assert!(kappa(&[(0, 1), (1, 0)]).expect("defined") < -0.99);
        assert_eq!(kappa(&[(1, 1), (1, 1)]), None, "one class only: chance agrees always");
        assert_eq!(agreement(&[], 3), None);
    }

    #[test]
    fn what_does_not_exist_is_named() {
        let taxonomy = Taxonomy::paper();
        let known = BTreeSet::from(["ball/1", "ball/2"]);
        let read = |labels: &str| {
            let text = format!("{{\"version\":1,\"annotator\":\"x\",\"labels\":{{{labels}}}}}");
            Labels::parse(&text, Path::new("l.json"), &taxonomy, &known).map_err(|error| error.to_string())
        };
        assert!(read("\"ball/1\":\"Ring\"").is_ok());
        for (labels, named) in
            [("\"ball/7\":\"Ring\"", "ball/7"), ("\"ball/1\":\"Rung\"", "Rung"), ("", "at least one")]
        {
            let error = read(labels).expect_err("bad");
            assert!(error.contains("l.json") && error.contains(named), "{error}");
        }
    }
}
