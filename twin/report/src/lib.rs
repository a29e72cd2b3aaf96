//! Report of a benchmark: `report.html`, one self-contained page, and its figures as files.
//!
//! The report is made from the records and their summary only, so `ftac report` can make it again at any time.
//! [`chart`] draws charts, [`picture`] the hand, [`plot`] line plots; the checks use the last two as well. [`film`] shows
//! trials, with text by [`lettering`]. [`grasp_gallery`] shows the best grasps of each object.

mod ablation;
pub mod chart;
mod comparisons;
mod failures;
mod figure;
pub mod film;
mod findings;
pub mod grasp_gallery;
mod heat_map;
pub mod html;
pub mod identified;
pub mod lettering;
mod page;
mod panels;
mod paper;
pub mod picture;
pub mod pictures;
pub mod plot;
mod prediction;
pub mod run;
pub mod style;
#[cfg(test)]
mod tests;
mod verdict;

use std::path::Path;

use anyhow::Result;
use ftac_platform::data::write_atomically;
use scenarios::TrialRecord;
use scenarios::summary::Summary;
use serde_json::Value;

/// Writes the report into the existing `folder`: `report.html`, and, if there are data for them, `contact.svg`,
/// `clean_success.svg`, `panel_c.svg`, `panel_d.svg`, `risk.svg` and `ablations.svg`. `run` describes the run: its key
/// `command` (text or a list of words) is shown as a command line, all other keys in a table, nested ones with dotted
/// names, and numbers whose key ends in `_s` as times.
pub fn write_report(folder: &Path, summary: &Summary, records: &[TrialRecord], run: &Value) -> Result<()> {
    let [contact, clean] = findings::figures(summary, records);
    for (name, figure) in [("contact.svg", &contact), ("clean_success.svg", &clean)] {
        write_atomically(&folder.join(name), chart::standalone(&figure.draw()).as_bytes())?;
    }
    let panels = panels::drawable_panels(records);
    for panel in &panels {
        write_atomically(&folder.join(panel.file()), chart::standalone(&panel.figure.draw()).as_bytes())?;
    }
    if let Some(figure) = prediction::standalone(records) {
        write_atomically(&folder.join("risk.svg"), figure.as_bytes())?;
    }
    if !summary.ablations.is_empty() {
        let figure = chart::standalone(&ablation::figure(summary, records));
        write_atomically(&folder.join("ablations.svg"), figure.as_bytes())?;
    }
    let page = page::render(summary, records, run, (folder, [&contact, &clean], &panels))?;
    Ok(write_atomically(&folder.join("report.html"), page.as_bytes())?)
}
