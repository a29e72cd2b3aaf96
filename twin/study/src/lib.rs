//! The grasp study: the second half of the paper's results, from this project's own verified grasps.
//!
//! Classification: [`taxonomy`] is the paper's table of 19 grasp types. [`attributes`] measures the taxonomy's attributes
//! on a held grasp, and [`rules`], which are data, decide the type, explain it and mark ambiguous cases. People label
//! grasps on a web page ([`page`]), and [`labels`] measures their agreement with the rules and with each other.
//!
//! Similarity: [`contact_map`] measures the distance of every part of the hand from the object, [`embedding`] maps these
//! vectors to the plane, and [`boundary`] separates power from precision grasps, with an estimate of its accuracy.
//!
//! Connectivity: [`landscape`] maps the energy landscape of grasps by attraction and diffusion: basins, barriers, and
//! their tree.
//!
//! [`sensors`] is the paper's comparison of tactile arrays with this model's figures. Nothing here knows the simulator:
//! the inputs are held grasps, and objects as distance functions and points.

pub mod attributes;
pub mod boundary;
pub mod contact_map;
pub mod embedding;
pub mod labels;
pub mod landscape;
pub mod page;
pub mod rules;
pub mod sensors;
pub mod taxonomy;
