//! All of the scene that a controller may know.
//!
//! [`objects`] are what is picked up, each with a [`geometry::Shape`]; they stand as a [`layout`] says on the table of [`physics`].
//! [`phase`] and [`attempt`] are what a controller says of itself, by which others judge it; [`sensing`] names the sensors that it may
//! use; [`holding`] says what "in the hand" means. Poses in the scene, errors and verdicts are not here: a controller that depends on this crate cannot name them.

pub mod attempt;
pub mod geometry;
pub mod holding;
pub mod layout;
pub mod objects;
pub mod phase;
pub mod physics;
pub mod sensing;

pub use geometry::Shape;
pub use objects::{ObjectFile, ObjectModel, ObjectSet, Symmetry};
pub use phase::Phase;
pub use sensing::Sensing;
