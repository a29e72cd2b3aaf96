//! Tactile perception with the calibration of the hand's own pads: trials, their replay, and invalid files.

use std::fs;
use std::path::Path;
use std::process::Output;

use e2e::{run, stderr};
use serde_json::Value;
use tempfile::tempdir;

fn text(path: &Path) -> &str {
    path.to_str().expect("a path in UTF-8")
}

/// Returns the JSON output of a run, whether its trial succeeded or not.
fn json(output: &Output) -> Value {
    assert!(matches!(output.status.code(), Some(0 | 1)), "{}", stderr(output));
    serde_json::from_slice(&output.stdout).expect("one JSON object")
}

#[test]
fn a_trial_feels_with_the_pads_that_it_is_given_and_keeps_them() {
    let folder = tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let (pads, sessions, record) = (at("pads.json"), at("sessions"), at("trial.rrd"));
    assert!(run(&["touch", "train", "--presses", "2", "--out", text(&pads)]).status.success());
    let mut file: Value = serde_json::from_str(&fs::read_to_string(&pads).expect("the file")).expect("JSON");
    let trial = ["trial", "0", "--policy", "touch", "--json", "--out", text(&record), "--session"];
    let felt = |sessions: &Path, pads: &[&str]| json(&run(&[&trial[..], &[text(sessions)], pads].concat()));
    let designed = felt(&at("designed"), &[]);
    let own = felt(&sessions, &["--pads", text(&pads)]);
    assert_ne!(own["pose_error_mm"], designed["pose_error_mm"], "other slopes, another pose");

    // The session contains the calibration: the file is not needed any more.
    fs::remove_file(&pads).expect("removed");
    let session = fs::read_dir(&sessions).expect("sessions").next().expect("one").expect("a file").path();
    let replayed = run(&["replay", text(&session), "--json"]);
    assert!(replayed.status.success(), "{}", stderr(&replayed));
    assert_eq!(json(&replayed)["same_decisions"], true);

    // A file that does not calibrate every pad is refused by every command, before anything is done.
    let bad = at("bad.json");
    let models = file["configurations"].as_object_mut().expect("models");
    let lost = models.remove("f").expect("the palm's");
    let without = file.to_string();
    file["configurations"]["f"] = lost;
    file["configurations"]["c"]["weights"].as_array_mut().expect("weights").pop();
    let out = at("out");
    for (wrong, words) in [
        (without, &["configuration `f`"][..]),
        (file.to_string(), &["configuration c", "weights"]),
        ("{}".to_owned(), &["version"]),
    ] {
        fs::write(&bad, wrong).expect("written");
        for endpoint in [
            &["trial", "0", "--out", text(&out)][..],
            &["bench", "--combos", "1", "--trials", "1", "--out", text(&out)],
            &["touch", "eval", "--combos", "1", "--trials", "1"],
        ] {
            let output = run(&[endpoint, &["--pads", text(&bad)]].concat());
            let said = stderr(&output);
            assert_eq!(output.status.code(), Some(2), "{said}");
            assert!(["--pads", "bad.json"].iter().chain(words).all(|word| said.contains(word)), "{said}");
        }
    }
    assert!(!out.exists(), "a refused command leaves nothing behind");
}
