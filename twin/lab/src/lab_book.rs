//! Lab book: every figure stated by this project, as data in `recordings/figures.csv`, and the page for readers,
//! `BENCHMARKS.md`.
//!
//! [`table::parse`] reads the figures, [`command::CommandCheck`] rejects those whose command could not be run again,
//! and [`page::page`] sets them beside the paper's and the goals. None of this depends on the command line: the caller
//! passes a parser for commands of `ftac`.

pub mod command;
pub mod error;
pub mod figure;
pub mod page;
pub mod table;
