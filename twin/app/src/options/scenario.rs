//! The option `--scenario FILE` of commands that play trials.

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Args;
use ftac_platform::data::{DataError, read_text};
use ftac_platform::reach::{BELOW, Reach};
use scenarios::Scenario;

/// Options for the scenario.
#[derive(Debug, Clone, Default, Args)]
pub struct ScenarioArgs {
    /// Scenario file; default: the built-in benchmark. It may name files below its own folder only.
    #[arg(long)]
    pub scenario: Option<PathBuf>,
    /// Let the scenario name files anywhere, not only below its own folder.
    #[arg(long, requires = "scenario")]
    pub any_files: bool,
}

impl ScenarioArgs {
    /// Reads the scenario. Also returns its self-contained text, which includes all files that it names.
    pub fn read(&self) -> Result<(Scenario, String)> {
        let Some(path) = &self.scenario else {
            return Ok((Scenario::benchmark(), scenarios::scenario::BENCHMARK.to_owned()));
        };
        let text = read_text(path).context("--scenario")?;
        let reach = if self.any_files { Reach::Anywhere } else { Reach::beside(path) };
        let scenario = Scenario::parse_within(&text, path, reach).map_err(with_the_way_out)?;
        Ok((scenario, Scenario::self_contained(&text, path, reach)?))
    }
}

/// Adds the option `--any-files` to an error about a file out of reach.
fn with_the_way_out(mut error: DataError) -> DataError {
    if let DataError::Field { expected, .. } = &mut error
        && expected.starts_with(BELOW)
    {
        expected.push_str(", or --any-files with a scenario of your own");
    }
    error
}
