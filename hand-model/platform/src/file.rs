//! Atomic writes of files, and bounded reads that are sure to end.

use std::fs::{File, FileType, Permissions};
use std::io::{self, Read as _, Write as _};
use std::os::unix::fs::{FileTypeExt as _, PermissionsExt as _};
use std::path::Path;

use tempfile::Builder;

use crate::file_access::folder_of;

/// Writes `bytes` to `path` atomically: a reader sees either all of them or the previous content, even if the process
/// is killed.
///
/// The bytes go to a temporary file in the same folder, which is synced and then renamed. The folder must exist. A
/// symbolic link stays a link: the file it points to is replaced. Anything that is not a regular file (`/dev/stdout`, a
/// pipe) cannot be replaced and is written to directly. A new file has the permissions 0644.
///
/// # Errors
/// The operating system's error, which does not name the file. The previous content is then unchanged.
///
/// ```
/// use ftac_platform::file::{read_text, write_atomically};
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("result.json");
/// write_atomically(&path, b"{}")?;
/// assert_eq!(read_text(&path)?, "{}");
/// # Ok::<(), std::io::Error>(())
/// ```
pub fn write_atomically(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let target = path.canonicalize();
    let path = target.as_deref().unwrap_or(path);
    if path.metadata().is_ok_and(|found| !found.is_file()) {
        return std::fs::write(path, bytes);
    }
    let folder = folder_of(path);
    // Temporary files are private unless told otherwise.
    let mut file = Builder::new().permissions(Permissions::from_mode(0o644)).tempfile_in(folder)?;
    file.write_all(bytes)?;
    file.as_file().sync_all()?;
    file.persist(path)?;
    Ok(())
}

/// Size limit of a text that is read whole, bytes.
pub const MAX_TEXT_SIZE: u64 = 1 << 30;

/// Opens a regular file of at most `most` bytes. A pipe, a device or a folder is refused before it is opened, because
/// reading it might never end.
///
/// # Errors
/// The operating system's error, or [`io::ErrorKind::InvalidInput`] with what was found and expected. Neither names the
/// file.
pub fn open_regular(path: &Path, most: u64) -> io::Result<File> {
    let refused = |found: String, expected: String| {
        Err(io::Error::new(io::ErrorKind::InvalidInput, format!("found {found}, expected {expected}")))
    };
    let about = std::fs::metadata(path)?;
    if !about.is_file() {
        return refused(file_type_name(about.file_type()).to_owned(), "a regular file".to_owned());
    }
    if about.len() > most {
        return refused(format!("{} MB", about.len() >> 20), format!("at most {} MB", most >> 20));
    }
    File::open(path)
}

/// Reads a regular file of at most `most` bytes.
///
/// # Errors
/// Those of [`open_regular`].
pub fn read_regular(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    // The file may grow while it is read, and files of /proc report no size.
    open_regular(path, most)?.take(most).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Reads the text of a regular file of at most [`MAX_TEXT_SIZE`] bytes.
///
/// # Errors
/// Those of [`open_regular`], and one for a file that is not UTF-8.
pub fn read_text(path: &Path) -> io::Result<String> {
    String::from_utf8(read_regular(path, MAX_TEXT_SIZE)?).map_err(|error| {
        let place = error.utf8_error().valid_up_to() + 1;
        io::Error::new(io::ErrorKind::InvalidData, format!("found no UTF-8 from byte {place} on, expected text"))
    })
}

fn file_type_name(kind: FileType) -> &'static str {
    match kind {
        kind if kind.is_dir() => "a folder",
        kind if kind.is_fifo() => "a pipe",
        kind if kind.is_socket() => "a socket",
        kind if kind.is_char_device() || kind.is_block_device() => "a device",
        _ => "something else",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn a_new_file_is_readable_by_everyone_and_alone_in_its_folder() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("new.json");
        write_atomically(&path, b"all of it").expect("written");
        assert_eq!(fs::read(&path).expect("readable"), b"all of it");
        let mode = fs::metadata(&path).expect("metadata").permissions().mode();
        assert_eq!(mode & 0o044, 0o044, "{mode:o}");
        assert_eq!(fs::read_dir(folder.path()).expect("listed").count(), 1, "the temporary file is gone");
    }

    /// A reader that opened the file before the write still reads the old bytes: the file is replaced, not overwritten.
    #[test]
    fn an_existing_file_is_replaced_in_one_step() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("result.csv");
        fs::write(&path, "before, and longer").expect("written");
        let mut open = fs::File::open(&path).expect("open");
        write_atomically(&path, b"after").expect("written");
        assert_eq!(io::read_to_string(&mut open).expect("readable"), "before, and longer");
        assert_eq!(fs::read(&path).expect("readable"), b"after");
    }

    #[test]
    fn a_link_stays_a_link() {
        let folder = tempfile::tempdir().expect("a folder");
        let (file, link) = (folder.path().join("file"), folder.path().join("link"));
        fs::write(&file, "before").expect("written");
        std::os::unix::fs::symlink(&file, &link).expect("linked");
        write_atomically(&link, b"after").expect("written");
        assert!(fs::symlink_metadata(&link).expect("metadata").is_symlink());
        assert_eq!(fs::read(&file).expect("readable"), b"after");
    }

    #[test]
    fn a_missing_folder_is_an_error_and_a_failed_write_leaves_nothing() {
        let folder = tempfile::tempdir().expect("a folder");
        let missing = write_atomically(&folder.path().join("missing/file"), b"x").expect_err("no such folder");
        assert_eq!(missing.kind(), io::ErrorKind::NotFound);
        write_atomically(folder.path(), b"x").expect_err("a folder is not a file");
        assert_eq!(fs::read_dir(folder.path()).expect("listed").count(), 0);
    }

    #[test]
    fn a_pipe_or_a_device_is_refused_instead_of_hanging() {
        let folder = tempfile::tempdir().expect("a folder");
        let pipe = folder.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().expect("mkfifo runs").success());
        let words = |path: &Path| read_regular(path, MAX_TEXT_SIZE).expect_err("refused").to_string();
        assert_eq!(words(&pipe), "found a pipe, expected a regular file");
        assert_eq!(words(Path::new("/dev/zero")), "found a device, expected a regular file");
        assert_eq!(words(folder.path()), "found a folder, expected a regular file");
        let sparse = folder.path().join("sparse");
        fs::File::create(&sparse).and_then(|file| file.set_len(2 * MAX_TEXT_SIZE)).expect("made");
        assert_eq!(words(&sparse), "found 2048 MB, expected at most 1024 MB");
        fs::write(&sparse, b"text\xff").expect("written");
        let error = read_text(&sparse).expect_err("no text").to_string();
        assert_eq!(error, "found no UTF-8 from byte 5 on, expected text");
        fs::write(&sparse, "whole").expect("written");
        assert_eq!(read_regular(&sparse, MAX_TEXT_SIZE).expect("read"), b"whole");
    }
}
