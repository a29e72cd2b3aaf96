//! The pull of a landscape, calibrated to the metastability threshold of pairs of its minima and kept in a file.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use indicatif::ProgressBar;
use rand::RngExt;
use serde::{Deserialize, Serialize};

use super::attraction::{Attraction, stream};
use super::grasps::{GraspLandscape, GraspState};
use super::metastability::thresholds;

/// A calibration begins with this pull.
pub const STRONGEST: f64 = 40.0;
/// Pairs of minima, and trials for each pull and pair.
const PAIRS: usize = 16;
const TRIALS: usize = 6;

/// Thresholds of pairs of minima; kept, so that going on does not repeat the work.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    /// What was calibrated, in words.
    pub subject: String,
    /// Thresholds in increasing order; pairs out of reach even of [`STRONGEST`] have none.
    pub thresholds: Vec<f64>,
    /// Pairs that were tried.
    pub pairs: usize,
}

/// What can be wrong with the file of a calibration.
#[derive(Debug, thiserror::Error)]
pub enum CalibrationError {
    /// Not writable.
    #[error("cannot write {path}: {source}")]
    Write {
        /// The file.
        path: PathBuf,
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// Not what a calibration writes.
    #[error("{path}: {source}")]
    Format {
        /// The file.
        path: PathBuf,
        /// Where and what.
        source: serde_json::Error,
    },
}

impl Calibration {
    /// No calibration: the pull is given.
    pub fn none(subject: &str) -> Self {
        Self { subject: subject.to_owned(), thresholds: Vec::new(), pairs: 0 }
    }

    /// The median threshold.
    pub fn pull(&self) -> Option<f64> {
        self.thresholds.get(self.thresholds.len() / 2).copied()
    }

    /// The calibration in `file` if it is of the same subject and seed; otherwise a new one, which is written there.
    pub fn resume(
        landscape: &GraspLandscape,
        minima: &[GraspState],
        question: &Question<'_>,
        file: &Path,
        progress: &ProgressBar,
    ) -> Result<Self, CalibrationError> {
        let format = |source| CalibrationError::Format { path: file.into(), source };
        let subject = format!("{}, seed {}", question.subject, question.seed);
        if let Ok(text) = std::fs::read_to_string(file) {
            let known: Self = serde_json::from_str(&text).map_err(format)?;
            if known.subject == subject {
                return Ok(known);
            }
        }
        progress.suspend(|| writeln!(std::io::stderr(), "calibrating the pull on {PAIRS} pairs of minima").ok());
        let found = Self::measure(landscape, minima, question, subject);
        let text = serde_json::to_string_pretty(&found).map_err(format)?;
        platform::file::write_whole(file, text.as_bytes())
            .map_err(|source| CalibrationError::Write { path: file.into(), source })?;
        Ok(found)
    }

    fn measure(landscape: &GraspLandscape, minima: &[GraspState], question: &Question<'_>, subject: String) -> Self {
        let mut rng = stream(question.seed, [0, 0, 0, 9]);
        let pairs: Vec<(GraspState, GraspState)> = (0..PAIRS)
            .map(|_| {
                let first = rng.random_range(0..minima.len());
                let second = (first + rng.random_range(1..minima.len())) % minima.len();
                (minima[first].clone(), minima[second].clone())
            })
            .collect();
        let thresholds = thresholds(landscape, &pairs, &question.attraction, TRIALS, question.seed);
        Self { subject, thresholds, pairs: PAIRS }
    }
}

#[derive(Debug, Clone, Copy)]
pub struct Question<'a> {
    /// The minima, in words: a file of other ones does not count.
    pub subject: &'a str,
    /// The chains; their pull is where the search for the threshold begins.
    pub attraction: Attraction,
    pub seed: u64,
}
