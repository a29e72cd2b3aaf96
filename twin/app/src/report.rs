//! The report of a benchmark: `report.html`, one page that needs nothing else, and its two figures as files.
//!
//! It is made from the records and their summary alone, so that `ftac report` can make it again at any time.

mod ablation;
mod definitions;
mod figure;
mod findings;
pub mod html;
pub mod lab_book;
mod page;
mod paper;
mod run;
pub mod style;
#[cfg(test)]
mod tests;

use std::fs::Permissions;
use std::io::Write as _;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;

use anyhow::{Context as _, Result};
use scenarios::TrialRecord;
use scenarios::statistics::Summary;
use serde_json::Value;
use tempfile::Builder;

/// Writes `collision.svg`, `success.svg`, where there are ablations `ablations.svg`, and `report.html` into `folder`, which is there already. `run` says how the records
/// came about; of its keys `command` (text or a list of words) is shown as a command line, all others in a table, nested ones
/// with dotted names, and numbers whose key ends in `_s` as times.
pub fn write_report(folder: &Path, summary: &Summary, records: &[TrialRecord], run: &Value) -> Result<()> {
    let [collision, success] = findings::figures(summary, records);
    write_whole(&folder.join("collision.svg"), collision.standalone().as_bytes())?;
    write_whole(&folder.join("success.svg"), success.standalone().as_bytes())?;
    if !summary.ablations.is_empty() {
        let figure = ablation::figure(summary, records, true);
        let head = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n";
        write_whole(&folder.join("ablations.svg"), format!("{head}{figure}").as_bytes())?;
    }
    let page = page::render(summary, records, run, [&collision, &success]);
    write_whole(&folder.join("report.html"), page.as_bytes())
}

/// Writes a file so that whoever opens it sees all of it or what was there before.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let write = || -> std::io::Result<()> {
        // Readable by everyone, as an ordinary new file is; temporary ones are private otherwise.
        let mut file = Builder::new().permissions(Permissions::from_mode(0o644)).tempfile_in(folder)?;
        file.write_all(bytes)?;
        file.as_file().sync_all()?;
        file.persist(path)?;
        Ok(())
    };
    write().with_context(|| format!("cannot write {}", path.display()))
}
