//! A Gen3 on loopback: its sessions, modes, faults, watchdogs and cyclic exchange, around a plant that can be
//! exchanged.
//!
//! [`Controller`] is the arm's base without sockets and without a clock of its own: frames and milliseconds go in,
//! frames come out. [`Emulator`] puts it on a TCP and a UDP port. Time runs by itself ([`Pace::RealTime`]) or by
//! [`Emulator::step`] alone ([`Pace::Stepped`]), which makes a test exact and lets a simulation be the plant.
//!
//! # What is assumed
//! Of a real arm's reactions not all are published. The emulator's, where they are guesses, are on the careful side:
//! - Commands that stop for [`Settings::cyclic_deadline`] raise every joint's watchdog fault and stop the arm.
//! - A session that ends while its speeds move the arm, or while it servoes, stops the arm.
//! - A joint further than [`Settings::following_error`] from its command raises a following error.
//! - In fault the arm keeps answering the cyclic exchange, without moving; after an emergency stop it refuses it,
//!   because the servoing mode is gone.

mod calls;
mod controller;
mod fault_injection;
mod peer;
mod plant;
mod server;
mod sessions;

pub use controller::{Commands, Controller, Event, Happening, Settings, Status};
pub use fault_injection::Injection;
pub use peer::{Outgoing, Peer};
pub use plant::{Drive, FirstOrderJoints, Plant};
pub use server::{Emulator, Pace};
