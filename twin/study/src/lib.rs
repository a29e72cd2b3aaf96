//! The grasp study: the paper's second half of results, made from this project's own verified grasps.
pub mod attributes;
pub mod boundary;
pub mod contact_map;
pub mod embedding;
pub mod labels;
pub mod landscape;
pub mod page;
pub mod rules;
pub mod taxonomy;
