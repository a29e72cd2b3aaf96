//! The user's policy of a run, and the processes that answer for it.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use anyhow::{Context as _, Result, bail};
use hand_model::digest::sha256;
use serde::{Deserialize, Serialize};

use super::host::{Guest, Host};
use super::process::Process;

/// What passes while a policy thinks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Pace {
    /// No simulated time: results repeat.
    #[default]
    Stand,
    /// As much simulated time as on the wall: results depend on the computer.
    Wall,
}

/// Where a policy comes from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Source {
    pub file: PathBuf,
    pub class: String,
    /// Of the file, SHA-256, hexadecimal: a run that goes on goes on with the same policy.
    pub sha256: String,
    #[serde(default)]
    pub pace: Pace,
}

impl Source {
    /// What `FILE.py:CLASS` names.
    pub fn parse(text: &str, pace: Pace) -> Result<Self> {
        let parts = text.rsplit_once(':').filter(|(file, class)| !file.is_empty() && !class.is_empty());
        let Some((file, class)) = parts else {
            bail!("--policy: found `{text}`, expected FILE.py:CLASS, such as my_policy.py:MyPolicy");
        };
        let file = PathBuf::from(file);
        Ok(Self { sha256: digest(&file)?, file, class: class.to_owned(), pace })
    }

    /// Whether the file is still what it was.
    pub fn check(&self) -> Result<()> {
        let found = digest(&self.file)?;
        if found != self.sha256 {
            bail!(
                "--policy {}: found a file of SHA-256 {found}, expected {}, with which the run began",
                self.file.display(),
                self.sha256
            );
        }
        Ok(())
    }
}

fn digest(file: &Path) -> Result<String> {
    let bytes = std::fs::read(file).with_context(|| format!("--policy: cannot read {}", file.display()))?;
    Ok(sha256(&bytes))
}

/// The user's policy, and its processes that wait: one for every thread that plays.
pub struct Own {
    pub source: Source,
    pub guest: Guest,
    waiting: Mutex<Vec<Process>>,
}

impl Own {
    /// Starts a first process: a policy that cannot be asked is found before anything is played.
    pub fn start(source: Source) -> Result<Self> {
        let (process, guest) = Process::start(&source)?;
        Ok(Self { source, guest, waiting: Mutex::new(vec![process]) })
    }

    /// Plays with a process that nobody else asks. One that failed is not asked again.
    pub fn with<T>(&self, play: impl FnOnce(&mut dyn Host) -> Result<T>) -> Result<T> {
        let waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut process = match waiting {
            Some(process) => process,
            None => Process::start(&self.source)?.0,
        };
        let played = play(&mut process);
        if process.is_well() {
            self.waiting.lock().unwrap_or_else(PoisonError::into_inner).push(process);
        }
        played
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_policy_is_named_by_file_and_class_and_stays_what_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a:b.py");
        std::fs::write(&file, "class Mine: ...").unwrap();
        let source = Source::parse(&format!("{}:Mine", file.display()), Pace::Stand).unwrap();
        assert_eq!((source.file.as_path(), source.class.as_str()), (file.as_path(), "Mine"));
        source.check().unwrap();
        std::fs::write(&file, "class Mine: pass").unwrap();
        let words = source.check().unwrap_err().to_string();
        assert!(words.contains("with which the run began") && words.contains(&source.sha256), "{words}");
        for text in ["", "mine.py", ":Mine", "mine.py:"] {
            let words = Source::parse(text, Pace::Stand).unwrap_err().to_string();
            assert!(words.contains(&format!("found `{text}`, expected FILE.py:CLASS")), "{words}");
        }
        let words = format!("{:#}", Source::parse("/no/where.py:Mine", Pace::Stand).unwrap_err());
        assert!(words.contains("cannot read /no/where.py"), "{words}");
    }
}
