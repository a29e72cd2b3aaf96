//! One measured scalar with its provenance.

use std::fmt;
use std::str::FromStr;

/// A decimal number that is shown as it was written: its digits indicate its precision.
#[derive(Debug, Clone, PartialEq)]
pub struct DecimalNumber {
    text: String,
    value: f64,
}

impl DecimalNumber {
    pub fn value(&self) -> f64 {
        self.value
    }
}

impl FromStr for DecimalNumber {
    type Err = String;

    /// Accepts finite decimal numbers only; the error is the text that was found.
    fn from_str(text: &str) -> Result<Self, String> {
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(Self { text: text.to_owned(), value }),
            _ => Err(format!("`{text}`")),
        }
    }
}

impl fmt::Display for DecimalNumber {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

/// Load of the machine during the measurement, which determines the reliability of a time: idle, busy, or unknown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MachineIdle {
    Yes,
    No,
    Unknown,
}

/// A row of the table. Texts may be empty if nothing is known.
#[derive(Debug, Clone, PartialEq)]
pub struct LabBookFigure {
    /// Line number in the table, counted from 1.
    pub line: u64,
    /// Stable name, such as `bench.touch.success.mean`.
    pub id: String,
    pub value: DecimalNumber,
    pub unit: String,
    /// 95 % interval, unless another one is noted.
    pub interval: Option<(DecimalNumber, DecimalNumber)>,
    /// Number of samples behind the value: trials, grasps, images, pixels.
    pub n: Option<u64>,
    /// Seed, or first and last of several.
    pub seed: Option<(u64, u64)>,
    /// Commit that first states the figure.
    pub commit: String,
    pub machine: String,
    pub idle: MachineIdle,
    /// Command that measures it again, or several separated by `;`.
    pub command: String,
    /// `id@commit` of the figure that this one replaces.
    pub supersedes: String,
    /// Heading on the page.
    pub group: String,
    /// Measured quantity, in plain words.
    pub label: String,
    /// The paper's figure, or that of another source, which is then named.
    pub paper: String,
    pub goal: String,
    pub note: String,
}
