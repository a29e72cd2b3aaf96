//! `ftac report --study`: everything the study found on one page, beside the paper: their figure, ours, the difference, and why.

use std::path::Path;

use anyhow::{Context, Result, bail};
use hand_model::Hand;
use optics::Foundation;
use optics::foundation::{probe_response, sensitivity};
use serde_json::{Value, json};
use study::page::escape;
use study::sensors::{Array, OTHERS, array};

use crate::check::figures;
use crate::cli::Cli;
use crate::commands::Outcome;
use crate::report::html::{Column, Table, number};
use crate::report::{style, write_whole};

/// A line of the comparison.
struct Line {
    what: &'static str,
    theirs: &'static str,
    ours: String,
    why: String,
}

/// A part of the study that a command leaves in the folder.
fn part(folder: &Path, file: &str) -> Result<Option<Value>> {
    let path = folder.join(file);
    match std::fs::read_to_string(&path) {
        Ok(text) => Ok(Some(serde_json::from_str(&text).with_context(|| path.display().to_string())?)),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error).with_context(|| path.display().to_string()),
    }
}

/// `ftac report --study`.
pub fn run(cli: &Cli, folder: &Path) -> Outcome {
    if !folder.is_dir() {
        bail!(
            "{}: found no such folder; expected what `ftac grasps classify --out {0}`, `map` and `landscape` leave",
            folder.display()
        );
    }
    let classes = part(folder, "classes.json")?;
    let map = part(folder, "map.json")?;
    let landscape = part(folder, "landscape/landscape.json")?;
    let hands = part(folder, "hands.json")?;
    let hand = Hand::ftac();
    let sensors = array(&hand);
    let coverage = figures::coverage(&hand, None)?.ours;
    let gel = Foundation::paper(hand.gel().thickness);
    let response = sensitivity(&probe_response(&gel, 160.0, 161), 50.0).per_kpa;
    let lines = lines(classes.as_ref(), map.as_ref(), landscape.as_ref(), &sensors, &coverage, response);
    let missing: Vec<&str> = [
        (classes.is_none(), "grasps classify"),
        (map.is_none(), "grasps map"),
        (landscape.is_none(), "grasps landscape"),
    ]
    .into_iter()
    .filter_map(|(missing, command)| missing.then_some(command))
    .collect();
    let page = page(folder, &lines, hands.as_ref(), &sensors, response, &coverage)?;
    write_whole(&folder.join("study.html"), page.as_bytes())?;
    if cli.json {
        let rows: Vec<Value> = lines
            .iter()
            .map(|line| json!({ "what": line.what, "paper": line.theirs, "ours": line.ours, "why": line.why }))
            .collect();
        println!("{}", json!({ "rows": rows, "sensors": sensors, "missing": missing }));
    } else {
        for line in &lines {
            println!("{:44} {:>22} {:>34}  {}", line.what, line.theirs, line.ours, line.why);
        }
        println!("{}/study.html", folder.display());
    }
    Ok((!missing.is_empty()).then(|| format!("parts are missing: run `ftac {}`", missing.join("`, `ftac "))))
}

fn lines(
    classes: Option<&Value>,
    map: Option<&Value>,
    landscape: Option<&Value>,
    sensors: &Array,
    coverage: &str,
    response: f64,
) -> Vec<Line> {
    let percent = |value: &Value| value.as_f64().map_or("-".into(), |x| format!("{:.2} %", 100.0 * x));
    let mut lines = Vec::new();
    let mut add = |what, theirs, ours: String, why: &str| lines.push(Line { what, theirs, ours, why: why.into() });
    if let Some(found) = classes {
        let objects = format!("{} of {} objects", found["grasps"], found["objects"]);
        add(
            "verified grasps",
            "3450 of 23 objects",
            objects,
            "each closed by its cables and held in physics; theirs by energy",
        );
        let unclear = format!("{} (of all; {} ambiguous)", found["types_present"], found["ambiguous"]);
        add(
            "grasp types present, of 19",
            "19",
            unclear,
            "rules on contacts and posture here, annotators' eyes there; nothing forced",
        );
        let kinds = &found["categories"];
        let shares = format!("{} / {} / {}", kinds["power"], kinds["intermediate"], kinds["precision"]);
        add(
            "power / intermediate / precision",
            "not given",
            shares,
            "cables close until the object stops them: palm and inner phalanges come to touch more often",
        );
    }
    if let Some(found) = map {
        let first = &found["seeds"][0];
        let (low, high) = (&found["training_over_seeds"][0], &found["training_over_seeds"][1]);
        let training = format!("{} ({} to {})", percent(&first["map"]["training"]), percent(low), percent(high));
        add(
            "power/precision boundary, training accuracy",
            "81.54 %",
            training,
            "both classes weigh the same here, because few of our grasps are precision; see also the next rows",
        );
        for (what, space) in
            [("the same, objects left out, on the map", "map"), ("the same, on six components", "components")]
        {
            let out = &first[space]["held_out"];
            let ours = format!(
                "{} [{}, {}]",
                percent(&out["accuracy"]),
                percent(&out["interval"][0]),
                percent(&out["interval"][1])
            );
            let why = format!(
                "stricter than the paper; balanced {}, the larger class alone {}",
                percent(&out["balanced"]),
                percent(&out["majority"])
            );
            add(what, "not given", ours, &why);
        }
    }
    if let Some(found) = landscape {
        let ours = format!("{} of {} grasps", found["basins"], found["grasps"]);
        let why = format!(
            "the count depends on pull and temperature (ours {} and {}, calibrated); the paper does not give its own",
            found["pull"].as_f64().map_or("-".into(), |pull| format!("{pull:.2}")),
            found["temperature"]
        );
        add("basins over six objects", "79", ours, &why);
        let kinds = format!("{} / {} / {}", found["power"], found["intermediate"], found["precision"]);
        add("basins by majority: power / interm. / precision", "not given", kinds, "see above");
        let shared = found["basins_with_several_objects"].to_string();
        add(
            "basins that hold several objects",
            "most (in pictures)",
            shared,
            "the distance is between postures, not objects",
        );
    }
    let density = format!("{:.0} taxels/cm2", sensors.taxels_per_cm2);
    let pitch = format!(
        "240 x 240 pixels a camera on its share of the pad: {:.3} mm a pixel on average, the paper rounds to 0.1 mm",
        sensors.pitch_mm
    );
    add("tactile resolution", "10000 taxels/cm2", density, &pitch);
    add("palmar coverage", "70 %", coverage.into(), "covers are ours; the pads are the paper's");
    add(
        "sensitivity below 50 kPa",
        "0.48 /kPa",
        format!("{response:.2} /kPa"),
        "the gel's law, pressed by the paper's probe",
    );
    lines
}

fn page(
    folder: &Path,
    lines: &[Line],
    hands: Option<&Value>,
    sensors: &Array,
    response: f64,
    coverage: &str,
) -> Result<String> {
    let words = Column::Words;
    let mut table = Table::new(
        "The paper beside this project",
        &[("figure", words), ("paper", words), ("ours", words), ("where the difference comes from", words)],
    );
    lines.iter().for_each(|line| table.row(&[line.what, line.theirs, &line.ours, &line.why]));
    let mut body = table.finish();
    let picture = |file: &str| std::fs::read_to_string(folder.join(file)).ok();
    for (title, file, more) in [
        ("Grasp types by object", "types.svg", None),
        ("Energy landscape", "landscape/landscape.svg", Some("landscape/landscape.html")),
        ("Contact maps", "map.svg", Some("map.html")),
    ] {
        if let Some(svg) = picture(file) {
            body += &format!("<h2>{}</h2>\n<figure>{svg}</figure>\n", escape(title));
            if let Some(page) = more.filter(|page| folder.join(page).exists()) {
                body += &format!("<p><a href=\"{page}\">{page}</a>: with grasps in 3D under the mouse.</p>\n");
            }
        }
    }
    body += &hand_table(hands);
    body += &sensor_tables(sensors, response, coverage);
    Ok(format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<title>The grasp study</title>\n<style>{}{}</style>\n\
         </head>\n<body><main>\n<h1>The grasp study</h1>\n<p class=\"byline\">What the paper reports on grasps, made again from this \
         project's own verified grasps.</p>\n{body}</main></body>\n</html>\n",
        style::FIGURE,
        style::PAGE
    ))
}

/// Success by hand and object, as `hands.json` has it: rows with hand, object, verified, of.
fn hand_table(hands: Option<&Value>) -> String {
    let mut html = "<h2>Other hands</h2>\n".to_owned();
    let Some(rows) = hands.and_then(|hands| hands["rows"].as_array()) else {
        return html + "<p>Not made: there is no hands.json in this folder.</p>\n";
    };
    let mut table = Table::new(
        "Verified grasps by hand and object",
        &[
            ("hand", Column::Words),
            ("object", Column::Words),
            ("verified", Column::Numbers),
            ("of chains", Column::Numbers),
        ],
    );
    let text = |value: &Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
    rows.iter().for_each(|row| table.row(&["hand", "object", "verified", "of"].map(|key| text(&row[key]))));
    html += &table.finish();
    html
}

fn sensor_tables(sensors: &Array, response: f64, coverage: &str) -> String {
    let words = Column::Words;
    let heads = ["system", "sensing area", "resolution", "transduction", "wiring", "sensitivity, 1/kPa"];
    let mut table = Table::new(
        "Tactile arrays: the paper's table, our row computed from the model",
        &heads.map(|head| (head, words)),
    );
    OTHERS.iter().for_each(|row| table.row(row));
    table.row(&[
        "this model".to_owned(),
        format!("{} pads, {:.0} cm2, {coverage}", sensors.pads, sensors.area_cm2),
        format!("{:.0} taxels/cm2, {} a hand", sensors.taxels_per_cm2, sensors.taxels),
        "vision-based".to_owned(),
        "per sensor".to_owned(),
        format!("{response:.2}"),
    ]);
    let mut html = format!("<h2>Sensors</h2>\n{}", table.finish());
    let numbers = Column::Numbers;
    let mut table = Table::new(
        "The six configurations, from the model",
        &[
            ("configuration", words),
            ("pads", numbers),
            ("cameras a pad", numbers),
            ("height, mm", numbers),
            ("width, mm", numbers),
            ("taxels/cm2", numbers),
        ],
    );
    for own in &sensors.configurations {
        table.row(&[
            own.letter.to_string(),
            own.pads.to_string(),
            own.cameras.to_string(),
            number(own.size_mm[0], 0),
            number(own.size_mm[1], 0),
            number(own.taxels_per_cm2, 0),
        ]);
    }
    html += &table.finish();
    html
}
