//! The `ftac` program.
fn main() {}
