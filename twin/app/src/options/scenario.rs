//! The option `--scenario FILE` of commands that run trials.

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Args;
use ftac_platform::data::{DataError, read_text};
use ftac_platform::file_access::{FileAccess, PERMITTED_FOLDER_PREFIX};
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
            return Ok((Scenario::benchmark(), scenarios::scenario::BENCHMARK_TOML.to_owned()));
        };
        let text = read_text(path).context("--scenario")?;
        let reach = if self.any_files { FileAccess::Anywhere } else { FileAccess::in_folder_of(path) };
        let scenario = Scenario::parse_within(&text, path, reach).map_err(with_any_files_hint)?;
        Ok((scenario, Scenario::self_contained(&text, path, reach)?))
    }
}

/// Adds the option `--any-files` to an error about a file out of reach.
fn with_any_files_hint(mut error: DataError) -> DataError {
    if let DataError::Field { expected, .. } = &mut error
        && expected.starts_with(PERMITTED_FOLDER_PREFIX)
    {
        expected.push_str(", or --any-files with a scenario of your own");
    }
    error
}
