//! Files, digests and child processes, shared by every crate.
//!
//! [`file`] writes files atomically and reads them with a size limit. [`data`] reads TOML, with errors that name file,
//! field, found and expected. [`file_access`] decides which files a text may name. [`journal`] records finished work line by
//! line and locks files that one process at a time writes. [`digest`] is SHA-256, and [`child`] starts other programs
//! without our secrets.

pub mod child;
pub mod data;
pub mod digest;
pub mod file;
pub mod file_access;
pub mod journal;

pub use data::DataError;
