//! `ftac view`.

use std::path::Path;

use crate::terminal::Outcome;

/// Opens a recording, or a folder's recordings, in the Rerun viewer.
pub fn run(path: &Path) -> Outcome {
    // A benchmark's recordings lie in a folder of their own within its results.
    let inside = path.join("recordings");
    let opened = stream::viewer::open(if inside.is_dir() { &inside } else { path })?;
    eprintln!("opened {} recording(s)", opened.len());
    Ok(None)
}
