//! What is done and how it is judged.
//!
//! The story in order: [`objects`] are what is picked up, each with a [`geometry::Shape`], from a table in a world of
//! [`physics`]; a [`scenario`] file says which of them come first and second, where they stand ([`layout`]) and how a trial
//! goes, and [`combination`] draws pairs; [`noise`] draws what goes wrong in a trial, [`individuals`] which arm and which objects
//! are at hand, [`sight`] what vision makes of them;
//! [`effects`] are what reality adds to an ideal robot, [`disturbance`] says what is done to a trial on purpose, and it goes through
//! the phases of [`phase`], or those that [`stages`] reads from the scene; the [`referee`] judges it from ground truth; a [`record::TrialRecord`] keeps the result and a [`tries::TryRecord`] that of each try; with less of
//! its means ([`ablation`], [`sensing`]) an [`record::AblatedTrial`], and [`statistics`] sums all of them up. [`transport`] says which balls are to be
//! carried, as many as fit at once.

pub mod ablation;
pub mod combination;
pub mod disturbance;
pub mod effects;
pub mod geometry;
pub mod holding;
pub mod individuals;
pub mod layout;
pub mod noise;
pub mod objects;
pub mod phase;
pub mod physics;
pub mod record;
pub mod referee;
pub mod scenario;
pub mod sensing;
pub mod sight;
pub mod stages;
pub mod statistics;
pub mod transport;
pub mod tries;

pub use ablation::Ablation;
pub use combination::{Combination, draw_combinations};
pub use geometry::Shape;
pub use objects::{ObjectFile, ObjectModel, ObjectSet, Symmetry};
pub use phase::Phase;
pub use record::{AblatedTrial, Condition, TrialId, TrialRecord};
pub use referee::{FailureCause, Referee, SceneTruth, Verdict};
pub use scenario::Scenario;
pub use sensing::Sensing;
