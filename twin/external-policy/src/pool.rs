//! Pool of the processes that answer for the user's policy in a run.

use std::sync::{Mutex, PoisonError};

use anyhow::{Result, bail};

use super::host::{Guest, Host};
use super::process::{Interrupted, Process};
use super::source::Source;

/// The user's policy with its idle processes, up to one for every thread that plays.
pub struct Own {
    pub source: Source,
    pub guest: Guest,
    waiting: Mutex<Vec<Process>>,
}

impl Own {
    /// Starts a first process, so that a policy that does not work is found before anything is played.
    pub fn start(source: Source) -> Result<Self> {
        let (process, guest) = Process::start(&source)?;
        Ok(Self { source, guest, waiting: Mutex::new(vec![process]) })
    }

    /// Plays with a process that nobody else uses. A process that failed is not used again.
    ///
    /// # Errors
    /// Those of `play`, and [`Interrupted`] if the operator requested a stop while the policy was thinking; the trial
    /// then does not count.
    pub fn with<T>(&self, play: impl FnOnce(&mut dyn Host) -> Result<T>) -> Result<T> {
        let waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut process = match waiting {
            Some(process) => process,
            None => Process::start(&self.source)?.0,
        };
        let played = play(&mut process);
        if process.was_interrupted() {
            bail!(Interrupted);
        }
        if process.is_well() {
            self.waiting.lock().unwrap_or_else(PoisonError::into_inner).push(process);
        }
        played
    }
}
