//! Files of long computations: written atomically, read with limits, and checked with errors that name the place.
//!
//! - [`data`]: reading of TOML, and [`DataError`], which names file, line or field, the value found and the one
//!   expected.
//! - [`file`](mod@file): atomic writes, and reads of regular files of bounded size.
//! - [`file_access`]: the files that a text from elsewhere may name.
//! - [`journal`]: finished work line by line, safe against a kill at any moment; locks on files and folders.
//! - [`digest`]: SHA-256 as text.
//! - [`child`]: child processes without this program's secrets.
//!
//! Only Unix systems.

#![deny(missing_docs, unreachable_pub)]

pub mod child;
pub mod data;
pub mod digest;
pub mod file;
pub mod file_access;
pub mod journal;

pub use data::DataError;

/// Compiles and runs the examples of the package's page.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
