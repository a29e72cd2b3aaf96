//! Rows of the study's page: the paper's figure, this project's, the difference, and the reason.
//!
//! A row gives a reason only if it was measured or follows from how the figure is made; otherwise the reason is marked
//! as not investigated.

use grasp_analysis::sensors::TactileArray;
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value;

/// Text for an unknown reason.
const UNKNOWN_REASON: &str = "not investigated";
/// Text for a figure that the paper does not print.
const UNSTATED_FIGURE: &str = "not given";

/// A row of the comparison.
#[derive(Debug, Serialize, JsonSchema)]
pub struct PaperComparisonRow {
    /// Name of the figure.
    pub what: &'static str,
    /// Figure in the paper.
    #[serde(rename = "paper")]
    pub theirs: &'static str,
    /// Figure in this project.
    pub ours: String,
    /// Difference, this project minus the paper.
    pub difference: String,
    /// Reason of the difference, as far as it is known.
    pub why: String,
}

/// Results of the study's parts; `None` for a part that was not run.
#[derive(Debug, Default)]
pub struct StudyParts {
    /// Contents of `classes.json`.
    pub classes: Option<Value>,
    /// Contents of `map.json`.
    pub map: Option<Value>,
    /// Contents of `landscape.json`.
    pub landscape: Option<Value>,
    /// Contents of `hands.json`.
    pub hands: Option<Value>,
}

/// Key figures of the hand's tactile sensors, from the model.
#[derive(Debug)]
pub struct SensorFigures {
    /// Pads, taxels and areas.
    pub array: TactileArray,
    /// Coverage of the palmar surface, in words: `77.6 % of 153 cm2`.
    pub coverage: String,
    /// Sensitivity below 50 kPa, 1/kPa.
    pub response: f64,
}

fn percent(value: &Value) -> String {
    value.as_f64().map_or("-".into(), |x| format!("{:.2} %", 100.0 * x))
}

fn signed(ours: &Value, theirs: f64, unit: &str, digits: usize) -> String {
    ours.as_f64().map_or("-".into(), |ours| format!("{:+.digits$}{unit}", ours - theirs))
}

/// Returns all rows.
pub fn comparison_rows(parts: &StudyParts, sensing: &SensorFigures) -> Vec<PaperComparisonRow> {
    let mut lines = Vec::new();
    if let Some(found) = &parts.classes {
        types(found, &mut lines);
    }
    if let Some(found) = &parts.map {
        boundary(found, &mut lines);
    }
    if let Some(found) = &parts.landscape {
        basins(found, &mut lines);
    }
    sensors(sensing, &mut lines);
    lines
}

fn types(found: &Value, lines: &mut Vec<PaperComparisonRow>) {
    let grasps = &found["grasps"];
    lines.push(PaperComparisonRow {
        what: "verified grasps",
        theirs: "3450 of 23 objects",
        ours: format!("{grasps} of {} objects", found["objects"]),
        difference: signed(grasps, 3450.0, "", 0),
        why: "by method: each of ours was closed by its cables and held in physics; the objects are this project's own 23".into(),
    });
    lines.push(PaperComparisonRow {
        what: "grasp types present, of 19",
        theirs: "19",
        ours: found["types_present"].to_string(),
        difference: signed(&found["types_present"], 19.0, "", 0),
        why: format!(
            "by method: rules here, people there; {} types have grasps that meet all their conditions, {} have clear ones; \
             {} grasps are ambiguous",
            found["types_fitted"], found["types_clear"], found["ambiguous"]
        ),
    });
    let kinds = &found["categories"];
    lines.push(PaperComparisonRow {
        what: "power / intermediate / precision",
        theirs: UNSTATED_FIGURE,
        ours: format!("{} / {} / {}", kinds["power"], kinds["intermediate"], kinds["precision"]),
        difference: "-".into(),
        why: UNKNOWN_REASON.into(),
    });
}

fn boundary(found: &Value, lines: &mut Vec<PaperComparisonRow>) {
    let first = &found["seeds"][0];
    let (low, high) = (&found["training_over_seeds"][0], &found["training_over_seeds"][1]);
    let training = &first["map"]["training"];
    lines.push(PaperComparisonRow {
        what: "power/precision boundary, training accuracy",
        theirs: "81.54 %",
        ours: format!("{} (seeds: {} to {})", percent(training), percent(low), percent(high)),
        difference: training.as_f64().map_or("-".into(), |x| format!("{:+.2} points", 100.0 * x - 81.54)),
        why: format!(
            "by method: both classes have the same weight here, for {} grasps are power and {} precision; without it the boundary always \
             gave power (measured on 900 earlier grasps). Anything beyond: {UNKNOWN_REASON}",
            found["power"], found["precision"]
        ),
    });
    for (what, space) in
        [("the same, objects left out, on the map", "map"), ("the same, on six components", "components")]
    {
        let out = &first[space]["held_out"];
        let interval = match out["interval"].as_array().map(Vec::as_slice) {
            Some([low, high]) => format!(" [{}, {}]", percent(low), percent(high)),
            _ => String::new(),
        };
        lines.push(PaperComparisonRow {
            what,
            theirs: UNSTATED_FIGURE,
            ours: format!("{}{interval}", percent(&out["accuracy"])),
            difference: "-".into(),
            why: format!(
                "stricter than the paper's figure; mean over both classes {}, the larger class alone {}",
                percent(&out["balanced"]),
                percent(&out["majority"])
            ),
        });
    }
}

fn basins(found: &Value, lines: &mut Vec<PaperComparisonRow>) {
    let number = |value: &Value| value.as_f64().map_or("-".into(), |x| format!("{x:.2}"));
    let mut why = format!(
        "by method: the count depends on pull, temperature and grasps (ours: {} calibrated, {}, {}); the paper states none of its values.",
        number(&found["pull"]),
        number(&found["temperature"]),
        found["grasps"]
    );
    let count = |row: &Value| row["basins"].as_u64();
    if let (Some(first), Some(last)) = (found["growth"].get(0), found["growth"].as_array().and_then(|rows| rows.last()))
    {
        why += &format!(
            " Measured: {} basins after {} grasps, {} after {}; {} hold one grasp only.",
            first["basins"], first["grasps"], last["basins"], last["grasps"], found["basins_of_one"]
        );
    }
    let grid = found["sweep"]["grid"].as_array().map_or(&[][..], Vec::as_slice);
    if let (Some(fewest), Some(most)) = (grid.iter().filter_map(count).min(), grid.iter().filter_map(count).max()) {
        why += &format!(
            " Over a quarter to four times the pull and half to twice the temperature: {fewest} to {most} of {} minima; over \
             seeds: {}.",
            found["sweep"]["minima"], found["sweep"]["over_seeds"]
        );
    }
    lines.push(PaperComparisonRow {
        what: "basins over six objects",
        theirs: "79",
        ours: format!("{} of {} grasps", found["basins"], found["grasps"]),
        difference: signed(&found["basins"], 79.0, "", 0),
        why,
    });
    lines.push(PaperComparisonRow {
        what: "basins by majority: power / interm. / precision",
        theirs: UNSTATED_FIGURE,
        ours: format!("{} / {} / {}", found["power"], found["intermediate"], found["precision"]),
        difference: "-".into(),
        why: UNKNOWN_REASON.into(),
    });
    lines.push(PaperComparisonRow {
        what: "basins that hold several objects",
        theirs: UNSTATED_FIGURE,
        ours: found["basins_with_several_objects"].to_string(),
        difference: "-".into(),
        why: "by method: the distance is between postures, whatever the object".into(),
    });
}

fn sensors(sensing: &SensorFigures, lines: &mut Vec<PaperComparisonRow>) {
    let SensorFigures { array, coverage, response } = sensing;
    lines.push(PaperComparisonRow {
        what: "tactile resolution",
        theirs: "10000 taxels/cm2",
        ours: format!("{:.0} taxels/cm2", array.taxels_per_cm2),
        difference: format!("{:+.0}", array.taxels_per_cm2 - 10_000.0),
        why: format!(
            "by method: 240 x 240 pixels per camera on its share of the pad are {:.3} mm per pixel on average; 10000 is 0.1 mm",
            array.pitch_mm
        ),
    });
    lines.push(PaperComparisonRow {
        what: "palmar coverage",
        theirs: "70 %",
        ours: coverage.clone(),
        // The figure is the first word, as in `77.6 % of 153 cm2`.
        difference: coverage
            .split_whitespace()
            .next()
            .and_then(|word| word.parse::<f64>().ok())
            .map_or("-".into(), |ours| format!("{:+.1} points", ours - 70.0)),
        why: "by method: the pads' sizes are the paper's, the covers around them are this project's".into(),
    });
    lines.push(PaperComparisonRow {
        what: "sensitivity below 50 kPa",
        theirs: "0.48 /kPa",
        ours: format!("{response:.2} /kPa"),
        difference: format!("{:+.2} /kPa", response - 0.48),
        why: "by method: the gel's law was set so that the paper's probe gives this; it is no prediction".into(),
    });
}
