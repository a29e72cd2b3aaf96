//! Errors of recording and viewing.

use std::path::PathBuf;

/// An error of this crate.
#[derive(Debug, thiserror::Error)]
pub enum TelemetryError {
    /// The recording's file cannot be created, or cannot be written completely.
    #[error("cannot write the recording {path}: {source}")]
    Unwritable {
        path: PathBuf,
        /// Reason given by the operating system.
        source: std::io::Error,
    },
    /// Logged data could not be flushed completely.
    #[error("the recording is incomplete: {0}")]
    Flush(#[from] rerun::sink::SinkFlushError),
    /// Rerun reported an error.
    #[error("rerun: {0}")]
    Rerun(Box<rerun::RecordingStreamError>),
    /// An address is not of the form `rerun+http://HOST:PORT/proxy` or `IP:PORT`.
    #[error("{0}: not an address of a viewer (expected rerun+http://HOST:PORT/proxy)")]
    Address(String),
    /// An image has the wrong number of bytes or could not be encoded.
    #[error("image of {what}: {reason}")]
    Image {
        what: String,
        /// Reason in words.
        reason: String,
    },
    /// An object or camera that was not announced when the recorder was created.
    #[error("found {0}, expected an object or camera announced to the recorder")]
    Unknown(String),
    /// No viewer is installed.
    #[error(
        "no Rerun viewer found (searched RERUN_BIN and PATH). Install it with\n    pip install rerun-sdk=={version}\nor\n    \
         cargo install rerun-cli --version {version} --locked",
        version = crate::release::RERUN_VERSION
    )]
    NoViewer,
    /// The path holds no recording.
    #[error("{0}: no recording (.rrd) there")]
    NoRecording(PathBuf),
    /// The file is no recording.
    #[error("{0}: found another kind of file, expected a recording (.rrd)")]
    OtherFile(PathBuf),
    /// The viewer ended immediately after it was started.
    #[error("the viewer {program} ended as soon as it was started: {reason}")]
    Ended {
        program: PathBuf,
        /// Last line that it wrote.
        reason: String,
    },
    /// The viewer could not be started.
    #[error("cannot start {program}: {source}")]
    Start {
        program: PathBuf,
        /// Reason given by the operating system.
        source: std::io::Error,
    },
}

impl From<rerun::RecordingStreamError> for TelemetryError {
    fn from(error: rerun::RecordingStreamError) -> Self {
        Self::Rerun(Box::new(error))
    }
}
