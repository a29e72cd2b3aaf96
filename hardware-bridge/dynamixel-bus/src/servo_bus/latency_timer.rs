//! The latency timer of FTDI USB adapters: the time for which they hold back bytes that do not fill a USB packet.
//!
//! Linux shows it under `/sys/class/tty/<name>/device/latency_timer`, in ms, 16 unless somebody changed it. At 16 ms no baud rate gets
//! beyond about 50 cycles a second. Other adapters (and a pty) have no such file.

use std::path::{Path, PathBuf};

/// State of a port's latency timer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LatencyTimer {
    /// Value of the timer, ms.
    Milliseconds(u32),
    /// The port has none: not an FTDI adapter, or not Linux.
    Absent,
}

/// Error of reading or setting the latency timer.
#[derive(Debug, thiserror::Error)]
pub enum LatencyTimerError {
    /// The file exists and cannot be used.
    #[error("{path}: {source}; to set it: echo 1 | sudo tee {path}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// The file does not hold a number.
    #[error("{path}: found `{found}`, expected a number of milliseconds")]
    Content {
        /// The file.
        path: PathBuf,
        /// Content of the file.
        found: String,
    },
}

fn file_of(port: &Path, root: &Path) -> Option<PathBuf> {
    let device = port.canonicalize().unwrap_or_else(|_| port.to_owned());
    let path = root.join(device.file_name()?).join("device/latency_timer");
    path.exists().then_some(path)
}

/// Folder in which Linux lists its serial ports.
pub const SYSTEM_FOLDER: &str = "/sys/class/tty";

/// Reads the timer of `port`; `root` is [`SYSTEM_FOLDER`].
///
/// ```
/// use dynamixel_bus::servo_bus::latency_timer::{LatencyTimer, SYSTEM_FOLDER, read};
///
/// // This port is not that of an FTDI adapter.
/// assert_eq!(read("/dev/null".as_ref(), SYSTEM_FOLDER.as_ref())?, LatencyTimer::Absent);
/// # Ok::<(), dynamixel_bus::servo_bus::latency_timer::LatencyTimerError>(())
/// ```
pub fn read(port: &Path, root: &Path) -> Result<LatencyTimer, LatencyTimerError> {
    let Some(path) = file_of(port, root) else { return Ok(LatencyTimer::Absent) };
    let text = std::fs::read_to_string(&path).map_err(|source| LatencyTimerError::Io { path: path.clone(), source })?;
    match text.trim().parse() {
        Ok(value) => Ok(LatencyTimer::Milliseconds(value)),
        Err(_) => Err(LatencyTimerError::Content { path, found: text.trim().to_owned() }),
    }
}

/// Sets the timer of `port`, which usually needs root, and reads it back.
pub fn set(port: &Path, root: &Path, milliseconds: u32) -> Result<LatencyTimer, LatencyTimerError> {
    let Some(path) = file_of(port, root) else { return Ok(LatencyTimer::Absent) };
    std::fs::write(&path, milliseconds.to_string()).map_err(|source| LatencyTimerError::Io { path, source })?;
    read(port, root)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn read_set_absent_and_nonsense() {
        let root = tempfile::tempdir().expect("a folder");
        let device = root.path().join("ttyUSB0/device");
        std::fs::create_dir_all(&device).expect("made");
        let port = Path::new("/dev/ttyUSB0");
        assert_eq!(read(port, root.path()).expect("absent"), LatencyTimer::Absent);
        std::fs::write(device.join("latency_timer"), "16\n").expect("written");
        assert_eq!(read(port, root.path()).expect("there"), LatencyTimer::Milliseconds(16));
        assert_eq!(set(port, root.path(), 1).expect("set"), LatencyTimer::Milliseconds(1));
        std::fs::write(device.join("latency_timer"), "soon").expect("written");
        assert!(read(port, root.path()).expect_err("no number").to_string().contains("found `soon`"));
    }
}
