//! The lab book: every figure this project states, as data in `recordings/figures.csv`, and the page that people read, `BENCHMARKS.md`.
//!
//! [`table::parse`] reads the figures, [`command::Check`] refuses those whose command could not be run again, and [`page::page`] sets them beside the paper
//! and the goals. None of it knows the command line: whoever calls says how a command of `ftac` is parsed.

pub mod command;
pub mod error;
pub mod figure;
pub mod page;
pub mod table;
