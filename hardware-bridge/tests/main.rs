//! Tests of the bridge on emulated devices in one program, which is linked once.

mod common;
mod faults;
mod fuzz;
mod hardware_robot;
mod kortex_link;
mod robot_link;
mod servo_bus;
mod soak;
