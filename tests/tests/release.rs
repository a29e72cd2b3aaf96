//! The files of a release: `.ci/release` makes them of the built programs. The wheel's test is in [`crate::python`],
//! which builds one.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use e2e::{binary, root, stderr};
use tempfile::tempdir;

/// Returns a command that runs the script with the programs of this test, with fixed times of the archive's files.
fn release(folder: &Path) -> Command {
    let mut script = Command::new(root().join(".ci/release"));
    script.arg("--binary").arg(binary()).env("SOURCE_DATE_EPOCH", "1767225600").current_dir(folder);
    script
}

fn output(command: &mut Command) -> Output {
    command.output().expect("it starts")
}

fn succeeds(command: &mut Command) -> String {
    let said = output(command);
    assert!(said.status.success(), "{command:?}: {}", stderr(&said));
    String::from_utf8(said.stdout).expect("UTF-8")
}

/// Names in a folder, sorted.
fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").file_name());
    let mut names: Vec<String> = entries.map(|name| name.into_string().expect("UTF-8")).collect();
    names.sort();
    names
}

/// Checks that the script refuses with these words, and leaves nothing but the files named.
fn is_refused(command: &mut Command, words: &[&str], left: &[&str]) {
    let folder = command.get_current_dir().expect("a folder").to_owned();
    let said = output(command);
    assert_eq!(said.status.code(), Some(2), "{command:?}: {}", stderr(&said));
    for word in words {
        assert!(stderr(&said).contains(word), "{word}: {}", stderr(&said));
    }
    assert_eq!(names(&folder), left, "{command:?}");
}

fn read(path: PathBuf) -> String {
    fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// The archive has programs that run, pages and completions; its digest is that of SHA256SUMS; and a second run makes
/// the same bytes.
#[test]
fn the_archive_runs_and_is_reproducible() {
    let folder = tempdir().expect("a folder");
    let made = folder.path().join("made");
    succeeds(release(folder.path()).args(["--without", "wheel", "--out", "made"]));
    succeeds(release(folder.path()).args(["--without", "wheel", "--out", "again"]));
    assert_eq!(names(folder.path()), ["again", "made"]);
    let sums = read(made.join("SHA256SUMS"));
    assert_eq!(sums, read(folder.path().join("again/SHA256SUMS")));
    succeeds(Command::new("sha256sum").args(["--check", "--strict", "SHA256SUMS"]).current_dir(&made));

    let version = env!("CARGO_PKG_VERSION");
    let name = format!("ftac-{version}-{}-unknown-linux-gnu", std::env::consts::ARCH);
    let archive = format!("{name}.tar.gz");
    assert_eq!(names(&made), ["RELEASE_NOTES.md", "SHA256SUMS", &archive]);
    assert!(sums.lines().count() == 1 && sums.trim_end().ends_with(&archive), "{sums}");
    let notes = read(made.join("RELEASE_NOTES.md"));
    for words in [&format!("# ftac {version}\n"), "\n- **Simulation:** ", &archive, "glibc 2."] {
        assert!(notes.contains(words), "{words}: {notes}");
    }

    succeeds(Command::new("tar").arg("-xzf").arg(made.join(&archive)).current_dir(folder.path()));
    let unpacked = folder.path().join(name);
    // Away from the checkout, without its environment.
    let program = |name: &str| {
        let mut program = Command::new(unpacked.join("bin").join(name));
        program.env_clear().env("FTAC_LOG", "").current_dir(folder.path());
        program
    };
    assert_eq!(succeeds(program("ftac").arg("--version")), format!("ftac {version}\n"));
    assert!(succeeds(program("ftac").args(["combos", "--json"])).starts_with('{'));
    // `ftac` finds the `ftac-lab` beside it.
    assert!(succeeds(program("ftac").args(["schema", "arm", "check"])).contains("properties"));
    let share = unpacked.join("share");
    let page = read(share.join("man/man1/ftac-bench.1"));
    assert!(page.contains(".SH OPTIONS") && page.contains("conditions"), "{page}");
    for (file, words) in [
        ("bash-completion/completions/ftac", "complete -F"),
        ("zsh/site-functions/_ftac", "#compdef ftac"),
        ("fish/vendor_completions.d/ftac.fish", "complete -c ftac"),
    ] {
        let script = read(share.join(file));
        assert!(script.contains(words) && script.contains("transport"), "{file}");
    }
    assert!(read(unpacked.join("INSTALL")).contains("with glibc 2."));
    assert!(read(unpacked.join("THIRD-PARTY.txt")).contains("\nrapier3d-f64 0."));
    for file in ["LICENSE-APACHE", "LICENSE-MIT", "README.md"] {
        assert_eq!(read(unpacked.join(file)), read(root().join(file)));
    }
}

/// A version without a changelog entry, with an empty one, or with one that has no date is not released.
#[test]
fn a_version_without_notes_is_refused() {
    let folder = tempdir().expect("a folder");
    let version = env!("CARGO_PKG_VERSION");
    let others = "# Changelog\n\n## [Unreleased]\n\n- More.\n\n## [0.0.1] - 2026-01-01\n\n- Less.\n";
    for (entry, words) in [
        (String::new(), "found no entry for"),
        (format!("## [{version}]\n\n- Undated.\n"), "YYYY-MM-DD"),
        (format!("## [{version}] - 2026-01-02\n\n## [0.0.0] - 2025-01-01\n\n- First.\n"), "found an empty entry for"),
    ] {
        fs::write(folder.path().join("log.md"), format!("{others}\n{entry}")).expect("written");
        let mut script = release(folder.path());
        script.args(["--without", "wheel", "--out", "made", "--changelog", "log.md"]);
        is_refused(&mut script, &[words, version], &["log.md"]);
    }
}

/// Contradictions are refused before anything is written, and programs that need too new a glibc after it.
#[test]
fn what_cannot_be_released_is_refused() {
    let folder = tempdir().expect("a folder");
    let refused = |arguments: &[&str], words: &[&str]| {
        let mut script = release(folder.path());
        is_refused(script.args(["--without", "wheel", "--out", "made"]).args(arguments), words, &[]);
    };
    refused(&["--tag", "v99.0.0"], &["--tag: found v99.0.0, expected v"]);
    refused(&["--out", "missing/made"], &["found no folder missing"]);
    refused(&["--wheel", "some.whl"], &["--without wheel"]);
    refused(&["--strip"], &["--strip", "--help"]);
    refused(&["--binary", "missing/ftac"], &["found no program missing/ftac"]);
    refused(&["--glibc", "2.2"], &["--glibc: ftac: found that it needs glibc 2.", "expected 2.2 or older"]);
    // An existing folder stays as it is.
    fs::create_dir(folder.path().join("made")).expect("made");
    let mut script = release(folder.path());
    is_refused(script.args(["--without", "wheel", "--out", "made"]), &["--out: found made"], &["made"]);
    assert!(names(&folder.path().join("made")).is_empty());
}

/// Writes a wheel with `ftac` as its extension module: a platform tag in its name, and one in its file WHEEL.
fn counterfeit(folder: &Path, named: &str, listed: &str) -> String {
    let version = env!("CARGO_PKG_VERSION");
    let name = format!("ftac-{version}-cp310-abi3-{named}.whl");
    let script = "import sys, zipfile\n\
                  wheel = zipfile.ZipFile(sys.argv[1], 'w')\n\
                  wheel.write(sys.argv[2], 'ftac/_native.abi3.so')\n\
                  wheel.writestr(f'ftac-{sys.argv[3]}.dist-info/WHEEL', f'Tag: cp310-abi3-{sys.argv[4]}\\n')\n\
                  wheel.close()\n";
    let mut write = Command::new("python3");
    succeeds(write.args(["-c", script]).arg(folder.join(&name)).arg(binary()).args([version, listed]));
    name
}

/// A wheel's tag must not promise an older glibc than its symbols need, and must be that of its metadata.
#[test]
fn a_wheel_with_a_false_tag_is_refused() {
    let folder = tempdir().expect("a folder");
    for (named, listed, words) in [
        ("manylinux_2_5_x86_64", "manylinux_2_5_x86_64", "expected 2.5 or older as the tag"),
        ("manylinux2010_x86_64", "manylinux2010_x86_64", "expected 2.12 or older as the tag"),
        ("linux_x86_64", "linux_x86_64", "found the platform linux_x86_64, expected manylinux_X_Y"),
        ("manylinux_2_99_x86_64", "linux_x86_64", "found no line \"Tag: cp310-abi3-manylinux_2_99_x86_64\""),
    ] {
        let name = counterfeit(folder.path(), named, listed);
        let mut script = release(folder.path());
        is_refused(script.args(["--out", "made", "--wheel", &name]), &[words, &name], &[&name]);
        fs::remove_file(folder.path().join(&name)).expect("removed");
    }
}

/// Checks that a wheel that was built on this machine can be released.
pub(crate) fn accepts_wheel(wheel: &Path) {
    let folder = tempdir().expect("a folder");
    succeeds(release(folder.path()).args(["--out", "made", "--wheel"]).arg(wheel));
    let made = folder.path().join("made");
    let name = wheel.file_name().and_then(|name| name.to_str()).expect("UTF-8");
    assert_eq!(fs::read(made.join(name)).expect("there"), fs::read(wheel).expect("there"));
    for file in ["SHA256SUMS", "RELEASE_NOTES.md"] {
        assert!(read(made.join(file)).contains(name), "{file}");
    }
    succeeds(Command::new("sha256sum").args(["--check", "--strict", "SHA256SUMS"]).current_dir(&made));
}
