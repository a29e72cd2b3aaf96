//! The real robot's side of the [`hand_model::robot::Robot`] interface.
pub mod arm_link;
pub mod calibration;
pub mod config;
pub mod emulator;
pub mod hand_bus;
pub mod hardware_robot;
pub mod homing;
pub mod kortex;
pub mod protocol2;
pub mod remote;
pub mod safety;
pub mod servo_bus;
pub mod servo_cycle;
pub mod session_log;
pub mod setup;
pub mod tactile_link;
pub mod xc330;

use std::sync::{Mutex, MutexGuard, PoisonError};

/// The value behind a lock. A thread that panicked while it held the lock has said so; what it left is still the newest there is.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
