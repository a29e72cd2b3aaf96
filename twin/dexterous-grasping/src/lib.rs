//! Grasps: their representation, the repertoire of each object, and the generation of new ones.
//!
//! A [`grasp::Grasp`] describes how the hand approaches an object, which digits close with which tensions, and the
//! resulting pose of the object in the hand. A [`repertoire::Repertoire`] holds the grasps of each object that were
//! closed and held in physics, ranked by success. [`sampler`] proposes new grasps around the hand's two basic ways of
//! picking things up, and [`digit_sets`] proposes grasps with any set of digits. [`force_closure`] computes, by
//! friction-cone programs, how much disturbance a set of contacts resists.
//!
//! [`synthesis`] finds grasp postures for any object from its signed distance alone, by sampling the paper's grasp
//! energy. [`taxonomy`] has the paper's 19 grasp types, with the rules that assign a type to a held grasp.

pub mod digit_sets;
pub mod force_closure;
pub mod grasp;
pub mod repertoire;
pub mod sampler;
pub mod synthesis;
pub mod taxonomy;

pub use digit_sets::digit_sets;
pub use grasp::Grasp;
pub use repertoire::{Repertoire, RepertoireError};
