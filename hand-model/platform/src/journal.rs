//! Journals of long computations, and locks.
//!
//! A journal has a line of JSON for each finished piece of work. The line is on disk before anything else happens, so
//! that a process killed at any moment loses only the work in flight. The locks are for files and folders that only one
//! process at a time may write.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, ErrorKind, Write as _};
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::data::{DataError, read_text};

/// A journal that is open for writing.
///
/// ```
/// use ftac_platform::journal::Journal;
///
/// let folder = tempfile::tempdir().expect("a folder");
/// let path = folder.path().join("trials.jsonl");
/// let mut journal = Journal::open(&path)?;
/// journal.append(&("trial 1", true))?;
/// journal.append(&("trial 2", false))?;
/// assert_eq!(Journal::read::<(String, bool)>(&path)?.len(), 2);
/// # Ok::<(), ftac_platform::DataError>(())
/// ```
#[derive(Debug)]
pub struct Journal {
    file: File,
    path: PathBuf,
}

impl Journal {
    /// Opens the journal at `path` for appending, and creates it if it is missing. A truncated last line is removed.
    ///
    /// # Errors
    /// [`DataError::Io`].
    pub fn open(path: &Path) -> Result<Self, DataError> {
        let open = || {
            let file = OpenOptions::new().create(true).append(true).open(path)?;
            let whole = std::fs::read(path)?.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1);
            file.set_len(whole as u64)?;
            Ok(file)
        };
        let file = open().map_err(|source| DataError::Io { path: path.into(), source })?;
        Ok(Self { file, path: path.into() })
    }

    /// Reads the lines of the journal at `path`, which stays unchanged. A truncated last line is skipped.
    ///
    /// # Errors
    /// A file that cannot be read, or the first line that does not parse as `T`.
    pub fn read<T: DeserializeOwned>(path: &Path) -> Result<Vec<T>, DataError> {
        let text = read_text(path)?;
        let whole = text.split_inclusive('\n').filter(|line| line.ends_with('\n'));
        let parsed = (1..).zip(whole).map(|(line, text)| {
            let wrong = |error: serde_json::Error| DataError::Line {
                path: path.into(),
                line,
                found: format!("a line that does not fit ({error})"),
                expected: "one of this journal".into(),
            };
            serde_json::from_str(text).map_err(wrong)
        });
        parsed.collect()
    }

    /// Appends a line; returns when it is on disk.
    ///
    /// # Errors
    /// [`DataError::Io`].
    pub fn append(&mut self, line: &impl Serialize) -> Result<(), DataError> {
        let text = serde_json::to_string(line).map_err(io::Error::from);
        let written = text.and_then(|text| self.file.write_all((text + "\n").as_bytes()));
        let written = written.and_then(|()| self.file.sync_data());
        written.map_err(|source| DataError::Io { path: self.path.clone(), source })
    }
}

/// Locks a file or folder for as long as it stays open; `None` if another process holds the lock. The operating system,
/// or the server of a network file system, releases the lock when its holder ends.
///
/// # Errors
/// The operating system's error.
pub fn try_lock(file: File) -> io::Result<Option<File>> {
    match file.try_lock() {
        Ok(()) => Ok(Some(file)),
        Err(TryLockError::WouldBlock) => Ok(None),
        Err(TryLockError::Error(error)) => Err(error),
    }
}

/// Opens and locks a folder against every other `what` that would write into it, for as long as the returned file stays
/// open.
///
/// # Errors
/// [`DataError::Io`]: the folder cannot be opened, or another process holds the lock.
///
/// ```
/// use ftac_platform::journal::lock_folder;
///
/// let folder = tempfile::tempdir().expect("a folder");
/// let lock = lock_folder(folder.path(), "sweep")?;
/// let error = lock_folder(folder.path(), "sweep").expect_err("locked");
/// assert!(error.to_string().ends_with("another sweep is writing into it"));
/// drop(lock);
/// # Ok::<(), ftac_platform::DataError>(())
/// ```
pub fn lock_folder(folder: &Path, what: &str) -> Result<File, DataError> {
    let busy = || io::Error::new(ErrorKind::WouldBlock, format!("another {what} is writing into it"));
    let lock = File::open(folder).and_then(try_lock).and_then(|lock| lock.ok_or_else(busy));
    lock.map_err(|source| DataError::Io { path: folder.into(), source })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_that_was_cut_off_is_left_out_and_one_that_does_not_fit_is_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("lines.jsonl");
        std::fs::write(&path, "[1, 0.5]\n[2, 0.1]\n[3,").expect("written");
        let mut journal = Journal::open(&path).expect("opens");
        journal.append(&(3, 1.0 / 3.0)).expect("added");
        assert_eq!(Journal::read::<(u32, f64)>(&path).expect("whole"), [(1, 0.5), (2, 0.1), (3, 1.0 / 3.0)]);
        journal.append(&"four").expect("added");
        let error = Journal::read::<(u32, f64)>(&path).expect_err("no pair").to_string();
        assert!(error.contains("lines.jsonl:4"), "{error}");
    }

    #[test]
    fn a_folder_is_locked_once() {
        let folder = tempfile::tempdir().expect("a folder");
        let lock = lock_folder(folder.path(), "run").expect("free");
        let error = lock_folder(folder.path(), "run").expect_err("busy").to_string();
        assert!(error.contains("another run is writing into it"), "{error}");
        drop(lock);
        assert!(lock_folder(folder.path(), "run").is_ok());
    }
}
