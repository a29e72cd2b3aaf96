//! The real robot's side of the [`hand_model::robot::Robot`] interface.
pub mod emulator;
pub mod protocol2;
pub mod servo_bus;
pub mod tactile_link;
pub mod xc330;

use std::sync::{Mutex, MutexGuard, PoisonError};

/// The value behind a lock. A thread that panicked while it held the lock has said so; what it left is still the newest there is.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
