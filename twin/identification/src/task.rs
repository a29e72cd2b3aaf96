//! Task of an excitation, as stored in its session.

use hand_model::Hand;
use serde::{Deserialize, Serialize};

use crate::script::Script;

/// [`Task::task`] of an excitation.
pub const NAME: &str = "excitation";

/// The task of an excitation's session.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Task {
    /// The name `excitation`.
    pub task: String,
    /// Name of the hand's nominal model.
    pub hand: String,
    /// Script of the excitation.
    pub script: Script,
    /// Index of the first step of this session.
    pub first: usize,
}

impl Task {
    /// Creates the task of the steps from `first` on.
    pub fn new(hand: &Hand, script: &Script, first: usize) -> Self {
        Self { task: NAME.to_owned(), hand: hand.parameters.name.clone(), script: script.clone(), first }
    }
}
