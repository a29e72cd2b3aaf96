//! `ftac view` finds the recordings of a result folder, and says how to install the viewer where there is none.

use std::fs;

use e2e::{ftac, stderr};
use tempfile::{TempDir, tempdir};

/// A result folder with one recording.
fn results() -> TempDir {
    let folder = tempdir().expect("a folder");
    let recordings = folder.path().join("recordings");
    fs::create_dir(&recordings).expect("made");
    fs::write(recordings.join("combination_00_trial_0.rrd"), "").expect("written");
    folder
}

#[test]
fn a_result_folder_is_opened() {
    let folder = results();
    let path = folder.path().to_str().expect("UTF-8");
    let output = ftac(&["view", path]).env("RERUN_BIN", "/bin/true").output().expect("runs");
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(stderr(&output).contains("opened 1 recording"), "{}", stderr(&output));
}

#[test]
fn a_missing_viewer_is_told_how_to_get() {
    let folder = results();
    let path = folder.path().to_str().expect("UTF-8");
    let output = ftac(&["view", path]).env_remove("RERUN_BIN").env("PATH", "/nowhere").output().expect("runs");
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert!(stderr(&output).contains("pip install rerun-sdk"), "{}", stderr(&output));
}
