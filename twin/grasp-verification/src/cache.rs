//! Cache for the results of long searches, a folder with one file per result. The key of a result holds everything that
//! goes into its search, so that a changed mesh, hand or rule finds nothing and is searched anew. For a search under
//! way, its finished steps are kept ([`SearchSteps`]), so that an interrupted search resumes where it stopped.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use anyhow::{Context, Result};
use ftac_platform::digest::hexadecimal;
use serde::Serialize;
use serde::de::DeserializeOwned;
use sha2::{Digest as _, Sha256};

/// Cache folder with one JSON file per result.
#[derive(Debug, Clone)]
pub struct ResultCache {
    folder: PathBuf,
}

/// Key of a result: a digest of all its inputs.
#[derive(Debug, Clone)]
pub struct CacheKey {
    /// Readable name of the result in the folder.
    label: String,
    digest: Sha256,
}

impl CacheKey {
    /// Creates the key of a result called `label`: small letters, digits, `_` and `-`.
    pub fn new(label: String) -> Self {
        let digest = Sha256::new_with_prefix(label.as_bytes());
        Self { label, digest }
    }

    /// Adds one more input of the result.
    pub fn with_part(mut self, part: &impl Serialize) -> Result<Self> {
        let bytes = serde_json::to_vec(part)?;
        self.digest.update(bytes.len().to_le_bytes());
        self.digest.update(&bytes);
        Ok(self)
    }

    /// Returns the file name: the label and the first 64 bits of the SHA-256 of all parts.
    pub(crate) fn file_name(&self) -> String {
        let digest = self.digest.clone().finalize();
        format!("{}-{}.json", self.label, hexadecimal(&digest[..8]))
    }
}

impl ResultCache {
    /// Opens the user's cache folder: `$XDG_CACHE_HOME/ftac`, or `~/.cache/ftac`.
    pub fn user_cache() -> Result<Self> {
        let set = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
        let base = set("XDG_CACHE_HOME").or_else(|| set("HOME").map(|home| home.join(".cache")));
        Ok(Self::in_folder(
            base.context("neither XDG_CACHE_HOME nor HOME is set: there is no folder to keep searches in")?
                .join("ftac"),
        ))
    }

    /// Opens a folder as a cache. It is created when something is kept.
    pub fn in_folder(folder: PathBuf) -> Self {
        Self { folder }
    }

    /// Returns the folder of the results.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Returns the result kept under `key`. A file that cannot be read is reported on stderr and counts as none.
    pub fn get<T: DeserializeOwned>(&self, key: &CacheKey) -> Option<T> {
        let path = self.folder.join(key.file_name());
        let text = std::fs::read_to_string(&path).ok()?;
        serde_json::from_str(&text).map_err(|error| eprintln!("{}: {error}; searched anew", path.display())).ok()
    }

    /// True if a result is kept under `key`.
    pub fn has(&self, key: &CacheKey) -> bool {
        self.folder.join(key.file_name()).is_file()
    }

    /// Keeps `result`. The file is written whole or not at all.
    pub fn put(&self, key: &CacheKey, result: &impl Serialize) -> Result<()> {
        std::fs::create_dir_all(&self.folder).with_context(|| self.folder.display().to_string())?;
        let path = self.folder.join(key.file_name());
        let text = serde_json::to_vec(result)?;
        ftac_platform::file::write_atomically(&path, &text).with_context(|| path.display().to_string())
    }

    /// Returns the result kept under `key`, or runs `search` and keeps its result. A search that was interrupted gets
    /// its finished steps. A result that cannot be kept is reported on stderr.
    pub fn get_or<T, S>(&self, key: &CacheKey, search: impl FnOnce(&SearchSteps<S>) -> Result<T>) -> Result<T>
    where
        T: Serialize + DeserializeOwned,
        S: Serialize + DeserializeOwned,
    {
        if let Some(kept) = self.get(key) {
            return Ok(kept);
        }
        let steps = SearchSteps::open(self.folder.join(key.file_name()).with_extension("steps.jsonl"));
        let found = search(&steps)?;
        match self.put(key, &found) {
            Ok(()) => steps.remove(),
            Err(error) => eprintln!("{error:#}: not kept, the next run searches again"),
        }
        Ok(found)
    }
}

/// Finished steps of a search under way, by name, as a growing file with one line of JSON per step. A line cut off by a
/// kill counts as none.
#[derive(Debug)]
pub struct SearchSteps<S> {
    path: Option<PathBuf>,
    known: BTreeMap<String, S>,
    file: Mutex<Option<File>>,
}

impl<S: Serialize + DeserializeOwned> SearchSteps<S> {
    /// Creates the steps of a search that are not kept on disk.
    pub fn in_memory() -> Self {
        Self { path: None, known: BTreeMap::new(), file: Mutex::new(None) }
    }

    fn open(path: PathBuf) -> Self {
        let text = std::fs::read_to_string(&path).unwrap_or_default();
        let known = text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect::<Vec<(String, S)>>();
        let open = || {
            std::fs::create_dir_all(path.parent().unwrap_or(Path::new("")))?;
            let mut file = OpenOptions::new().create(true).append(true).open(&path)?;
            if !text.is_empty() && !text.ends_with('\n') {
                file.write_all(b"\n")?;
            }
            Ok::<_, std::io::Error>(file)
        };
        let file = open()
            .map_err(|error| eprintln!("{}: {error}: an interruption would lose this search", path.display()))
            .ok();
        Self { path: Some(path), known: known.into_iter().collect(), file: Mutex::new(file) }
    }

    /// Returns the result that was kept of a step.
    pub fn known(&self, step: &str) -> Option<&S> {
        self.known.get(step)
    }

    /// Returns the names of the steps that were kept.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.known.keys().map(String::as_str)
    }

    /// Keeps the result of a step. If the file cannot be written, this is reported on stderr.
    pub fn keep(&self, step: &str, result: &S) -> Result<()> {
        let mut line = serde_json::to_vec(&(step, result))?;
        line.push(b'\n');
        if let Ok(mut file) = self.file.lock()
            && let Some(open) = file.as_mut()
            && let Err(error) = open.write_all(&line)
        {
            eprintln!("{error}: an interruption would lose what is searched from now on");
            *file = None;
        }
        Ok(())
    }

    /// Removes the file once the search is done.
    fn remove(self) {
        // A file that stays behind is never looked up.
        self.path.into_iter().for_each(|path| drop(std::fs::remove_file(path)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A result is found again under the same parts and under no others. A damaged file is searched anew.
    #[test]
    fn results_are_found_by_what_they_were_made_from() {
        let folder = tempfile::tempdir().expect("a folder");
        let cache = ResultCache::in_folder(folder.path().join("cache"));
        let key = |mass: f64| CacheKey::new("mug".into()).with_part(&("mug", mass)).expect("a key");
        assert_eq!(cache.get::<u32>(&key(0.3)), None);
        let search =
            |mass: f64, found: u32| cache.get_or(&key(mass), |_: &SearchSteps<u32>| Ok(found)).expect("searched");
        assert_eq!(search(0.3, 7), 7);
        assert_eq!(search(0.3, 9), 7);
        assert_eq!(cache.get::<u32>(&key(0.31)), None);
        let file = cache.folder().join(key(0.3).file_name());
        std::fs::write(file, "{").expect("written");
        assert_eq!(search(0.3, 8), 8);
    }

    /// A search that was killed in the middle of a line resumes from its finished steps. None of them is left once it
    /// is done.
    #[test]
    fn an_interrupted_search_goes_on() {
        let folder = tempfile::tempdir().expect("a folder");
        let cache = ResultCache::in_folder(folder.path().to_owned());
        let key = CacheKey::new("mug".into());
        let killed = cache.get_or(&key, |steps: &SearchSteps<u32>| -> Result<u32> {
            steps.keep("first", &1)?;
            steps.keep("second", &2)?;
            anyhow::bail!("killed")
        });
        assert!(killed.is_err());
        let file = std::fs::read_dir(folder.path()).expect("a folder").next().expect("a file").expect("a file").path();
        let text = std::fs::read_to_string(&file).expect("steps");
        std::fs::write(&file, &text[..text.len() - 3]).expect("written");
        let found = cache.get_or(&key, |steps: &SearchSteps<u32>| {
            assert_eq!((steps.known("first"), steps.known("second")), (Some(&1), None));
            assert_eq!(steps.names().collect::<Vec<_>>(), ["first"]);
            steps.keep("second", &5)?;
            Ok(6u32)
        });
        assert_eq!(found.expect("found"), 6);
        assert!(!file.exists() && cache.get::<u32>(&key) == Some(6));
    }

    /// The boundary between two parts is part of the key.
    #[test]
    fn parts_are_told_apart() {
        let key =
            |parts: [&str; 2]| CacheKey::new("k".into()).with_part(&parts[0]).and_then(|key| key.with_part(&parts[1]));
        let name = |parts: [&str; 2]| key(parts).expect("a key").file_name();
        assert_ne!(name(["ab", "c"]), name(["a", "bc"]));
    }
}
