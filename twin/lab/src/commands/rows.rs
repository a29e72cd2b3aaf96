//! The rows of a check, printed and kept.

use std::path::Path;

use ftac::terminal::{Outcome, Terminal};
use lab::hand_check as check;

/// Prints the rows of a check and keeps them in `folder`.
pub fn show_rows(terminal: &Terminal, rows: &[check::Row], folder: Option<&Path>) -> Outcome {
    let text = serde_json::json!({ "seed": terminal.seed, "rows": rows });
    if let Some(folder) = folder {
        platform::data::write_whole(&folder.join("check.json"), serde_json::to_string_pretty(&text)?.as_bytes())?;
    }
    if terminal.json {
        println!("{text}");
    } else {
        print!("{}", check::row::table(rows));
    }
    Ok(check::shortfall(rows))
}
