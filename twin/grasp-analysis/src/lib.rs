//! Grasp analysis: the second half of the paper's results, from this project's own verified grasps.
//!
//! **Grasp types.** [`dexterous_grasping::taxonomy`] has the paper's 19 types and the rules that decide on them.
//! [`classification`] holds the decisions on a whole set of grasps. [`distribution`] and [`summary`] count them, and
//! [`explanation`] gives the reasons for a single decision. [`labels`] and [`raters`] compare the decisions with the
//! types that people assign, and [`people`] compares them with the frequencies of people's own grasps.
//!
//! **Similarity of grasps.** [`contact_map`] measures the distance of each part of the hand from the object.
//! [`embedding`] lays the maps out in the plane, and [`boundary`] separates power from precision grasps. [`grasp_map`]
//! does all three for a set of grasps.
//!
//! **Connections between grasps.** [`landscape`] maps the energy by attraction and diffusion: basins, barriers, and
//! their tree.
//!
//! [`sensors`] sets the paper's comparison of tactile arrays beside the figures of this model. This crate depends on
//! neither the simulator nor the meshes of objects: grasps come in as they were held, objects as distances and points.
//! `lab` draws the pages and figures.

pub mod boundary;
pub mod classification;
pub mod contact_map;
pub mod distribution;
pub mod embedding;
pub mod explanation;
pub mod grasp_map;
pub mod labels;
pub mod landscape;
pub mod people;
pub mod raters;
pub mod sensors;
pub mod summary;

#[cfg(test)]
mod test_grasp;
