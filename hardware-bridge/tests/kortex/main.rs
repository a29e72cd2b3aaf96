//! The arm's client against the emulated arm, over loopback TCP and UDP.

mod dead_host;
mod faults;
mod servo_loop;
mod servoing;
mod session;
mod support;
