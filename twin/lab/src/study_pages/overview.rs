//! Page of the whole grasp study: the paper's figure, this project's, the difference and the reason, then the results
//! of each part.

use std::path::Path;

use grasp_analysis::sensors::OTHER_SYSTEMS;
use maud::{Markup, PreEscaped, html};
use report::html::{ColumnAlignment, HtmlTable, format_number, whole_page};
use serde_json::Value;

use super::comparison::{PaperComparisonRow, SensorFigures};

/// Returns the page. Pictures and the pages of the parts are taken from `folder` if they exist; `hands` is
/// `hands.json`.
pub fn page(folder: &Path, lines: &[PaperComparisonRow], hands: Option<&Value>, sensing: &SensorFigures) -> String {
    let words = ColumnAlignment::Words;
    let mut table = HtmlTable::new(
        "The paper beside this project",
        &[("figure", words), ("paper", words), ("ours", words), ("difference", words), ("why", words)],
    );
    lines.iter().for_each(|line| table.row(&[line.what, line.theirs, &line.ours, &line.difference, &line.why]));
    let parts = [
        (
            "Grasp types by object",
            "Numbers of verified grasps by object and by the paper's 19 types, assigned by written rules.",
            "types.svg",
            None,
        ),
        (
            "Energy landscape",
            "Grasps that lead to one another without climbing share a basin, a circle sized by its number of grasps, at the height of its \
             lowest energy. A bar joins two basins at the energy over which one leads to the other.",
            "landscape/landscape.svg",
            Some("landscape/landscape.html"),
        ),
        (
            "Contact maps",
            "Each point is a grasp, placed by its contacts with the hand: neighbours have similar contacts. The line separates power from \
             precision grasps.",
            "map.svg",
            Some("map.html"),
        ),
    ];
    let is_there = |file: &str| folder.join(file).exists();
    let body = html! {
        p.byline { "The paper's results on grasps, reproduced with this project's own verified grasps." }
        (table)
        @for (title, caption, file, more) in parts {
            @if let Ok(svg) = std::fs::read_to_string(folder.join(file)) {
                h2 { (title) }
                p { (caption) }
                figure style="overflow-x:auto" { (PreEscaped(svg.split_once("?>").map_or(&*svg, |(_, nominal)| nominal))) }
                @if let Some(page) = more.filter(|page| is_there(page)) { p { a href=(page) { (page) } ": with grasps in 3D under the mouse." } }
            }
        }
        @if is_there("landscape/growth.png") {
            figure { img src="landscape/growth.png" alt="basins over grasps" style="max-width:100%"; }
            p { "The number of basins grows with the number of sorted grasps; the paper does not state this number for its 79." }
        }
        h2 { "Other hands" }
        (hand_table(folder, hands))
        h2 { "Sensors" }
        (sensor_tables(sensing))
    };
    whole_page("The grasp study", &body)
}

/// Returns the table of success by object and hand from `hands.json`, with its picture sheet.
fn hand_table(folder: &Path, hands: Option<&Value>) -> Markup {
    let Some(rows) = hands.and_then(|hands| hands["rows"].as_array()) else {
        return html! { p { "Not made: " code { "ftac grasps hands" } " writes it to this folder." } };
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
    let mut head = vec![("object", ColumnAlignment::Words)];
    head.extend(names.iter().map(|name| (*name, ColumnAlignment::Words)));
    let mut table = HtmlTable::new("Grasps that pass all three checks, of chains, with Wilson 95 % intervals", &head);
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
    html! {
        (table)
        p {
            "The paper shows pictures for its hands on eight objects that it does not name, and no rates: there is no comparison with these \
            figures. The objects here are eight of this project's 23."
        }
        @if folder.join("hands.png").exists() {
            figure { img src="hands.png" alt="a held grasp of each hand on each object" style="max-width:100%"; }
        }
    }
}

fn sensor_tables(sensing: &SensorFigures) -> Markup {
    let SensorFigures { array: sensors, coverage, response } = sensing;
    let words = ColumnAlignment::Words;
    let heads = ["system", "sensing area", "resolution", "transduction", "wiring", "sensitivity, 1/kPa"];
    let mut arrays = HtmlTable::new(
        "Tactile arrays: the paper's table, our row computed from the model",
        &heads.map(|head| (head, words)),
    );
    OTHER_SYSTEMS.iter().for_each(|row| arrays.row(row));
    arrays.row(&[
        "this model".to_owned(),
        format!("{} pads, {:.0} cm2, {coverage}", sensors.pads, sensors.area_cm2),
        format!("{:.0} taxels/cm2, {} a hand", sensors.taxels_per_cm2, sensors.taxels),
        "vision-based".to_owned(),
        "per sensor".to_owned(),
        format!("{response:.2}"),
    ]);
    let numbers = ColumnAlignment::Numbers;
    let mut table = HtmlTable::new(
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
            format_number(own.size_mm[0], 0),
            format_number(own.size_mm[1], 0),
            format_number(own.taxels_per_cm2, 0),
        ]);
    }
    html! { (arrays) (table) }
}
