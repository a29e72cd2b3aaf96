//! The second program, `ftac-lab`: validation, grasp analysis, training and the lab book.
//!
//! `ftac` knows the [`arguments`] of its commands and [hands over](hand_over) to it, so that a build of `ftac` has none of what only these need.

pub mod arguments;
pub mod hand_over;
pub mod identity;
