//! What can go wrong while recording or viewing.

use std::path::PathBuf;

/// An error of this crate.
#[derive(Debug, thiserror::Error)]
pub enum StreamError {
    /// The recording's file cannot be created, or not be written to its end.
    #[error("cannot write the recording {path}: {source}")]
    Unwritable {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// What was logged could not be written to the end.
    #[error("the recording is incomplete: {0}")]
    Flush(#[from] rerun::sink::SinkFlushError),
    /// Rerun refused.
    #[error("rerun: {0}")]
    Rerun(Box<rerun::RecordingStreamError>),
    /// An address is not of the form `rerun+http://HOST:PORT/proxy` or `IP:PORT`.
    #[error("{0}: not an address of a viewer (expected rerun+http://HOST:PORT/proxy)")]
    Address(String),
    /// An image has the wrong number of bytes or could not be encoded.
    #[error("image of {what}: {reason}")]
    Image {
        what: String,
        /// Why.
        reason: String,
    },
    /// A name that was not announced when the recorder was created.
    #[error("nothing called {0} was announced when the recorder was created")]
    Unknown(String),
    /// No viewer is installed.
    #[error(
        "no Rerun viewer found (looked at RERUN_BIN and PATH). Install it with\n    pip install rerun-sdk=={version}\nor\n    \
         cargo install rerun-cli --version {version} --locked",
        version = crate::release::RERUN_VERSION
    )]
    NoViewer,
    /// There is nothing to open.
    #[error("{0}: no recording (.rrd) there")]
    NoRecording(PathBuf),
    /// The viewer started and ended at once.
    #[error("the viewer {program} ended as soon as it was started: {reason}")]
    Ended {
        program: PathBuf,
        /// What it said last.
        reason: String,
    },
    /// The viewer did not start.
    #[error("cannot start {program}: {source}")]
    Start {
        program: PathBuf,
        /// Why.
        source: std::io::Error,
    },
}

impl From<rerun::RecordingStreamError> for StreamError {
    fn from(error: rerun::RecordingStreamError) -> Self {
        Self::Rerun(Box::new(error))
    }
}
