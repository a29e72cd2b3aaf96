//! Pool of the processes that answer for the user's policy in a run.

use std::sync::{Mutex, PoisonError};

use anyhow::{Result, bail};

use super::process::{PolicyInterrupted, PolicyProcess};
use super::server::{PolicyIntroduction, PolicyServer};
use super::source::PolicySource;

/// The user's policy with its idle processes, up to one for every thread that plays.
pub struct ExternalPolicy {
    pub source: PolicySource,
    pub introduction: PolicyIntroduction,
    idle: Mutex<Vec<PolicyProcess>>,
}

impl ExternalPolicy {
    /// Starts a first process, so that a policy that does not work is found before anything is played.
    pub fn start(source: PolicySource) -> Result<Self> {
        let (process, guest) = PolicyProcess::start(&source)?;
        Ok(Self { source, introduction: guest, idle: Mutex::new(vec![process]) })
    }

    /// Plays with a process that nobody else uses. A process that failed is not used again.
    ///
    /// # Errors
    /// Those of `play`, and [`PolicyInterrupted`] if the operator requested a stop while the policy was thinking; the trial
    /// then does not count.
    pub fn with_process<T>(&self, play: impl FnOnce(&mut dyn PolicyServer) -> Result<T>) -> Result<T> {
        let waiting = self.idle.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut process = match waiting {
            Some(process) => process,
            None => PolicyProcess::start(&self.source)?.0,
        };
        let played = play(&mut process);
        if process.was_interrupted() {
            bail!(PolicyInterrupted);
        }
        if process.is_healthy() {
            self.idle.lock().unwrap_or_else(PoisonError::into_inner).push(process);
        }
        played
    }
}
