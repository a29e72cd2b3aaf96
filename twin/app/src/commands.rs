//! What each command does. Each module holds its command's arguments, wires the libraries and prints.

pub mod arm;
pub mod bench;
mod body;
pub mod bridge;
pub mod demo;
pub mod export;
pub mod grasps;
pub mod hand;
mod individual;
pub mod lab_book;
pub mod optics;
mod own_hand;
pub mod replay;
mod rows;
mod scenario;
pub mod schema;
mod sessions;
pub mod shell;
pub mod study;
pub mod sweep;
mod tactile_backend;
pub mod touch;
pub mod transport;
pub mod trial;
pub mod twin;
pub mod view;
