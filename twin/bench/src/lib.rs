//! Plays and judges trials.
//!
//! [`trial`] plays one, [`run`] plays a benchmark's many in parallel, [`results`] sums them up, [`journal`] keeps what is finished, [`recording`] shows
//! a trial in Rerun, [`fault_watch`] has fault detection look on. [`workers`] are the threads it all runs on.

// What is printed may hold text of others: `eprintln!` is the one that makes it printable.
#[macro_use]
extern crate progress;

mod bounds;
pub mod builtin;
pub mod fault_watch;
pub mod journal;
pub mod provenance;
pub mod recording;
pub mod results;
pub mod robot;
pub mod run;
pub mod trial;
pub mod workers;
