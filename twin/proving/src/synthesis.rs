//! Grasps for any object, sampled, closed by cables and held in physics.
//!
//! [`subject`] makes an object ready for sampling, [`closing`] turns a sampled posture into a closed grasp, and [`checks`] verifies it.
//! [`synthesizer`] does all three for one chain, [`search`] runs many chains and keeps the [`record`]s of grasps that pass with a [`report`], and [`evaluation`]
//! measures how often that works and which metrics predict it. [`load`] says for what mass, [`size`] whether a hand can take an object at all. [`parts`] fills the collection of all objects, one resumable file an
//! object; [`grasp_file`] reads it and what single searches left. [`again`] closes the grasps of a file once more, and [`export`] writes
//! them for another engine. [`grasping_hand`] is what all of them ask of a hand; [`urdf_hand`] finds it of a URDF. [`kinds`] sorts what was found, [`hands`] compares
//! hands on the same objects. A search may be for one [`wanted`] type of the taxonomy.

pub mod again;
pub mod checks;
pub mod closing;
pub mod evaluation;
pub mod export;
pub mod grasp_file;
pub mod grasping_hand;
pub mod hands;
pub mod kinds;
pub mod load;
pub mod parts;
pub mod record;
pub mod report;
pub mod search;
pub mod size;
pub mod subject;
pub mod synthesizer;
pub mod urdf_hand;
pub mod wanted;
