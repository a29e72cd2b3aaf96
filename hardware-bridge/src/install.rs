//! Setup of a computer for the bridge: name and access of the servo adapter, real-time scheduling, a folder for stop
//! sockets, a stop at shutdown.
//!
//! [`files`] lists the files; [`write`] writes them below a root folder, and [`remove`] removes them again. Foreign
//! files are left alone: every installed text begins with [`FILE_MARK`], and the program lies beside one that does.
//!
//! # Stop at shutdown
//! The service runs a copy of the program that only root can change, under a user that exists only for this purpose and
//! may only write to the operators' stop sockets. A program or configuration in a user's home is neither run nor read,
//! and need not exist any more.

use std::fs::Permissions;
use std::io;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

use ftac_platform::file::write_atomically;

use crate::remote::socket_paths;

/// First line of every installed text file.
pub const FILE_MARK: &str = "# Written by `ftac bridge install`; `ftac bridge install --remove` takes it away.\n";
/// Group of the users who may use the servos and stop robots.
pub const OPERATOR_GROUP: &str = "dialout";
/// USB adapters that talk to servos: FT232H (U2D2) and FT232R, by vendor and product.
const ADAPTERS: [(&str, &str); 2] = [("0403", "6014"), ("0403", "6001")];

/// Error of writing or removing a file.
#[derive(Debug, thiserror::Error)]
pub enum InstallError {
    #[error("{path}: {source}")]
    Io { path: PathBuf, source: io::Error },
    #[error("{path}: found a foreign file, expected none or one that begins with {expected:?}", expected = FILE_MARK.trim_end())]
    Foreign { path: PathBuf },
}

/// Parameters of an installation.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InstallSetup {
    /// Serial number of the adapter; `None` for any adapter of a known kind.
    pub serial: Option<String>,
    /// Program that is copied for the stop at shutdown.
    pub program: PathBuf,
}

/// Content of an installed file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum FileContent {
    Text(String),
    /// A copy of the program at this path.
    Program(PathBuf),
}

/// A file of the installation.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InstallFile {
    /// Path relative to the root folder.
    pub path: &'static str,
    /// Purpose of the file, in words.
    pub purpose: &'static str,
    pub content: FileContent,
}

impl InstallFile {
    fn text(path: &'static str, purpose: &'static str, text: String) -> Self {
        Self { path, purpose, content: FileContent::Text(text) }
    }
}

/// Path of the program's copy; `PROGRAM_NOTE_PATH` is the text that states its owner.
const PROGRAM_PATH: &str = "usr/local/lib/ftac/ftac";
const PROGRAM_NOTE_PATH: &str = "usr/local/lib/ftac/README";

/// Extracts the serial number from a port's name below `/dev/serial/by-id`, as udev makes it:
/// `usb-VENDOR_MODEL_SERIAL-if00-port0`.
pub fn serial_of(port: &Path) -> Option<String> {
    let name = port.file_name()?.to_str()?.strip_prefix("usb-")?;
    let (name, _) = name.rsplit_once("-if")?;
    let serial = name.rsplit('_').next()?;
    let plain = !serial.is_empty() && serial.chars().all(|c| c.is_ascii_alphanumeric());
    plain.then(|| serial.to_owned())
}

/// Returns the files of an installation.
pub fn files(setup: &InstallSetup) -> Vec<InstallFile> {
    let serial = setup.serial.as_ref().map_or(String::new(), |serial| format!(", ATTRS{{serial}}==\"{serial}\""));
    let adapters: String = ADAPTERS
        .iter()
        .map(|(vendor, product)| {
            format!(
                "SUBSYSTEM==\"tty\", ATTRS{{idVendor}}==\"{vendor}\", ATTRS{{idProduct}}==\"{product}\"{serial}, \
                 SYMLINK+=\"ftac-servos\", GROUP=\"{OPERATOR_GROUP}\", MODE=\"0660\"\n"
            )
        })
        .collect();
    let rules = format!(
        "{FILE_MARK}# The servo adapter as /dev/ftac-servos for the group {OPERATOR_GROUP}; 1 ms instead of 16 until it passes short answers on.\n{adapters}\
         ACTION==\"add\", SUBSYSTEM==\"usb-serial\", DRIVER==\"ftdi_sio\", ATTR{{latency_timer}}=\"1\"\n"
    );
    let unit = format!(
        "{FILE_MARK}[Unit]\nDescription=Holds F-TAC hands and their arms before this computer shuts down\n\
         # It is stopped before these are: the arm's network, and the programs of users.\n\
         After=network.target systemd-user-sessions.service systemd-tmpfiles-setup.service\n\n\
         [Service]\nType=oneshot\nRemainAfterExit=yes\nExecStart=/bin/true\n\
         # Where no robot is running there is nothing to stop.\n\
         ExecStop=-/{PROGRAM_PATH} bridge stop\nTimeoutStopSec=10\n\
         # It may write to the stop sockets, and nothing else.\n\
         DynamicUser=yes\nSupplementaryGroups={OPERATOR_GROUP}\nEnvironment=FTAC_LOG=\nNoNewPrivileges=yes\nCapabilityBoundingSet=\n\
         ProtectSystem=strict\nProtectHome=yes\nPrivateDevices=yes\nRestrictAddressFamilies=AF_UNIX\n\n\
         [Install]\nWantedBy=multi-user.target\n"
    );
    let limits = format!("{FILE_MARK}@{OPERATOR_GROUP} - rtprio 50\n@{OPERATOR_GROUP} - memlock unlimited\n");
    // Members of the group can create sockets there, but cannot remove each other's.
    let runtime = format!("{FILE_MARK}d {} 3770 root {OPERATOR_GROUP} -\n", socket_paths::OPERATORS_FOLDER);
    let note = format!("{FILE_MARK}# The program beside this file is run by ftac-stop.service, and by nothing else.\n");
    vec![
        InstallFile::text(
            "etc/udev/rules.d/70-ftac.rules",
            "names the servo adapter /dev/ftac-servos, lets the group dialout use it, sets its latency timer to 1 ms",
            rules,
        ),
        InstallFile::text(
            "etc/security/limits.d/ftac.conf",
            "permits first-in-first-out scheduling to the group dialout, from the next login on",
            limits,
        ),
        InstallFile::text(
            "etc/tmpfiles.d/ftac.conf",
            "makes /run/ftac at boot: there every member of the group dialout can stop any robot",
            runtime,
        ),
        InstallFile::text(PROGRAM_NOTE_PATH, "states the owner of the program beside it", note),
        InstallFile {
            path: PROGRAM_PATH,
            purpose: "a copy of this program that root alone may change, for the stop at shutdown",
            content: FileContent::Program(setup.program.clone()),
        },
        InstallFile::text(
            "etc/systemd/system/ftac-stop.service",
            "stops running robots before the computer shuts down; `systemctl stop ftac-stop` does too",
            unit,
        ),
    ]
}

fn io_error(path: &Path) -> impl FnOnce(io::Error) -> InstallError + '_ {
    move |source| InstallError::Io { path: path.to_owned(), source }
}

/// True if a file exists and belongs to the installation. A program does if the text beside it does.
fn is_ours(root: &Path, file: &InstallFile) -> Result<bool, InstallError> {
    let path = root.join(file.path);
    let text = match file.content {
        FileContent::Text(_) => path.clone(),
        FileContent::Program(_) if path.exists() => path.with_file_name("README"),
        FileContent::Program(_) => return Ok(false),
    };
    match std::fs::read_to_string(&text) {
        Ok(text) if text.starts_with(FILE_MARK) => Ok(true),
        Ok(_) => Err(InstallError::Foreign { path }),
        Err(error) if error.kind() == io::ErrorKind::NotFound => match file.content {
            FileContent::Text(_) => Ok(false),
            FileContent::Program(_) => Err(InstallError::Foreign { path }),
        },
        Err(error) => Err(io_error(&text)(error)),
    }
}

/// Writes all files below `root`, or none if one of them is foreign.
pub fn write(root: &Path, files: &[InstallFile]) -> Result<(), InstallError> {
    for file in files {
        is_ours(root, file)?;
    }
    for file in files {
        let path = root.join(file.path);
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(io_error(folder))?;
        }
        match &file.content {
            FileContent::Text(text) => write_atomically(&path, text.as_bytes()).map_err(io_error(&path))?,
            FileContent::Program(program) => {
                let bytes = std::fs::read(program).map_err(io_error(program))?;
                write_atomically(&path, &bytes).map_err(io_error(&path))?;
                std::fs::set_permissions(&path, Permissions::from_mode(0o755)).map_err(io_error(&path))?;
            }
        }
    }
    Ok(())
}

/// Removes the installed files below `root`; returns their paths.
pub fn remove(root: &Path, files: &[InstallFile]) -> Result<Vec<PathBuf>, InstallError> {
    let mut there = Vec::new();
    for file in files {
        if is_ours(root, file)? {
            there.push(root.join(file.path));
        }
    }
    for path in &there {
        std::fs::remove_file(path).map_err(io_error(path))?;
    }
    // The folder is empty now, unless it holds a foreign file.
    let _ = std::fs::remove_dir(root.join(PROGRAM_PATH).with_file_name(""));
    Ok(there)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A setup whose program is in a user's home.
    fn setup(home: &Path) -> InstallSetup {
        let program = home.join("f tac");
        std::fs::write(&program, "the program").expect("written");
        InstallSetup { serial: Some("FT4TFKX0".into()), program }
    }

    fn text(file: &InstallFile) -> &str {
        match &file.content {
            FileContent::Text(text) => text,
            FileContent::Program(_) => "",
        }
    }

    #[test]
    fn serial_numbers_are_read_from_names() {
        let of = |name: &str| serial_of(&Path::new("/dev/serial/by-id").join(name));
        assert_eq!(of("usb-FTDI_USB__-__Serial_Converter_FT4TFKX0-if00-port0").as_deref(), Some("FT4TFKX0"));
        assert_eq!(of("usb-ROBOTIS_U2D2_FT-9\"x-if00-port0"), None);
        assert_eq!(of("ttyUSB0"), None);
    }

    /// The program run at shutdown is a copy that only root can change, under a user of its own; no path of a user is
    /// in the unit.
    #[test]
    fn the_service_runs_no_program_that_a_user_can_change() {
        let root = tempfile::tempdir().expect("a folder");
        let files = files(&setup(root.path()));
        assert!(
            text(&files[0]).contains("ATTRS{serial}==\"FT4TFKX0\", SYMLINK+=\"ftac-servos\""),
            "{}",
            text(&files[0])
        );
        let unit = text(&files[5]);
        assert!(unit.contains("ExecStop=-/usr/local/lib/ftac/ftac bridge stop\n"), "{unit}");
        assert!(unit.contains("DynamicUser=yes\nSupplementaryGroups=dialout\n"), "{unit}");
        assert!(!unit.contains(&root.path().display().to_string()) && !unit.contains("--config"), "{unit}");
        write(root.path(), &files).expect("written");
        let copy = root.path().join(PROGRAM_PATH);
        assert_eq!(std::fs::read(&copy).expect("copied"), b"the program");
        assert_eq!(std::fs::metadata(&copy).expect("there").permissions().mode() & 0o777, 0o755);
    }

    /// Writing twice is like writing once. A foreign file stops everything before anything is written, and is never
    /// removed.
    #[test]
    fn others_files_are_left_alone() {
        let root = tempfile::tempdir().expect("a folder");
        let files = files(&setup(root.path()));
        assert!(
            files
                .iter()
                .all(|file| matches!(file.content, FileContent::Program(_)) || text(file).starts_with(FILE_MARK))
        );
        write(root.path(), &files).expect("written");
        write(root.path(), &files).expect("written again");
        assert_eq!(remove(root.path(), &files).expect("removed").len(), files.len());
        assert!(!root.path().join("usr/local/lib/ftac").exists());
        assert!(remove(root.path(), &files).expect("nothing there").is_empty());
        for foreign in [5, 4] {
            let path = root.path().join(files[foreign].path);
            std::fs::create_dir_all(path.parent().expect("a folder")).expect("made");
            std::fs::write(&path, "[Unit]\n").expect("written");
            let error = write(root.path(), &files).expect_err("a foreign file").to_string();
            assert!(error.contains(files[foreign].path) && error.contains("found a foreign file"), "{error}");
            assert!(!root.path().join(files[0].path).exists());
            assert!(remove(root.path(), &files).is_err() && path.exists());
            std::fs::remove_file(&path).expect("removed");
        }
    }
}
