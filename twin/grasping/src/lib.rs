//! What the hand knows about gripping: grasps, repertoires, and where new ones come from.
//!
//! A [`grasp::Grasp`] says how the hand approaches an object, which digits close with which tensions, and where the object
//! then sits in the hand. A [`repertoire::Repertoire`] holds an object's grasps, each closed and held in physics, ranked by
//! how well. [`sampler`] proposes new ones around the hand's few ways of picking things up; [`force_closure`] says, by a
//! friction-cone program, how much disturbance a set of contacts resists.
//!
//! [`synthesis`] finds postures for any object from its signed distance alone: the paper's grasp energy, sampled.

pub mod digit_sets;
pub mod force_closure;
pub mod grasp;
pub mod repertoire;
pub mod sampler;
pub mod synthesis;

pub use grasp::{Grasp, Role};
pub use repertoire::{Repertoire, RepertoireError};
