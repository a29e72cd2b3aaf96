//! Runs and judges trials.
//!
//! [`run_each_condition`] runs one, and [`run`] runs those of a benchmark in parallel on the threads of [`workers`].
//! [`journal`] keeps finished units, and [`results`] aggregates them. [`recording`] shows a trial in Rerun, and
//! [`fault_watch`] lets fault detection observe it.

// Printed text may come from third parties: this `eprintln!` makes it printable.
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
