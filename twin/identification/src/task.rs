//! Task of an excitation, as stored in its session.

use hand_model::Hand;
use serde::{Deserialize, Serialize};

use crate::script::ExcitationScript;

/// [`IdentificationTask::task`] of an excitation.
pub const TASK_NAME: &str = "excitation";

/// The task of an excitation's session.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IdentificationTask {
    /// The name `excitation`.
    pub task: String,
    /// Name of the hand's nominal model.
    pub hand: String,
    /// Script of the excitation.
    pub script: ExcitationScript,
    /// Index of the first step of this session.
    pub first: usize,
}

impl IdentificationTask {
    /// Creates the task of the steps from `first` on.
    pub fn new(hand: &Hand, script: &ExcitationScript, first: usize) -> Self {
        Self { task: TASK_NAME.to_owned(), hand: hand.parameters.name.clone(), script: script.clone(), first }
    }
}
