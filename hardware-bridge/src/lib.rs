//! The real robot's side of the [`hand_model::robot::Robot`] interface.
//!
//! # What is here
//! - [`protocol2`]: the wire format of the servo bus (Dynamixel Protocol 2.0): packets, byte stuffing, CRC, a stream decoder that finds its
//!   way back after garbage, synchronous reads and writes of several servos.
//! - [`xc330`]: the XC330-T288-T's control table as data, and its counts in SI units both ways.
//!
//! # What is not here yet
//! No serial port is opened and nothing moves: there is no bus master with deadlines, no tactile camera link, no arm, no safety
//! supervisor, no emulators, and **no implementation of `Robot`**. `ftac --robot hardware` and `--robot emulated` therefore have nothing to
//! drive. Nothing in this crate has been run against a servo; it is checked against the maker's published packets and tables.

pub mod kortex;
pub mod protocol2;
pub mod session_log;
pub mod xc330;
