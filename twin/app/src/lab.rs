//! Interface to the second program, `ftac-lab`: validation, grasp analysis, training and the lab book.
//!
//! `ftac` defines the [`arguments`] of the commands of `ftac-lab` and [hands them over](hand_over), so that a build of
//! `ftac` contains nothing that only these commands need.

pub mod arguments;
pub mod hand_over;
pub mod identity;
