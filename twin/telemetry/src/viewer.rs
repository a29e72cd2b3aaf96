//! Finds and starts the Rerun viewer, which is a separate program.

use std::io::{Read as _, Seek as _, Write as _};
use std::net::{Ipv4Addr, SocketAddr, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use ftac_platform::child;

use crate::error::TelemetryError;
use crate::release::RERUN_VERSION;

/// A viewer installed on this machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Viewer {
    pub program: PathBuf,
    /// Version that it reports; `None` if it reports none.
    pub version: Option<String>,
}

impl Viewer {
    /// Returns a warning if this viewer may be unable to show these recordings.
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

/// Finds the viewer: `RERUN_BIN`, or `rerun` on the PATH. A warning about its version goes to stderr.
pub fn find_viewer() -> Option<PathBuf> {
    let viewer = find()?;
    if let Some(warning) = viewer.warning() {
        let _ = writeln!(std::io::stderr(), "warning: {warning}");
    }
    Some(viewer.program)
}

/// As [`find_viewer`], but returns the version as well and prints nothing.
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

/// Extracts the version from the answer to `rerun --version`, such as `rerun-cli 0.36.3 (base ...)`.
fn version_of(text: &str) -> Option<String> {
    text.split_whitespace()
        .find(|word| word.starts_with(|c: char| c.is_ascii_digit()) && word.contains('.'))
        .map(str::to_owned)
}

/// First bytes of a recording.
const MAGIC: [u8; 3] = *b"RRF";

/// Lists the recordings at `path`: the file itself, or all `.rrd` files in the folder, sorted by name.
pub fn recordings(path: &Path) -> Result<Vec<PathBuf>, TelemetryError> {
    let nothing = || TelemetryError::NoRecording(path.to_owned());
    if path.is_file() {
        let mut start = [0; MAGIC.len()];
        let read = std::fs::File::open(path).and_then(|mut file| file.read_exact(&mut start));
        return match read {
            Ok(()) if start == MAGIC => Ok(vec![path.to_owned()]),
            _ => Err(TelemetryError::OtherFile(path.to_owned())),
        };
    }
    let entries = std::fs::read_dir(path).map_err(|_| nothing())?;
    let mut files: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|file| file.is_file() && file.extension().is_some_and(|extension| extension == "rrd"))
        .collect();
    files.sort();
    if files.is_empty() { Err(nothing()) } else { Ok(files) }
}

/// Opens recordings in the viewer `program`, which outlives this process. Returns an error if it ends immediately, for
/// instance without a display.
pub fn open(program: &Path, files: &[PathBuf]) -> Result<(), TelemetryError> {
    let mut command = child::command(program);
    // The viewer also listens for programs that log to it: on this machine only.
    command.args(["--bind", "127.0.0.1", "--port", "auto"]).args(files);
    start(program, command)
}

/// Starts a viewer to connect to, or finds the one that already listens. Returns its address, or an error if the viewer
/// ends immediately.
pub fn spawn() -> Result<String, TelemetryError> {
    let program = find_viewer().ok_or(TelemetryError::NoViewer)?;
    let place = SocketAddr::from((Ipv4Addr::LOCALHOST, rerun::DEFAULT_SERVER_PORT));
    if TcpStream::connect_timeout(&place, Duration::from_secs(1)).is_err() {
        let mut command = child::command(&program);
        command.args(["--bind", "127.0.0.1", "--expect-data-soon", "--hide-welcome-screen"]);
        command.arg(format!("--port={}", place.port()));
        start(&program, command)?;
    }
    Ok(format!("rerun+http://{place}/proxy"))
}

/// Time after which a viewer counts as started.
const START_TIMEOUT: Duration = Duration::from_secs(2);
/// The same time if no display is named: the viewer will fail, even on a slow machine.
const START_TIMEOUT_HEADLESS: Duration = Duration::from_secs(10);

/// Starts a viewer, and watches it until a failure would show.
fn start(program: &Path, mut command: Command) -> Result<(), TelemetryError> {
    let failed = |source| TelemetryError::Start { program: program.to_owned(), source };
    // A file, not a pipe: the viewer outlives this program and may go on writing.
    let mut said = tempfile::tempfile().map_err(failed)?;
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(said.try_clone().map_err(failed)?);
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    let mut viewer = command.spawn().map_err(failed)?;
    let named = |name: &str| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    let blind = cfg!(target_os = "linux") && !["DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"].into_iter().any(named);
    let deadline = Instant::now() + if blind { START_TIMEOUT_HEADLESS } else { START_TIMEOUT };
    while Instant::now() < deadline {
        match viewer.try_wait().map_err(failed)? {
            None => std::thread::sleep(Duration::from_millis(20)),
            // A launcher that has started the viewer.
            Some(status) if status.success() => break,
            Some(status) => {
                let mut text = Vec::new();
                said.rewind().and_then(|()| said.read_to_end(&mut text)).map_err(failed)?;
                let reason = reason(&String::from_utf8_lossy(&text)).unwrap_or_else(|| status.to_string());
                return Err(TelemetryError::Ended { program: program.to_owned(), reason });
            }
        }
    }
    Ok(())
}

/// Returns the last line that a program wrote, without terminal control characters.
fn reason(text: &str) -> Option<String> {
    let line = text.lines().rev().find(|line| !line.trim().is_empty())?;
    let line = line.trim().trim_start_matches("Error: ");
    Some(line.chars().filter(|character| !character.is_control()).collect())
}

/// Reason why this process has lost its viewer, if it has.
static LOSS_REASON: Mutex<Option<String>> = Mutex::new(None);

/// Returns the reason why this process has lost, or could not start, its viewer. Its files are complete nevertheless.
pub fn loss_reason() -> Option<String> {
    LOSS_REASON.lock().ok().and_then(|lost| lost.clone())
}

/// Notes that the viewer is lost, and prints the first reason.
pub(crate) fn mark_lost(why: &str) {
    if let Ok(mut lost) = LOSS_REASON.lock()
        && lost.is_none()
    {
        let _ = writeln!(std::io::stderr(), "warning: the viewer is lost: {why}; files are still written");
        *lost = Some(why.to_owned());
    }
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
    fn what_a_viewer_said_last_is_the_reason() {
        let text = "\u{1b}[2mINFO\u{1b}[0m fine\nError: winit: \u{1b}[1mno display\n\n";
        assert_eq!(reason(text).as_deref(), Some("winit: [1mno display"));
        assert_eq!(reason("\n"), None);
    }

    #[test]
    fn the_error_says_how_to_install() {
        let text = TelemetryError::NoViewer.to_string();
        assert!(text.contains("pip install rerun-sdk==0.36.3\n"), "{text}");
        assert!(text.contains("cargo install rerun-cli --version 0.36.3 --locked"), "{text}");
    }

    #[test]
    fn recordings_of_a_folder() {
        let folder = tempfile::tempdir().expect("folder");
        assert!(matches!(recordings(folder.path()), Err(TelemetryError::NoRecording(_))));
        for name in ["b.rrd", "a.rrd", "c.txt"] {
            std::fs::write(folder.path().join(name), b"x").expect("writes");
        }
        let found = recordings(folder.path()).expect("two");
        assert_eq!(found, [folder.path().join("a.rrd"), folder.path().join("b.rrd")]);
        assert!(matches!(recordings(&folder.path().join("none")), Err(TelemetryError::NoRecording(_))));
    }
}
