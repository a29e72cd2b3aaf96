//! Host side of a bus of Dynamixel servos.

pub mod exclusive;
pub mod models;
pub mod protocol2;
pub mod register;
pub mod servo_bus;
pub mod tap;
pub mod x_series;
pub mod xc330;

pub use tap::{Direction, Tap};
