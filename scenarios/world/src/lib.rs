//! The part of the scene that a controller may use.
//!
//! [`objects`] are the objects to be picked, each with a [`geometry::ObjectShape`]. They stand on the table of
//! [`physics`] as a [`layout`] defines. A controller reports its [`phase`] and [`attempt`], by which others judge it.
//! [`sensing`] names the sensors that it may use, and [`holding`] defines "in the hand". True poses, errors and
//! verdicts are not in this crate, so that a controller that depends on it cannot refer to them.

pub mod attempt;
pub mod geometry;
pub mod holding;
pub mod layout;
pub mod objects;
pub mod phase;
pub mod physics;
pub mod sensing;

pub use geometry::ObjectShape;
pub use objects::{ObjectFile, ObjectModel, ObjectSet, Symmetry};
pub use phase::Phase;
pub use sensing::Sensing;
