//! The pull of a landscape, calibrated to the metastability threshold of pairs of its minima and kept in a file.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use indicatif::ProgressBar;
use rand::RngExt;
use serde::{Deserialize, Serialize};

use super::attraction::{AttractionSettings, chain_rng};
use super::grasps::{GraspLandscape, GraspState};
use super::metastability::thresholds;

/// Pull at which a calibration begins.
pub const INITIAL_PULL: f64 = 40.0;
/// Number of pairs of minima, and number of trials for each pull and pair.
const PAIR_COUNT: usize = 16;
const TRIAL_COUNT: usize = 6;

/// Thresholds of pairs of minima. They are kept, so that a resumed run does not repeat the work.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PullCalibration {
    /// Description of the calibrated minima, with the seed.
    pub subject: String,
    /// Thresholds in increasing order. Pairs that are out of reach even of [`INITIAL_PULL`] have none.
    pub thresholds: Vec<f64>,
    /// Number of pairs that were tried.
    pub pairs: usize,
}

/// Errors of the file of a calibration.
#[derive(Debug, thiserror::Error)]
pub enum CalibrationError {
    /// File that cannot be written.
    #[error("cannot write {path}: {source}")]
    Write {
        /// The file.
        path: PathBuf,
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// Text that is not a calibration.
    #[error("{path}: {source}")]
    Format {
        /// The file.
        path: PathBuf,
        /// Position and cause.
        source: serde_json::Error,
    },
}

impl PullCalibration {
    /// Returns an empty calibration, for a pull that is given.
    pub fn empty(subject: &str) -> Self {
        Self { subject: subject.to_owned(), thresholds: Vec::new(), pairs: 0 }
    }

    /// Returns the median threshold.
    pub fn pull(&self) -> Option<f64> {
        self.thresholds.get(self.thresholds.len() / 2).copied()
    }

    /// Reads the calibration in `file` if it is of the same subject and seed. Otherwise measures a new one and writes
    /// it there.
    pub fn resume(
        landscape: &GraspLandscape,
        minima: &[GraspState],
        question: &CalibrationRequest<'_>,
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
        progress.suspend(|| writeln!(std::io::stderr(), "calibrating the pull on {PAIR_COUNT} pairs of minima").ok());
        let found = Self::measure(landscape, minima, question, subject);
        let text = serde_json::to_string_pretty(&found).map_err(format)?;
        ftac_platform::file::write_atomically(file, text.as_bytes())
            .map_err(|source| CalibrationError::Write { path: file.into(), source })?;
        Ok(found)
    }

    fn measure(
        landscape: &GraspLandscape,
        minima: &[GraspState],
        question: &CalibrationRequest<'_>,
        subject: String,
    ) -> Self {
        let mut rng = chain_rng(question.seed, [0, 0, 0, 9]);
        let pairs: Vec<(GraspState, GraspState)> = (0..PAIR_COUNT)
            .map(|_| {
                let first = rng.random_range(0..minima.len());
                let second = (first + rng.random_range(1..minima.len())) % minima.len();
                (minima[first].clone(), minima[second].clone())
            })
            .collect();
        let thresholds = thresholds(landscape, &pairs, &question.attraction, TRIAL_COUNT, question.seed);
        Self { subject, thresholds, pairs: PAIR_COUNT }
    }
}

#[derive(Debug, Clone, Copy)]
pub struct CalibrationRequest<'a> {
    /// Description of the minima. A file with another one is not used.
    pub subject: &'a str,
    /// Settings of the chains. The search for the threshold begins at their pull.
    pub attraction: AttractionSettings,
    pub seed: u64,
}
