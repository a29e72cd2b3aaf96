//! Exclusive access to a serial port, and identification of the program that has it.
//!
//! The device itself is locked (`flock`). This keeps out other runs of this program and ends with its process, however
//! that ends. Other programs are kept out with TIOCEXCL, except on a pseudo-terminal, where it would outlast a killed
//! program.

use std::fs::{self, File};
use std::io::{self, ErrorKind};
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _};
use std::path::Path;

use rustix::fs::{FlockOperation, OFlags, flock};
use rustix::termios::ioctl_tiocexcl;
use serial2::{IntoSettings as _, SerialPort};

/// Opens `path` at `baud` (bits per second) for exclusive use, in raw mode, 8N1.
///
/// ```no_run
/// let port = dynamixel_bus::exclusive::open("/dev/ttyACM0".as_ref(), 115_200)?;
/// # Ok::<(), std::io::Error>(())
/// ```
///
/// # Errors
/// The operating system's error, or one that names the program that has the port.
pub fn open(path: &Path, baud: u32) -> io::Result<SerialPort> {
    let device = File::options()
        .read(true)
        .write(true)
        .custom_flags((OFlags::NONBLOCK | OFlags::NOCTTY).bits().cast_signed())
        .open(path)
        .map_err(|error| match error.kind() {
            ErrorKind::ResourceBusy => port_in_use(path),
            _ => error,
        })?;
    // The port is locked before it is set up: a rate set by a second program would garble what the first one sends and
    // receives.
    if flock(&device, FlockOperation::NonBlockingLockExclusive).is_err() {
        return Err(port_in_use(path));
    }
    let mut port = SerialPort::from(OwnedFd::from(device));
    let mut settings = port.get_configuration()?;
    baud.apply_to_settings(&mut settings)?;
    port.set_configuration(&settings)?;
    let real = fs::canonicalize(path)?;
    if !real.starts_with("/dev/pts") {
        ioctl_tiocexcl(port.as_fd())?;
    }
    Ok(port)
}

fn port_in_use(path: &Path) -> io::Error {
    let owner = owner(path).unwrap_or_else(|| "another program".to_owned());
    io::Error::new(ErrorKind::ResourceBusy, format!("in use by {owner}"))
}

/// Describes the process that has locked the device, as far as /proc shows it.
fn owner(path: &Path) -> Option<String> {
    let device = fs::metadata(path).ok()?;
    let process = locked_by(&fs::read_to_string("/proc/locks").ok()?, device.dev(), device.ino())?;
    let arguments = fs::read(format!("/proc/{process}/cmdline")).unwrap_or_default();
    let command: Vec<_> = arguments.split(|byte| *byte == 0).map(String::from_utf8_lossy).collect();
    Some(format!("process {process}: {}", command.join(" ").trim()))
}

/// Finds the process that holds a `flock` on an inode in the lines of /proc/locks (`1: FLOCK  ADVISORY  WRITE 4711
/// 00:18:3 0 EOF`).
fn locked_by(locks: &str, device: u64, inode: u64) -> Option<u32> {
    let (major, minor) = (rustix::fs::major(device), rustix::fs::minor(device));
    let place = format!("{major:02x}:{minor:02x}:{inode}");
    let line =
        locks.lines().find(|line| line.contains("FLOCK") && line.split_whitespace().any(|word| word == place))?;
    line.split_whitespace().nth(4)?.parse().ok()
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;

    #[test]
    fn the_owner_is_found_among_others() {
        let locks = "1: POSIX  ADVISORY  WRITE 12 00:18:3 0 EOF\n2: FLOCK  ADVISORY  WRITE 4711 00:18:3 0 EOF\n";
        let device = rustix::fs::makedev(0, 0x18);
        assert_eq!(locked_by(locks, device, 3), Some(4711));
        assert_eq!(locked_by(locks, device, 4), None);
    }

    /// Returns the device end and the path of the host's end.
    fn pseudo_terminal() -> (SerialPort, PathBuf) {
        use std::os::fd::AsRawFd as _;
        let (device, host) = SerialPort::pair().expect("a pseudo-terminal");
        let path = fs::read_link(format!("/proc/self/fd/{}", host.as_raw_fd())).expect("its path");
        (device, path)
    }

    /// A port can be opened only once, and a second program does not touch its settings. Once closed, it is free again.
    #[test]
    fn one_at_a_time() {
        let (_device, path) = pseudo_terminal();
        let first = open(&path, 57_600).expect("free");
        let error = open(&path, 3_000_000).expect_err("taken").to_string();
        let settings = first.get_configuration().expect("settings");
        assert_eq!(settings.get_baud_rate().expect("a rate"), 57_600);
        assert!(error.starts_with("in use by process ") && error.contains("dynamixel_bus"), "{error}");
        drop(first);
        drop(open(&path, 57_600).expect("free again"));
    }
}
