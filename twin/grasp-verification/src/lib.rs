//! Grasp verification in physics.
//!
//! A grasp counts only when it has closed and held in the simulator. [`simulated_world`] is the robot with its
//! scenario, and [`rollout`] closes and holds one grasp in a rollout of the physics. [`repertoire_search`] fills the
//! benchmark's repertoire and [`grasp_pair`] pairs grasps into combinations. [`preparation`] does both for a user's own
//! objects and keeps the results in a [`cache`]. [`synthesis`] verifies sampled grasps of any object by any hand.
//! [`scene_model`] runs rollouts of a try before a policy chooses one. The verified grasps and grasp pairs of the
//! benchmark are in `data/`.

// Printed text may come from others. The `eprintln!` of `progress` makes it printable.
#[macro_use]
extern crate progress;

pub mod ball_sizes;
pub mod builtin;
pub mod cache;
pub mod grasp_pair;
pub mod preparation;
pub mod proposals;
pub mod repertoire_search;
pub mod rollout;
pub mod scene_model;
pub mod simulated_world;
pub mod skills;
pub mod synthesis;
