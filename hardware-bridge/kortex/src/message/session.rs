//! Service 1, sessions.

/// Logs in. The session's number is in the answer's header.
#[derive(Clone, PartialEq, Eq, prost::Message)]
pub struct CreateSessionInfo {
    /// Name.
    #[prost(string, tag = "1")]
    pub user: String,
    /// ms without a call after which the arm ends the session.
    #[prost(uint32, tag = "2")]
    pub session_timeout: u32,
    #[prost(string, tag = "3")]
    pub password: String,
    /// ms without any sign of life, keep-alives included, after which the arm ends the session.
    #[prost(uint32, tag = "4")]
    pub connection_timeout: u32,
}
