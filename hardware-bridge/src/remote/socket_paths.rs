//! Location of the stop sockets, which any terminal finds without a configuration.
//!
//! On a computer that `ftac bridge install` has set up, they are in [`OPERATORS_FOLDER`], open to the group of the
//! operators. Elsewhere they are in a folder of the user who runs the robot, open only to that user and to root. A
//! socket is called `NAME-KEY.PROCESS.stop`. The key is a hash of the path of the robot's configuration, so that
//! `--config FILE` finds its robot even if the file has changed since.

use std::fs::{DirBuilder, Metadata};
use std::io;
use std::os::unix::fs::{DirBuilderExt as _, FileTypeExt as _, MetadataExt as _};
use std::path::{Path, PathBuf};

use crc::{CRC_32_ISCSI, Crc};

/// The operators' folder, created at boot (`tmpfiles.d`): `root:dialout`, mode 3770.
pub const OPERATORS_FOLDER: &str = "/run/ftac";
/// Suffix of the names of stop sockets.
const SOCKET_SUFFIX: &str = ".stop";
/// Maximum length of the readable part of a socket's name, characters: the path of a socket is limited to 107 bytes.
const MAX_STEM_LENGTH: usize = 20;

/// A folder for the stop sockets of this process.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SocketFolder {
    pub path: PathBuf,
    /// Group that may also stop robots, if this is the operators' folder.
    pub group: Option<u32>,
    /// Reason why this is not the operators' folder, if it is not.
    pub fallback_reason: Option<String>,
}

/// Returns the user id of this process.
pub fn user_id() -> io::Result<u32> {
    Ok(std::fs::metadata("/proc/self")?.uid())
}

/// Returns the folder for this process's stop socket, and creates it if it is the user's own.
///
/// # Errors
/// The user's own folder cannot be created, or belongs to another user.
pub fn folder() -> io::Result<SocketFolder> {
    folder_at(Path::new(OPERATORS_FOLDER), &user_folder(user_id()?))
}

fn folder_at(shared: &Path, own: &Path) -> io::Result<SocketFolder> {
    let why_own = match std::fs::metadata(shared) {
        Err(error) => format!("{}: {error}; `ftac bridge install` makes it", shared.display()),
        Ok(found) if found.mode() & 0o002 != 0 => format!("{}: writable by every user", shared.display()),
        Ok(found) => match check_writable(shared) {
            Ok(()) => {
                return Ok(SocketFolder { path: shared.to_owned(), group: Some(found.gid()), fallback_reason: None });
            }
            Err(error) => {
                format!("{}: {error}; is this user in its group, and logged in since?", shared.display())
            }
        },
    };
    let failed = |text: String| io::Error::other(format!("{}: {text}", own.display()));
    let user = user_id()?;
    match DirBuilder::new().mode(0o700).create(own) {
        Err(error) if error.kind() != io::ErrorKind::AlreadyExists => return Err(failed(error.to_string())),
        _ => {}
    }
    // In a folder that every user may write, another user may have created it first.
    let found = std::fs::symlink_metadata(own)?;
    if !is_private(&found, user) {
        let (owner, mode) = (found.uid(), found.mode() & 0o7777);
        return Err(failed(format!(
            "found owner {owner} and mode {mode:o}, expected a folder of user {user} with mode 700"
        )));
    }
    Ok(SocketFolder { path: own.to_owned(), group: None, fallback_reason: Some(why_own) })
}

fn is_private(found: &Metadata, user: u32) -> bool {
    found.is_dir() && found.uid() == user && found.mode() & 0o077 == 0
}

/// Checks that something can be created in a folder.
fn check_writable(folder: &Path) -> io::Result<()> {
    let probe = folder.join(format!(".{}", std::process::id()));
    DirBuilder::new().mode(0o700).create(&probe)?;
    std::fs::remove_dir(&probe)
}

/// Returns a user's own folder: below that of the login session, whether or not the environment names it.
fn user_folder(user: u32) -> PathBuf {
    let session = PathBuf::from(format!("/run/user/{user}"));
    match std::fs::metadata(&session) {
        Ok(found) if found.uid() == user => session.join("ftac"),
        _ => temporary_folder(user),
    }
}

/// Returns a user's folder below `/tmp`, not below `TMPDIR`, which may differ from one terminal to the next.
fn temporary_folder(user: u32) -> PathBuf {
    PathBuf::from(format!("/tmp/ftac-{user}"))
}

/// Returns the name of the socket of the robot with this configuration, without process and suffix.
pub fn stem(config: &Path) -> String {
    let whole = match (config.parent().map(Path::canonicalize), config.file_name()) {
        (Some(Ok(folder)), Some(file)) => folder.join(file),
        _ => std::path::absolute(config).unwrap_or_else(|_| config.to_owned()),
    };
    let key = Crc::<u32>::new(&CRC_32_ISCSI).checksum(whole.as_os_str().as_encoded_bytes());
    let folder = whole.parent().and_then(Path::file_name).unwrap_or_default().to_string_lossy().into_owned();
    let name: String = folder.chars().filter(|c| c.is_ascii_alphanumeric()).take(MAX_STEM_LENGTH).collect();
    format!("{name}-{key:08x}")
}

/// Returns the path of this process's stop socket in `folder`.
pub fn socket_path(folder: &Path, config: &Path) -> PathBuf {
    folder.join(format!("{}.{}{SOCKET_SUFFIX}", stem(config), std::process::id()))
}

/// Finds the stop sockets on this computer that this user can see. Also returns the folders searched: those of all
/// users, as far as they may be read.
pub fn find_sockets() -> (Vec<PathBuf>, Vec<PathBuf>) {
    let own = user_id().map(user_folder);
    let mut folders = vec![PathBuf::from(OPERATORS_FOLDER)];
    folders.extend(own);
    let children = |folder: &Path| -> Vec<PathBuf> {
        std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()).collect()
    };
    folders.extend(children(Path::new("/run/user")).into_iter().map(|session| session.join("ftac")));
    // Only folders of the user in their name count: every user may create folders there.
    let own =
        |path: &PathBuf| std::fs::symlink_metadata(path).is_ok_and(|found| *path == temporary_folder(found.uid()));
    folders.extend(children(Path::new("/tmp")).into_iter().filter(own));
    folders.sort();
    folders.dedup();
    folders.retain(|folder| folder.is_dir());
    (folders.iter().flat_map(|folder| sockets_in(folder)).collect(), folders)
}

/// Lists the stop sockets in a folder, sorted.
pub fn sockets_in(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let is_one = |entry: &std::fs::DirEntry| {
        entry.file_type().is_ok_and(|kind| kind.is_socket())
            && entry.file_name().to_string_lossy().ends_with(SOCKET_SUFFIX)
    };
    let mut sockets: Vec<PathBuf> = entries.filter(is_one).map(|entry| entry.path()).collect();
    sockets.sort();
    sockets
}

/// True if a socket is that of the robot with this configuration.
pub fn belongs_to_robot(socket: &Path, config: &Path) -> bool {
    let name = socket.file_name().unwrap_or_default().to_string_lossy().into_owned();
    name.strip_prefix(&stem(config)).is_some_and(|rest| rest.starts_with('.'))
}

/// Removes stale sockets of this user's robots in `folder`, which no process serves any more.
pub fn remove_stale_sockets(folder: &Path) {
    for socket in sockets_in(folder) {
        let refused = std::os::unix::net::UnixStream::connect(&socket).map_err(|error| error.kind());
        if refused.err() == Some(io::ErrorKind::ConnectionRefused) {
            // A socket of another user cannot be removed, and does no harm.
            let _ = std::fs::remove_file(&socket);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::Permissions;
    use std::os::unix::fs::PermissionsExt as _;

    /// The operators' folder is used if possible, otherwise the user's own, with the reason. A folder that another user
    /// could have created is refused.
    #[test]
    fn the_folder_is_the_operators_or_ones_own() {
        let root = tempfile::tempdir().expect("a folder");
        let (shared, own) = (root.path().join("shared"), root.path().join("own"));
        let found = folder_at(&shared, &own).expect("its own");
        assert_eq!((&found.path, found.group), (&own, None));
        assert!(found.fallback_reason.expect("said").contains("`ftac bridge install` makes it"));
        assert_eq!(std::fs::metadata(&own).expect("made").mode() & 0o777, 0o700);
        std::fs::create_dir(&shared).expect("made");
        std::fs::set_permissions(&shared, Permissions::from_mode(0o3770)).expect("set");
        let found = folder_at(&shared, &own).expect("the operators'");
        assert_eq!((&found.path, found.group.is_some(), found.fallback_reason), (&shared, true, None));
        std::fs::set_permissions(&shared, Permissions::from_mode(0o777)).expect("set");
        assert_eq!(folder_at(&shared, &own).expect("its own").path, own, "not a folder that every user may write");
        std::fs::set_permissions(&own, Permissions::from_mode(0o755)).expect("set");
        let error = folder_at(&shared, &own).expect_err("open to others").to_string();
        assert!(error.contains("mode 755") && error.contains("mode 700"), "{error}");
    }

    /// A configuration identifies its robot's socket by its path, regardless of its content, even if it does not exist.
    #[test]
    fn a_robot_is_found_by_the_path_of_its_configuration() {
        let root = tempfile::tempdir().expect("a folder");
        let config = root.path().join("bridge.toml");
        let one = socket_path(root.path(), &config);
        assert!(belongs_to_robot(&one, &config) && belongs_to_robot(&one, &root.path().join(".").join("bridge.toml")));
        assert!(!belongs_to_robot(&one, &root.path().join("other.toml")) && one.to_string_lossy().ends_with(".stop"));
        let listener = std::os::unix::net::UnixListener::bind(&one).expect("bound");
        remove_stale_sockets(root.path());
        assert_eq!(sockets_in(root.path()), [one], "somebody listens");
        drop(listener);
        remove_stale_sockets(root.path());
        assert!(sockets_in(root.path()).is_empty());
    }
}
