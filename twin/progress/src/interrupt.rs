//! Ctrl-C as a request to end in order.

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag;

/// Guard that catches interrupts. While one is alive, the first Ctrl-C (or SIGTERM, or the end of the terminal) is
/// noted instead of ending the program. The second one ends it.
pub struct Interrupt {
    flags: &'static InterruptFlags,
}

/// Flags that all guards share: there is one operator.
static INTERRUPT_FLAGS: OnceLock<InterruptFlags> = OnceLock::new();

#[derive(Debug)]
struct InterruptFlags {
    happened: Arc<AtomicBool>,
    /// True if the next signal ends the program, as it does by default.
    next_is_fatal: Arc<AtomicBool>,
    /// True while a guard is alive.
    is_guarded: AtomicBool,
}

impl Interrupt {
    /// Catches interrupts from now on. Guards that are alive at the same time share their state: there is one operator.
    pub fn catch() -> io::Result<Self> {
        let flags = match INTERRUPT_FLAGS.get() {
            Some(flags) => flags,
            None => {
                let new = InterruptFlags {
                    happened: Arc::default(),
                    next_is_fatal: Arc::new(AtomicBool::new(true)),
                    is_guarded: AtomicBool::new(false),
                };
                for signal in [SIGINT, SIGTERM, SIGHUP] {
                    // The order matters: a signal is counted as fatal or not before it is noted.
                    flag::register_conditional_default(signal, new.next_is_fatal.clone())?;
                    flag::register(signal, new.next_is_fatal.clone())?;
                    flag::register(signal, new.happened.clone())?;
                }
                std::thread::Builder::new().name("interrupt".to_owned()).spawn(acknowledge)?;
                INTERRUPT_FLAGS.get_or_init(|| new)
            }
        };
        flags.happened.store(false, Ordering::SeqCst);
        flags.next_is_fatal.store(false, Ordering::SeqCst);
        flags.is_guarded.store(true, Ordering::SeqCst);
        Ok(Self { flags })
    }

    /// True if the operator has asked to end.
    pub fn happened(&self) -> bool {
        self.flags.happened.load(Ordering::SeqCst)
    }
}

/// Time between two looks for an interrupt, ms, and number of looks after which work that goes on is worth a word.
const POLL_INTERVAL: u64 = 100;
const LOOKS_BEFORE_MESSAGE: u32 = 5;

/// Says that an interrupt was noted if what is running takes a while to end in order.
fn acknowledge() {
    let mut pending = 0;
    loop {
        std::thread::sleep(Duration::from_millis(POLL_INTERVAL));
        let Some(flags) = INTERRUPT_FLAGS.get() else { continue };
        let happened = flags.is_guarded.load(Ordering::SeqCst) && flags.happened.load(Ordering::SeqCst);
        pending = if happened { pending + 1 } else { 0 };
        if pending == LOOKS_BEFORE_MESSAGE {
            eprintln!("interrupted: what is running is finished first; interrupt again to end at once");
        }
    }
}

/// Error for work that ended early at the operator's request; finished pieces were kept.
#[derive(Debug)]
pub struct Interrupted {
    /// Number of finished pieces.
    pub done: usize,
    /// Number of all pieces.
    pub total: usize,
    /// Name of a piece with its verb, in the plural.
    pub pieces: &'static str,
    /// Instructions for resuming.
    pub resume_hint: String,
}

impl std::fmt::Display for Interrupted {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { done, total: of, pieces: what, resume_hint: further } = self;
        write!(formatter, "interrupted: {done} of {of} {what}; {further}")
    }
}

impl std::error::Error for Interrupted {}

/// True if the operator has asked to end since interrupts were last caught.
pub fn is_interrupted() -> bool {
    INTERRUPT_FLAGS.get().is_some_and(|flags| flags.happened.load(Ordering::SeqCst))
}

impl Drop for Interrupt {
    fn drop(&mut self) {
        self.flags.next_is_fatal.store(true, Ordering::SeqCst);
        self.flags.is_guarded.store(false, Ordering::SeqCst);
    }
}
