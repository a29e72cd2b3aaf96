//! What a computer needs so that the bridge runs as a tool: names and access of the servo adapter, real-time scheduling, a stop at shutdown.
//!
//! [`files`] says what would be written; [`write`] writes it below a root folder and [`remove`] takes it away again. Files of others are
//! left alone: every file begins with [`MARK`].

use std::io;
use std::path::{Path, PathBuf};

use hand_model::file::write_whole;

/// First line of every file that is ours.
pub const MARK: &str = "# Written by `ftac bridge install`; `ftac bridge install --remove` takes it away.\n";
/// The adapters that speak to servos: FT232H (U2D2) and FT232R, by vendor and product.
const ADAPTERS: [(&str, &str); 2] = [("0403", "6014"), ("0403", "6001")];

/// Why a file was not written or removed.
#[derive(Debug, thiserror::Error)]
pub enum InstallError {
    #[error("{path}: {source}")]
    Io { path: PathBuf, source: io::Error },
    #[error("{path}: found a file of somebody else, expected none or one that begins with {expected:?}", expected = MARK.trim_end())]
    Foreign { path: PathBuf },
}

/// Who the computer is set up for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Setup {
    /// Serial number of the adapter; any adapter of a known kind without one.
    pub serial: Option<String>,
    /// The program, as an absolute path.
    pub program: PathBuf,
    /// The bridge's configuration, as an absolute path.
    pub config: PathBuf,
}

/// A file that makes up the installation.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InstallFile {
    /// Relative to the root folder.
    pub path: &'static str,
    /// What it is for, in words.
    pub purpose: &'static str,
    pub text: String,
}

/// The serial number in a port's name below `/dev/serial/by-id`, as udev makes it: `usb-VENDOR_MODEL_SERIAL-if00-port0`.
pub fn serial_of(port: &Path) -> Option<String> {
    let name = port.file_name()?.to_str()?.strip_prefix("usb-")?;
    let (name, _) = name.rsplit_once("-if")?;
    let serial = name.rsplit('_').next()?;
    let plain = !serial.is_empty() && serial.chars().all(|c| c.is_ascii_alphanumeric());
    plain.then(|| serial.to_owned())
}

/// The files of an installation.
pub fn files(setup: &Setup) -> Vec<InstallFile> {
    let serial = setup.serial.as_ref().map_or(String::new(), |serial| format!(", ATTRS{{serial}}==\"{serial}\""));
    let adapters: String = ADAPTERS
        .iter()
        .map(|(vendor, product)| {
            format!(
                "SUBSYSTEM==\"tty\", ATTRS{{idVendor}}==\"{vendor}\", ATTRS{{idProduct}}==\"{product}\"{serial}, \
                 SYMLINK+=\"ftac-servos\", GROUP=\"dialout\", MODE=\"0660\"\n"
            )
        })
        .collect();
    let rules = format!(
        "{MARK}# The servo adapter as /dev/ftac-servos for the group dialout; 1 ms instead of 16 until it passes short answers on.\n{adapters}\
         ACTION==\"add\", SUBSYSTEM==\"usb-serial\", DRIVER==\"ftdi_sio\", ATTR{{latency_timer}}=\"1\"\n"
    );
    let (program, config) = (quoted(&setup.program), quoted(&setup.config));
    let unit = format!(
        "{MARK}[Unit]\nDescription=Holds the F-TAC hand and its arm before this computer shuts down\n\n\
         [Service]\nType=oneshot\nRemainAfterExit=yes\nExecStart=/bin/true\n\
         # Where no robot is running there is nothing to stop.\n\
         ExecStop=-{program} bridge stop --config {config}\nTimeoutStopSec=5\n\n[Install]\nWantedBy=multi-user.target\n"
    );
    let limits = format!("{MARK}@dialout - rtprio 50\n@dialout - memlock unlimited\n");
    vec![
        InstallFile {
            path: "etc/udev/rules.d/70-ftac.rules",
            purpose: "names the servo adapter /dev/ftac-servos, lets the group dialout use it, sets its latency timer to 1 ms",
            text: rules,
        },
        InstallFile {
            path: "etc/security/limits.d/ftac.conf",
            purpose: "permits first-in-first-out scheduling to the group dialout, from the next login on",
            text: limits,
        },
        InstallFile {
            path: "etc/systemd/system/ftac-stop.service",
            purpose: "stops a running robot before the computer shuts down; `systemctl stop ftac-stop` does too",
            text: unit,
        },
    ]
}

/// A path as a word of a systemd unit.
fn quoted(path: &Path) -> String {
    let text = path.display().to_string().replace('\\', "\\\\").replace('"', "\\\"").replace('%', "%%");
    format!("\"{text}\"")
}

fn io_error(path: &Path) -> impl FnOnce(io::Error) -> InstallError + '_ {
    move |source| InstallError::Io { path: path.to_owned(), source }
}

/// Whether a file is there and ours.
fn ours(path: &Path) -> Result<bool, InstallError> {
    match std::fs::read_to_string(path) {
        Ok(text) if text.starts_with(MARK) => Ok(true),
        Ok(_) => Err(InstallError::Foreign { path: path.to_owned() }),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
        Err(error) => Err(io_error(path)(error)),
    }
}

/// Writes all files below `root`, none where one of them is somebody else's.
pub fn write(root: &Path, files: &[InstallFile]) -> Result<(), InstallError> {
    for file in files {
        ours(&root.join(file.path))?;
    }
    for file in files {
        let path = root.join(file.path);
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(io_error(folder))?;
        }
        write_whole(&path, file.text.as_bytes()).map_err(io_error(&path))?;
    }
    Ok(())
}

/// Removes those files below `root` that are there and ours; answers with them.
pub fn remove(root: &Path, files: &[InstallFile]) -> Result<Vec<PathBuf>, InstallError> {
    let mut removed = Vec::new();
    for path in files.iter().map(|file| root.join(file.path)) {
        if ours(&path)? {
            std::fs::remove_file(&path).map_err(io_error(&path))?;
            removed.push(path);
        }
    }
    Ok(removed)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn setup() -> Setup {
        Setup {
            serial: Some("FT4TFKX0".into()),
            program: "/opt/f tac/ftac".into(),
            config: "/etc/ftac/50%.toml".into(),
        }
    }

    #[test]
    fn serial_numbers_are_read_from_names() {
        let of = |name: &str| serial_of(&Path::new("/dev/serial/by-id").join(name));
        assert_eq!(of("usb-FTDI_USB__-__Serial_Converter_FT4TFKX0-if00-port0").as_deref(), Some("FT4TFKX0"));
        assert_eq!(of("usb-ROBOTIS_U2D2_FT-9\"x-if00-port0"), None);
        assert_eq!(of("ttyUSB0"), None);
    }

    #[test]
    fn files_name_adapter_program_and_configuration() {
        let files = files(&setup());
        assert!(files.iter().all(|file| file.text.starts_with(MARK)));
        assert!(files[0].text.contains("ATTRS{serial}==\"FT4TFKX0\", SYMLINK+=\"ftac-servos\""), "{}", files[0].text);
        let stop = "ExecStop=-\"/opt/f tac/ftac\" bridge stop --config \"/etc/ftac/50%%.toml\"\n";
        assert!(files[2].text.contains(stop), "{}", files[2].text);
    }

    /// Written twice is written once; somebody else's file stops everything before anything is written, and is never removed.
    #[test]
    fn others_files_are_left_alone() {
        let root = tempfile::tempdir().expect("a folder");
        let files = files(&setup());
        write(root.path(), &files).expect("written");
        write(root.path(), &files).expect("written again");
        assert_eq!(remove(root.path(), &files).expect("removed").len(), 3);
        assert!(remove(root.path(), &files).expect("nothing there").is_empty());
        let unit = root.path().join(files[2].path);
        std::fs::write(&unit, "[Unit]\n").expect("written");
        let error = write(root.path(), &files).expect_err("somebody else's").to_string();
        assert!(error.contains("ftac-stop.service: found a file of somebody else"), "{error}");
        assert!(!root.path().join(files[0].path).exists());
        assert!(remove(root.path(), &files).is_err() && unit.exists());
    }
}
