//! Listing of the sessions of a folder.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};

/// File name ending of ROS 2 bags exported from sessions.
pub const BAG_SUFFIX: &str = ".ros2.mcap";

/// Lists the sessions (MCAP) of `folder`, sorted by path, without bags exported from them.
pub fn sessions_in(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).with_context(|| folder.display().to_string())? {
        let path = entry.with_context(|| folder.display().to_string())?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if name.ends_with(".mcap") && !name.ends_with(BAG_SUFFIX) {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bags_are_no_sessions() {
        let folder = tempfile::tempdir().expect("a folder");
        for name in ["b.mcap", "a.mcap", "a.ros2.mcap", "a.rrd"] {
            std::fs::write(folder.path().join(name), "").expect("written");
        }
        let found = sessions_in(folder.path()).expect("listed");
        assert_eq!(found, ["a.mcap", "b.mcap"].map(|name| folder.path().join(name)));
    }
}
