//! A client for the Kinova Gen3 arm in its own protocol, Kortex, and an emulator of the arm.
//!
//! The arm has two interfaces. Over TCP (port 10000) the host calls functions and receives notifications; over UDP (port
//! 10001) it exchanges one command and one answer per millisecond. Both carry the same frames and require a session.
//!
//! From the wire up:
//! - [`frame`]: header and payload; [`tcp_framing`]: frames in a stream; [`call`]: the functions; [`message`]: their
//!   arguments and results; [`refusal`] and [`safety_bank`]: refusals and faults.
//! - [`link`] and [`session`]: transport, calls with deadlines, keep-alives, notifications; [`tap`]: copies for a recorder.
//! - [`joints`] and [`degrees`]: joint quantities, and their units on the wire.
//! - [`base`]: the high-level interface, with [`base::actions`]. [`cyclic`]: the cyclic exchange and its counters. [`arm`]: both.
//! - [`servoing`]: joint commands with seeded entry, checks and clean exit.
//! - [`servo_loop`]: servoing at 1 kHz in a thread, with targets from a slower controller.
//! - [`emulator`]: a Gen3 on loopback.
//!
//! # Limitations
//! The wire format was taken from the maker's client and public message definitions. Nothing here has moved a real
//! Gen3. Only tests on the arm can show how, and how fast, it reacts when commands stop; which calls its session
//! timeout counts (here all but keep-alives, as the maker describes it); the threshold of its following error; whether
//! notification handles are counted as [`base::Base::subscribe`] assumes; and how it reacts to a session that times out
//! in motion.

#![deny(missing_docs, unreachable_pub)]

pub mod arm;
pub mod base;
pub mod call;
pub mod cyclic;
pub mod degrees;
#[cfg(feature = "emulator")]
pub mod emulator;
pub mod error;
pub mod frame;
pub mod gen3;
pub mod joints;
pub mod link;
mod lock;
pub mod message;
mod recent;
pub mod refusal;
pub mod safety_bank;
pub mod servo_loop;
pub mod servoing;
pub mod session;
pub mod tap;
pub mod tcp_framing;

pub use arm::{Address, Arm};
pub use error::{CommandError, KortexError};
pub use joints::{JOINTS, Motion, ToolPose};
pub use session::{Credentials, Timeouts};
pub use tap::{Direction, Tap};
