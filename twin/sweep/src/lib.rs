//! Sweeps: many benchmarks along axes, in units of a few minutes, on one machine or on a cluster.
//!
//! [`file`] is what a user writes, [`axis`] what can vary, [`plan`] the units that follow from it. [`folder`] is the result folder, which is
//! all that workers share; [`claim`] keeps two of them from the same unit. [`play`] plays a unit, [`work`] all that are left.
//! [`columns`] says what is kept of a trial, [`table`] is that as Parquet, [`rows`] makes it from records. [`merge`] joins the units' files,
//! [`slurm`] hands the work to a cluster, [`status`] says how far it is. [`outcomes`], [`curve`] and [`page`] are the report,
//! [`makespan`] is a replay of recorded unit times on more cores.

// What is printed may hold text of others: `eprintln!` is the one that makes it printable.
#[macro_use]
extern crate progress;

pub mod axis;
pub mod claim;
pub mod columns;
pub mod curve;
mod figure;
pub mod file;
pub mod folder;
pub mod makespan;
pub mod merge;
mod near;
pub mod outcomes;
pub mod page;
pub mod plan;
pub mod play;
pub mod rows;
pub mod slurm;
pub mod status;
#[cfg(test)]
mod synthetic;
pub mod table;
pub mod work;
