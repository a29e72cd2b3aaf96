//! Objects to be picked: everyday objects of true size, and the user's.
//!
//! An object is a data file ([`file`]): a shape or a mesh file, mass, friction, symmetry, and resting pose. The
//! built-in ones are `data/objects/*.toml` ([`builtin`]); a scenario file refers to others by their path. The frame of
//! every object is at its centre of volume, which is its centre of mass. The sizes of the built-in objects suit the
//! hand: objects held by ring and little finger are 43 to 60 mm across, objects grasped second 43 to 66 mm.

mod builtin;
mod fallen;
mod features;
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
