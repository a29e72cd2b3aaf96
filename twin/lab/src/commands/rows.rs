//! Output of the rows of a check, printed and saved.

use std::path::Path;

use ftac::terminal::{Outcome, Terminal};
use lab::hand_check as check;
use schemars::JsonSchema;
use serde::Serialize;

/// Output of a check.
#[derive(Debug, Serialize, JsonSchema)]
pub struct CheckOutput<'a> {
    /// Seed of all random numbers.
    seed: u64,
    /// One entry per row of the table.
    rows: &'a [check::CheckRow],
}

/// Prints the rows of a check and saves them in `folder`.
pub fn show_rows(terminal: &Terminal, rows: &[check::CheckRow], folder: Option<&Path>) -> Outcome {
    let checked = CheckOutput { seed: terminal.seed, rows };
    if let Some(folder) = folder {
        ftac_platform::data::write_atomically(
            &folder.join("check.json"),
            serde_json::to_string_pretty(&checked)?.as_bytes(),
        )?;
    }
    terminal.print(&checked, &check::row::table(rows))?;
    Ok(check::shortfall(rows))
}
