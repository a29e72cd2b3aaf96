//! What is picked up: everyday things of true size, and any thing of a user's own.
//!
//! An object is a data file ([`file`]): a shape or a mesh file, mass, friction, symmetry, and how it rests. The built-in ones
//! are `data/objects/*.toml` ([`builtin`]); a scenario file names others by their path. Every object's frame sits in its centre
//! of volume, which is its centre of mass. Sizes of the built-in objects suit the hand: what ring and little finger hold measures
//! 43 to 60 mm across, what is grasped second 43 to 66 mm.

mod builtin;
mod fallen;
pub mod file;
mod lathe;
mod model;
mod resting;
mod set;
mod symmetry;

pub use file::ObjectFile;
pub use model::ObjectModel;
pub use set::ObjectSet;
pub use symmetry::Symmetry;
