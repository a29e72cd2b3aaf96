//! The scenario file: which objects come first and second, where they stand, what goes wrong, how a trial goes and is judged.

mod checks;
mod definition;
mod file;

pub use definition::{Protocol, Scenario, Start, VERSION};
pub use file::BENCHMARK;

#[cfg(test)]
mod tests;
