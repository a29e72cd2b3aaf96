//! One row of a check: quantity, measured figure, the paper's, the method, and the verdict.

use schemars::JsonSchema;
use serde::Serialize;

/// Verdict on a check.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Within the tolerance.
    Good,
    /// Outside the tolerance.
    FallsShort,
}

impl Verdict {
    pub fn from_good(good: bool) -> Self {
        if good { Self::Good } else { Self::FallsShort }
    }
}

/// A row of the table.
#[derive(Debug, Clone, Serialize, JsonSchema)]
pub struct CheckRow {
    /// Compared quantity.
    pub what: String,
    /// Measured figure.
    pub ours: String,
    /// The paper's figure.
    pub paper: String,
    /// Method by which the figure was measured, with the tolerance.
    pub method: String,
    /// Verdict on the measured figure.
    pub verdict: Verdict,
    /// File name of the picture.
    pub picture: Option<String>,
    /// Figures behind the row.
    pub details: serde_json::Value,
}

impl CheckRow {
    /// Creates a row without picture and details.
    pub fn new(what: &str, ours: String, paper: &str, method: &str, verdict: Verdict) -> Self {
        Self {
            what: what.into(),
            ours,
            paper: paper.into(),
            method: method.into(),
            verdict,
            picture: None,
            details: serde_json::Value::Null,
        }
    }

    /// Adds details to the row.
    pub fn with_details(self, details: serde_json::Value) -> Self {
        Self { details, ..self }
    }
}

/// Returns the table as text.
pub fn table(rows: &[CheckRow]) -> String {
    let mut text = String::new();
    for row in rows {
        let verdict = match row.verdict {
            Verdict::Good => "ok",
            Verdict::FallsShort => "FALLS SHORT",
        };
        text += &format!("{:34} {:>24}   beside: {:30} {verdict}\n", row.what, row.ours, row.paper);
        text += &format!("    {}\n", row.method);
        if let Some(picture) = &row.picture {
            text += &format!("    picture: {picture}\n");
        }
    }
    text
}
