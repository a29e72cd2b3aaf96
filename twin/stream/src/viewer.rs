//! Finds and starts the Rerun viewer, which is a separate program.

use std::path::{Path, PathBuf};
use std::process::Stdio;

use hand_model::child;

use crate::error::StreamError;
use crate::release::RERUN_VERSION;

/// A viewer on this machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Viewer {
    pub program: PathBuf,
    /// What it says its version is; `None` if it does not say.
    pub version: Option<String>,
}

impl Viewer {
    /// A warning if this viewer may not be able to show our recordings.
    pub fn warning(&self) -> Option<String> {
        let series = |version: &str| version.split('.').take(2).collect::<Vec<_>>().join(".");
        let found = self.version.as_deref().unwrap_or("of unknown version");
        (series(found) != series(RERUN_VERSION)).then(|| {
            format!(
                "the Rerun viewer {} is {found}; recordings are written for {RERUN_VERSION} (pip install rerun-sdk=={RERUN_VERSION})",
                self.program.display()
            )
        })
    }
}

/// The viewer: `RERUN_BIN`, or `rerun` on the PATH. A warning about its version goes to stderr.
pub fn find_viewer() -> Option<PathBuf> {
    let viewer = find()?;
    if let Some(warning) = viewer.warning() {
        eprintln!("warning: {warning}");
    }
    Some(viewer.program)
}

/// As [`find_viewer`], with the version, and silent.
pub fn find() -> Option<Viewer> {
    let named = std::env::var_os("RERUN_BIN").filter(|name| !name.is_empty()).map(PathBuf::from);
    let path = std::env::var_os("PATH").unwrap_or_default();
    let name = format!("rerun{}", std::env::consts::EXE_SUFFIX);
    let on_path = std::env::split_paths(&path).map(|folder| folder.join(&name)).find(|file| file.is_file());
    let program = named.or(on_path).filter(|program| program.is_file())?;
    let output = child::command(&program).arg("--version").stdin(Stdio::null()).output().ok()?;
    let version = version_of(&String::from_utf8_lossy(&output.stdout));
    Some(Viewer { program, version })
}

/// The version in the answer to `rerun --version`, such as `rerun-cli 0.36.3 (base ...)`.
fn version_of(text: &str) -> Option<String> {
    text.split_whitespace()
        .find(|word| word.starts_with(|c: char| c.is_ascii_digit()) && word.contains('.'))
        .map(str::to_owned)
}

/// Recordings at `path`: the file itself, or all `.rrd` in the folder, by name.
pub fn recordings(path: &Path) -> Result<Vec<PathBuf>, StreamError> {
    let nothing = || StreamError::NoRecording(path.to_owned());
    if path.is_file() {
        return Ok(vec![path.to_owned()]);
    }
    let entries = std::fs::read_dir(path).map_err(|_| nothing())?;
    let mut files: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|file| file.is_file() && file.extension().is_some_and(|extension| extension == "rrd"))
        .collect();
    files.sort();
    if files.is_empty() { Err(nothing()) } else { Ok(files) }
}

/// Opens recordings in the viewer `program`, which lives on by itself.
pub fn open(program: &Path, files: &[PathBuf]) -> Result<(), StreamError> {
    let mut command = child::command(program);
    // The viewer also listens for programs that log to it: on this machine only.
    command.args(["--bind", "127.0.0.1", "--port", "auto"]).args(files);
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    command.spawn().map_err(|source| StreamError::Start { program: program.to_owned(), source })?;
    Ok(())
}

/// Starts a viewer to be connected to, or finds the one that listens already; returns its address.
pub fn spawn() -> Result<String, StreamError> {
    let program = find_viewer().ok_or(StreamError::NoViewer)?;
    let options = rerun::SpawnOptions {
        executable_path: Some(program.to_string_lossy().into_owned()),
        extra_args: vec!["--bind".to_owned(), "127.0.0.1".to_owned()],
        extra_env: child::blanked(),
        hide_welcome_screen: true,
        ..rerun::SpawnOptions::default()
    };
    let info = rerun::spawn(&options).map_err(|error| StreamError::Rerun(Box::new(error.into())))?;
    Ok(format!("rerun+http://127.0.0.1:{}/proxy", info.port))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions() {
        let version = version_of("rerun-cli 0.36.3 (base lance) [rustc 1.95.0 (x)] x86_64\nVideo features: av1");
        assert_eq!(version.as_deref(), Some("0.36.3"));
        let viewer = |version: &str| Viewer { program: "rerun".into(), version: Some(version.to_owned()) };
        assert_eq!(viewer("0.36.1").warning(), None);
        assert!(viewer("0.35.0").warning().expect("too old").contains("pip install rerun-sdk==0.36.3"));
        assert!(Viewer { program: "rerun".into(), version: None }.warning().is_some());
    }

    #[test]
    fn the_error_says_how_to_install() {
        let text = StreamError::NoViewer.to_string();
        assert!(text.contains("pip install rerun-sdk==0.36.3\n"), "{text}");
        assert!(text.contains("cargo install rerun-cli --version 0.36.3 --locked"), "{text}");
    }

    #[test]
    fn recordings_of_a_folder() {
        let folder = tempfile::tempdir().expect("folder");
        assert!(matches!(recordings(folder.path()), Err(StreamError::NoRecording(_))));
        for name in ["b.rrd", "a.rrd", "c.txt"] {
            std::fs::write(folder.path().join(name), b"x").expect("writes");
        }
        let found = recordings(folder.path()).expect("two");
        assert_eq!(found, [folder.path().join("a.rrd"), folder.path().join("b.rrd")]);
        assert!(matches!(recordings(&folder.path().join("none")), Err(StreamError::NoRecording(_))));
    }
}
