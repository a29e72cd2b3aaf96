//! Writing a file whole or not at all.

use std::fs::Permissions;
use std::io::{self, Write as _};
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;

use tempfile::Builder;

/// Writes `bytes` to `path` so that a reader sees either all of them or what was there before, even if the process is killed.
///
/// The bytes go to a temporary file in the same folder, which is synced and then renamed. The folder must exist. A symbolic
/// link stays a link: the file it points to is replaced. Anything that is not a regular file (`/dev/stdout`, a pipe) cannot
/// be replaced and is written to directly. A new file has the permissions 0644.
pub fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let target = path.canonicalize();
    let path = target.as_deref().unwrap_or(path);
    if path.metadata().is_ok_and(|found| !found.is_file()) {
        return std::fs::write(path, bytes);
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    // Temporary files are private unless told otherwise.
    let mut file = Builder::new().permissions(Permissions::from_mode(0o644)).tempfile_in(folder)?;
    file.write_all(bytes)?;
    file.as_file().sync_all()?;
    file.persist(path)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn a_new_file_is_readable_by_everyone_and_alone_in_its_folder() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("new.json");
        write_whole(&path, b"all of it").expect("written");
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
        write_whole(&path, b"after").expect("written");
        assert_eq!(io::read_to_string(&mut open).expect("readable"), "before, and longer");
        assert_eq!(fs::read(&path).expect("readable"), b"after");
    }

    #[test]
    fn a_link_stays_a_link() {
        let folder = tempfile::tempdir().expect("a folder");
        let (file, link) = (folder.path().join("file"), folder.path().join("link"));
        fs::write(&file, "before").expect("written");
        std::os::unix::fs::symlink(&file, &link).expect("linked");
        write_whole(&link, b"after").expect("written");
        assert!(fs::symlink_metadata(&link).expect("metadata").is_symlink());
        assert_eq!(fs::read(&file).expect("readable"), b"after");
    }

    #[test]
    fn a_missing_folder_is_an_error_and_a_failed_write_leaves_nothing() {
        let folder = tempfile::tempdir().expect("a folder");
        let missing = write_whole(&folder.path().join("missing/file"), b"x").expect_err("no such folder");
        assert_eq!(missing.kind(), io::ErrorKind::NotFound);
        write_whole(folder.path(), b"x").expect_err("a folder is not a file");
        assert_eq!(fs::read_dir(folder.path()).expect("listed").count(), 0);
    }
}
