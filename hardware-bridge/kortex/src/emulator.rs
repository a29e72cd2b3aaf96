//! An emulated Gen3 on loopback: sessions, modes, faults, watchdogs and the cyclic exchange, around any [`Plant`].
//!
//! [`Controller`] is the arm's base without sockets or clock: it takes frames and milliseconds and returns frames.
//! [`Emulator`] serves it on a TCP and a UDP port, in real time ([`Pace::RealTime`]) or stepped by [`Emulator::step`]
//! ([`Pace::Stepped`]), for exact tests and for a simulated plant.
//!
//! # Assumptions
//! Not all reactions of the real arm are published. Where the emulator guesses, it takes the careful side:
//! - If commands stop for [`Settings::cyclic_deadline`], every joint raises its watchdog fault and the arm stops. A
//!   command that has arrived but was not read yet does not count as missing.
//! - A session ends without a call for its session timeout, or without any sign of life for its connection timeout.
//!   Keep-alives are signs of life but not calls.
//! - A session that ends while its speeds or its action move the arm, or while it is servoing, stops the arm.
//! - An action is aborted by any command that moves or stops the arm and by a change of mode. The next one begins when
//!   the joints have braked. An action takes 0.5 rad/s and 1.5 rad/s² unless it asks for a duration or a speed. Poses,
//!   twists and sequences are refused: the arm's base here knows no kinematics.
//! - A joint further than [`Settings::following_error`] from its command raises a following error.
//! - In fault the arm keeps answering the cyclic exchange, without moving; after an emergency stop it refuses it,
//!   because the servoing mode is gone.

mod actions;
mod calls;
mod controller;
mod devices;
mod fault_injection;
mod notifications;
mod path;
mod peer;
mod plant;
mod playing;
mod refusals;
mod server;
mod sessions;
mod sockets;
mod subscription;

pub use controller::{Commands, Controller, Event, EventKind, Settings, Status};
pub use fault_injection::Injection;
pub use peer::{Outgoing, Peer};
pub use plant::{Drive, FirstOrderJoints, Plant};
pub use server::{Emulator, Pace};
