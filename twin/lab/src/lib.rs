//! Measures the body against the paper and against other engines.
//!
//! [`hand_check`] and [`arm_check`] make the rows of `ftac hand check` and `ftac arm check`; [`touch`] measures and calibrates
//! photometric stereo and in-hand poses.

pub mod arm_check;
pub mod hand_check;
pub mod touch;
