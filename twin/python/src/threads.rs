//! Work without Python's lock, on threads of this process.
//!
//! The threads of rayon's shared pool stay behind when a process forks, as `multiprocessing` and Gymnasium's
//! asynchronous environments do on Linux. In the forked process the pool would still take work, and nobody would do it.
//! There the work is given to another pool, which is made when it is first needed.

use std::process;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use anyhow::Context as _;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::arrays::failure;

/// The process that imported this module.
static IMPORTED_BY: OnceLock<u32> = OnceLock::new();
/// Pool of a forked process, with its number.
static FORKED_POOL: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);

/// Remembers which process imported this module.
pub fn remember_process() {
    IMPORTED_BY.get_or_init(process::id);
}

/// Threads on which work is done: the shared pool's, or those of a forked process.
#[derive(Clone)]
pub struct Threads(Option<Arc<ThreadPool>>);

impl Threads {
    /// Returns the threads of this process. Returns an error if none can be started.
    pub fn of_process() -> PyResult<Self> {
        let process = process::id();
        if IMPORTED_BY.get() == Some(&process) {
            return Ok(Self(None));
        }
        let mut pool = FORKED_POOL.lock().unwrap_or_else(PoisonError::into_inner);
        let forked_again = pool.take_if(|(owner, _)| *owner != process);
        // Its threads are in another process, and are not waited for.
        std::mem::forget(forked_again);
        if let Some((_, pool)) = &*pool {
            return Ok(Self(Some(pool.clone())));
        }
        let made = ThreadPoolBuilder::new().build().context("threads of a forked process");
        let (_, made) = pool.insert((process, Arc::new(made.map_err(|error| failure(&error))?)));
        Ok(Self(Some(made.clone())))
    }

    /// Does `work`; what it splits is done on these threads.
    pub fn run<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        match &self.0 {
            None => work(),
            Some(pool) => pool.install(work),
        }
    }
}

/// Does `work` without Python's lock, on threads of this process. It must not wait for a lock of this module: a thread
/// that holds one may take up other work while its own is split. Such locks are taken outside of [`Threads::run`].
pub fn detach<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    let threads = Threads::of_process()?;
    Ok(py.detach(|| threads.run(work)))
}
