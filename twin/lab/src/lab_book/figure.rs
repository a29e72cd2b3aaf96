//! One measured scalar, and how it came about.

use std::fmt;
use std::str::FromStr;

/// A decimal number that is shown as it was written: its digits say how precisely it is known.
#[derive(Debug, Clone, PartialEq)]
pub struct Number {
    text: String,
    value: f64,
}

impl Number {
    pub fn value(&self) -> f64 {
        self.value
    }
}

impl FromStr for Number {
    type Err = String;

    /// Only finite decimal numbers; the error is what was found.
    fn from_str(text: &str) -> Result<Self, String> {
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(Self { text: text.to_owned(), value }),
            _ => Err(format!("`{text}`")),
        }
    }
}

impl fmt::Display for Number {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

/// Whether the machine did anything else during the measurement; decides how far a time can be trusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Idle {
    Yes,
    No,
    Unknown,
}

/// A row of the table. Texts may be empty where nothing is known.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// Line of the table, counted from 1.
    pub line: u64,
    /// Stable name, such as `bench.touch.success.mean`.
    pub id: String,
    pub value: Number,
    pub unit: String,
    /// 95 % interval, unless the note says otherwise.
    pub interval: Option<(Number, Number)>,
    /// Samples behind the value: trials, grasps, images, pixels.
    pub n: Option<u64>,
    /// Seed, or first and last of several.
    pub seed: Option<(u64, u64)>,
    /// The commit that first states the figure.
    pub commit: String,
    pub machine: String,
    pub idle: Idle,
    /// What measures it again: one command, or several separated by `;`.
    pub command: String,
    /// `id@commit` of the figure that this one replaces.
    pub supersedes: String,
    /// Heading on the page.
    pub group: String,
    /// What was measured, in plain words.
    pub label: String,
    /// The paper's figure, or another source's, which is then named.
    pub paper: String,
    pub goal: String,
    pub note: String,
}
