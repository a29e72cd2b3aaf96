//! Results of long searches, kept in a folder by what they were made from: whatever goes into a search goes into its key, so that a
//! changed mesh, hand or rule finds nothing and is searched anew.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use hand_model::digest::hexadecimal;
use serde::Serialize;
use serde::de::DeserializeOwned;
use sha2::{Digest as _, Sha256};

/// A folder with one JSON file a result.
#[derive(Debug, Clone)]
pub struct Cache {
    folder: PathBuf,
}

/// What a result was made from.
#[derive(Debug, Clone)]
pub struct Key {
    /// For people who look into the folder.
    label: String,
    digest: Sha256,
}

impl Key {
    /// Of a result called `label`: small letters, digits, `_` and `-`.
    pub fn new(label: String) -> Self {
        let digest = Sha256::new_with_prefix(label.as_bytes());
        Self { label, digest }
    }

    /// With one more thing that goes into it.
    pub fn with(mut self, part: &impl Serialize) -> Result<Self> {
        let bytes = serde_json::to_vec(part)?;
        self.digest.update(bytes.len().to_le_bytes());
        self.digest.update(&bytes);
        Ok(self)
    }

    /// The label and the first 64 bits of the SHA-256 of all parts.
    pub(crate) fn file_name(&self) -> String {
        let digest = self.digest.clone().finalize();
        format!("{}-{}.json", self.label, hexadecimal(&digest[..8]))
    }
}

impl Cache {
    /// The user's cache folder: `$XDG_CACHE_HOME/ftac`, or `~/.cache/ftac`.
    pub fn standard() -> Result<Self> {
        let set = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
        let base = set("XDG_CACHE_HOME").or_else(|| set("HOME").map(|home| home.join(".cache")));
        Ok(Self::at(
            base.context("neither XDG_CACHE_HOME nor HOME is set: there is no folder to keep searches in")?
                .join("ftac"),
        ))
    }

    /// A folder, which is made when something is kept.
    pub fn at(folder: PathBuf) -> Self {
        Self { folder }
    }

    /// Where the results are.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// What was kept under `key`; a file that cannot be read is named on stderr, and counts as none.
    pub fn get<T: DeserializeOwned>(&self, key: &Key) -> Option<T> {
        let path = self.folder.join(key.file_name());
        let text = std::fs::read_to_string(&path).ok()?;
        serde_json::from_str(&text).map_err(|error| eprintln!("{}: {error}; searched anew", path.display())).ok()
    }

    /// Keeps `result`, whole or not at all.
    pub fn put(&self, key: &Key, result: &impl Serialize) -> Result<()> {
        std::fs::create_dir_all(&self.folder).with_context(|| self.folder.display().to_string())?;
        let path = self.folder.join(key.file_name());
        let text = serde_json::to_vec(result)?;
        hand_model::file::write_whole(&path, &text).with_context(|| path.display().to_string())
    }

    /// What was kept under `key`, or what `search` finds, which is then kept. Where it cannot be kept, a line on stderr says so.
    pub fn get_or<T: Serialize + DeserializeOwned>(&self, key: &Key, search: impl FnOnce() -> Result<T>) -> Result<T> {
        if let Some(kept) = self.get(key) {
            return Ok(kept);
        }
        let found = search()?;
        if let Err(error) = self.put(key, &found) {
            eprintln!("{error:#}: not kept, the next run searches again");
        }
        Ok(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What was kept is found under the same parts, and under no others; damage is searched anew.
    #[test]
    fn results_are_found_by_what_they_were_made_from() {
        let folder = tempfile::tempdir().expect("a folder");
        let cache = Cache::at(folder.path().join("cache"));
        let key = |mass: f64| Key::new("mug".into()).with(&("mug", mass)).expect("a key");
        assert_eq!(cache.get::<u32>(&key(0.3)), None);
        assert_eq!(cache.get_or(&key(0.3), || Ok(7u32)).expect("searched"), 7);
        assert_eq!(cache.get_or(&key(0.3), || anyhow::bail!("not asked for")).unwrap_or(0u32), 7);
        assert_eq!(cache.get::<u32>(&key(0.31)), None);
        let file = cache.folder().join(key(0.3).file_name());
        std::fs::write(file, "{").expect("written");
        assert_eq!(cache.get_or(&key(0.3), || Ok(8u32)).expect("searched"), 8);
    }

    /// Where two parts meet is part of the key.
    #[test]
    fn parts_are_told_apart() {
        let key = |parts: [&str; 2]| Key::new("k".into()).with(&parts[0]).and_then(|key| key.with(&parts[1]));
        let name = |parts: [&str; 2]| key(parts).expect("a key").file_name();
        assert_ne!(name(["ab", "c"]), name(["a", "bc"]));
    }
}
