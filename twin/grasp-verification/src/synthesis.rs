//! Grasp synthesis for any object: grasps are sampled, closed by cables and held in physics.
//!
//! [`subject`] makes an object ready for sampling, [`closing`] turns a sampled posture into a closed grasp, and
//! [`checks`] verifies it. [`synthesizer`] does all three for one chain. [`search`] runs many chains and keeps a
//! [`record`] of each grasp that passes, with a [`report`]. [`evaluation`] measures the success rate and the predictive
//! power of each metric. [`object_properties`] states the mass for which grasps are verified, and [`size`] decides if a
//! hand can take an object at all.
//! an object at all.
//! [`parts`] fills the collection of all objects, one resumable file per object. [`grasp_file`] reads the collection
//! and the files of single searches. [`reevaluation`] closes and checks the grasps of a file once more, and [`export`]
//! writes them for another physics engine. [`grasping_hand`] is the hand interface of all of them, and [`urdf_hand`]
//! derives it from a URDF. [`kinds`] sorts the grasps that were found, and [`hands`] compares hands on the same
//! objects. A search may be for one type of the taxonomy ([`type_filter`]).

pub mod checks;
pub mod closing;
pub mod evaluation;
pub mod export;
pub mod grasp_file;
pub mod grasping_hand;
pub mod hands;
pub mod kinds;
pub mod object_properties;
pub mod parts;
pub mod record;
pub mod reevaluation;
pub mod report;
pub mod search;
pub mod size;
pub mod subject;
pub mod synthesizer;
pub mod type_filter;
pub mod urdf_hand;
