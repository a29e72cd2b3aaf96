//! Commands of the program: each wires the libraries together and prints the result. Their arguments are in
//! `ftac::lab::arguments`.

pub mod arm;
pub mod grasps;
pub mod hand;
mod lab_book;
pub mod report;
mod rows;
pub mod schema;
pub mod study;
pub mod touch;
