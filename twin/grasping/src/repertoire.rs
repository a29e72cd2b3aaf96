//! Repertoires: for each object its grasps, ranked, with the seed and the command that made them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use hand_model::file::write_whole;
use serde::{Deserialize, Serialize};

use crate::grasp::{Grasp, Role};

/// What can be wrong with a repertoire file.
#[derive(Debug, thiserror::Error)]
pub enum RepertoireError {
    /// Not readable or writable.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// Not a repertoire.
    #[error("{path}: {message}")]
    Syntax {
        /// The file.
        path: PathBuf,
        /// The parser's message, with line and column.
        message: String,
    },
    /// Made by another version.
    #[error("{path}: version: found {found}, expected {VERSION}")]
    Version {
        /// The file.
        path: PathBuf,
        /// What the file says.
        found: u32,
    },
}

/// Version of the file format.
pub const VERSION: u32 = 1;

/// All objects' grasps.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Repertoire {
    /// Format version.
    pub version: u32,
    /// Command that made it.
    pub command: String,
    /// Seed it was made with.
    pub seed: u64,
    /// Grasps by object, best first.
    pub grasps: BTreeMap<String, Vec<Grasp>>,
}

impl Repertoire {
    /// Parses a file's text; `path` is used in errors.
    pub fn parse(text: &str, path: &Path) -> Result<Self, RepertoireError> {
        let repertoire: Self = serde_json::from_str(text)
            .map_err(|error| RepertoireError::Syntax { path: path.into(), message: error.to_string() })?;
        if repertoire.version != VERSION {
            return Err(RepertoireError::Version { path: path.into(), found: repertoire.version });
        }
        Ok(repertoire)
    }

    /// Reads a file.
    pub fn read(path: &Path) -> Result<Self, RepertoireError> {
        let text = std::fs::read_to_string(path).map_err(|source| RepertoireError::Io { path: path.into(), source })?;
        Self::parse(&text, path)
    }

    /// Writes a file: one grasp a line, whole or not at all.
    pub fn write(&self, path: &Path) -> Result<(), RepertoireError> {
        let mut text = format!(
            "{{\"version\":{},\"command\":{},\"seed\":{},\"grasps\":{{\n",
            self.version,
            serde_json::Value::from(self.command.clone()),
            self.seed
        );
        for (n, (object, grasps)) in self.grasps.iter().enumerate() {
            let lines: Vec<String> = grasps.iter().filter_map(|grasp| serde_json::to_string(grasp).ok()).collect();
            text += &format!(
                "{}: [\n{}\n]{}\n",
                serde_json::Value::from(object.clone()),
                lines.join(",\n"),
                if n + 1 < self.grasps.len() { "," } else { "" }
            );
        }
        text += "}}\n";
        write_whole(path, text.as_bytes()).map_err(|source| RepertoireError::Io { path: path.into(), source })
    }

    /// Grasps of `object` for `role`, best first.
    pub fn of(&self, object: &str, role: Role) -> impl Iterator<Item = &Grasp> {
        self.grasps.get(object).into_iter().flatten().filter(move |grasp| grasp.role == role)
    }

    /// Adds a grasp and keeps its object's list ranked by score (ties: by number).
    pub fn insert(&mut self, grasp: Grasp) {
        let list = self.grasps.entry(grasp.object.clone()).or_default();
        list.push(grasp);
        list.sort_by(|a, b| b.score.total_cmp(&a.score).then(a.id.cmp(&b.id)));
    }
}
