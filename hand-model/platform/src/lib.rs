//! Files, digests and child processes, for every crate.
//!
//! [`file`] writes a file whole or not at all, and reads one that is sure to end; [`data`] reads TOML and says what is wrong with it by
//! file, field, found and expected; [`reach`] says which files a text may name. [`journal`] keeps finished work line by line and locks what one
//! process at a time writes. [`digest`] is SHA-256, and [`child`] starts other programs without our secrets.

pub mod child;
pub mod data;
pub mod digest;
pub mod file;
pub mod journal;
pub mod reach;

pub use data::DataError;
