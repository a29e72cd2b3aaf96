//! The result folder, shared by all workers of a sweep.
//!
//! Every file is written under another name, synced and renamed, as a network file system requires: a file under its
//! final name is complete.
//!
//! | path | content |
//! |---|---|
//! | `plan.json` | the sweep, as planned |
//! | `units/trials/ID_COLUMNS.parquet` | trials of a finished unit; it is written last, so that a unit with this file is finished |
//! | `units/tries/ID_COLUMNS.parquet` | their tries |
//! | `claims/ID_COLUMNS` | a worker runs this unit now ([`crate::claim`]) |
//! | `failed/ID_COLUMNS.json` | the last attempt at this unit failed, with the reason |
//! | `corrupt/` | units' files that were found broken |
//! | `merged/trials/`, `merged/tries/`, `merged/units.csv` | rows of all units, one file per point; the units' times ([`crate::merge`]) |
//! | `slurm/` | scripts, numbers and logs of jobs ([`crate::slurm`]) |

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsStr;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use ftac_platform::data::write_atomically;
use serde::{Deserialize, Serialize};

use crate::columns::TableKind;
use crate::plan::SweepPlan;
use crate::table::ParquetReader;

/// A failed attempt at a unit.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Failure {
    pub reason: String,
    /// Worker of the attempt: machine, process, job.
    pub by: String,
}

/// A result folder and its plan.
#[derive(Debug)]
pub struct SweepFolder {
    pub path: PathBuf,
    pub plan: SweepPlan,
}

const PLAN_FILE: &str = "plan.json";

impl SweepFolder {
    /// True if `path` is the folder of a sweep.
    pub fn is_at(path: &Path) -> bool {
        path.join(PLAN_FILE).is_file()
    }

    /// Opens the sweep in `path`.
    pub fn open(path: &Path) -> Result<Self> {
        let file = path.join(PLAN_FILE);
        let text = fs::read_to_string(&file)
            .with_context(|| format!("{}: found no sweep (cannot read {})", path.display(), file.display()))?;
        let plan: SweepPlan = serde_json::from_str(&text).with_context(|| file.display().to_string())?;
        if plan.version != crate::columns::VERSION {
            bail!("{}: version: found {}, expected {}", file.display(), plan.version, crate::columns::VERSION);
        }
        Ok(Self { path: path.to_owned(), plan })
    }

    /// Creates the folder for `plan`, or opens the one that already holds this sweep. Refuses the folder of another
    /// sweep.
    pub fn join(path: &Path, plan: SweepPlan) -> Result<Self> {
        if !Self::is_at(path) {
            if path.join("run.json").exists() {
                bail!("--out: {} already holds a benchmark; name another folder", path.display());
            }
            for folder in ["units/trials", "units/tries", "claims", "failed"] {
                let folder = path.join(folder);
                fs::create_dir_all(&folder)
                    .with_context(|| format!("--out: cannot create the folder {}", folder.display()))?;
            }
            // Of two workers that start at the same time, one is first.
            let mut draft = tempfile::NamedTempFile::new_in(path).with_context(|| path.display().to_string())?;
            std::io::Write::write_all(&mut draft, plan.to_json()?.as_bytes())?;
            draft.as_file().sync_all()?;
            match fs::hard_link(draft.path(), path.join(PLAN_FILE)) {
                Err(error) if error.kind() != ErrorKind::AlreadyExists => {
                    return Err(error).with_context(|| path.join(PLAN_FILE).display().to_string());
                }
                _ => {}
            }
        }
        let held = Self::open(path)?;
        match plan.first_difference(&held.plan) {
            None => Ok(held),
            Some(how) => bail!(
                "--out: {} holds another sweep, or this one before it was changed: {how}; name another folder (nothing was changed in this one)",
                path.display()
            ),
        }
    }

    /// Returns the path of a unit's file.
    pub fn unit_path(&self, which: TableKind, id: &str) -> PathBuf {
        self.path.join("units").join(which.name()).join(format!("{id}.parquet"))
    }

    /// True if a unit is finished, according to the present file system.
    pub fn is_finished(&self, id: &str) -> bool {
        self.unit_path(TableKind::Trials, id).is_file()
    }

    /// Returns the plan's units that are finished.
    pub fn finished(&self) -> Result<BTreeSet<String>> {
        let found = file_stems(&self.path.join("units/trials"), "parquet")?;
        let planned: BTreeSet<&str> = self.plan.units.iter().map(|unit| unit.id.as_str()).collect();
        Ok(found.into_iter().filter(|id| planned.contains(id.as_str())).collect())
    }

    /// Stores the tables of a finished unit: its tries first.
    pub fn store_unit(&self, id: &str, tries: &[u8], trials: &[u8]) -> Result<()> {
        write_atomically(&self.unit_path(TableKind::Tries, id), tries)?;
        write_atomically(&self.unit_path(TableKind::Trials, id), trials)?;
        match fs::remove_file(self.failure_path(id)) {
            Err(error) if error.kind() != ErrorKind::NotFound => Err(error).context("failed/"),
            _ => Ok(()),
        }
    }

    fn failure_path(&self, id: &str) -> PathBuf {
        self.path.join("failed").join(format!("{id}.json"))
    }

    /// Records that an attempt at a unit failed.
    pub fn note_failure(&self, id: &str, failure: &Failure) -> Result<()> {
        Ok(write_atomically(&self.failure_path(id), &serde_json::to_vec_pretty(failure)?)?)
    }

    /// Returns the units whose last attempt failed.
    pub fn failures(&self) -> Result<BTreeMap<String, Failure>> {
        let ids = file_stems(&self.path.join("failed"), "json")?;
        let read = |id: String| {
            let file = self.failure_path(&id);
            let text = fs::read_to_string(&file).with_context(|| file.display().to_string())?;
            Ok((id, serde_json::from_str(&text).with_context(|| file.display().to_string())?))
        };
        ids.into_iter().map(read).collect()
    }

    /// Opens a finished unit's file and checks that it is complete and belongs to this unit.
    pub fn open_checked(&self, which: TableKind, id: &str) -> Result<ParquetReader> {
        let path = self.unit_path(which, id);
        let reader = ParquetReader::open(&path)?;
        for (key, expected) in [("ftac.schema", crate::columns::VERSION.to_string()), ("ftac.unit", id.to_owned())] {
            let found = reader.metadata(key).unwrap_or("nothing");
            if found != expected {
                bail!("{}: {key}: found {found}, expected {expected}", path.display());
            }
        }
        Ok(reader)
    }

    /// Moves the files of a unit aside, so that it is run again.
    pub fn set_aside(&self, id: &str) -> Result<PathBuf> {
        let aside = self.path.join("corrupt");
        fs::create_dir_all(&aside).with_context(|| aside.display().to_string())?;
        let mut to = PathBuf::new();
        for which in TableKind::ALL {
            let from = self.unit_path(which, id);
            // An older file that was found broken is kept as well.
            to = (0..)
                .map(|n| aside.join(format!("{id}.{}.{n}.parquet", which.name())))
                .find(|path| !path.exists())
                .unwrap_or_default();
            match fs::rename(&from, &to) {
                Err(error) if error.kind() != ErrorKind::NotFound => {
                    return Err(error).with_context(|| from.display().to_string());
                }
                _ => {}
            }
        }
        Ok(to)
    }
}

/// Returns the names, without extension, of the files in `folder` with the extension `ending`.
fn file_stems(folder: &Path, ending: &str) -> Result<BTreeSet<String>> {
    let entries = match fs::read_dir(folder) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(BTreeSet::new()),
        entries => entries.with_context(|| folder.display().to_string())?,
    };
    let mut found = BTreeSet::new();
    for entry in entries {
        let path = entry.with_context(|| folder.display().to_string())?.path();
        if path.extension() == Some(OsStr::new(ending)) {
            found.extend(path.file_stem().and_then(OsStr::to_str).map(str::to_owned));
        }
    }
    Ok(found)
}
