//! The grasp study as a user runs it: types, labels, maps, landscape, pages, and bad input.
//!
//! `tests/data/grasps` holds the first eight grasps of six objects, as `ftac grasps generate` wrote them.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

use e2e::{root, run, stderr};
use serde_json::{Value, json};
use tempfile::tempdir;

const GRASPS_FOLDER: &str = "tests/data/grasps";
const CHROMIUM: &str = "/usr/bin/chromium";

fn text(path: &Path) -> &str {
    path.to_str().expect("a UTF-8 path")
}

/// Runs a command with `--json` on the grasps of `from`. A result that falls short (exit code 1) counts as a result.
fn answer(from: &str, arguments: &[&str]) -> Value {
    let mut all = vec!["--json"];
    all.extend_from_slice(arguments);
    if arguments[0] == "grasps" {
        all.extend_from_slice(&["--grasps", from]);
    }
    let output = run(&all);
    assert!(matches!(output.status.code(), Some(0 | 1)), "{arguments:?}: {}", stderr(&output));
    serde_json::from_slice(&output.stdout).expect("JSON on stdout")
}

fn refused(arguments: &[&str], named: &[&str]) {
    let output = run(arguments);
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "ftac {arguments:?} said: {message}");
    for word in named {
        assert!(message.contains(word), "ftac {arguments:?} does not name {word:?}: {message}");
    }
    assert!(!message.contains("panicked") && output.stdout.is_empty(), "{message}");
}

/// Returns type and broad type of every grasp.
fn types() -> BTreeMap<String, (String, String)> {
    let found = answer(GRASPS_FOLDER, &["grasps", "classify"]);
    let word = |value: &Value| value.as_str().expect("a word").to_owned();
    let rows = found["decisions"].as_array().expect("a list").iter();
    rows.map(|row| (word(&row["id"]), (word(&row["type"]), word(&row["category"])))).collect()
}

#[test]
fn every_grasp_gets_a_type_and_reasons() {
    let folder = tempdir().expect("a folder");
    let found = answer(GRASPS_FOLDER, &["grasps", "classify", "--out", text(folder.path())]);
    assert_eq!(found["grasps"], 48);
    let sum: u64 =
        found["types"].as_array().expect("a list").iter().map(|kind| kind["grasps"].as_u64().unwrap_or(0)).sum();
    assert_eq!(sum, 48);
    assert!(folder.path().join("classes.json").exists() && folder.path().join("types.svg").exists());
    let id = found["decisions"][5]["id"].as_str().expect("an id");
    let why = answer(GRASPS_FOLDER, &["grasps", "classify", "--explain", id]);
    assert_eq!(why["type"], found["decisions"][5]["type"]);
    let conditions = why["conditions"].as_array().expect("a list");
    let least = conditions.iter().filter_map(|check| check["margin"].as_f64()).fold(1.0, f64::min);
    assert!((least - why["margin"].as_f64().expect("a number")).abs() < 1e-9, "the worst condition decides: {why}");
    assert!(conditions.iter().all(|check| check["reason"].as_str().is_some_and(|reason| !reason.is_empty())));
}

#[test]
fn labels_are_compared() {
    let folder = tempdir().expect("a folder");
    let write = |name: &str, labels: &BTreeMap<String, String>| {
        let path = folder.path().join(name);
        fs::write(&path, json!({ "version": 1, "annotator": name, "labels": labels }).to_string()).expect("written");
        path
    };
    let same: BTreeMap<String, String> = types().into_iter().map(|(id, (kind, _))| (id, kind)).collect();
    let wrong: BTreeMap<String, String> = same.keys().map(|id| (id.clone(), "Lateral".to_owned())).collect();
    let (same, wrong) = (write("same", &same), write("wrong", &wrong));
    let found = answer(GRASPS_FOLDER, &["grasps", "classify", "--labels", text(&same), "--labels", text(&wrong)]);
    let pairs = found["agreement"].as_array().expect("a list");
    assert_eq!(pairs.len(), 3, "each with the rules, and with each other: {pairs:?}");
    assert_eq!(pairs[0]["types"]["kappa"], 1.0);
    assert!(pairs[1]["types"]["kappa"].as_f64().expect("defined") < 0.05);
    let unknown = write("unknown", &BTreeMap::from([("ball/99999".to_owned(), "Ring".to_owned())]));
    refused(
        &["grasps", "classify", "--grasps", GRASPS_FOLDER, "--labels", text(&unknown)],
        &["unknown", "ball/99999", "expected"],
    );
    let no_type = write("no_type", &BTreeMap::from([(types().keys().next().expect("one").clone(), "Rung".to_owned())]));
    refused(&["grasps", "classify", "--grasps", GRASPS_FOLDER, "--labels", text(&no_type)], &["no_type", "Rung"]);
}

#[test]
fn an_empty_collection_is_refused() {
    let folder = tempdir().expect("a folder");
    let header = "{\"version\":1,\"command\":\"none\",\"seed\":1}\n";
    let file = folder.path().join("empty.jsonl");
    fs::write(&file, header).expect("written");
    let out = folder.path().join("out");
    let page = folder.path().join("page.html");
    for arguments in [
        &["grasps", "classify"][..],
        &["grasps", "annotate", "--out", text(&page)],
        &["grasps", "map", "--out", text(&out)],
        &["grasps", "landscape", "--out", text(&out)],
    ] {
        let with = |more: &'static str| [arguments, &["--grasps", more]].concat();
        let mut full = arguments.to_vec();
        full.extend(["--grasps", text(&file)]);
        refused(&full, &["empty.jsonl", "found no grasp"]);
        refused(&with("no/such/folder"), &["no/such/folder"]);
    }
    assert!(!out.exists() && !page.exists(), "left something behind");
    let empty = folder.path().join("folder");
    fs::create_dir(&empty).expect("made");
    refused(&["grasps", "classify", "--grasps", text(&empty)], &["folder", "no .jsonl"]);
    fs::write(&file, format!("{header}{{\"object\":1}}\n")).expect("written");
    refused(&["grasps", "classify", "--grasps", text(&file)], &["empty.jsonl:2"]);
}

#[test]
fn grasps_of_one_class_have_no_boundary() {
    let kinds = types();
    let folder = tempdir().expect("a folder");
    let mut kept = String::new();
    for entry in fs::read_dir(root().join(GRASPS_FOLDER)).expect("the fixtures") {
        let all = fs::read_to_string(entry.expect("a file").path()).expect("text");
        for (n, line) in all.lines().enumerate() {
            let value: Value = serde_json::from_str(line).expect("JSON");
            let id = format!("{}/{}", value["object"].as_str().unwrap_or_default(), value["chain"]);
            if (n == 0 && kept.is_empty()) || kinds.get(&id).is_some_and(|(_, category)| category == "power") {
                kept += line;
                kept.push('\n');
            }
        }
    }
    let (file, out) = (folder.path().join("power.jsonl"), folder.path().join("out"));
    fs::write(&file, kept).expect("written");
    let arguments = ["grasps", "map", "--grasps", text(&file), "--out", text(&out)];
    refused(&arguments, &["0 precision", "some of both"]);
    assert!(!out.exists());
}

#[test]
fn a_landscape_goes_on_where_it_was_interrupted() {
    let folder = tempdir().expect("a folder");
    let out = folder.path().join("landscape");
    let arguments =
        ["grasps", "landscape", "--objects", "pawn,vase", "--each", "5", "--pull", "4", "--out", text(&out)];
    let whole = answer(GRASPS_FOLDER, &arguments);
    assert_eq!(whole["grasps"], 10);
    let members: usize =
        whole["list"].as_array().expect("basins").iter().map(|b| b["members"].as_array().map_or(0, Vec::len)).sum();
    assert_eq!(members, 10, "every grasp is in one basin");
    let journal = out.join("journal.jsonl");
    let full = fs::read_to_string(&journal).expect("a journal");
    fs::write(&journal, &full[..full.len() * 2 / 5]).expect("cut");
    assert_eq!(answer(GRASPS_FOLDER, &arguments), whole);
    assert_eq!(fs::read_to_string(&journal).expect("a journal"), full);
    let other = [
        "grasps",
        "landscape",
        "--objects",
        "pawn,ball",
        "--each",
        "5",
        "--pull",
        "4",
        "--grasps",
        GRASPS_FOLDER,
        "--out",
        text(&out),
    ];
    refused(&other, &["journal.jsonl", "pawn,vase", "pawn,ball"]);
    refused(
        &["grasps", "landscape", "--objects", "teapot", "--grasps", GRASPS_FOLDER, "--out", text(&out)],
        &["teapot", "pawn"],
    );
    let page = fs::read_to_string(out.join("landscape.html")).expect("a page");
    assert!(page.contains("data-grasp") && !page.contains("http://w3") && !page.contains("src=\"http"));
}

/// Opens a page in headless Chromium with `script` added at its end. Returns the content of the element `result`.
fn browse(page: &Path, script: &str, profile: &Path) -> String {
    let with = page.with_extension("test.html");
    let html = fs::read_to_string(page).expect("the page");
    let added = format!("<pre id=\"result\"></pre><script>{script}</script></body>");
    fs::write(&with, html.replace("</body>", &added)).expect("written");
    let output = Command::new(CHROMIUM)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"])
        .args(["--disable-background-networking", "--disable-component-update", "--virtual-time-budget=8000"])
        .arg(format!("--user-data-dir={}", profile.display()))
        .args(["--dump-dom", &format!("file://{}", with.display())])
        .output()
        .expect("Chromium runs");
    let dom = String::from_utf8_lossy(&output.stdout).into_owned();
    let (_, rest) =
        dom.split_once("<pre id=\"result\">").unwrap_or_else(|| panic!("no result in {dom:.300}: {}", stderr(&output)));
    rest.split("</pre>").next().unwrap_or_default().replace("&amp;", "&").replace("&lt;", "<").replace("&gt;", ">")
}

/// The page takes labels by its keys, draws hand, object and contacts, keeps its labels over a restart of the browser,
/// and exports a file that `classify` reads.
#[test]
fn the_annotation_page_works_in_a_browser() {
    if !Path::new(CHROMIUM).exists() {
        eprintln!("SKIPPED: no {CHROMIUM} on this machine, so the annotation page was not tried in a browser");
        return;
    }
    let folder = tempdir().expect("a folder");
    let (page, profile) = (folder.path().join("page.html"), folder.path().join("profile"));
    answer(GRASPS_FOLDER, &["grasps", "annotate", "--out", text(&page)]);
    let script = "const key = k => dispatchEvent(new KeyboardEvent('keydown', { key: k }));
        const drawn = () => { const d = viewer.image.data; let n = [0, 0]; for (let k = 0; k < d.length; k += 4) {
            if (d[k] + 8 < d[k + 2]) n[0]++; if (d[k] > d[k + 1] + 8 && d[k] > d[k + 2]) n[1]++; } return n; };
        const seen = { all: drawn() }; key('o'); seen.no_object = drawn(); key('o'); key('h'); seen.no_hand = drawn(); key('h');
        const before = viewer.view.join(); viewer.rotate(0.3, 0.1); seen.turned = before !== viewer.view.join();
        key('w'); seen.types = document.querySelectorAll('#types button').length; key('1'); key('r'); key('2'); key('i'); key('2');
        key('ArrowLeft'); key('x'); $('annotator').value = 'tester'; $('annotator').oninput({ target: $('annotator') });
        document.getElementById('result').textContent = JSON.stringify({ seen, exported: JSON.parse(exported()) });";
    let first: Value = serde_json::from_str(&browse(&page, script, &profile)).expect("JSON from the page");
    let seen = &first["seen"];
    let count = |what: &str, k: usize| seen[what][k].as_u64().expect("a count");
    assert!(count("all", 0) > 500 && count("all", 1) > 5000, "object and hand are drawn: {seen}");
    // The green contacts, which show through, contain a little blue.
    assert!(5 * count("no_object", 0) < count("all", 0) && count("no_hand", 1) < 50, "{seen}");
    assert_eq!((&seen["turned"], &seen["types"]), (&json!(true), &json!(10)));
    let exported = &first["exported"];
    let labels = exported["labels"].as_object().expect("labels");
    assert_eq!(labels.len(), 2, "three given, one taken back: {labels:?}");
    assert_eq!(labels.values().collect::<Vec<_>>().len(), 2);
    assert!(
        labels.values().any(|kind| kind == "Adducted Thumb") && labels.values().any(|kind| kind == "Writing Tripod")
    );
    let again = browse(&page, "document.getElementById('result').textContent = exported();", &profile);
    let kept: Value = serde_json::from_str(&again).expect("JSON from the page");
    assert_eq!(&kept, exported, "kept over a restart");
    let file = folder.path().join("labels.json");
    fs::write(&file, again).expect("written");
    let found = answer(GRASPS_FOLDER, &["grasps", "classify", "--labels", text(&file)]);
    assert_eq!(
        (&found["agreement"][0]["first"], &found["agreement"][0]["types"]["items"]),
        (&json!("tester"), &json!(2))
    );
}

#[test]
fn the_study_on_one_page() {
    let folder = tempdir().expect("a folder");
    let out = text(folder.path());
    answer(GRASPS_FOLDER, &["grasps", "classify", "--out", out]);
    let found = answer(GRASPS_FOLDER, &["report", "--study", out]);
    assert_eq!(found["missing"], json!(["grasps map", "grasps landscape", "grasps hands"]));
    let rows = found["rows"].as_array().expect("rows");
    assert!(
        rows.iter().all(|row| ["what", "paper", "ours", "difference", "why"].iter().all(|key| row[key].is_string()))
    );
    let page = fs::read_to_string(folder.path().join("study.html")).expect("a page");
    for word in ["10000 taxels/cm2", "of 19", "Sundaram", "<svg"] {
        assert!(page.contains(word), "{word}");
    }
    refused(&["report", "--study", "no/such/folder"], &["no/such/folder"]);
}

/// Without `--grasps` the study works on the built-in collection: every object with its 150 grasps, all types present.
#[test]
fn the_built_in_collection_is_the_default() {
    let output = run(&["--json", "grasps", "classify"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let found: Value = serde_json::from_slice(&output.stdout).expect("JSON on stdout");
    assert_eq!((&found["grasps"], &found["objects"], &found["types_present"]), (&json!(3450), &json!(23), &json!(19)));
    let fit = |kind: &Value| kind["fit"].as_u64().expect("a count") <= kind["grasps"].as_u64().expect("a count");
    assert!(found["types"].as_array().expect("a list").iter().all(fit));
    refused(&["grasps", "classify", "--explain", "ball/999999"], &["--explain", "ball/999999", "golf_ball/0"]);
}

/// A comparison of hands resumes after its last cell, is reproducible, and refuses arguments that make no sense.
#[test]
fn hands_side_by_side() {
    let folder = tempdir().expect("a folder");
    let out = text(folder.path());
    let arguments =
        ["--json", "grasps", "hands", "--objects", "golf_ball,ball_50", "--n", "4", "--closings", "2", "--out", out];
    let table = || {
        let output = run(&arguments);
        assert!(matches!(output.status.code(), Some(0 | 1)), "{}", stderr(&output));
        fs::read(folder.path().join("hands.json")).expect("hands.json")
    };
    let whole = table();
    let found: Value = serde_json::from_slice(&whole).expect("JSON");
    let rows = found["rows"].as_array().expect("rows");
    assert_eq!(rows.len(), 2);
    for row in rows {
        assert_eq!((&row["hand"], &row["chains"]), (&json!("F-TAC"), &json!(4)));
        let [low, high] = ["low", "high"].map(|end| row[end].as_f64().expect("an end"));
        let rate = row["verified"].as_f64().expect("a count") / 4.0;
        assert!(low <= rate && rate <= high, "{row}");
    }
    assert!(folder.path().join("hands.png").exists());
    let cells = folder.path().join("hands");
    let last = cells.join("F_TAC-ball_50.json");
    let before = fs::read(&last).expect("a cell");
    fs::remove_file(&last).expect("removed");
    assert_eq!(table(), whole, "goes on to the same table");
    assert_eq!(fs::read(&last).expect("a cell"), before);
    refused(
        &["grasps", "hands", "--objects", "golf_ball", "--n", "5", "--out", out],
        &["golf_ball.json", "chains: 4", "chains: 5"],
    );
    refused(&["grasps", "hands", "--objects", "teapot", "--out", out], &["--objects", "teapot", "pawn"]);
    refused(&["grasps", "hands", "--n", "0", "--out", out], &["--n", "0"]);
    refused(&["grasps", "hands", "--urdf", "a.urdf", "--out", out], &["--pulls", "0 for 1"]);
    fs::write(&last, "{").expect("spoilt");
    refused(&arguments[1..], &["F_TAC-ball_50.json"]);
}

/// One command makes every part and the page. Run again, it resumes from the existing parts and gives the same figures.
#[test]
fn the_whole_study_is_one_command() {
    let folder = tempdir().expect("a folder");
    let out = folder.path().join("study");
    let first = answer(GRASPS_FOLDER, &["study", "--grasps", GRASPS_FOLDER, "--out", text(&out)]);
    assert_eq!(first["missing"].as_array().map(Vec::len), Some(0), "{first}");
    for file in ["types.svg", "map.html", "landscape/landscape.html", "landscape/growth.png", "hands.png", "study.html"]
    {
        assert!(out.join(file).exists(), "no {file}");
    }
    let page = fs::read_to_string(out.join("study.html")).expect("the page");
    let basins = first["rows"].as_array().expect("rows").iter().find(|row| row["what"] == "basins over six objects");
    let ours = basins.and_then(|row| row["ours"].as_str()).expect("a count");
    assert!(page.contains(ours) && page.contains("growth.png"), "{ours}");
    let again = answer(GRASPS_FOLDER, &["study", "--grasps", GRASPS_FOLDER, "--out", text(&out)]);
    assert_eq!(first["rows"], again["rows"]);
    refused(&["study", "--urdf", "none.urdf", "--pulls", "none.toml", "--out", text(&out)], &["none.urdf"]);
}
