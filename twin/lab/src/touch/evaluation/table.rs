//! Results of the evaluation as text.

use std::collections::BTreeSet;

use crate::touch::networks::{METHOD_IN_USE, NormalMethod};
use statistics::percentile;

use super::{ChangedOptics, TouchEvaluation, step_latencies};
use crate::touch::normals::{NormalErrors, RealRow, RealSource};
use crate::touch::poses::{
    Causes, ErrorPercentiles, LARGE_ERROR, PoseEvaluation, PoseSource, SymmetryClass, causes, error_percentiles,
};

const SOURCES: [PoseSource; 3] = [PoseSource::Prior, PoseSource::Points, PoseSource::Touch];

/// Formats all results.
pub fn to_text(found: &TouchEvaluation) -> String {
    let TouchEvaluation { felt, changed, real } = found;
    let normals = normals(found.as_built(), real.as_ref());
    let poses = [poses(felt), error_causes(felt)].join("\n");
    format!("{normals}\n{poses}\n{}\n{}", changes(changed), latency(felt))
}

fn changes(rows: &[ChangedOptics]) -> String {
    let mut text = format!("{:20}", "normals, mean deg");
    for method in NormalMethod::ALL {
        text += &format!(" {:>20}", method.name());
    }
    text.push('\n');
    for ChangedOptics { change, normals, .. } in rows {
        text += &format!("{change:20}");
        for (_, measured) in normals {
            text += &format!(" {:20.2}", measured.mean_deg);
        }
        text.push('\n');
    }
    text.push('\n');
    for (change, (method, ErrorPercentiles { grasps, mm, deg })) in
        rows.iter().flat_map(|row| row.poses.iter().map(|pose| (row.change, pose)))
    {
        let number = |value: Option<f64>| value.unwrap_or(f64::NAN);
        text += &format!(
            "{change:20} {:20} {grasps:5} grasps {:6.2} mm median {:6.2} p95 {:6.2} deg median {:6.2} p95\n",
            method.name(),
            number(mm.median),
            number(mm.p95),
            number(deg.median),
            number(deg.p95)
        );
    }
    text
}

fn normals(rows: &[(NormalMethod, NormalErrors)], real: Option<&(RealSource, Vec<RealRow>)>) -> String {
    let mut text =
        format!("{:52} {:>9} {:>9} {:>9}   {:>9}\n", "angular error, deg", "mean", "median", "p95", "samples");
    let mut row = |name: String, measured: &NormalErrors| {
        text += &format!(
            "{name:52} {:9.2} {:9.2} {:9.2}   {:9}",
            measured.mean_deg, measured.median_deg, measured.p95_deg, measured.samples
        );
        text += &measured.height_rms_um.map_or_else(String::new, |rms| format!("   height {rms:.1} um RMS"));
        text.push('\n');
    };
    for (method, measured) in rows {
        let used = if *method == METHOD_IN_USE { " (used in trials)" } else { "" };
        row(format!("unseen shapes, {}{used}", method.name()), measured);
    }
    for RealRow { method, simulated, error } in real.map_or(&[][..], |(_, rows)| rows) {
        let from = if *simulated { "renders of the sensor" } else { "even-numbered presses" };
        row(format!("real GelSight, {} from {from}", method.name()), error);
    }
    if let Some((RealSource { folder, ball_diameter_mm, pixel_mm }, _)) = real {
        text += &format!(
            "real GelSight: {}, balls of {ball_diameter_mm} mm, pixels of {pixel_mm} mm; the networks are those of the folder that \
             `--networks`, else the built-in ones of the GelSight\n",
            folder.display()
        );
    }
    text
}

fn poses(felt: &[PoseEvaluation]) -> String {
    let mut text = format!(
        "{:16} {:>6}   {:^27}   {:^27}   {:^27}\n{:16} {:>6}",
        "in-hand pose", "", "prior", "points only", "touch", "", "grasps"
    );
    for _ in SOURCES {
        text += &format!("   {:>6} {:>6} {:>6} {:>6}", "mm", "p95", "deg", "p95");
    }
    text.push('\n');
    let mut row = |name: &str, pick: &dyn Fn(&PoseEvaluation) -> bool| {
        let spreads: Vec<ErrorPercentiles> =
            SOURCES.iter().map(|source| error_percentiles(felt, *source, pick)).collect();
        text += &format!("{name:16} {:>6}", spreads[0].grasps);
        for ErrorPercentiles { mm, deg, .. } in spreads {
            for value in [mm.median, mm.p95, deg.median, deg.p95] {
                text += if value == mm.median { "   " } else { " " };
                text += &value.map_or_else(|| format!("{:>6}", "-"), |value| format!("{value:6.2}"));
            }
        }
        text.push('\n');
    };
    row("all", &|_| true);
    for class in SymmetryClass::ALL {
        row(class.name(), &|felt| felt.class == class);
        let objects: BTreeSet<&str> =
            felt.iter().filter(|felt| felt.class == class).map(|felt| felt.object.as_str()).collect();
        for name in objects {
            row(&format!("  {name}"), &|felt| felt.object == name);
        }
    }
    text
}

/// Formats the causes of large pose errors, by class of object.
fn error_causes(felt: &[PoseEvaluation]) -> String {
    let mut text = format!(
        "{:16} {:>9} {:>11} {:>12} {:>12} {:>12}\n",
        "share, %",
        "in 95 %",
        format!("over {LARGE_ERROR} mm"),
        "misled",
        "missed",
        "untold"
    );
    let mut row = |name: &str, pick: &dyn Fn(&PoseEvaluation) -> bool| {
        let Causes { covered, far, misled, missed } = causes(felt, pick);
        let [covered, far, misled, missed] = [covered, far, misled, missed].map(|share| 100.0 * share);
        let untold = far - misled - missed;
        text += &format!("{name:16} {covered:9.1} {far:11.1} {misled:12.1} {missed:12.1} {untold:12.1}\n");
    };
    row("all", &|_| true);
    for class in SymmetryClass::ALL {
        row(class.name(), &|felt| felt.class == class);
    }
    text
}

fn latency(felt: &[PoseEvaluation]) -> String {
    let mut text = String::new();
    for (name, times) in step_latencies(felt) {
        let at = |percent| percentile(&times, percent).unwrap_or(f64::NAN);
        text += &format!("{name:8} {:7.2} ms p50 {:7.2} ms p99\n", at(50.0), at(99.0));
    }
    text
}
