//! Grasp synthesis for any object and any hand: a grasp energy, sampled by a Metropolis-adjusted Langevin chain.
//!
//! [`sampled_hand`] describes the hand, from a parameter file or a URDF.
//!
//! [`field`] is the object, sampled once as signed distance and normal. [`surface`] is the hand's surface with its
//! contact candidates. [`frames`] places the surface on the object and maps forces back to pose and joints.
//! [`closure_energy`] scores contact points for force closure, [`mechanism`] describes the joint motion of each
//! actuator, and [`energy`] adds all other terms. [`hand_use`] limits a search to parts of the hand.
//!
//! [`langevin`] is the sampler's kernel, and [`chain`] runs it from a random start to a posture. [`posture`] projects
//! that posture to one that cables and springs can hold, and opens it clear of the object. Closing it in physics is up
//! to the caller. [`tabletop`] turns such postures into proposals for grasps of objects on a table.
//!
//! [`held`] is the result of a synthesis. [`grasp_file`] keeps the grasps of one search, and [`collection`] stores the
//! grasps of many objects in one compact file. [`kind`] sorts grasps, and [`diversity`] measures how different they
//! are.

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
pub mod sampled_hand;
pub mod surface;
pub mod tabletop;
