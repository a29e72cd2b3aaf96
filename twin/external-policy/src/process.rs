//! A policy in a separate process.

use std::time::Duration;

use anyhow::{Context as _, Result, bail};
use python_process::{HostedProcess, ProcessError, QuestionArray, Role, StartError};
use serde_json::Value;

use super::server::{PolicyIntroduction, PolicyServer, PolicyServerError};
use super::source::PolicySource;

/// The process of a policy.
pub struct PolicyProcess(HostedProcess);

impl PolicyProcess {
    /// Starts the process of a policy and waits for its introduction.
    pub fn start(source: &PolicySource) -> Result<(Self, PolicyIntroduction)> {
        let limit = Duration::from_secs(source.timeout.into());
        match HostedProcess::start(Role::Policy, &source.python_class(), limit) {
            Ok((process, introduction)) => {
                let introduction = serde_json::from_value(introduction).context("--policy: its introduction")?;
                Ok((Self(process), introduction))
            }
            Err(StartError::Interrupted { .. }) => bail!(PolicyInterrupted),
            Err(error) => Err(error.into()),
        }
    }

    /// True if it can be asked again.
    pub fn is_healthy(&self) -> bool {
        self.0.is_healthy()
    }

    /// True if the operator requested a stop while the policy was computing.
    pub fn was_interrupted(&self) -> bool {
        self.0.was_interrupted()
    }
}

impl PolicyServer for PolicyProcess {
    fn ask(&mut self, question: &Value, arrays: &[QuestionArray]) -> Result<Value, PolicyServerError> {
        Ok(self.0.ask(question, arrays)?.value)
    }
}

impl From<ProcessError> for PolicyServerError {
    fn from(error: ProcessError) -> Self {
        match error {
            ProcessError::Failed(why) => Self::Failed(why),
            ProcessError::Ended(status) => Self::ProcessEnded(status),
            ProcessError::InvalidAnswer(why) => Self::InvalidAnswer(why),
            ProcessError::TimedOut(limit) => Self::TimedOut(limit),
            ProcessError::Interrupted => Self::Interrupted,
            ProcessError::Pipe(error) => Self::Pipe(error),
        }
    }
}

/// The operator requested a stop while a policy was computing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("interrupted while the policy thought: this trial is left out, what is finished is kept")]
pub struct PolicyInterrupted;
