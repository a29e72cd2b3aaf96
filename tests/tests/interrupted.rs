//! Interrupted benchmarks, and folders that hold another run: nothing is lost and nothing mixed up.

use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use e2e::{ftac, run, stderr};
use tempfile::{TempDir, tempdir};

/// Starts a run of blind trials and returns it once at least one of many units is finished.
fn under_way(out: &Path, seed: &str) -> Child {
    let size = ["--combos", "4", "--trials", "20", "--conditions", "blind", "--jobs", "1", "--record", "none"];
    let arguments = [&["bench", "--seed", seed, "--out", text(out)], &size[..]].concat();
    let mut child = ftac(&arguments).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("starts");
    while units(out) == 0 {
        assert!(child.try_wait().expect("ours").is_none(), "it ended before a unit was finished");
        std::thread::sleep(Duration::from_millis(20));
    }
    child
}

/// Returns the number of finished units.
fn units(out: &Path) -> usize {
    fs::read_to_string(out.join("journal.jsonl")).map_or(0, |journal| journal.lines().count())
}

fn text(path: &Path) -> &str {
    path.to_str().expect("a UTF-8 path")
}

/// Interrupts a run with Ctrl-C. Returns its folder and its output.
fn interrupted(seed: &str) -> (TempDir, std::process::Output) {
    let folder = tempdir().expect("a folder");
    let child = under_way(folder.path(), seed);
    let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill runs");
    assert!(sent.success());
    let output = child.wait_with_output().expect("ours");
    (folder, output)
}

/// Units finished before Ctrl-C are kept, and the message says how to resume. A resumed run must have the original settings.
#[test]
fn ctrl_c_ends_in_order() {
    let (folder, output) = interrupted("3");
    let out = folder.path();
    let (said, kept) = (stderr(&output), units(out));
    assert_eq!(output.status.code(), Some(130), "{said}");
    assert!(said.contains(&format!("{kept} of 80 units")) && said.contains("--resume"), "{said}");
    assert!(!out.join("summary.json").exists());
    for contradiction in [["--seed", "4"], ["--trials", "3"], ["--conditions", "touch"], ["--without", "gel"]] {
        let refused = run(&[&["bench", "--resume", text(out)], &contradiction[..]].concat());
        assert_eq!(refused.status.code(), Some(2));
        assert!(stderr(&refused).contains("cannot be used with"), "{}", stderr(&refused));
    }
    let report = run(&["report", text(out)]);
    assert!(report.status.success(), "{}", stderr(&report));
    // The page shows the command that made the data, not only that which made the page.
    let page = fs::read_to_string(out.join("report.html")).expect("a page");
    assert!(page.contains("bench --seed 3 --out") && page.contains("page made by"), "{page}");
    assert_eq!(fs::read_to_string(out.join("trials.csv")).expect("trials").lines().count(), kept + 1);

    // Units of another run in the journal are detected and named by their line number.
    let (other, _) = interrupted("5");
    let journal = fs::read_to_string(out.join("journal.jsonl")).expect("a journal");
    let foreign = fs::read_to_string(other.path().join("journal.jsonl")).expect("a journal");
    fs::write(out.join("journal.jsonl"), format!("{journal}{foreign}")).expect("written");
    let refused = run(&["bench", "--resume", text(out), "--record", "none"]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(stderr(&refused).contains(&format!("line {}", kept + 1)), "{}", stderr(&refused));
}

/// A run that records everything records the remaining trials too when resumed, without the option being repeated.
#[test]
fn a_resumed_run_records_as_it_was_begun() {
    let folder = tempdir().expect("a folder");
    let out = folder.path().join("out");
    let size = ["--combos", "1", "--trials", "2", "--conditions", "blind", "--record", "all", "--out", text(&out)];
    // One job: the journal's first line is the first trial.
    let output = run(&[&["bench", "--jobs", "1"], &size[..]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let recordings = || -> std::collections::BTreeSet<String> {
        let files = fs::read_dir(out.join("recordings")).expect("a folder");
        files.map(|file| file.expect("a file").file_name().to_string_lossy().into_owned()).collect()
    };
    let all = recordings();
    assert!(all.contains("combination_00_trial_1.rrd") && all.contains("combination_00_trial_1_blind.png"), "{all:?}");
    // As if killed before its second trial.
    let journal = fs::read_to_string(out.join("journal.jsonl")).expect("a journal");
    let first = journal.lines().next().expect("a unit");
    fs::write(out.join("journal.jsonl"), format!("{first}\n")).expect("written");
    fs::remove_dir_all(out.join("recordings")).expect("removed");
    let output = run(&["bench", "--resume", text(&out)]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let again = recordings();
    assert!(again.len() == 2 && again.is_subset(&all) && again.contains("combination_00_trial_1.rrd"), "{again:?}");
    // With nothing left to do, the results stay as they are, wall time included.
    let summary = || fs::read_to_string(out.join("summary.json")).expect("a summary");
    let finished = summary();
    assert_eq!(run(&["bench", "--resume", text(&out)]).status.code(), Some(0));
    assert_eq!(summary(), finished);
}

#[test]
fn a_folder_belongs_to_one_run_at_a_time() {
    let folder = tempdir().expect("a folder");
    let mut child = under_way(folder.path(), "3");
    let second = run(&["bench", "--resume", text(folder.path()), "--record", "none"]);
    assert!(child.try_wait().expect("ours").is_none(), "the first run was over");
    child.kill().expect("killed");
    child.wait().expect("ours");
    assert_eq!(second.status.code(), Some(2));
    assert!(stderr(&second).contains("another run is writing into it"), "{}", stderr(&second));
}

#[test]
fn numbers_that_make_no_sense_are_refused_before_any_work() {
    for (arguments, wanted) in [
        (["--jobs", "0"], "--jobs: found 0"),
        (["--noise-scale", "-1"], "--noise-scale: found -1"),
        (["--combos", "0"], "--combos: found 0"),
    ] {
        let refused = run(&[&["bench"], &arguments[..]].concat());
        assert_eq!(refused.status.code(), Some(2));
        assert!(stderr(&refused).contains(wanted), "{}", stderr(&refused));
    }
}
