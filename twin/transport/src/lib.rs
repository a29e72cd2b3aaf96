//! Carrying several objects to one place in one trip.
//!
//! [`site`] is the place in physics, [`play`] one transport under one policy, [`rehearse`] the
//! search for [skills](proving::skills), [`recorded`] the recording.

// What is printed may hold text of others: `eprintln!` is the one that makes it printable.
#[macro_use]
extern crate progress;

pub mod play;
pub mod recorded;
pub mod rehearse;
pub mod site;
