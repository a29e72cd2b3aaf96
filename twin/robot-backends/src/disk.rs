//! Check of the free disk space for a session, made before anything moves.

use std::path::Path;

use anyhow::{Context as _, Result, bail};

/// Upper estimate of the size of a session, bytes: 10 MB per second were measured with five images per second of each
/// camera, and a trial may last two minutes.
const SESSION_SIZE: u64 = 1_500_000_000;

/// Creates the folder and checks that a session can be written into it.
pub fn ensure_session_space(folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    // A file is written and removed again: permissions alone do not show it.
    tempfile::NamedTempFile::new_in(folder).with_context(|| {
        format!("{}: found a folder that cannot be written to, expected room for the session", folder.display())
    })?;
    let disk = rustix::fs::statvfs(folder).with_context(|| folder.display().to_string())?;
    let free = disk.f_bavail.saturating_mul(disk.f_frsize);
    if free < SESSION_SIZE {
        bail!(
            "{}: found {:.2} GB free, expected {:.1} GB or more for the session of a trial",
            folder.display(),
            free as f64 / 1e9,
            SESSION_SIZE as f64 / 1e9
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_no_folder() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("file");
        std::fs::write(&file, "x").expect("written");
        assert!(ensure_session_space(&file.join("sessions")).is_err());
        let sessions = folder.path().join("a/b");
        // The result depends on the disk. In either case the folder exists and is empty.
        let _ = ensure_session_space(&sessions);
        assert_eq!(std::fs::read_dir(&sessions).expect("made").count(), 0);
    }
}
