//! Log of commands that use devices: a line when a command begins and one when it ends, in a file of limited length.
//!
//! The file is `ftac/ftac.log` below `$XDG_STATE_HOME` (`~/.local/state` by default), or that named by `FTAC_LOG`
//! (empty for no log). When it reaches [`MAX_FILE_SIZE`] it becomes `ftac.log.1`; [`KEPT_FILE_COUNT`] older files are
//! kept. Passwords are never arguments, so the log contains none.

use std::fs::{self, OpenOptions};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::time::Instant;

use jiff::Timestamp;

/// Size from which a new file is begun, bytes.
const MAX_FILE_SIZE: u64 = 1 << 20;
/// Number of older files kept.
const KEPT_FILE_COUNT: u32 = 5;

/// A logged command in progress.
pub struct LogEntry {
    file: PathBuf,
    started: Instant,
}

/// Returns the log's path; none if the log is switched off or there is no home folder.
fn log_path() -> Option<PathBuf> {
    let named = |name: &str| std::env::var_os(name).map(PathBuf::from);
    match named("FTAC_LOG") {
        Some(file) => (!file.as_os_str().is_empty()).then_some(file),
        None => {
            let state = named("XDG_STATE_HOME").filter(|folder| folder.is_absolute());
            let state = state.or_else(|| Some(named("HOME")?.join(".local/state")));
            Some(state?.join("ftac/ftac.log"))
        }
    }
}

impl LogEntry {
    /// Logs the beginning of this process with its arguments. If the log cannot be written, a note goes to stderr and
    /// the command continues.
    pub fn begin() -> Option<Self> {
        let file = log_path()?;
        let arguments: Vec<String> = std::env::args().skip(1).collect();
        let entry = Self { file, started: Instant::now() };
        match entry.write(&format!("begins: ftac {}", arguments.join(" "))) {
            Ok(()) => Some(entry),
            Err(error) => {
                eprintln!(
                    "no log of this: {}: {error} (FTAC_LOG names another file, or none if empty)",
                    entry.file.display()
                );
                None
            }
        }
    }

    /// Logs the end of the command: duration, exit code and message.
    pub fn end(self, code: u8, message: &str) {
        let seconds = self.started.elapsed().as_secs_f64();
        let colon = if message.is_empty() { "" } else { ": " };
        // The beginning was written. A failure to write the end is no reason to fail.
        let _ = self.write(&format!("ends after {seconds:.1} s with code {code}{colon}{message}"));
    }

    fn write(&self, words: &str) -> io::Result<()> {
        if let Some(folder) = self.file.parent() {
            fs::create_dir_all(folder)?;
        }
        rotate(&self.file, MAX_FILE_SIZE)?;
        // One write per line, so that lines of two programs do not mix.
        let line = format!(
            "{:.3} {} {}\n",
            Timestamp::now(),
            std::process::id(),
            progress::printable(&words.replace('\n', " "))
        );
        OpenOptions::new().create(true).append(true).open(&self.file)?.write_all(line.as_bytes())
    }
}

/// Begins a new file if the old one is at least `longest` bytes long.
fn rotate(file: &Path, longest: u64) -> io::Result<()> {
    if !file.metadata().is_ok_and(|found| found.len() >= longest) {
        return Ok(());
    }
    let older = |n: u32| PathBuf::from(format!("{}.{n}", file.display()));
    for n in (1..KEPT_FILE_COUNT).rev() {
        match fs::rename(older(n), older(n + 1)) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
    }
    fs::rename(file, older(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// No more files than `KEPT_FILE_COUNT` remain, and the newest lines are in the file itself.
    #[test]
    fn old_files_make_room() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("ftac.log");
        for n in 0..20 {
            rotate(&file, 4).expect("rotated");
            fs::write(&file, format!("line {n}")).expect("written");
        }
        assert_eq!(fs::read_dir(folder.path()).expect("listed").count(), 1 + KEPT_FILE_COUNT as usize);
        assert_eq!(fs::read_to_string(&file).expect("read"), "line 19");
        let oldest = folder.path().join(format!("ftac.log.{KEPT_FILE_COUNT}"));
        assert_eq!(fs::read_to_string(oldest).expect("read"), "line 14");
    }
}
