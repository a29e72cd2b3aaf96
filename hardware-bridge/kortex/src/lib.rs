//! The Kinova Gen3 arm, spoken to in Kortex, its own protocol, and an emulator of it.
//!
//! An arm has two sides. Over TCP (port 10000) the host calls functions and gets told of events; over UDP (port 10001)
//! it exchanges one command and one answer a thousand times a second. Both carry the same frames, and on both a session
//! is opened first.
//!
//! From the wire up:
//! - [`frame`]: header and payload; [`tcp_framing`]: frames in a stream; [`call`]: which functions there are;
//!   [`message`]: their arguments and results; [`refusal`] and [`safety_bank`]: what the arm answers when it will not
//!   or cannot.
//! - [`link`] and [`session`]: frames to and fro, calls with deadlines, keep-alives, notifications.
//! - [`degrees`]: the wire's units, and joints that turn more than once.
//! - [`base`]: the high-level side. [`cyclic`]: the exchange with its counters. [`arm`]: both.
//! - [`servoing`]: joint commands with seeded entry, checks and clean exit.
//! - [`servo_loop`]: the thousand cycles a second in a thread of their own, fed by a slower controller.
//! - [`emulator`]: a Gen3 on loopback.
//!
//! # What holds on a real arm
//! The wire format was read from the maker's own client and its public message definitions. Nothing here has moved a
//! real Gen3. Only the arm can show: what it does, and how fast, when commands stop; its following error's threshold;
//! whether handles of notifications are counted as [`base::Base::subscribe`] assumes; its reaction to a session that
//! times out in motion.

pub mod arm;
pub mod base;
pub mod call;
pub mod cyclic;
pub mod degrees;
pub mod emulator;
pub mod error;
pub mod frame;
pub mod joints;
pub mod link;
mod lock;
pub mod message;
pub mod refusal;
pub mod safety_bank;
pub mod servo_loop;
pub mod servoing;
pub mod session;
pub mod tap;
pub mod tcp_framing;

pub use arm::{Address, Arm};
pub use error::{CommandError, KortexError};
pub use joints::{JOINTS, Motion};
pub use session::{Credentials, Timeouts};
pub use tap::{Direction, Tap};
