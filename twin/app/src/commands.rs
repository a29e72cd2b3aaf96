//! The commands. Each module holds the arguments of its command, wires the libraries and prints the result.

pub mod bench;
pub mod board;
pub mod bridge;
pub mod combos;
pub mod demo;
pub mod demonstrations;
pub mod export;
pub mod grasps;
pub mod hand;
pub mod optics;
pub mod reference;
pub mod replay;
pub mod report;
pub mod ros2;
pub mod schema;
mod sessions;
pub mod shell;
pub mod sweep;
pub mod sysid;
pub mod touch;
pub mod transport;
pub mod trial;
pub mod view;
