//! New grasps for any object by sampling: the paper's grasp energy under a Metropolis-adjusted Langevin chain.
//!
//! The story in order: [`field`] is the object, sampled once as signed distance and normal; [`surface`] is the hand's skin and
//! where it may touch; [`frames`] puts the skin on the object and brings forces back to pose and joints; [`closure_energy`]
//! scores contact points for force closure, [`mechanism`] says what the actuators move and [`energy`] adds everything else; [`langevin`] is the sampler's
//! kernel and [`chain`] runs it from a random start to a posture; [`posture`] projects that to what cables and springs can
//! hold and opens it clear of the object. Closing it in physics is the program's part; [`held`] is what comes of it,
//! [`collection`] keeps the grasps of many objects in one compact file, and [`diversity`] says how different they are.

pub mod chain;
pub mod closure_energy;
pub mod collection;
pub mod diversity;
pub mod energy;
pub mod field;
pub mod frames;
pub mod held;
pub mod langevin;
pub mod mechanism;
pub mod posture;
pub mod surface;
