//! `ftac view`: opens recordings in the Rerun viewer.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use telemetry::TelemetryError;
use telemetry::viewer;

use super::export;
use super::sessions::sessions_in;
use crate::terminal::{Outcome, Terminal};

/// Opens a recording, a session, or a folder's recordings in the Rerun viewer. If a folder has no recordings, its
/// sessions are opened.
pub fn run(terminal: &Terminal, path: &Path) -> Outcome {
    if !path.exists() {
        return Err(TelemetryError::NoRecording(path.to_owned()).into());
    }
    let program = viewer::find_viewer().ok_or(TelemetryError::NoViewer)?;
    // Recordings and sessions of a benchmark lie in subfolders of its results.
    let inside = |name: &str| Some(path.join(name)).filter(|folder| folder.is_dir()).unwrap_or_else(|| path.to_owned());
    let (recordings, sessions) = (inside("recordings"), inside("sessions"));
    let mut shortfall = None;
    let files = if path.extension().is_some_and(|extension| extension == "mcap") {
        vec![ensure_recording(terminal, path, &mut shortfall)?]
    } else {
        match viewer::recordings(&recordings) {
            Ok(files) => files,
            Err(error) => {
                let sessions = sessions_in(&sessions).unwrap_or_default();
                if sessions.is_empty() {
                    return Err(error.into());
                }
                sessions
                    .iter()
                    .map(|session| ensure_recording(terminal, session, &mut shortfall))
                    .collect::<Result<_>>()?
            }
        }
    };
    viewer::open(&program, &files)?;
    eprintln!("opened {} recording(s)", files.len());
    Ok(shortfall)
}

/// Returns the recording beside a session. It is made now unless it exists and is newer than the session.
fn ensure_recording(terminal: &Terminal, session: &Path, shortfall: &mut Option<String>) -> Result<PathBuf> {
    let out = session.with_extension("rrd");
    let changed = |path: &Path| path.metadata().and_then(|found| found.modified());
    let recorded = changed(session).with_context(|| session.display().to_string())?;
    if changed(&out).is_ok_and(|drawn| drawn > recorded) {
        return Ok(out);
    }
    let (_, left) = export::export_rrd(terminal, session, &out)?;
    *shortfall = shortfall.take().or(left);
    Ok(out)
}
