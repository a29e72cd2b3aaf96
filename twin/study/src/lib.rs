//! The grasp study: the second half of the paper's results, from this project's own verified grasps.
//!
//! *Which type is a grasp?* [`grasping::taxonomy`] has the paper's 19 types and the rules that decide; [`classification`] holds the decisions
//! on a whole set of grasps. [`distribution`] and [`summary`] count them, [`explanation`] gives the reasons for one of them, and [`labels`] and
//! [`raters`] compare them with the types that people give, [`people`] with how often people hold things in which way.
//!
//! *Which grasps are alike?* [`contact_map`] measures how near each part of the hand is to the object, [`embedding`] lays the maps
//! out in the plane, [`boundary`] separates power from precision grasps, and [`grasp_map`] does all three for a set of grasps.
//!
//! *How are grasps connected?* [`landscape`] maps the energy by attraction and diffusion: basins, barriers, and their tree.
//!
//! [`sensors`] sets the paper's comparison of tactile arrays beside the model's own figures. Nothing here knows the simulator or
//! the meshes of objects: grasps come in as they were held, objects as distances and points. Pages and figures are drawn by `lab`.

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
