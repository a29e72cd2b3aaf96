//! Transport of several objects to one place in one trip.
//!
//! [`site`] sets up the scene in physics, [`play`] runs one transport under one policy, [`rehearse`] searches for
//! [skills](grasp_verification::skills) by rollouts, and [`recorded`] writes the recording.

// Printed text may come from third parties: this `eprintln!` makes it printable (no control characters).
#[macro_use]
extern crate progress;

pub mod play;
pub mod recorded;
pub mod rehearse;
pub mod site;
