//! End-to-end tests of `ftac`.
