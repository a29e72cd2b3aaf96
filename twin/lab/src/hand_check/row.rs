//! One line of the check: what, ours, the paper's, how, and whether it is good.

use schemars::JsonSchema;
use serde::Serialize;

/// How a check came out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Within the tolerance.
    Good,
    /// Not within it.
    FallsShort,
}

impl Verdict {
    pub fn of(good: bool) -> Self {
        if good { Self::Good } else { Self::FallsShort }
    }
}

/// A row of the table.
#[derive(Debug, Clone, Serialize, JsonSchema)]
pub struct Row {
    /// What is compared.
    pub what: String,
    /// Our figure.
    pub ours: String,
    /// The paper's.
    pub paper: String,
    /// How our figure was measured, and the tolerance.
    pub method: String,
    /// How it came out.
    pub verdict: Verdict,
    /// The picture's file name.
    pub picture: Option<String>,
    /// Figures behind the row.
    pub details: serde_json::Value,
}

impl Row {
    /// A row without picture and details.
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

    /// The same row with details.
    pub fn with(self, details: serde_json::Value) -> Self {
        Self { details, ..self }
    }
}

/// The table as text.
pub fn table(rows: &[Row]) -> String {
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
