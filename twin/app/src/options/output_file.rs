//! Files to write.

use std::path::Path;

use anyhow::{Result, bail};

/// Refuses a file to write that is one of the files to read: it would be gone before it is read, or right after.
pub fn check_other_file<'a>(option: &str, out: &Path, inputs: impl IntoIterator<Item = &'a Path>) -> Result<()> {
    if let Some(input) = inputs.into_iter().find(|input| is_same_place(input, out)) {
        bail!("{option}: found {}, which is read, expected another file", input.display());
    }
    Ok(())
}

/// True if two paths lead to one file or folder that is there.
pub fn is_same_place(one: &Path, other: &Path) -> bool {
    one.canonicalize().is_ok_and(|one| other.canonicalize().is_ok_and(|other| one == other))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_not_written_over_itself() {
        let folder = tempfile::tempdir().expect("a folder");
        let (input, link) = (folder.path().join("in"), folder.path().join("link"));
        std::fs::write(&input, "text").expect("written");
        std::os::unix::fs::symlink(&input, &link).expect("linked");
        for out in [&input, &link] {
            let error = check_other_file("--out", out, [input.as_path()]).expect_err("refused").to_string();
            assert!(error.starts_with("--out: found ") && error.ends_with("which is read, expected another file"));
        }
        check_other_file("--out", &folder.path().join("new"), [input.as_path()]).expect("another file");
    }
}
