//! A client for the Kinova Gen3 arm in its own protocol, Kortex, and an emulator of the arm.
//!
//! The arm has two interfaces. Over TCP (port 10000) the host calls functions and receives notifications; over UDP (port
//! 10001) it exchanges one command and one answer per millisecond. Both carry the same frames and require a session.
//!
//! # Example
//! ```
//! use kinova_kortex::emulator::{Emulator, FirstOrderJoints, Pace, Settings};
//! use kinova_kortex::{Arm, Timeouts, gen3};
//!
//! // An emulated arm. A real one has `Address::of("192.168.1.10".parse()?)` and credentials of its own.
//! let settings = Settings::default();
//! let credentials = settings.credentials.clone();
//! let emulator = Emulator::start(settings, Box::new(FirstOrderJoints::gen3()), Pace::RealTime)?;
//!
//! let mut arm = Arm::connect(emulator.address(), &credentials, Timeouts::default(), gen3::HOME)?;
//! println!("state {:?}", arm.base.arm_state()?);
//! println!("joint angles {:?} rad", arm.cyclic.feedback()?.motion.position);
//! arm.close()?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//! [`Arm`] reads and calls, [`servoing::Servoing`] commands the joints cycle by cycle, and [`servo_loop::ServoLoop`] does so in
//! a thread.
//!
//! # Features
//! - `emulator`, off by default: the module `emulator`, a Gen3 on loopback for tests and for work without an arm.
//!
//! # Modules
//! From the wire up:
//! - [`frame`]: header and payload; [`tcp_framing`]: frames in a stream; [`call`]: the functions; [`message`]: their
//!   arguments and results; [`refusal`] and [`safety_bank`]: refusals and faults.
//! - [`link`] and [`session`]: transport, calls with deadlines, keep-alives, notifications; [`tap`]: copies for a recorder.
//! - [`joints`] and [`degrees`]: joint quantities, and their units on the wire. [`gen3`]: the published figures of the arm.
//! - [`base`]: the high-level interface, with [`base::actions`]. [`cyclic`]: the cyclic exchange and its counters. [`arm`]: both.
//! - [`servoing`]: joint commands with seeded entry, checks and clean exit.
//! - [`servo_loop`]: servoing at 1 kHz in a thread, with targets from a slower controller.
//! - `emulator`, with the feature of that name: a Gen3 on loopback.
//!
//! # Limitations
//! The wire format was taken from the maker's client and public message definitions. Nothing here has moved a real
//! Gen3. Only tests on the arm can show how, and how fast, it reacts when commands stop; which calls its session
//! timeout counts (here all but keep-alives, as the maker describes it); the threshold of its following error; whether
//! notification handles are counted as [`base::Base::subscribe`] assumes; and how it reacts to a session that times out
//! in motion.
//!
//! Only arms with seven joints, and only Unix systems.

#![cfg_attr(docsrs, feature(doc_cfg))]
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
pub use joints::{JOINTS, JointMotion, ToolPose};
pub use session::{Credentials, Timeouts};
pub use tap::{Direction, Tap};

/// Compiles and runs the examples of the package's page.
#[cfg(all(doctest, feature = "emulator"))]
#[doc = include_str!("../README.md")]
struct Readme;
