//! Transport of several objects to one place in one trip.
//!
//! [`site`] sets up the scene in physics, [`run_until_decision`] runs one transport under one policy, [`skill_search`]
//! searches for [skills](grasp_verification::skills) by rollouts, and [`recording`] writes the recording.

// Printed text may come from third parties: this `eprintln!` escapes its control characters.
#[macro_use]
extern crate progress;

pub mod recording;
pub mod site;
pub mod skill_search;
pub mod trial;
