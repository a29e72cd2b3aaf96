//! Grasp study: the second half of the paper's results, each made by one command from verified grasps.
//!
//! [`source`] reads the grasps and the models of their objects. [`classify`] assigns each grasp its type, [`pick_ups`]
//! does so for the grasps of the benchmark's grasp pairs, and [`annotate`] writes the page for assignment by people.
//! [`map`] draws the map of contact, [`landscape`] the tree of basins and barriers, [`hands`] compares several hands,
//! and [`report`] compares all of it with the paper. [`all_types`] runs everything. The mathematics is in the crate
//! `grasp_analysis`, the pages are in `lab::study_pages`.

pub mod all;
pub mod annotate;
pub mod classify;
pub mod hands;
pub mod landscape;
pub mod map;
pub mod pick_ups;
pub mod report;
mod source;
