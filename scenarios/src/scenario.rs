//! The scenario file: objects and their order, layout, noise, protocol of a trial, and rules of judgement.

mod checks;
mod definition;
mod file;

pub use definition::{Protocol, Scenario, Start, VERSION};
pub use file::BENCHMARK;

#[cfg(test)]
mod tests;
