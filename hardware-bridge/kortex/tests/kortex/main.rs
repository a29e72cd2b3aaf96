//! The arm's client against the emulated arm, over loopback TCP and UDP.

mod actions;
mod any_request;
mod dead_host;
mod fault_matrix;
mod faults;
mod lost_arm;
mod servo_loop;
mod servoing;
mod session;
mod support;
