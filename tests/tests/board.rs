//! The board: a row is made from a run, listed, checked, and run again; a changed row is found.

use std::fs;
use std::path::Path;
use std::process::Output;

use e2e::{root, run, stderr};
use serde_json::Value;
use tempfile::tempdir;

fn text(path: &Path) -> &str {
    path.to_str().expect("a UTF-8 path")
}

fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {}", stderr(output)))
}

/// Rows of a run of two trials: made, listed together, shown on a page, and checked with one trial run again.
#[test]
fn a_row_from_a_run_to_a_repetition() {
    let folder = tempdir().expect("a folder");
    let [runs, rows, page] = ["run", "rows", "board.html"].map(|name| folder.path().join(name));
    let size = ["--combos", "1", "--trials", "2", "--conditions", "blind,touch", "--record", "none", "--seed", "1"];
    let made = run(&[&["bench", "--out", text(&runs)], &size[..]].concat());
    assert!(matches!(made.status.code(), Some(0 | 1)), "{}", stderr(&made));

    for condition in ["touch", "blind"] {
        let add = ["board", "add", text(&runs), "--condition", condition, "--name", condition, "--out", text(&rows)];
        let added = run(&[&add[..], &["--json"]].concat());
        assert_eq!(added.status.code(), Some(0), "{}", stderr(&added));
        assert_eq!(json(&added)["shares"]["clean"]["of"], 2);
    }
    let listed = run(&["board", "list", text(&rows), "--json"]);
    assert_eq!(listed.status.code(), Some(0), "{}", stderr(&listed));
    let groups = &json(&listed)["groups"];
    assert_eq!((groups.as_array().map(Vec::len), groups[0]["rows"].as_array().map(Vec::len)), (Some(1), Some(2)));
    let shown = run(&["board", "page", text(&rows), "--out", text(&page), "--json"]);
    assert_eq!(shown.status.code(), Some(0), "{}", stderr(&shown));
    assert!(fs::read_to_string(&page).expect("a page").contains("<th scope=\"row\">touch</th>"));

    let row = rows.join("touch.toml");
    let checked = run(&["board", "check", text(&row), "--trials", "1", "--json"]);
    assert_eq!(checked.status.code(), Some(0), "{}", stderr(&checked));
    assert_eq!(json(&checked)["entries"][0]["trials"], 1);
    changed_rows_are_found(&row);

    invented_outcomes_are_found(&runs, &rows);

    // The journal without its last line is an unfinished run, which leaves no file.
    let journal = runs.join("journal.jsonl");
    let kept = fs::read_to_string(&journal).expect("a journal");
    fs::write(&journal, kept.lines().take(1).map(|line| format!("{line}\n")).collect::<String>()).expect("written");
    let out = folder.path().join("none");
    let refused = run(&["board", "add", text(&runs), "--condition", "touch", "--name", "x", "--out", text(&out)]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(stderr(&refused).contains("found 1 of 2 units of work"), "{}", stderr(&refused));
    assert!(!out.exists());
}

/// A changed line is named with its trial, and a file of another schema with its field.
fn changed_rows_are_found(row: &Path) {
    let kept = fs::read_to_string(row).expect("a row");
    let line = kept.lines().find(|line| line.starts_with("0 1 ")).expect("an outcome");
    let mut words: Vec<&str> = line.split(' ').collect();
    words[2] = if words[2] == "clean" { "failed" } else { "clean" };
    fs::write(row, kept.replacen(line, &words.join(" "), 1)).expect("written");
    let checked = run(&["board", "check", text(row), "--json"]);
    assert_eq!(checked.status.code(), Some(1), "{}", stderr(&checked));
    assert_eq!(json(&checked)["entries"][0]["differences"][0]["field"], "seed 1, combination 0, trial 1, blind: check");

    fs::write(row, kept.replacen("schema = 1", "schema = 9", 1)).expect("written");
    let refused = run(&["board", "check", text(row)]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(stderr(&refused).contains("touch.toml: schema: found 9, expected 1"), "{}", stderr(&refused));
    fs::write(row, &kept).expect("written");
}

/// Invented outcomes from which everything else follows are in order by themselves. The repetition names their trials.
fn invented_outcomes_are_found(runs: &Path, rows: &Path) {
    let journal = runs.join("journal.jsonl");
    let kept = fs::read_to_string(&journal).expect("a journal");
    let mut invented = String::new();
    for line in kept.lines() {
        let mut unit: Value = serde_json::from_str(line).expect("a unit");
        for record in unit["records"].as_array_mut().expect("records") {
            if record["condition"] == "touch" {
                let success = record["success"] == false;
                record["success"] = success.into();
                record["clean_success"] = (success && record["contact"] == false).into();
            }
        }
        invented += &format!("{unit}\n");
    }
    fs::write(&journal, invented).expect("written");
    let add = ["board", "add", text(runs), "--condition", "touch", "--name", "invented", "--out", text(rows)];
    assert_eq!(run(&add).status.code(), Some(0));
    fs::write(&journal, kept).expect("written");
    let row = rows.join("invented.toml");
    assert_eq!(run(&["board", "check", text(&row)]).status.code(), Some(0));
    let checked = run(&["board", "check", text(&row), "--trials", "2"]);
    assert_eq!(checked.status.code(), Some(1), "{}", stderr(&checked));
    let shown = String::from_utf8_lossy(&checked.stdout);
    for trial in ["trial 0", "trial 1"] {
        assert!(shown.contains(&format!("seed 1, combination 0, {trial}, touch: outcome: found ")), "{shown}");
    }
    assert!(!shown.contains("blind: "), "{shown}");
}

/// The rows of the repository are in order, and the guide shows them.
#[test]
fn the_rows_of_the_repository_are_in_order() {
    let folder = root().join("recordings/board");
    let rows: Vec<_> = fs::read_dir(&folder).expect("rows").map(|file| file.expect("a file").path()).collect();
    let names: Vec<&str> = rows.iter().map(|path| text(path)).collect();
    let checked = run(&[&["board", "check"][..], &names].concat());
    assert_eq!(checked.status.code(), Some(0), "{}{}", String::from_utf8_lossy(&checked.stdout), stderr(&checked));
    let listed = run(&["board", "list", text(&folder), "--markdown"]);
    let table = String::from_utf8_lossy(&listed.stdout).trim().to_owned();
    let page = fs::read_to_string(root().join("twin/guide/src/tutorials/board.md")).expect("a page");
    let shown = page.split("<!-- board -->").nth(1).and_then(|rest| rest.split("<!-- /board -->").next());
    let again = "put the output of `ftac board list --markdown` between the marks";
    assert_eq!(shown.map(str::trim), Some(table.as_str()), "{again}");
}
