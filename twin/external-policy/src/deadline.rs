//! The end of a policy's process: at a time limit, at the operator's wish, or because nobody asks it any more; never left behind.

use std::process::Stdio;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use platform::child;

use progress::interrupt;

/// Between two looks at whether the operator wants to end while an answer is awaited.
const LOOK: Duration = Duration::from_millis(50);
/// How long an answer may still take once the operator wants to end.
const GRACE: Duration = Duration::from_secs(1);

/// Why a process was ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ended {
    /// It took longer than this.
    Late(Duration),
    /// The operator wanted to end.
    Interrupted,
}

#[derive(Debug, Default)]
struct State {
    /// Until when an answer must be there, and how long that is.
    awaited: Option<(Instant, Duration)>,
    /// Since when the operator wants to end.
    wished: Option<Instant>,
    /// The leader of the process group, as long as the group may be there.
    group: Option<u32>,
    ended: Option<Ended>,
    /// Nobody awaits anything any more.
    over: bool,
}

/// Watches over one process group from a thread of its own: whoever reads from or writes to the process is set free by its end.
#[derive(Debug)]
pub struct Deadline {
    shared: Arc<(Mutex<State>, Condvar)>,
}

fn lock(state: &Mutex<State>) -> MutexGuard<'_, State> {
    state.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Deadline {
    /// Over the process group that the process `leader` leads.
    pub fn over(leader: u32) -> Self {
        let state = State { group: Some(leader), ..State::default() };
        let shared = Arc::new((Mutex::new(state), Condvar::new()));
        let watched = shared.clone();
        std::thread::spawn(move || watch(&watched.0, &watched.1));
        Self { shared }
    }

    /// Waits for `answer`, which reads or writes, for no longer than `limit`. What ended the process meanwhile is told instead of the error that this
    /// led to.
    pub fn within<T, E>(&self, limit: Duration, answer: impl FnOnce() -> Result<T, E>) -> Result<T, Result<Ended, E>> {
        let (state, changed) = &*self.shared;
        {
            let mut state = lock(state);
            (state.awaited, state.wished) = (Some((Instant::now() + limit, limit)), None);
        }
        changed.notify_one();
        let answer = answer();
        let mut state = lock(state);
        state.awaited = None;
        answer.map_err(|error| state.ended.ok_or(error))
    }

    /// Ends every process of the group, for good: its number may be another's later.
    pub fn end(&self) {
        end(&mut lock(&self.shared.0));
    }
}

impl Drop for Deadline {
    fn drop(&mut self) {
        lock(&self.shared.0).over = true;
        self.shared.1.notify_one();
    }
}

fn end(state: &mut State) {
    if let Some(group) = state.group.take() {
        // The shell's own: the standard library signals no groups. One that has ended by itself is as good.
        let kill = ["-c", "kill -s KILL -- -\"$1\"", "sh", &group.to_string()].map(str::to_owned);
        let _ =
            child::command("sh").args(kill).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).status();
    }
}

fn watch(state: &Mutex<State>, changed: &Condvar) {
    let mut state = lock(state);
    while !state.over {
        let Some((until, limit)) = state.awaited else {
            state = changed.wait(state).unwrap_or_else(PoisonError::into_inner);
            continue;
        };
        let now = Instant::now();
        if interrupt::is_interrupted() {
            state.wished.get_or_insert(now);
        }
        let ended = match state.wished {
            Some(wished) if now >= wished + GRACE => Some(Ended::Interrupted),
            _ if now >= until => Some(Ended::Late(limit)),
            _ => None,
        };
        if ended.is_some() {
            state.ended = ended;
            end(&mut state);
            return;
        }
        let wait = LOOK.min(until.saturating_duration_since(now));
        state = changed.wait_timeout(state, wait).unwrap_or_else(PoisonError::into_inner).0;
    }
}
