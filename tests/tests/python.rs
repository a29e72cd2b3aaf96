//! The Python package: its wheel is built and installed into a fresh environment, in which the examples of its page and
//! of the book, and its own tests run.
//!
//! It needs `python3` with `venv`, and downloads maturin, numpy, gymnasium, matplotlib, pyarrow and av. Without them it
//! prints a note and passes, unless `FTAC_PYTHON=required` is set.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::io::Write as _;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::Mutex;

use e2e::{forget_package, root, stderr, target_dir};
use tempfile::tempdir;

use crate::guide;

/// Packages that the test downloads.
const PIP_PACKAGES: [&str; 6] = ["maturin>=1.9,<2", "numpy", "gymnasium>=1.0", "matplotlib", "pyarrow", "av"];

/// Returns the Python blocks of a page.
fn examples(page: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut block: Option<String> = None;
    for line in page.lines() {
        match (&mut block, line.trim_end()) {
            (None, "```python") => block = Some(String::new()),
            (Some(_), "```") => found.extend(block.take()),
            (Some(text), _) => *text += &format!("{line}\n"),
            _ => {}
        }
    }
    found
}

fn run(command: &mut Command) -> Result<Output, String> {
    let output = command.output().map_err(|error| format!("{command:?}: {error}"))?;
    match output.status.success() {
        true => Ok(output),
        false => Err(format!("{command:?}:\n{}{}", String::from_utf8_lossy(&output.stdout), stderr(&output))),
    }
}

/// Makes a virtual environment with these packages. Returns its Python, or the reason why there is none.
pub(crate) fn environment(folder: &Path, packages: &[&str]) -> Result<PathBuf, String> {
    run(Command::new("python3").args(["-m", "venv"]).arg(folder))?;
    let python = folder.join("bin/python");
    run(Command::new(&python).args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"]).args(packages))?;
    Ok(python)
}

/// Builds the wheel in the target folder of this test. Packages for other platforms may have to be downloaded, because
/// `maturin` asks for all.
fn wheel(python: &Path, out: &Path) -> PathBuf {
    let mut build = Command::new(python);
    build
        .args(["-m", "maturin", "build", "--release", "--locked", "--manifest-path"])
        .arg(root().join("twin/python/Cargo.toml"))
        .arg("--target-dir")
        .arg(target_dir())
        .arg("--out")
        .arg(out);
    forget_package(&mut build);
    run(&mut build).expect("the wheel is built");
    let wheels: Vec<_> =
        std::fs::read_dir(out).expect("a folder").map(|entry| entry.expect("an entry").path()).collect();
    assert_eq!(wheels.len(), 1, "{wheels:?}");
    wheels[0].clone()
}

/// Checks that a build from source reports missing tools before it begins.
fn refuses_to_build_without_rust(python: &Path, folder: &Path) {
    let version = std::fs::read_to_string(root().join("Cargo.toml")).expect("the workspace's manifest");
    let rust =
        version.lines().find_map(|line| line.strip_prefix("rust-version = ")).expect("a version").trim_matches('"');
    let build = || {
        let hook = "import build_backend; build_backend.get_requires_for_build_wheel()";
        let mut build = Command::new(python);
        build.args(["-c", hook]).current_dir(root().join("twin/python")).env("PATH", folder);
        build.env("PYTHONDONTWRITEBYTECODE", "1");
        build.output().expect("python runs")
    };
    let without = build();
    let expected = format!("found no cargo on the path, expected Rust {rust} or later");
    assert!(!without.status.success() && stderr(&without).contains(&expected), "{}", stderr(&without));
    let cargo = folder.join("cargo");
    std::fs::write(&cargo, "#!/bin/sh\necho 'cargo 1.60.0 (d1fd9fe2c 2022-03-01)'\n").expect("written");
    std::fs::set_permissions(&cargo, std::fs::Permissions::from_mode(0o755)).expect("made a program");
    let old = build();
    let expected = format!("found cargo 1.60.0 (d1fd9fe2c 2022-03-01), expected Rust {rust} or later");
    assert!(!old.status.success() && stderr(&old).contains(&expected), "{}", stderr(&old));
}

#[test]
fn the_wheel_installs_and_its_examples_run() {
    let folder = tempdir().expect("a folder");
    let python = match environment(&folder.path().join("venv"), &PIP_PACKAGES) {
        Ok(python) => python,
        Err(why) => {
            assert!(std::env::var("FTAC_PYTHON").as_deref() != Ok("required"), "FTAC_PYTHON=required, but {why}");
            // Printed past the captured output, which is not shown for a passing test.
            let told = writeln!(
                std::io::stderr(),
                "LEFT OUT: the Python package is NOT tested, for want of an environment:\n{why}"
            );
            told.expect("stderr");
            return;
        }
    };
    let without = folder.path().join("without");
    std::fs::create_dir(&without).expect("made");
    refuses_to_build_without_rust(&python, &without);
    let wheel = wheel(&python, &folder.path().join("wheels"));
    crate::release::accepts_wheel(&wheel);
    let install = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-deps"];
    run(Command::new(&python).args(install).arg(&wheel)).expect("the wheel installs");
    // The package includes the program.
    let program = python.with_file_name("ftac");
    let version = run(Command::new(&program).arg("--version")).expect("the program runs");
    assert!(String::from_utf8_lossy(&version.stdout).starts_with("ftac "), "{version:?}");
    let refused = Command::new(&program).arg("bnch").output().expect("the program runs");
    assert_eq!(refused.status.code(), Some(2), "{}", stderr(&refused));
    let page = std::fs::read_to_string(root().join("twin/python/README.md")).expect("the page");
    let own = examples(&page);
    assert!(own.len() >= 4, "the page has {} examples", own.len());
    let of_book: Vec<String> = guide::PYTHON.iter().flat_map(|name| examples(&guide::page(name))).collect();
    assert!(of_book.len() >= guide::PYTHON.len(), "the book has {} examples", of_book.len());
    let tests = root().join("twin/python/tests");
    let files = std::fs::read_dir(&tests).expect("a folder").map(|entry| entry.expect("an entry").file_name());
    let mut jobs: Vec<Vec<OsString>> = files
        .filter(|name| name.to_string_lossy().starts_with("test"))
        .map(|name| {
            ["-m".into(), "unittest".into(), "discover".into(), "-s".into(), tests.clone().into(), "-p".into(), name]
                .into()
        })
        .collect();
    let test_files = jobs.len();
    assert!(test_files > 0, "no tests in {}", tests.display());
    for (n, example) in own.iter().chain(&of_book).enumerate() {
        let script = folder.path().join(format!("example_{n}.py"));
        std::fs::write(&script, example).expect("written");
        jobs.push(vec![script.into()]);
    }
    let outputs = run_side_by_side(&python, folder.path(), &jobs);
    for told in outputs[..test_files].iter().map(stderr) {
        assert!(told.contains("OK") && !told.contains("Ran 0 tests"), "{told}");
    }
}

/// Runs Python in `folder` once with each list of arguments, two at a time. Returns the outputs in the same order.
///
/// # Panics
/// If one fails.
fn run_side_by_side(python: &Path, folder: &Path, jobs: &[Vec<OsString>]) -> Vec<Output> {
    let (left, outputs) = (Mutex::new(jobs.iter().enumerate()), Mutex::new(BTreeMap::new()));
    let work = || {
        loop {
            let Some((n, job)) = left.lock().expect("no panic holds it").next() else { break };
            let output =
                run(Command::new(python).args(job).current_dir(folder)).unwrap_or_else(|error| panic!("{error}"));
            outputs.lock().expect("no panic holds it").insert(n, output);
        }
    };
    std::thread::scope(|scope| {
        scope.spawn(work);
        work();
    });
    outputs.into_inner().expect("no panic holds it").into_values().collect()
}
