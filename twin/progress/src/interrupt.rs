//! Ctrl-C as a request to end in order.

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag;

/// Guard that catches interrupts. While one is alive, the first Ctrl-C (or SIGTERM, or the end of the terminal) is
/// noted instead of ending the program. The second one ends it.
pub struct Interrupt {
    flags: &'static Flags,
}

/// Flags that all guards share: there is one operator.
static FLAGS: OnceLock<Flags> = OnceLock::new();

#[derive(Debug)]
struct Flags {
    happened: Arc<AtomicBool>,
    /// True if the next signal ends the program, as it does by default.
    deadly: Arc<AtomicBool>,
}

impl Interrupt {
    /// Catches interrupts from now on. Guards that are alive at the same time share their state: there is one operator.
    pub fn catch() -> io::Result<Self> {
        let flags = match FLAGS.get() {
            Some(flags) => flags,
            None => {
                let new = Flags { happened: Arc::default(), deadly: Arc::new(AtomicBool::new(true)) };
                for signal in [SIGINT, SIGTERM, SIGHUP] {
                    // The order matters: whether a signal is deadly is decided before it is noted.
                    flag::register_conditional_default(signal, new.deadly.clone())?;
                    flag::register(signal, new.deadly.clone())?;
                    flag::register(signal, new.happened.clone())?;
                }
                FLAGS.get_or_init(|| new)
            }
        };
        flags.happened.store(false, Ordering::SeqCst);
        flags.deadly.store(false, Ordering::SeqCst);
        Ok(Self { flags })
    }

    /// True if the operator has asked to end.
    pub fn happened(&self) -> bool {
        self.flags.happened.load(Ordering::SeqCst)
    }
}

/// Error for work that ended early at the operator's request; finished pieces were kept.
#[derive(Debug)]
pub struct Interrupted {
    /// Number of finished pieces.
    pub done: usize,
    /// Number of all pieces.
    pub of: usize,
    /// Name of a piece with its verb, in the plural.
    pub what: &'static str,
    /// Instructions for resuming.
    pub further: String,
}

impl std::fmt::Display for Interrupted {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { done, of, what, further } = self;
        write!(formatter, "interrupted: {done} of {of} {what}; {further}")
    }
}

impl std::error::Error for Interrupted {}

/// True if the operator has asked to end since interrupts were last caught.
pub fn is_interrupted() -> bool {
    FLAGS.get().is_some_and(|flags| flags.happened.load(Ordering::SeqCst))
}

impl Drop for Interrupt {
    fn drop(&mut self) {
        self.flags.deadly.store(true, Ordering::SeqCst);
    }
}
