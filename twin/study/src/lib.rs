//! The grasp study: the paper's second half of results, made from this project's own verified grasps.
//!
//! What kind of grasp is it? [`taxonomy`] is the paper's table of 19 types; [`attributes`] measures on a held grasp what the
//! taxonomy is about, and [`rules`], which are data, decide, give their reasons and say when they are in doubt. People decide on
//! a page ([`page`]), and [`labels`] measures how well they agree with the rules and with each other.
//!
//! Which grasps are alike? [`contact_map`] says how near every part of the hand is to the object, [`embedding`] lays such maps out
//! in the plane, and [`boundary`] draws the line between power and precision and says how far it can be trusted.
//!
//! How are grasps connected? [`landscape`] maps the energy by attraction and diffusion: basins, barriers, and their tree.
//!
//! [`sensors`] is the paper's comparison of tactile arrays with the model's own figures. Nothing here knows the simulator: grasps
//! come in as they were held, objects as distances and points.

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
