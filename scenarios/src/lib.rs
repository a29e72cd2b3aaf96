//! The benchmark's rules: what is done, and how it is judged.
//!
//! A [`scenario`] file says which objects of [`world`] come first and second, where they stand and how a trial goes, and
//! [`combination`] draws pairs. [`noise`] draws the errors of a trial, [`sight`] what an object detector makes of the
//! scene; [`effects`] are what reality adds to an ideal robot, with the draws of the [`plant`]'s hidden parameters, and [`disturbance`] says what is done to a
//! trial on purpose. The [`referee`] judges a trial from ground truth, by the phases that the controller reports or that [`stages`] reads
//! from the scene. A [`record::TrialRecord`] keeps the result and a [`tries::TryRecord`] that of each try, an [`record::AblatedTrial`]
//! that of a trial with fewer means ([`ablation`]); [`summary`] sums them up. [`transport`] says which balls are to be carried, as many
//! as fit at once.

pub mod ablation;
pub mod combination;
pub mod disturbance;
pub mod effects;
pub mod generator;
pub mod noise;
pub mod record;
pub mod referee;
pub mod scenario;
pub mod sight;
pub mod stages;
pub mod summary;
pub mod transport;
pub mod tries;

pub use ablation::Ablation;
pub use combination::{Combination, draw_combinations};
pub use record::{AblatedTrial, Condition, TrialId, TrialRecord};
pub use referee::{FailureCause, Referee, SceneTruth, Verdict};
pub use scenario::Scenario;
