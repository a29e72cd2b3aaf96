//! A pseudo-terminal: the device end for an emulator, the other end for any program that opens serial ports.

use std::os::fd::AsRawFd;
use std::path::{Path, PathBuf};

use serial2::SerialPort;

/// A pseudo-terminal with its two ends.
#[derive(Debug)]
pub struct Pty {
    /// The device's end.
    pub device: SerialPort,
    /// The host's end, kept open so that the device's end survives when a host closes it.
    host: SerialPort,
    path: PathBuf,
}

/// Error of making a pseudo-terminal.
#[derive(Debug, thiserror::Error)]
pub enum PtyError {
    /// The pseudo-terminal could not be made.
    #[error("pseudo-terminal: {0}")]
    Open(std::io::Error),
    /// The link to it could not be made.
    #[error("{path}: {source}")]
    Link {
        /// The link.
        path: PathBuf,
        /// The operating system's reason.
        source: std::io::Error,
    },
}

impl Pty {
    /// Opens a new pair.
    pub fn open() -> Result<Self, PtyError> {
        let (device, host) = SerialPort::pair().map_err(PtyError::Open)?;
        // The kernel's list of this process's open files has the name of the host's end.
        let path = std::fs::read_link(format!("/proc/self/fd/{}", host.as_raw_fd())).map_err(PtyError::Open)?;
        Ok(Self { device, host, path })
    }

    /// Returns the path that a host opens.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Removes the device, and its path with it. As long as the returned port lives, the system gives that path to no
    /// other pseudo-terminal: a host that looks for its device again must not find a different one.
    pub fn hang_up(self) -> SerialPort {
        self.host
    }

    /// Makes `link` point to the host's end, in place of an older link.
    pub fn link(&self, link: &Path) -> Result<(), PtyError> {
        let failed = |source| PtyError::Link { path: link.to_owned(), source };
        match std::fs::symlink_metadata(link) {
            Ok(found) if found.file_type().is_symlink() => std::fs::remove_file(link).map_err(failed)?,
            Ok(_) => return Err(failed(std::io::Error::other("exists and is no link"))),
            Err(_) => {}
        }
        std::os::unix::fs::symlink(&self.path, link).map_err(failed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_cross_and_the_host_sets_the_rate() {
        let folder = tempfile::tempdir().expect("a folder");
        let link = folder.path().join("servos");
        let pty = Pty::open().expect("a pty");
        pty.link(&link).expect("linked");
        pty.link(&link).expect("linked again");
        let host = SerialPort::open(&link, 3_000_000).expect("opens");
        host.write_all(&[0, 1, 0xFF, 13, 10]).expect("written");
        let mut buffer = [0; 5];
        pty.device.read_exact(&mut buffer).expect("read");
        assert_eq!(buffer, [0, 1, 0xFF, 13, 10]);
        let settings = pty.device.get_configuration().expect("settings");
        assert_eq!(settings.get_baud_rate().expect("a rate"), 3_000_000);
    }

    #[test]
    fn a_path_that_is_gone_is_nobody_elses() {
        let pty = Pty::open().expect("a pty");
        let path = pty.path().to_owned();
        let kept = pty.hang_up();
        assert!(SerialPort::open(&path, 3_000_000).is_err());
        let others: Vec<Pty> = (0..8).map(|_| Pty::open().expect("a pty")).collect();
        assert!(others.iter().all(|other| other.path() != path));
        drop(kept);
    }
}
