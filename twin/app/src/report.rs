//! The report of a benchmark: `report.html`, one page that needs nothing else, and its two figures as files.
//!
//! It is made from the records and their summary alone, so that `ftac report` can make it again at any time.

mod definitions;
mod figure;
mod findings;
mod html;
mod page;
mod paper;
mod run;
mod style;
#[cfg(test)]
mod tests;

use std::fs::File;
use std::io::Write as _;
use std::path::Path;

use anyhow::{Context as _, Result};
use scenarios::TrialRecord;
use scenarios::statistics::Summary;
use serde_json::Value;

/// Writes `collision.svg`, `success.svg` and `report.html` into `folder`, which is there already. `run` says how the records
/// came about; of its keys `command` (text or a list of words) is shown as a command line, all others in a table, nested ones
/// with dotted names, and numbers whose key ends in `_s` as times.
pub fn write_report(folder: &Path, summary: &Summary, records: &[TrialRecord], run: &Value) -> Result<()> {
    let [collision, success] = findings::figures(summary, records);
    write_whole(&folder.join("collision.svg"), collision.standalone().as_bytes())?;
    write_whole(&folder.join("success.svg"), success.standalone().as_bytes())?;
    let page = page::render(summary, records, run, [&collision, &success]);
    write_whole(&folder.join("report.html"), page.as_bytes())
}

/// Writes a file so that whoever opens it sees all of it or what was there before.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    let mut partial = path.as_os_str().to_owned();
    partial.push(".partial");
    let partial = Path::new(&partial);
    let write = || -> std::io::Result<()> {
        let mut file = File::create(partial)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        std::fs::rename(partial, path)
    };
    write().with_context(|| format!("cannot write {}", path.display()))
}
