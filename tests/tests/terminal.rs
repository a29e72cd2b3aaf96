//! The program in a pipe, on a full disk, and with wrong arguments: scripts get readable output, and nothing panics.

use std::process::{Output, Stdio};

use e2e::{ftac, run, stderr};
use serde_json::Value;
use tempfile::tempdir;

/// Returns the only line on stdout, parsed as JSON.
fn object(output: &Output) -> Value {
    let text = String::from_utf8_lossy(&output.stdout);
    assert_eq!(text.lines().count(), 1, "{text}");
    serde_json::from_str(&text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

#[test]
fn a_wrong_command_line_is_json_under_json() {
    for (arguments, named) in [
        (&["bench", "--combo", "3", "--json"][..], "--combo"),
        (&["--json", "dance"], "dance"),
        (&["trial", "--json"], "COMBINATION"),
        (&["bench", "--trials", "many", "--json"], "many"),
        (&["bench", "--resume", "x", "--seed", "1", "--json"], "cannot be used with"),
        (&["--json"], "command"),
    ] {
        let output = ftac(arguments).output().expect("runs");
        let found = object(&output);
        assert_eq!((output.status.code(), &found["code"]), (Some(2), &Value::from(2)), "{arguments:?}");
        let error = found["error"].as_str().expect("a text");
        assert!(
            error.contains(named) && !error.contains("Usage") && !error.contains('\u{1b}'),
            "{arguments:?}: {error}"
        );
        assert!(!stderr(&output).is_empty(), "people are told too");
    }
    let without = ftac(&["bench", "--combo", "3"]).output().expect("runs");
    assert!(without.stdout.is_empty() && stderr(&without).contains("--combos"), "{}", stderr(&without));
    // Help is no error, and goes to stdout.
    let help = ftac(&["bench", "--help", "--json"]).output().expect("runs");
    assert_eq!(help.status.code(), Some(0));
    assert!(String::from_utf8_lossy(&help.stdout).contains("--noise-scale") && help.stderr.is_empty());
}

/// `ftac schema | head -1` once panicked: "failed printing to stdout: Broken pipe".
#[test]
fn a_closed_pipe_ends_quietly() {
    for arguments in [
        &["schema"][..],
        &["schema", "--json"],
        &["completions", "bash"],
        &["--help"],
        &["bench", "--help"],
        &["--version"],
        &["combos"],
        &["combos", "--json"],
        &["sweep", "plan", "twin/guide/files/noise.toml"],
    ] {
        let (reader, writer) = std::io::pipe().expect("a pipe");
        drop(reader);
        let output = ftac(arguments).stdout(writer).stderr(Stdio::piped()).output().expect("runs");
        let said = stderr(&output);
        assert_eq!((output.status.code(), said.as_str()), (Some(0), ""), "{arguments:?}");
    }
    // With stderr closed too, the exit code is still that of the error.
    for arguments in [&["schema", "dance"][..], &["schema", "dance", "--json"], &["bench", "--combo", "3"]] {
        let (reader, writer) = std::io::pipe().expect("a pipe");
        drop(reader);
        let status = ftac(arguments).stdout(Stdio::null()).stderr(writer).status().expect("runs");
        assert_eq!(status.code(), Some(2), "{arguments:?}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_named_as_such() {
    let full = || std::fs::OpenOptions::new().write(true).open("/dev/full").expect("the full device");
    for arguments in [&["schema"][..], &["combos", "--json"], &["--help"], &["completions", "zsh"]] {
        let output = ftac(arguments).stdout(full()).stderr(Stdio::piped()).output().expect("runs");
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {said}");
        assert!(said.contains("stdout: No space left on device"), "{arguments:?}: {said}");
    }
    let output = run(&["trial", "0", "--policy", "ideal", "--out", "/dev/full"]);
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert!(stderr(&output).contains("/dev/full: No space left on device"), "{}", stderr(&output));
}

/// The numbers are those of `trials.csv`, and object names are accepted as people write them.
#[test]
fn combinations_are_listed_with_names() {
    let listed = object(&run(&["combos", "--json"]));
    let rows = listed["combinations"].as_array().expect("rows");
    assert_eq!(rows.len(), 60);
    assert!(rows.iter().enumerate().all(|(n, row)| row["combination"] == n), "{listed}");
    let folder = tempdir().expect("a folder");
    let out = folder.path().to_str().expect("UTF-8");
    let bench = run(&["bench", "--combos", "2", "--conditions", "ideal", "--record", "none", "--out", out]);
    assert_eq!(bench.status.code(), Some(0), "{}", stderr(&bench));
    let mut trials = csv::Reader::from_path(folder.path().join("trials.csv")).expect("trials.csv");
    for row in trials.records().map(|row| row.expect("a row")) {
        let own = &rows[row[0].parse::<usize>().expect("a number")];
        assert_eq!((&own["first"], &own["second"]), (&Value::from(&row[3]), &Value::from(&row[4])));
    }
    let few = run(&["combos", "--combos", "3"]);
    assert_eq!(String::from_utf8_lossy(&few.stdout).lines().count(), 4);
}

/// Without the public model of the hand, a check leaves its row out, says so, and still passes; a model that is named
/// must exist.
#[test]
fn a_check_of_the_hand_needs_nothing_from_outside() {
    let folder = tempdir().expect("a folder");
    let named =
        ftac(&["hand", "check", "--public-model", "nowhere"]).current_dir(folder.path()).output().expect("runs");
    assert_eq!(named.status.code(), Some(2));
    assert!(stderr(&named).contains("nowhere") && stderr(&named).contains("Taccel"), "{}", stderr(&named));
    let output = ftac(&["hand", "check", "--json"]).current_dir(folder.path()).output().expect("runs");
    let said = stderr(&output);
    // Measured rows may fall short; none is refused because of a missing file.
    assert!(matches!(output.status.code(), Some(0 | 1)), "{said}");
    assert!(said.contains("left out: joint frames") && said.contains("github.com/Taccel-Simulator/Taccel"), "{said}");
    let rows = object(&output)["rows"].as_array().expect("rows").len();
    assert!(rows >= 10, "{rows}");
}
