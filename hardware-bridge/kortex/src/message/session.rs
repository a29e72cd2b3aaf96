//! Service 1, sessions.

/// Login request. The session's number is in the header of the answer.
#[derive(Clone, PartialEq, Eq, prost::Message)]
pub struct CreateSessionInfo {
    /// User name.
    #[prost(string, tag = "1")]
    pub user: String,
    /// Session timeout: time without a call after which the arm ends the session, ms.
    #[prost(uint32, tag = "2")]
    pub session_timeout: u32,
    #[prost(string, tag = "3")]
    pub password: String,
    /// Connection timeout: time without any sign of life, keep-alives included, after which the arm ends the session,
    /// ms.
    #[prost(uint32, tag = "4")]
    pub connection_timeout: u32,
}
