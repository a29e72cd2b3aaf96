//! Scenarios with a user's own objects: they are run, or a reason is given; an interrupted search for their grasps
//! keeps its results.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use e2e::{ftac, stderr};
use serde_json::Value;
use tempfile::{TempDir, tempdir};

fn text(path: &Path) -> &str {
    path.to_str().expect("a UTF-8 path")
}

/// Returns a folder with a scenario of one user-defined ball and the golf ball, with these lists of first and second
/// objects.
fn scenario(first: &str, second: &str) -> (TempDir, PathBuf) {
    let folder = tempdir().expect("a folder");
    let file = folder.path().join("mine.toml");
    let ball = "name = \"my_ball\"\nmass = 0.06\nfriction = 0.8\nsymmetry = \"full\"\nshape.sphere.diameter = 0.047\n";
    fs::write(folder.path().join("my_ball.toml"), ball).expect("written");
    let scenario = format!(
        "version = 1\nname = \"mine\"\nextends = \"benchmark\"\nobjects = [\"my_ball.toml\"]\nfirst = {first}\nsecond = {second}\n"
    );
    fs::write(&file, scenario).expect("written");
    (folder, file)
}

fn bench(folder: &Path, scenario: &Path, more: &[&str]) -> Command {
    let out = folder.join("out");
    let asked = ["bench", "--scenario", text(scenario), "--combos", "1", "--trials", "1", "--record", "none", "--out"];
    let mut command = ftac(&[&asked[..], &[text(&out)], more].concat());
    command.env("XDG_CACHE_HOME", folder.join("cache"));
    command
}

/// If none of the user's own objects can be used, no other benchmark replaces them: there is an error with the
/// reason, and nothing is written.
#[test]
fn a_scenario_none_of_whose_own_objects_can_be_played_plays_nothing_else() {
    let (folder, scenario) = scenario("[\"golf_ball\"]", "[\"can_66\"]");
    let output = bench(folder.path(), &scenario, &["--json"]).output().expect("runs");
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("none of the scenario's own objects can be used: my_ball"), "{said}");
    let answer: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(answer["code"], 1);
    assert!(!folder.path().join("out").exists());
}

/// Returns the names of the finished steps of the search under way.
fn steps(folder: &Path) -> Vec<String> {
    let files = fs::read_dir(folder.join("cache/ftac")).into_iter().flatten().filter_map(Result::ok);
    let file = files.map(|file| file.path()).find(|path| text(path).ends_with(".steps.jsonl"));
    let kept = file.map(|file| fs::read_to_string(file).expect("steps")).unwrap_or_default();
    kept.lines().filter_map(|line| Some(serde_json::from_str::<Value>(line).ok()?[0].as_str()?.to_owned())).collect()
}

/// Waits until the search has more than `count` finished steps, and kills it at that moment.
fn killed_after(folder: &Path, mut child: Child, count: usize) -> Vec<String> {
    while steps(folder).len() <= count {
        assert!(child.try_wait().expect("ours").is_none(), "the search ended before it was interrupted");
        std::thread::sleep(Duration::from_millis(50));
    }
    child.kill().expect("killed");
    child.wait().expect("ours");
    steps(folder)
}

/// Steps finished before a kill are not repeated.
#[test]
fn an_interrupted_search_for_own_objects_keeps_what_it_found() {
    let (folder, scenario) = scenario("[\"my_ball\"]", "[\"can_66\"]");
    let start = || {
        let mut command = bench(folder.path(), &scenario, &["--quiet"]);
        command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("starts")
    };
    let before = killed_after(folder.path(), start(), 3);
    let after = killed_after(folder.path(), start(), before.len() + 2);
    assert_eq!(after[..before.len()], before);
    let distinct: std::collections::BTreeSet<&String> = after.iter().collect();
    assert_eq!(distinct.len(), after.len(), "{after:?}");
}
