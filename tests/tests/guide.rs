//! The commands of the guide, as a reader would type them: every block of a page in one folder, in order.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use e2e::{binary, root, stderr};
use tempfile::{TempDir, tempdir};

/// Returns the commands of a page: the line, and true if it takes too long for a test, so that only its arguments are
/// checked.
fn commands(page: &str) -> Vec<(String, bool)> {
    let mut found = Vec::new();
    let mut block = None;
    for line in page.lines() {
        match line.strip_prefix("```") {
            Some(language) => block = block.is_none().then_some(language),
            None if block.is_some_and(|language| language.starts_with("sh")) => {
                found.push((line.to_owned(), block == Some("sh,slow")));
            }
            None => {}
        }
    }
    found
}

fn page(name: &str) -> String {
    fs::read_to_string(root().join("twin/guide/pages").join(name)).expect("a page")
}

/// Returns a folder with the files that the pages name.
fn folder() -> TempDir {
    let folder = tempdir().expect("a folder");
    for file in fs::read_dir(root().join("twin/guide/files")).expect("files") {
        let file = file.expect("a file");
        fs::copy(file.path(), folder.path().join(file.file_name())).expect("copied");
    }
    folder
}

fn typed(line: &str, more: &[&str], folder: &Path) -> Output {
    let mut words = line.split_whitespace();
    assert_eq!(words.next(), Some("ftac"), "{line}");
    Command::new(binary()).args(words).args(more).current_dir(folder).output().expect("ftac runs")
}

fn run_page(name: &str) -> TempDir {
    let folder = folder();
    let all = commands(&page(name));
    assert!(!all.is_empty(), "{name} has no command");
    for (line, slow) in all {
        let output = typed(&line, if slow { &["--help"] } else { &["--quiet"] }, folder.path());
        // A result may fall short, but usage and input are right.
        assert!(matches!(output.status.code(), Some(0 | 1)), "{name}: {line}\n{}", stderr(&output));
    }
    folder
}

#[test]
fn the_page_for_another_robot() {
    run_page("robot.md");
}

#[test]
fn the_benchmark_runners_page() {
    let folder = run_page("benchmark.md");
    for file in [
        "demo/index.html",
        "small/report.html",
        "small/tries.csv",
        "noisy/trials.csv",
        "kinder/trials.csv",
        "trial.rrd",
    ] {
        assert!(folder.path().join(file).exists(), "no {file}");
    }
}

#[test]
fn the_sweep_page() {
    let folder = run_page("sweep.md");
    for file in ["swept/report.html", "swept/contrasts.csv", "swept/makespan.html", "swept/merged/units.csv"] {
        assert!(folder.path().join(file).exists(), "no {file}");
    }
    // The page shows the file that is run.
    assert!(page("sweep.md").contains(&fs::read_to_string(folder.path().join("noise.toml")).expect("a file")));
}

#[test]
fn the_sensor_owners_page() {
    let folder = run_page("sensor.md");
    assert!(folder.path().join("pad.png").exists() && folder.path().join("pads").exists());
}

#[test]
fn the_hand_owners_page() {
    let folder = run_page("hand.md");
    for file in ["clamp.png", "box.jsonl", "fist.png"] {
        assert!(folder.path().join(file).exists(), "no {file}");
    }
}

#[test]
fn the_troubleshooters_page() {
    run_page("troubleshooting.md");
}

/// Files printed on the pages are identical to the files used.
#[test]
fn printed_files_are_those_that_are_used() {
    for (name, file) in [("benchmark.md", "twice_the_noise.toml"), ("hand.md", "clamp.toml")] {
        let own = fs::read_to_string(root().join("twin/guide/files").join(file)).expect("a file");
        assert!(page(name).contains(&format!("```toml\n{own}```")), "{name} prints another {file}");
    }
}
