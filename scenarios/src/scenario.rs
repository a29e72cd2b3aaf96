//! The scenario file: objects and their order, layout, noise, protocol of a trial, and the referee's rules.

mod checks;
mod definition;
mod file;

pub use definition::{Scenario, StartPose, TrialProtocol, VERSION};
pub use file::BENCHMARK_TOML;

#[cfg(test)]
mod tests;
