//! Whoever answers for a policy.

use std::sync::Arc;
use std::time::Duration;

use hand_model::robot::TactileImage;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// On which level a policy decides.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Level {
    /// It chooses how the second object is taken.
    Choose,
    /// It moves the robot, twenty times a second.
    Act,
}

/// A policy as it introduces itself.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Guest {
    /// Of its class.
    pub name: String,
    pub level: Level,
    /// Side of the tactile images of a policy that acts, pixels; without it, it gets none.
    pub images: Option<usize>,
}

/// Why there is no answer.
#[derive(Debug, thiserror::Error)]
pub enum HostError {
    /// The policy has failed, in its own words: an exception with its traceback, or an answer that cannot be.
    #[error("the policy failed: {0}")]
    Failed(String),
    /// Its process has ended.
    #[error("the policy's process has ended ({0})")]
    Ended(String),
    /// What it says is no answer.
    #[error("the policy's answer: {0}")]
    Answer(String),
    /// It took too long.
    #[error("the policy has not answered within {} s (--policy-timeout): its process was ended", .0.as_secs())]
    Late(Duration),
    /// The operator wanted to end while it thought.
    #[error("interrupted while the policy thought")]
    Interrupted,
    /// The pipes to it do not work.
    #[error("the policy's process: {0}")]
    Pipe(#[from] std::io::Error),
}

/// Bytes that belong to a question, and their shape.
#[derive(Debug, Clone)]
pub struct Array<'a> {
    pub shape: Vec<usize>,
    pub bytes: &'a [u8],
}

impl<'a> Array<'a> {
    /// A camera's picture.
    pub fn picture(image: &'a Arc<TactileImage>) -> Self {
        let side = (image.rgb.len() / 3).isqrt();
        Self { shape: vec![side, side, 3], bytes: &image.rgb }
    }
}

/// Answers for a policy: a process of its own, or an object in this one.
pub trait Host {
    /// Asks a question, to which `arrays` belong, and waits for the answer: as long as it takes, or as its host lets it.
    fn ask(&mut self, question: &Value, arrays: &[Array]) -> Result<Value, HostError>;
}
