//! Host side of a bus of Dynamixel servos: Protocol 2.0, requests with deadlines, control tables in SI units, statistics.
//!
//! A [`ServoBus`] owns a serial port. It asks one servo, or several at once, and returns a result for each of them: one
//! silent servo does not hide the others. A [`Register`] converts between SI units and counts; [`models`] has the control
//! tables.
//!
//! # Example
//! ```no_run
//! use std::time::Duration;
//!
//! use dynamixel_bus::models::{Model, xl330_m288::{GOAL_POSITION, PRESENT_POSITION}};
//! use dynamixel_bus::{BusSettings, ServoBus};
//!
//! let settings = BusSettings { baud: 1_000_000, ..BusSettings::default() };
//! let mut bus = ServoBus::open("/dev/ttyUSB0", settings)?;
//! for servo in bus.scan(Duration::from_millis(300))? {
//!     println!("{}: {}", servo.id, Model::by_number(servo.model).map_or("unknown model", |model| model.name));
//! }
//! for torque in bus.set_torque(&[1, 2], true) {
//!     torque?;
//! }
//! bus.sync_write_values(&GOAL_POSITION, &[(1, 1.5), (2, 3.0)])?;
//! for angle in bus.sync_read_register(&[1, 2], &PRESENT_POSITION)? {
//!     println!("{:.3} rad", angle?);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Modules
//! From the wire up:
//! - [`protocol2`]: packets, their decoder, instructions and answers; independent of any port.
//! - [`register`]: registers and units. [`models`]: control tables by model number; [`xc330`] is one of them, with the
//!   blocks of a control cycle. [`x_series`]: operating modes, hardware errors, baud rates.
//! - [`servo_bus`]: the bus, with its statistics, the calculated duration of a cycle, and the latency timer of FTDI
//!   adapters.
//! - [`exclusive`]: a serial port that one program at a time can open. [`tap`]: copies of all bytes for a recorder.
//!
//! # Units
//! rad, rad/s, rad/s^2, A, V, s and degrees Celsius. Angles are those of the servo: 0 to 2 pi rad within a turn, pi rad at
//! the middle of its travel (2048 counts), positive counter-clockwise in the normal drive mode.
//!
//! # Limitations
//! Nothing here has been run on a real servo: it was tested on emulated ones, and its packets against the manufacturer's
//! published examples. Protocol 1.0, and the instructions clear, factory reset and control table backup, are missing.
//! Only Unix systems. Port-owner lookup and the latency timer work only on Linux.

#![deny(missing_docs, unreachable_pub)]

pub mod exclusive;
pub mod models;
pub mod protocol2;
pub mod register;
pub mod servo_bus;
pub mod tap;
pub mod x_series;
pub mod xc330;

pub use models::Model;
pub use protocol2::{ReplyError, ServoError, Status};
pub use register::{Register, RegisterError};
pub use servo_bus::{BusError, BusSettings, PingReply, ServoBus};
pub use tap::{Direction, Tap};

/// Compiles and runs the examples of the package's page.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
