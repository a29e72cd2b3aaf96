//! What was done with devices, and what came of it: a line when a command begins and one when it ends, in a file that is never long.
//!
//! The file is `ftac/ftac.log` below `$XDG_STATE_HOME` (`~/.local/state` by default), or what `FTAC_LOG` names; empty for none. When it
//! reaches [`LONGEST`] it becomes `ftac.log.1`, and of older ones [`KEPT`] stay. Passwords are no arguments, so that none is in it.

use std::fs::{self, OpenOptions};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};
use std::time::Instant;

use jiff::Timestamp;

/// Bytes from which on a new file is begun.
const LONGEST: u64 = 1 << 20;
/// Older files that stay.
const KEPT: u32 = 5;

/// A command that has been noted as begun.
pub struct Entry {
    file: PathBuf,
    started: Instant,
}

/// Where the log is; none where nobody wants one or there is no home.
fn place() -> Option<PathBuf> {
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

impl Entry {
    /// Notes that this process began, with its arguments. Where the log cannot be written that is said, and the command goes on.
    pub fn begin() -> Option<Self> {
        let file = place()?;
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

    /// Notes how it ended.
    pub fn end(self, code: u8, message: &str) {
        let seconds = self.started.elapsed().as_secs_f64();
        let colon = if message.is_empty() { "" } else { ": " };
        // The beginning could be written; that the end cannot is no reason to fail.
        let _ = self.write(&format!("ends after {seconds:.1} s with code {code}{colon}{message}"));
    }

    fn write(&self, words: &str) -> io::Result<()> {
        if let Some(folder) = self.file.parent() {
            fs::create_dir_all(folder)?;
        }
        rotate(&self.file, LONGEST)?;
        // One write a line: lines of two programs do not mix.
        let line = format!(
            "{:.3} {} {}\n",
            Timestamp::now(),
            std::process::id(),
            progress::printable(&words.replace('\n', " "))
        );
        OpenOptions::new().create(true).append(true).open(&self.file)?.write_all(line.as_bytes())
    }
}

/// Begins a new file where the old one is `longest` bytes long.
fn rotate(file: &Path, longest: u64) -> io::Result<()> {
    if !file.metadata().is_ok_and(|found| found.len() >= longest) {
        return Ok(());
    }
    let older = |n: u32| PathBuf::from(format!("{}.{n}", file.display()));
    for n in (1..KEPT).rev() {
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

    /// As many files as are kept, the newest lines in the file itself.
    #[test]
    fn old_files_make_room() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("ftac.log");
        for n in 0..20 {
            rotate(&file, 4).expect("rotated");
            fs::write(&file, format!("line {n}")).expect("written");
        }
        assert_eq!(fs::read_dir(folder.path()).expect("listed").count(), 1 + KEPT as usize);
        assert_eq!(fs::read_to_string(&file).expect("read"), "line 19");
        let oldest = folder.path().join(format!("ftac.log.{KEPT}"));
        assert_eq!(fs::read_to_string(oldest).expect("read"), "line 14");
    }
}
