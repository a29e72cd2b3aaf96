//! Policies of the user's own: a condition of the benchmark whose decisions somebody else makes.
//!
//! [`host`] is whoever answers for a policy, and what it is asked; [`message`] writes a question from what a controller may know. [`process`] runs a
//! policy in a process of its own by the [`python`] that is there, which a deadline ends, [`pool`] keeps such processes for a run. [`chooser`] is a policy that chooses grasps.
//! One that moves the robot itself is played by the benchmark.
//!
//! A policy is told what the built-in ones know: measurements, images, what vision reports, and what touch makes of it. It runs outside of this
//! process, or behind Python's door: nothing but the answers to these questions reaches it.

pub mod chooser;
mod deadline;
pub mod host;
pub mod message;
pub mod pool;
pub mod process;
pub mod python;
pub mod source;

pub use host::{Guest, Host, HostError, Level};
pub use pool::Own;
pub use process::Interrupted;
pub use source::{Pace, Source};
