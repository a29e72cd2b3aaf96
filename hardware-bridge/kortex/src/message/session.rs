//! Service 1, sessions.

include!("generated/session.rs");
