//! Termination of a hosted process: at a time limit, at the operator's request, or when it is no longer needed. No process
//! is left behind.

use std::process::Stdio;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use ftac_platform::child;

use progress::interrupt;

/// Polling interval for the operator's request to stop while an answer is awaited.
const POLL_INTERVAL: Duration = Duration::from_millis(50);
/// Grace period for an answer after the operator's request to stop.
const GRACE_PERIOD: Duration = Duration::from_secs(1);

/// Cause of the end of a process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EndCause {
    /// It exceeded this time limit.
    Late(Duration),
    /// The operator requested a stop.
    Interrupted,
}

#[derive(Debug, Default)]
struct DeadlineState {
    /// Deadline of the awaited answer, and its time limit.
    awaited_answer: Option<(Instant, Duration)>,
    /// Time at which the operator requested a stop.
    stop_requested_at: Option<Instant>,
    /// Leader of the process group, as long as the group may exist.
    group: Option<u32>,
    ended: Option<EndCause>,
    /// True if no answer will be awaited any more.
    finished: bool,
}

/// Supervises one process group from a thread of its own. A blocking read from or write to the process returns when the
/// process ends.
#[derive(Debug)]
pub struct Deadline {
    shared: Arc<(Mutex<DeadlineState>, Condvar)>,
}

fn lock(state: &Mutex<DeadlineState>) -> MutexGuard<'_, DeadlineState> {
    state.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Deadline {
    /// Supervises the process group of the process `leader`.
    pub fn supervise(leader: u32) -> Self {
        let state = DeadlineState { group: Some(leader), ..DeadlineState::default() };
        let shared = Arc::new((Mutex::new(state), Condvar::new()));
        let watched = shared.clone();
        std::thread::spawn(move || watch(&watched.0, &watched.1));
        Self { shared }
    }

    /// Waits for `answer`, which reads or writes, for at most `limit`. If the process is ended meanwhile, returns the
    /// reason for that instead of the resulting error.
    pub fn wait_for<T, E>(
        &self,
        limit: Duration,
        answer: impl FnOnce() -> Result<T, E>,
    ) -> Result<T, Result<EndCause, E>> {
        let (state, changed) = &*self.shared;
        {
            let mut state = lock(state);
            (state.awaited_answer, state.stop_requested_at) = (Some((Instant::now() + limit, limit)), None);
        }
        changed.notify_one();
        let answer = answer();
        let mut state = lock(state);
        state.awaited_answer = None;
        answer.map_err(|error| state.ended.ok_or(error))
    }

    /// Ends every process of the group, once only, because its number may belong to another group later.
    pub fn kill_group(&self) {
        kill_locked_group(&mut lock(&self.shared.0));
    }
}

impl Drop for Deadline {
    fn drop(&mut self) {
        lock(&self.shared.0).finished = true;
        self.shared.1.notify_one();
    }
}

fn kill_locked_group(state: &mut DeadlineState) {
    if let Some(group) = state.group.take() {
        // The shell's own `kill`, because the standard library cannot signal groups. A group that has ended by itself
        // is fine.
        let kill = ["-c", "kill -s KILL -- -\"$1\"", "sh", &group.to_string()].map(str::to_owned);
        let _ =
            child::command("sh").args(kill).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).status();
    }
}

fn watch(state: &Mutex<DeadlineState>, changed: &Condvar) {
    let mut state = lock(state);
    while !state.finished {
        let Some((until, limit)) = state.awaited_answer else {
            state = changed.wait(state).unwrap_or_else(PoisonError::into_inner);
            continue;
        };
        let now = Instant::now();
        if interrupt::is_interrupted() {
            state.stop_requested_at.get_or_insert(now);
        }
        let ended = match state.stop_requested_at {
            Some(requested) if now >= requested + GRACE_PERIOD => Some(EndCause::Interrupted),
            _ if now >= until => Some(EndCause::Late(limit)),
            _ => None,
        };
        if ended.is_some() {
            state.ended = ended;
            kill_locked_group(&mut state);
            return;
        }
        let wait = POLL_INTERVAL.min(until.saturating_duration_since(now));
        state = changed.wait_timeout(state, wait).unwrap_or_else(PoisonError::into_inner).0;
    }
}
