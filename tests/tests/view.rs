//! `ftac view` finds the recordings of a result folder, and says how to install the viewer where there is none.

use std::fs;
use std::path::PathBuf;

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

/// A program in place of the viewer that writes down its arguments.
#[cfg(unix)]
fn fake_viewer(folder: &TempDir) -> PathBuf {
    use std::os::unix::fs::PermissionsExt as _;
    let program = folder.path().join("viewer.sh");
    let script = "#!/bin/sh\nif [ \"$1\" = --version ]; then echo rerun-cli 0.36.3; exit; fi\n\
                  printf '%s\\n' \"$@\" > \"$0.part\" && mv \"$0.part\" \"$0.args\"\n";
    fs::write(&program, script).expect("written");
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).expect("may be run");
    program
}

#[cfg(unix)]
#[test]
fn a_result_folder_is_opened() {
    let folder = results();
    let viewer = fake_viewer(&folder);
    let path = folder.path().to_str().expect("UTF-8");
    let output = ftac(&["view", path]).env("RERUN_BIN", &viewer).output().expect("runs");
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    // The viewer outlives the command, so its file comes when it comes.
    let list = folder.path().join("viewer.sh.args");
    let arguments = std::iter::repeat_with(|| {
        std::thread::sleep(std::time::Duration::from_millis(20));
        fs::read_to_string(&list).ok()
    })
    .take(3000)
    .find_map(|text| text)
    .expect("the viewer is started");
    let opened: Vec<&str> = arguments.lines().filter(|argument| argument.ends_with(".rrd")).collect();
    let recording = folder.path().join("recordings/combination_00_trial_0.rrd");
    assert_eq!(opened, [recording.to_str().expect("UTF-8")], "{arguments}");
}

#[test]
fn a_missing_viewer_is_told_how_to_get() {
    let folder = results();
    let path = folder.path().to_str().expect("UTF-8");
    let output = ftac(&["view", path]).env_remove("RERUN_BIN").env("PATH", "/nowhere").output().expect("runs");
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert!(stderr(&output).contains("pip install rerun-sdk"), "{}", stderr(&output));
}
