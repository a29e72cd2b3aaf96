//! `ftac` hands the commands for validation, grasp analysis and training over to `ftac-lab`.

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use e2e::{binary, ftac, root, run, stderr};
use serde_json::Value;
use tempfile::{TempDir, tempdir};

/// A command of each group that `ftac-lab` runs.
const LAB_COMMANDS: [&[&str]; 7] = [
    &["hand", "check"],
    &["arm", "check"],
    &["touch", "eval"],
    &["grasps", "classify"],
    &["study"],
    &["report", "--study"],
    &["report", "--lab-book"],
];

/// Command with which a user builds it.
const BUILD_COMMAND: &str = "cargo build --release -p ftac-lab";

fn lab() -> PathBuf {
    binary().with_file_name("ftac-lab")
}

/// Returns the identity that `ftac-lab` prints for `ftac`.
fn identity() -> String {
    let output = Command::new(lab()).arg("--identity").output().expect("ftac-lab runs");
    assert!(output.status.success(), "{}", stderr(&output));
    String::from_utf8_lossy(&output.stdout).trim().to_owned()
}

/// Returns a folder that contains only `ftac`.
fn alone() -> TempDir {
    let folder = tempdir().expect("a folder");
    let copied = Command::new("cp").arg(binary()).arg(folder.path().join("ftac")).status().expect("cp runs");
    assert!(copied.success());
    folder
}

/// Writes a stand-in for `ftac-lab` to `folder` that reports `identity`; otherwise it leaves a mark, prints its
/// arguments and its input, writes to stderr, and exits with code 7.
fn stand_in(folder: &Path, identity: &str) {
    let program = folder.join("ftac-lab");
    let script = format!(
        "#!/bin/sh\nif [ \"$1\" = --identity ]; then echo '{identity}'; exit 0; fi\n\
         : > '{}'\necho \"given: $*\"\n/bin/cat\necho complaint >&2\nexit 7\n",
        mark(folder).display()
    );
    write_program(&program, &script);
}

/// Writes a script in another process: a file that this process has open cannot be run, and another test's child may
/// keep it open.
fn write_program(path: &Path, script: &str) {
    let write =
        Command::new("sh").args(["-c", "printf %s \"$1\" > \"$0\" && chmod +x \"$0\""]).arg(path).arg(script).status();
    assert!(write.expect("sh runs").success());
}

fn mark(folder: &Path) -> PathBuf {
    folder.join("ran")
}

/// Returns a command that runs `ftac` of a folder with a search path.
fn started(folder: &Path, path: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(folder.join("ftac"));
    command.args(arguments).current_dir(root()).env("FTAC_LOG", "").env("PATH", path);
    command
}

fn output(command: &mut Command) -> Output {
    command.stdin(Stdio::null()).output().expect("ftac runs")
}

#[test]
fn without_ftac_lab_the_command_that_builds_it_is_told() {
    let folder = alone();
    for arguments in LAB_COMMANDS {
        let said = output(&mut started(folder.path(), folder.path(), arguments));
        assert_eq!(said.status.code(), Some(2), "{arguments:?}: {}", stderr(&said));
        assert!(
            stderr(&said).contains("found no `ftac-lab`") && stderr(&said).contains(BUILD_COMMAND),
            "{}",
            stderr(&said)
        );
    }
    let said = output(&mut started(folder.path(), folder.path(), &["arm", "check", "--json"]));
    let error: Value = serde_json::from_slice(&said.stdout).expect("JSON");
    assert_eq!(error["code"], 2);
    assert!(error["error"].as_str().expect("words").contains(BUILD_COMMAND), "{error}");
    // Everything else works: help of these commands, and refusal of wrong arguments.
    let help = output(&mut started(folder.path(), folder.path(), &["hand", "--help"]));
    let help = String::from_utf8_lossy(&help.stdout).into_owned();
    assert!(
        ["check", "close", "export", "picture"].iter().all(|name| help.contains(&format!("\n  {name} "))),
        "{help}"
    );
    let wrong = output(&mut started(folder.path(), folder.path(), &["hand", "check", "--types", "34"]));
    assert!(stderr(&wrong).contains("34") && !stderr(&wrong).contains("ftac-lab"), "{}", stderr(&wrong));
}

/// An `ftac-lab` of another version is not run, and the search does not continue behind it.
#[test]
fn another_version_is_refused() {
    let (folder, path) = (alone(), tempdir().expect("a folder"));
    stand_in(folder.path(), "0.0.1 0123456789abcdef");
    stand_in(path.path(), &identity());
    let said = output(&mut started(folder.path(), path.path(), &["hand", "check"]));
    assert_eq!(said.status.code(), Some(2), "{}", stderr(&said));
    for words in ["found \"0.0.1 0123456789abcdef\"", &identity(), BUILD_COMMAND] {
        assert!(stderr(&said).contains(words), "{words}: {}", stderr(&said));
    }
    assert!(!mark(folder.path()).exists() && !mark(path.path()).exists(), "it ran");
    // A program without an identity is refused too.
    write_program(&folder.path().join("ftac-lab"), "#!/bin/sh\nexit 0\n");
    let said = output(&mut started(folder.path(), path.path(), &["hand", "check"]));
    assert_eq!(said.status.code(), Some(2), "{}", stderr(&said));
    assert!(stderr(&said).contains("found \"\""), "{}", stderr(&said));
}

/// The program beside `ftac` comes before the search path. It gets all arguments and streams of `ftac`, and its exit
/// code becomes that of `ftac`.
#[test]
fn arguments_streams_and_the_exit_code_pass_through() {
    let (folder, path) = (alone(), tempdir().expect("a folder"));
    stand_in(path.path(), &identity());
    for place in [path.path(), folder.path()] {
        stand_in(place, &identity());
        let arguments = ["--seed", "3", "grasps", "classify", "--grasps", "a file", "-q"];
        let mut command = started(folder.path(), path.path(), &arguments);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().expect("ftac starts");
        child.stdin.take().expect("stdin").write_all(b"what is typed\n").expect("written");
        let said = child.wait_with_output().expect("it ends");
        assert_eq!(said.status.code(), Some(7), "{}", stderr(&said));
        let expected = format!("given: {}\nwhat is typed\n", arguments.join(" "));
        assert_eq!(
            (String::from_utf8_lossy(&said.stdout).as_ref(), stderr(&said).as_str()),
            (&*expected, "complaint\n")
        );
        assert!(mark(place).exists());
        fs::remove_file(mark(place)).expect("its mark");
    }
    assert!(!mark(path.path()).exists(), "the search path came before the neighbour");
}

/// With the real `ftac-lab`, a result, a result that falls short, and bad input have their own exit codes.
#[test]
fn exit_codes_are_those_of_the_command() {
    let folder = tempdir().expect("a folder");
    let page = folder.path().join("book.md");
    let done = run(&["report", "--lab-book", "--out", page.to_str().expect("UTF-8"), "--json"]);
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    assert!(page.exists());
    let bad = run(&["touch", "eval", "--combos", "0", "--json"]);
    assert_eq!(bad.status.code(), Some(2), "{}", stderr(&bad));
    assert!(stderr(&bad).starts_with("ftac: --combos"), "{}", stderr(&bad));
    let short = run(&["report", "--study", folder.path().to_str().expect("UTF-8"), "--json"]);
    assert_eq!(short.status.code(), Some(1), "{}", stderr(&short));
    assert!(stderr(&short).contains("falls short: parts are missing"), "{}", stderr(&short));
}

/// `ftac-lab` has its own commands and no others.
#[test]
fn ftac_lab_runs_what_is_handed_over_and_nothing_else() {
    let refused = Command::new(lab()).args(["bench", "--combos", "1"]).output().expect("ftac-lab runs");
    assert_eq!(refused.status.code(), Some(2), "{}", stderr(&refused));
    assert!(stderr(&refused).contains("'bench'"), "{}", stderr(&refused));
    let page = Command::new(lab()).args(["report", "a_folder"]).output().expect("ftac-lab runs");
    assert_eq!(page.status.code(), Some(2), "{}", stderr(&page));
    let help = Command::new(lab()).arg("--help").output().expect("ftac-lab runs");
    let help = String::from_utf8_lossy(&help.stdout).into_owned();
    for arguments in LAB_COMMANDS {
        assert!(help.contains(&format!("\n  {} ", arguments[0])), "{arguments:?}:\n{help}");
    }
    let listed = ftac(&["--help"]).output().expect("ftac runs");
    let listed = String::from_utf8_lossy(&listed.stdout).into_owned();
    for arguments in LAB_COMMANDS {
        assert!(listed.contains(&format!("\n  {} ", arguments[0])), "{arguments:?}:\n{listed}");
    }
}
