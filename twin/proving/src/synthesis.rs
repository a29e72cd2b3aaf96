//! Grasps for any object, sampled, closed by cables and held in physics.
//!
//! [`subject`] makes an object ready for sampling, [`closing`] takes a sampled posture to a closed grasp, [`checks`] verifies it,
//! [`workshop`] does all that for a chain, [`search`] runs chains and keeps what was found, [`evaluation`] measures how well that works.
//! [`any`] does the same for other hands.

pub mod any;
pub mod checks;
pub mod closing;
pub mod evaluation;
pub mod repertoire;
pub mod search;
pub mod subject;
pub mod workshop;
