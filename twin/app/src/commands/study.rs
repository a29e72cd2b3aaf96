//! The grasp study: the paper's second half of results, each made by one command from verified grasps.
//!
//! [`source`] reads the grasps and knows their objects; [`classify`] gives each its type, [`annotate`] writes the page on which
//! people do; [`map`] puts contact maps on a sheet and [`landscape`] basins and barriers on a tree; [`report`] puts all of it beside
//! the paper, row by row as [`comparison`] has it. The mathematics is in the crate `study`.

pub mod annotate;
pub mod classify;
mod comparison;
mod distribution;
pub mod landscape;
pub mod map;
pub mod report;
mod source;
