//! `ftac report --study`: all results of the study on one page, compared with the paper: the paper's figure, this
//! project's, the difference, and its reason.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use ftac::terminal::{Outcome, Terminal};
use ftac_platform::data::write_atomically;
use grasp_analysis::sensors::{TactileArray, tactile_array};
use hand_model::RobotModel;
use lab::hand_check::figures;
use lab::study_pages::comparison::{PaperComparisonRow, SensorFigures, StudyParts, comparison_rows};
use lab::study_pages::overview;
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value;
use tactile_optics::GelFoundation;
use tactile_optics::foundation::{probe_response, sensitivity};

/// Output once the page is written.
#[derive(Debug, Serialize, JsonSchema)]
pub struct StudyOutput<'a> {
    /// One entry per row of the table.
    rows: &'a [PaperComparisonRow],
    /// Tactile sensors of the hand.
    sensors: &'a TactileArray,
    /// Commands whose results are missing.
    missing: &'a [&'a str],
}

/// Reads the result file of one part of the study; `None` if it is missing.
fn read_part(folder: &Path, file: &str) -> Result<Option<Value>> {
    let path = folder.join(file);
    match std::fs::read_to_string(&path) {
        Ok(text) => Ok(Some(serde_json::from_str(&text).with_context(|| path.display().to_string())?)),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error).with_context(|| path.display().to_string()),
    }
}

/// Reports on the study in the named folder, or in the default one.
pub fn report_folders(terminal: &Terminal, folders: &[PathBuf]) -> Outcome {
    match folders {
        [] => run(terminal, Path::new("recordings/study")),
        [folder] => run(terminal, folder),
        _ => bail!("--study: found {} folders, expected one", folders.len()),
    }
}

/// Runs `ftac report --study`.
fn run(terminal: &Terminal, folder: &Path) -> Outcome {
    if !folder.is_dir() {
        bail!(
            "{}: found no such folder; expected the results of `ftac grasps classify --out {0}`, `map` and `landscape`",
            folder.display()
        );
    }
    let parts = StudyParts {
        classes: read_part(folder, "classes.json")?,
        map: read_part(folder, "map.json")?,
        landscape: read_part(folder, "landscape/landscape.json")?,
        hands: read_part(folder, "hands.json")?,
    };
    let sensing = sensing()?;
    let lines = comparison_rows(&parts, &sensing);
    let missing: Vec<&str> = [
        (parts.classes.is_none(), "grasps classify"),
        (parts.map.is_none(), "grasps map"),
        (parts.landscape.is_none(), "grasps landscape"),
        (parts.hands.is_none(), "grasps hands"),
    ]
    .into_iter()
    .filter_map(|(missing, command)| missing.then_some(command))
    .collect();
    let page = overview::page(folder, &lines, parts.hands.as_ref(), &sensing);
    write_atomically(&folder.join("study.html"), page.as_bytes())?;
    let row = |PaperComparisonRow { what, theirs, ours, difference, why }: &PaperComparisonRow| {
        format!("{what:48} {theirs:>18} {ours:>36} {difference:>13}  {why}\n")
    };
    let text: String = lines.iter().map(row).collect();
    let study = StudyOutput { rows: &lines, sensors: &sensing.array, missing: &missing };
    terminal.print(&study, &format!("{text}{}/study.html\n", folder.display()))?;
    Ok((!missing.is_empty()).then(|| format!("parts are missing: run `ftac {}`", missing.join("`, `ftac "))))
}

/// Computes the key figures of the hand's tactile sensors.
fn sensing() -> Result<SensorFigures> {
    let hand = RobotModel::ftac_gen3().hand;
    let gel = GelFoundation::paper(hand.gel().thickness);
    Ok(SensorFigures {
        array: tactile_array(&hand),
        coverage: figures::coverage(&hand, None)?.ours,
        response: sensitivity(&probe_response(&gel, 160.0, 161), 50.0).per_kpa,
    })
}
