//! The grasp study: the paper's second half of results, each made by one command from verified grasps.
//!
//! [`source`] reads the grasps and knows their objects; [`classify`] gives each its type, [`pick_ups`] those of the benchmark's plans, and [`annotate`] writes the page on which
//! people do. [`map`] draws the map of contact, [`landscape`] the tree of basins and barriers, [`hands`] sets hands side by side, and
//! [`report`] sets all of it beside the paper; [`all`] makes everything. The mathematics is in the crate `study`, the pages are in `lab::study_pages`.

pub mod all;
pub mod annotate;
pub mod classify;
pub mod hands;
pub mod landscape;
pub mod map;
pub mod pick_ups;
pub mod report;
mod source;
