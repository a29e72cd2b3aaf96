//! Grasp synthesis for any object: the paper's grasp energy, sampled by a Metropolis-adjusted Langevin chain.
//!
//! [`field`] is the object, sampled once as signed distance and normal; [`surface`] is the hand's surface and where it
//! may touch. [`frames`] places the surface on the object and maps forces back to pose and joints. [`closure_energy`]
//! scores contact points for force closure, [`mechanism`] describes what the actuators move, and [`energy`] adds all
//! other terms; [`hand_use`] limits them to parts of the hand. [`langevin`] is the sampler's kernel, and [`chain`] runs it from a random start to a posture. [`posture`]
//! projects that posture to one that cables and springs can hold, and opens it clear of the object. Closing it in physics
//! is up to the caller. [`tabletop`] makes proposals for pick-ups from a table of such postures. [`held`] is the result, [`grasp_file`] keeps those of one search, [`collection`] stores the grasps of many objects in one compact file, and
//! [`kind`] sorts them and [`diversity`] measures how different they are.

pub mod chain;
pub mod closure_energy;
pub mod collection;
pub mod diversity;
pub mod energy;
pub mod field;
pub mod frames;
pub mod grasp_file;
pub mod hand_use;
pub mod held;
pub mod kind;
pub mod langevin;
pub mod mechanism;
pub mod posture;
pub mod surface;
pub mod tabletop;
