//! Pool of the processes that answer for the external policy in a run.

use std::sync::{Mutex, PoisonError};

use anyhow::{Result, bail};

use super::process::{PolicyInterrupted, PolicyProcess};
use super::server::{PolicyIntroduction, PolicyServer};
use super::source::PolicySource;

/// The external policy with its idle processes, up to one for every thread that runs trials.
pub struct ExternalPolicy {
    pub source: PolicySource,
    pub introduction: PolicyIntroduction,
    idle: Mutex<Vec<PolicyProcess>>,
}

impl ExternalPolicy {
    /// Starts a first process, so that a policy that does not work is found before any trial runs.
    pub fn start(source: PolicySource) -> Result<Self> {
        let (process, guest) = PolicyProcess::start(&source)?;
        Ok(Self { source, introduction: guest, idle: Mutex::new(vec![process]) })
    }

    /// Calls `answer` with an idle process. A process that failed is not used again.
    ///
    /// # Errors
    /// Those of `answer`, and [`PolicyInterrupted`] if the operator requested a stop while the policy was computing; the
    /// trial then does not count.
    pub fn with_process<T>(&self, answer: impl FnOnce(&mut dyn PolicyServer) -> Result<T>) -> Result<T> {
        let waiting = self.idle.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut process = match waiting {
            Some(process) => process,
            None => PolicyProcess::start(&self.source)?.0,
        };
        let answered = answer(&mut process);
        if process.was_interrupted() {
            bail!(PolicyInterrupted);
        }
        if process.is_healthy() {
            self.idle.lock().unwrap_or_else(PoisonError::into_inner).push(process);
        }
        answered
    }
}
