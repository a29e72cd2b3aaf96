//! Proofs of grasps in physics.
//!
//! A grasp counts only when it has closed and held in the simulator. [`simulated_world`] is the robot with its scenario, [`rehearsal`] closes and
//! holds one grasp, [`pick_ups`] fills the benchmark's repertoire, [`plan`] pairs grasps into combinations, [`preparation`] does both for
//! objects of a user's own and keeps them in a [`cache`], and [`synthesis`] verifies sampled grasps of any object by any hand. [`twin`] plays tries
//! before a policy chooses one. The proven
//! grasps and plans of the benchmark are in `data/`.

// What is printed may hold text of others: `eprintln!` is the one that makes it printable.
#[macro_use]
extern crate progress;

pub mod ball_sizes;
pub mod builtin;
pub mod cache;
pub mod pick_ups;
pub mod plan;
pub mod preparation;
pub mod proposals;
pub mod rehearsal;
pub mod simulated_world;
pub mod skills;
pub mod synthesis;
pub mod twin;
