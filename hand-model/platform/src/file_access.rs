//! Access control for files that a text names.
//!
//! A scenario or a sweep may come from a stranger. The files that it names are read with the rights of whoever runs it,
//! and their content may appear in an error or be kept in a result. Hence the text must not choose them freely.

use std::path::{Component, Path, PathBuf};

use crate::data::DataError;

/// The files that a text may name.
///
/// ```
/// use std::path::Path;
///
/// use ftac_platform::file_access::FileAccess;
///
/// let folder = tempfile::tempdir()?;
/// let scenario = folder.path().join("scenario.toml");
/// let access = FileAccess::in_folder_of(&scenario);
/// assert!(access.resolve(&scenario, "objects[0]", Path::new("mug.obj")).is_ok());
/// let error = access.resolve(&scenario, "objects[0]", Path::new("/etc/shadow")).expect_err("outside of the folder");
/// assert!(error.to_string().contains("objects[0]: found \"/etc/shadow\", expected a file below "));
/// # Ok::<(), std::io::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileAccess<'a> {
    /// No file: the text is self-contained, as in sessions and results.
    Nothing,
    /// Files below a folder, symbolic links resolved.
    Below(&'a Path),
    /// Any file: the user has allowed it.
    Anywhere,
}

/// Start of the text by which an error names the permitted folder.
pub const PERMITTED_FOLDER_PREFIX: &str = "a file below ";

impl<'a> FileAccess<'a> {
    /// Permits files below the folder of `file`.
    pub fn in_folder_of(file: &'a Path) -> Self {
        Self::Below(folder_of(file))
    }

    /// Resolves `name`, which `field` of the text in `file` gives relative to `file`, to a path.
    ///
    /// # Errors
    /// [`DataError::Field`] for a name out of reach. The error does not reveal what is there.
    pub fn resolve(self, file: &Path, field: &str, name: &Path) -> Result<PathBuf, DataError> {
        let named = folder_of(file).join(name);
        let refused = |expected: String| {
            Err(DataError::field(file, field, format!("{:?}", name.display().to_string()), expected))
        };
        match self {
            Self::Anywhere => Ok(named),
            Self::Nothing => refused("no file: this text must have everything in it".to_owned()),
            Self::Below(root) => {
                // Check the name first: an error must not reveal anything about files elsewhere, not even that they
                // exist.
                let inside = normalized(&named)
                    .is_some_and(|named| normalized(root).is_some_and(|root| named.starts_with(root)));
                let inside = inside
                    && match (named.canonicalize(), root.canonicalize()) {
                        (Ok(named), Ok(root)) => named.starts_with(root),
                        // A missing file is reported by whoever reads it.
                        _ => !named.is_symlink(),
                    };
                if inside {
                    return Ok(named);
                }
                refused(format!("{PERMITTED_FOLDER_PREFIX}{}", or_current_folder(root).display()))
            }
        }
    }
}

/// Refuses a folder of results in which a file is a symbolic link to one elsewhere: a write would replace the linked
/// file.
///
/// # Errors
/// [`DataError::Field`] with the link's name; [`DataError::Io`] for a folder that cannot be read.
pub fn check_links(folder: &Path) -> Result<(), DataError> {
    let io = |source| DataError::Io { path: folder.into(), source };
    let root = folder.canonicalize().map_err(io)?;
    for entry in folder.read_dir().map_err(io)? {
        let path = entry.map_err(io)?.path();
        let target = path.canonicalize().ok().filter(|target| path.is_symlink() && target.is_file());
        if let Some(target) = target.filter(|target| !target.starts_with(&root)) {
            let found = format!("a symbolic link to {}", target.display());
            return Err(DataError::field(&path, "kind of file", found, "a file in this folder"));
        }
    }
    Ok(())
}

/// Returns the folder of a file: `.`, the current one, for a name alone.
pub fn folder_of(file: &Path) -> &Path {
    or_current_folder(file.parent().unwrap_or(Path::new("")))
}

/// Replaces the empty path by `.`, the current folder.
fn or_current_folder(folder: &Path) -> &Path {
    if folder.as_os_str().is_empty() { Path::new(".") } else { folder }
}

/// Returns the absolute path without `.` and `..`, resolved by name only.
fn normalized(path: &Path) -> Option<PathBuf> {
    let mut parts = PathBuf::new();
    for part in std::path::absolute(path).ok()?.components() {
        match part {
            Component::ParentDir => drop(parts.pop()),
            Component::CurDir => {}
            part => parts.push(part),
        }
    }
    Some(parts)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_not_written_through_links() {
        let folder = tempfile::tempdir().expect("a folder");
        let (results, theirs) = (folder.path().join("results"), folder.path().join("profile"));
        std::fs::create_dir(&results).expect("made");
        std::fs::write(&theirs, "mine").expect("written");
        std::fs::write(results.join("a.csv"), "").expect("written");
        std::os::unix::fs::symlink("a.csv", results.join("b.csv")).expect("linked");
        check_links(&results).expect("a link within");
        std::os::unix::fs::symlink(&theirs, results.join("trials.csv")).expect("linked");
        let words = check_links(&results).expect_err("a link out").to_string();
        assert!(
            words.contains("trials.csv: kind of file: found a symbolic link to ") && words.contains("profile"),
            "{words}"
        );
    }

    #[test]
    fn a_text_reads_no_file_outside_its_folder() {
        let folder = tempfile::tempdir().expect("a folder");
        let (inner, outer) = (folder.path().join("inner"), folder.path().join("secret.toml"));
        std::fs::create_dir_all(inner.join("things")).expect("made");
        std::fs::write(inner.join("things/mug.toml"), "").expect("written");
        std::fs::write(&outer, "").expect("written");
        std::os::unix::fs::symlink(&outer, inner.join("things/link.toml")).expect("linked");
        std::os::unix::fs::symlink(folder.path(), inner.join("up")).expect("linked");
        let file = inner.join("scenario.toml");
        let reach = FileAccess::in_folder_of(&file);
        let resolve = |name: &str| reach.resolve(&file, "objects[0]", Path::new(name));
        for good in
            ["things/mug.toml", "./things/../things/mug.toml", inner.join("things/mug.toml").to_str().expect("text")]
        {
            assert!(resolve(good).expect("in reach").ends_with("mug.toml"));
        }
        assert_eq!(resolve("things/absent.toml").expect("in reach"), inner.join("things/absent.toml"));
        let elsewhere = outer.to_str().expect("text");
        for bad in [
            "/etc/shadow",
            "/nowhere/at/all",
            "../secret.toml",
            "things/../../secret.toml",
            elsewhere,
            "things/link.toml",
            "up/secret.toml",
        ] {
            let words = resolve(bad).expect_err("out of reach").to_string();
            assert!(words.contains("objects[0]: found ") && words.contains("expected a file below "), "{words}");
            assert_eq!(
                FileAccess::Anywhere.resolve(&file, "objects[0]", Path::new(bad)).expect("any"),
                inner.join(bad)
            );
        }
        let words = FileAccess::Nothing
            .resolve(&file, "objects[0]", Path::new("things/mug.toml"))
            .expect_err("none")
            .to_string();
        assert!(words.contains("found \"things/mug.toml\", expected no file"), "{words}");
        // Relative to the current folder.
        assert!(
            FileAccess::in_folder_of(Path::new("scenario.toml"))
                .resolve(Path::new("scenario.toml"), "a", Path::new("Cargo.toml"))
                .is_ok()
        );
    }
}
