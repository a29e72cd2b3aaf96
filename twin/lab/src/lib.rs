//! Validation of the hand against the paper and against other engines, and of its sensors against known presses.
//!
//! [`hand_check`] and [`arm_check`] make the rows of `ftac hand check` and `ftac arm check`; [`closing`] closes any
//! hand on a ball. [`touch`] trains and evaluates photometric stereo and in-hand poses. [`study_pages`] draws the grasp
//! study, and [`lab_book`] makes the page of all figures. Results come as values, as JSON and as text; the program
//! `ftac-lab` prints them.

pub mod arm_check;
pub mod closing;
pub mod hand_check;
pub mod lab_book;
pub mod study_pages;
pub mod touch;
