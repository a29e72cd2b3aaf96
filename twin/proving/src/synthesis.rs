//! Grasps for any object, sampled, closed by cables and held in physics.
//!
//! [`subject`] makes an object ready for sampling, [`closing`] turns a sampled posture into a closed grasp, and [`checks`] verifies it.
//! [`synthesizer`] does all three for one chain, [`search`] runs many chains and keeps the grasps that pass, and [`evaluation`]
//! measures how often that works and which metrics predict it. [`load`] says for what mass, [`size`] whether a hand can take an object at all. [`parts`] fills the collection of all objects, one resumable file an
//! object; [`grasp_file`] reads it and what single searches left. [`again`] closes the grasps of a file once more, and [`export`] writes
//! them for another engine. [`any`] is the same search for other hands, and [`hands`] compares hands on the same objects.

pub mod again;
pub mod any;
pub mod checks;
pub mod closing;
pub mod evaluation;
pub mod export;
pub mod grasp_file;
pub mod hands;
pub mod load;
pub mod parts;
pub mod search;
pub mod size;
pub mod subject;
pub mod synthesizer;
