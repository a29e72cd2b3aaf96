//! Plays and judges trials.
//!
//! [`body`] holds the bodies on which a trial can be played, [`trial`] plays one, [`run`] plays a benchmark's many in parallel, [`results`] sums them up,
//! [`journal`] keeps what is finished, [`recording`] shows a trial in Rerun. [`transport`] carries several objects in one trip,
//! [`mirror`] lets a twin look on and names what differs, [`own`] lets a policy of the user's decide in them, [`environment`] lets a learner step through scenes. [`workers`] are the threads it all runs on.

// What is printed may hold text of others: `eprintln!` is the one that makes it printable.
#[macro_use]
extern crate progress;

pub mod body;
mod bounds;
pub mod builtin;
pub mod emulated_table;
pub mod environment;
pub mod journal;
pub mod mirror;
pub mod own;
pub mod provenance;
pub mod recording;
pub mod registration;
pub mod results;
pub mod run;
pub mod transport;
pub mod trial;
pub mod workers;
