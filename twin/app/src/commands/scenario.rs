//! `--scenario FILE`, of the commands that play trials.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use scenarios::Scenario;

/// The scenario in `file`, or the built-in benchmark, and its text with all the files that it names in it.
pub fn read(file: Option<&Path>) -> Result<(Scenario, String)> {
    let path = file.map_or_else(|| PathBuf::from("benchmark.toml"), Path::to_path_buf);
    let text = match file {
        Some(path) => std::fs::read_to_string(path).with_context(|| format!("--scenario {}", path.display()))?,
        None => scenarios::scenario::BENCHMARK.to_owned(),
    };
    Ok((Scenario::parse(&text, &path)?, Scenario::self_contained(&text, &path)?))
}
