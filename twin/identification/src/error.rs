//! Errors of identification.

use std::path::PathBuf;

use ftac_platform::DataError;
use robot_session_log::SessionLogError;

/// A session or a script from which nothing can be identified.
#[derive(Debug, thiserror::Error)]
pub enum IdentificationError {
    #[error(transparent)]
    Data(#[from] DataError),
    #[error(transparent)]
    Session(#[from] SessionLogError),
    #[error("{path}: {source}")]
    Io { path: PathBuf, source: std::io::Error },
    /// The session does not belong to an excitation.
    #[error("{path}: {field}: found {found}, expected {expected}")]
    NotAnExcitation { path: PathBuf, field: String, found: String, expected: String },
    /// No session moves this actuator.
    #[error(
        "{sessions}: motions of `{actuator}`: found none, expected at least one free motion; run `ftac sysid excite` to its end"
    )]
    NotExcited {
        /// Paths of the sessions' files.
        sessions: String,
        actuator: String,
    },
}
