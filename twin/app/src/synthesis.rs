//! `ftac grasps generate` and `eval`: grasps for any object, sampled, closed by cables and held in physics.
//!
//! [`subject`] makes an object ready for sampling, [`closing`] takes a sampled posture to a closed grasp, [`checks`] verifies
//! it, [`search`] runs chains and keeps what was found, [`evaluation`] measures how well all that works.

pub mod checks;
pub mod closing;
pub mod search;
pub mod subject;
