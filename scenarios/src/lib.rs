//! Rules of the benchmark: the trials and their evaluation.
//!
//! A [`scenario`] file lists the objects of [`world`] that come first and second, their layout, and the protocol of a
//! trial; [`combination`] draws pairs of them. [`noise`] draws the errors of a trial, and [`detector_model`] turns the
//! scene into the reports of an object detector. [`effects`] are the imperfections of a real robot, with draws of the
//! [`plant`]'s hidden parameters; a [`disturbance`] is a deliberate intervention in a trial.
//!
//! The [`referee`] judges a trial from ground truth, by the phases that the controller reports or that
//! [`phase_tracker`] infers from the scene. A [`record::TrialRecord`] stores the result of a trial, a
//! [`tries::TryRecord`] that of each try, and a [`record::AblatedTrial`] that of a trial under an [`ablation`];
//! [`summary`] aggregates them. [`transport`] describes tasks in which as many balls are carried at once as the hand
//! can hold.

pub mod ablation;
pub mod combination;
pub mod detector_model;
pub mod disturbance;
pub mod effects;
pub mod generator;
pub mod noise;
pub mod phase_tracker;
pub mod record;
pub mod referee;
pub mod scenario;
pub mod summary;
pub mod transport;
pub mod tries;

pub use ablation::Ablation;
pub use combination::{Combination, draw_combinations};
pub use record::{AblatedTrial, Condition, TrialId, TrialRecord};
pub use referee::{FailureCause, Referee, SceneTruth, Verdict};
pub use scenario::Scenario;
