//! Policy servers: they answer the questions to a policy.

use std::sync::Arc;
use std::time::Duration;

use hand_model::robot::TactileImage;
pub use python_process::QuestionArray;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Level at which a policy decides.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DecisionLevel {
    /// The policy chooses how the second object is taken.
    Choose,
    /// The policy moves the robot, twenty times a second.
    Act,
}

/// Introduction of a policy.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PolicyIntroduction {
    /// Name of its class.
    pub name: String,
    pub level: DecisionLevel,
    /// Side of the tactile images for a policy that acts, pixels. Without it, the policy gets no images.
    pub images: Option<usize>,
}

/// Failure to get an answer.
#[derive(Debug, thiserror::Error)]
pub enum PolicyServerError {
    /// The policy has failed, in its own words: an exception with its traceback, or an invalid answer.
    #[error("the policy failed: {0}")]
    Failed(String),
    /// The policy's process has ended.
    #[error("the policy's process has ended ({0})")]
    ProcessEnded(String),
    /// The reply is not a valid answer.
    #[error("the policy's answer: {0}")]
    InvalidAnswer(String),
    /// The policy exceeded its time limit.
    #[error("the policy has not answered within {} s (--policy-timeout): its process was ended", .0.as_secs())]
    TimedOut(Duration),
    /// The operator requested a stop while the policy was computing.
    #[error("interrupted while the policy thought")]
    Interrupted,
    /// The pipes to the policy failed.
    #[error("the policy's process: {0}")]
    Pipe(#[from] std::io::Error),
}

/// Returns the image of a camera as an array of a question.
pub fn image_array(image: &Arc<TactileImage>) -> QuestionArray<'_> {
    let side = (image.rgb.len() / 3).isqrt();
    QuestionArray { shape: vec![side, side, 3], bytes: &image.rgb }
}

/// Answers the questions to a policy: a separate process, or an object in this one.
pub trait PolicyServer {
    /// Asks a question, accompanied by `arrays`, and waits for the answer without limit, or up to the server's time
    /// limit.
    fn ask(&mut self, question: &Value, arrays: &[QuestionArray]) -> Result<Value, PolicyServerError>;
}
