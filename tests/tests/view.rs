//! `ftac view` finds the recordings of a result folder, and says how to install the viewer if there is none.

use std::fs;
use std::path::PathBuf;

use e2e::{ftac, stderr};
use tempfile::{TempDir, tempdir};

/// Returns a result folder with one recording.
fn results() -> TempDir {
    let folder = tempdir().expect("a folder");
    let recordings = folder.path().join("recordings");
    fs::create_dir(&recordings).expect("made");
    fs::write(recordings.join("combination_00_trial_0.rrd"), "").expect("written");
    folder
}

/// Writes a stand-in for the viewer that records its arguments.
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
    // The viewer outlives the command, so its file may appear later.
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

/// Writes a stand-in for the viewer that runs `body`.
#[cfg(unix)]
fn viewer_that(folder: &TempDir, body: &str) -> PathBuf {
    use std::os::unix::fs::PermissionsExt as _;
    let program = folder.path().join("viewer.sh");
    let version = "if [ \"$1\" = --version ]; then echo rerun-cli 0.36.3; exit; fi";
    fs::write(&program, format!("#!/bin/sh\n{version}\n{body}\n")).expect("written");
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).expect("may be run");
    program
}

/// Behaviour of the viewer without a display.
const NO_DISPLAY_MESSAGE: &str =
    "echo 'INFO starting' >&2; echo 'Error: neither WAYLAND_DISPLAY nor DISPLAY is set.' >&2; exit 1";

/// A path that does not exist is named, whether or not there is a viewer.
#[test]
fn a_path_that_is_not_there_is_named() {
    let output = ftac(&["view", "nowhere"]).env("RERUN_BIN", "").env("PATH", "").output().expect("runs");
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("nowhere"), "{}", stderr(&output));
}

#[cfg(unix)]
#[test]
fn a_viewer_without_a_display_is_no_success() {
    let folder = results();
    let viewer = viewer_that(&folder, NO_DISPLAY_MESSAGE);
    let path = folder.path().to_str().expect("UTF-8");
    let output = ftac(&["view", path]).env("RERUN_BIN", &viewer).output().expect("runs");
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("ended as soon as it was started: neither WAYLAND_DISPLAY nor DISPLAY is set."), "{said}");
    assert!(!said.contains("opened"), "{said}");
}

/// Regression: the demo hung here for ever, because its recordings waited for a viewer that had died.
#[cfg(unix)]
#[test]
fn without_a_display_the_demo_still_writes_page_and_film() {
    let folder = tempdir().expect("a folder");
    let (viewer, out) = (viewer_that(&folder, NO_DISPLAY_MESSAGE), folder.path().join("demo"));
    let arguments = ["demo", "--quiet", "--out", out.to_str().expect("UTF-8")];
    let output = ftac(&arguments).env("RERUN_BIN", &viewer).output().expect("runs");
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("falls short: the viewer was lost") && said.contains("nor DISPLAY is set"), "{said}");
    let page = fs::read_to_string(out.join("index.html")).expect("the page");
    assert_eq!(page.matches("data:image/webp;base64,").count(), 1, "a film in it");
    for file in ["blind.rrd", "touch.rrd", "blind.png", "touch.png", "film.webp"] {
        assert!(fs::metadata(out.join(file)).is_ok_and(|file| file.len() > 1000), "{file}");
    }
}

/// A viewer that starts and never answers does not block a trial either.
#[cfg(unix)]
#[test]
fn a_viewer_that_never_answers_does_not_hang_a_trial() {
    let folder = tempdir().expect("a folder");
    let viewer = viewer_that(&folder, "echo $$ > \"$0.pid\"; exec sleep 600");
    let file = folder.path().join("trial.rrd");
    let out = file.to_str().expect("UTF-8");
    let arguments = ["trial", "0", "--policy", "blind", "--live", "--out", out];
    let output = ftac(&arguments).env("RERUN_BIN", &viewer).env("DISPLAY", ":none").output().expect("runs");
    let pid = fs::read_to_string(folder.path().join("viewer.sh.pid")).expect("the viewer was started");
    let ended = std::process::Command::new("kill").arg(pid.trim()).status().expect("kill runs");
    assert!(ended.success(), "the viewer lives on by itself");
    let said = stderr(&output);
    assert!(said.contains("does not answer"), "{said}");
    // If the trial failed as well, that is reported instead.
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(fs::metadata(&file).is_ok_and(|file| file.len() > 100_000), "the recording is whole");
}

#[test]
fn a_missing_viewer_is_told_how_to_get() {
    let folder = results();
    let path = folder.path().to_str().expect("UTF-8");
    let output = ftac(&["view", path]).env_remove("RERUN_BIN").env("PATH", "/nowhere").output().expect("runs");
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert!(stderr(&output).contains("pip install rerun-sdk"), "{}", stderr(&output));
}
