//! `ftac report --study`: everything the study found on one page, beside the paper: their figure, ours, the difference, and why.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use hand_model::Hand;
use optics::Foundation;
use optics::foundation::{probe_response, sensitivity};
use serde_json::{Value, json};
use study::page::escape;
use study::sensors::{Array, OTHERS, array};

use super::comparison::{Line, Parts, lines};
use crate::terminal::Outcome;
use crate::terminal::Terminal;
use lab::hand_check::figures;
use report::html::{Column, Table, number};
use report::{style, write_whole};

/// A part of the study that a command leaves in the folder.
fn part(folder: &Path, file: &str) -> Result<Option<Value>> {
    let path = folder.join(file);
    match std::fs::read_to_string(&path) {
        Ok(text) => Ok(Some(serde_json::from_str(&text).with_context(|| path.display().to_string())?)),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error).with_context(|| path.display().to_string()),
    }
}

/// The study in the folder that is named, or in the usual one.
pub fn of_folders(terminal: &Terminal, folders: &[PathBuf]) -> Outcome {
    match folders {
        [] => run(terminal, Path::new("recordings/study")),
        [folder] => run(terminal, folder),
        _ => bail!("--study: found {} folders, expected one", folders.len()),
    }
}

/// `ftac report --study`.
fn run(terminal: &Terminal, folder: &Path) -> Outcome {
    if !folder.is_dir() {
        bail!(
            "{}: found no such folder; expected what `ftac grasps classify --out {0}`, `map` and `landscape` leave",
            folder.display()
        );
    }
    let parts = Parts {
        classes: part(folder, "classes.json")?,
        map: part(folder, "map.json")?,
        landscape: part(folder, "landscape/landscape.json")?,
        hands: part(folder, "hands.json")?,
    };
    let hand = Hand::ftac();
    let sensors = array(&hand);
    let coverage = figures::coverage(&hand, None)?.ours;
    let gel = Foundation::paper(hand.gel().thickness);
    let response = sensitivity(&probe_response(&gel, 160.0, 161), 50.0).per_kpa;
    let lines = lines(&parts, &sensors, &coverage, response);
    let missing: Vec<&str> = [
        (parts.classes.is_none(), "grasps classify"),
        (parts.map.is_none(), "grasps map"),
        (parts.landscape.is_none(), "grasps landscape"),
        (parts.hands.is_none(), "grasps hands"),
    ]
    .into_iter()
    .filter_map(|(missing, command)| missing.then_some(command))
    .collect();
    let page = page(folder, &lines, parts.hands.as_ref(), &sensors, response, &coverage)?;
    write_whole(&folder.join("study.html"), page.as_bytes())?;
    if terminal.json {
        let rows: Vec<Value> = lines
            .iter()
            .map(|line| json!({ "what": line.what, "paper": line.theirs, "ours": line.ours, "difference": line.difference, "why": line.why }))
            .collect();
        println!("{}", json!({ "rows": rows, "sensors": sensors, "missing": missing }));
    } else {
        for line in &lines {
            println!("{:48} {:>18} {:>36} {:>13}  {}", line.what, line.theirs, line.ours, line.difference, line.why);
        }
        println!("{}/study.html", folder.display());
    }
    Ok((!missing.is_empty()).then(|| format!("parts are missing: run `ftac {}`", missing.join("`, `ftac "))))
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
        &[("figure", words), ("paper", words), ("ours", words), ("difference", words), ("why", words)],
    );
    lines.iter().for_each(|line| table.row(&[line.what, line.theirs, &line.ours, &line.difference, &line.why]));
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
    body += &hand_table(folder, hands);
    body += &sensor_tables(sensors, response, coverage);
    Ok(format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<title>The grasp study</title>\n<style>{}{}</style>\n\
         </head>\n<body><main>\n<h1>The grasp study</h1>\n<p class=\"byline\">What the paper reports on grasps, made again from this \
         project's own verified grasps.</p>\n{body}</main></body>\n</html>\n",
        style::FIGURE,
        style::PAGE
    ))
}

/// Success by object and hand, as `hands.json` has it, and its picture sheet.
fn hand_table(folder: &Path, hands: Option<&Value>) -> String {
    let mut html = "<h2>Other hands</h2>\n".to_owned();
    let Some(rows) = hands.and_then(|hands| hands["rows"].as_array()) else {
        return html + "<p>Not made: <code>ftac grasps hands</code> leaves it in this folder.</p>\n";
    };
    let distinct = |key: &str| {
        let mut found: Vec<&str> = Vec::new();
        for name in rows.iter().filter_map(|row| row[key].as_str()) {
            if !found.contains(&name) {
                found.push(name);
            }
        }
        found
    };
    let (names, objects) = (distinct("hand"), distinct("object"));
    let mut head = vec![("object", Column::Words)];
    head.extend(names.iter().map(|name| (*name, Column::Words)));
    let mut table = Table::new("Grasps that pass all three checks, of chains, with Wilson 95 % intervals", &head);
    let cell = |row: &Value| {
        let percent = |key: &str| row[key].as_f64().map_or("-".into(), |x| format!("{:.0}", 100.0 * x));
        format!("{} of {} [{}, {}] %", row["verified"], row["of"], percent("low"), percent("high"))
    };
    for object in objects {
        let of = |name: &&str| rows.iter().find(|row| row["hand"] == **name && row["object"] == object).map(cell);
        let mut cells = vec![object.to_owned()];
        cells.extend(names.iter().map(|name| of(name).unwrap_or_else(|| "-".into())));
        table.row(&cells);
    }
    html += &table.finish();
    html += "<p>The paper shows pictures for its hands on eight objects that it does not name, and no rates: there is nothing to set \
             beside these figures. The objects here are eight of this project's 23.</p>\n";
    if folder.join("hands.png").exists() {
        html += "<figure><img src=\"hands.png\" alt=\"a held grasp of each hand on each object\" style=\"max-width:100%\"></figure>\n";
    }
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
