//! Sweeps: many benchmarks along axes, in units of a few minutes, on one machine or on a cluster.
//!
//! [`mod@file`] is the user's description of a sweep, and [`axis`] defines the fields that can vary. [`plan`] derives
//! the units of work. [`folder`] is the result folder, the only thing that workers share, and [`claim`] keeps two of
//! them from running the same unit. [`execution`] runs one unit, and [`work`] all that are left. [`columns`] defines the
//! results that are kept of a trial, [`table`] stores them as Parquet, and [`rows`] makes them from records. [`merge`]
//! joins the units' files, [`slurm`] submits the work to a cluster, and [`status`] reports its progress. [`outcomes`],
//! [`curve`] and [`page`] make the report. [`makespan`] replays recorded unit times on more cores.

// Printed text may come from third parties: this `eprintln!` makes it printable.
#[macro_use]
extern crate progress;

pub mod axis;
pub mod claim;
pub mod columns;
pub mod curve;
pub mod execution;
mod figure;
pub mod file;
pub mod folder;
pub mod makespan;
pub mod merge;
mod near;
pub mod outcomes;
pub mod page;
pub mod plan;
pub mod rows;
pub mod slurm;
pub mod status;
#[cfg(test)]
mod synthetic;
pub mod table;
pub mod work;
