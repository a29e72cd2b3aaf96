//! Claims (leases) of units of work, so that no two workers run the same unit.
//!
//! A claim is a file that names its holder, who keeps it locked. The operating system, or the server of a network file
//! system, releases the lock when the holder has ended, in any way. The claim may then be taken over.
//!
//! A claim only saves work. If two workers do run the same unit (on a file system that does not pass locks on to other
//! machines), both write the same results.

use std::fs::{self, File, OpenOptions};
use std::io::Write as _;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use ftac_platform::journal::try_lock;
use serde::{Deserialize, Serialize};

/// Holder of a claim.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ClaimHolder {
    pub host: String,
    pub process: u32,
    /// Slurm job, or task of an array, of the holder.
    pub job: Option<String>,
}

impl ClaimHolder {
    /// Returns this process as a holder.
    pub fn current_process() -> Self {
        let variable = |name: &str| std::env::var(name).ok();
        let task = variable("SLURM_ARRAY_JOB_ID").zip(variable("SLURM_ARRAY_TASK_ID"));
        let job = task.map(|(job, task)| format!("{job}_{task}")).or_else(|| variable("SLURM_JOB_ID"));
        Self { host: variable("SLURMD_NODENAME").unwrap_or_else(machine), process: std::process::id(), job }
    }
}

impl std::fmt::Display for ClaimHolder {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{} process {}", self.host, self.process)?;
        self.job.iter().try_for_each(|job| write!(formatter, " (job {job})"))
    }
}

/// Returns the machine's name.
fn machine() -> String {
    fs::read_to_string("/proc/sys/kernel/hostname").map_or_else(|_| "unknown".to_owned(), |name| name.trim().to_owned())
}

/// The claims of one process.
pub struct Claims {
    folder: PathBuf,
    holder: ClaimHolder,
}

/// An exclusive claim of a unit, held during the lifetime of this value.
pub struct Claim {
    path: PathBuf,
    _lock: File,
}

impl Claims {
    /// Creates the claims of this process in a sweep's folder.
    pub fn new(sweep: &Path) -> Result<Self> {
        let folder = sweep.join("claims");
        fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
        Ok(Self { folder, holder: ClaimHolder::current_process() })
    }

    /// Returns the holder: this process.
    pub fn holder(&self) -> &ClaimHolder {
        &self.holder
    }

    /// Claims a unit. Returns none if another worker holds it.
    pub fn try_claim(&self, id: &str) -> Result<Option<Claim>> {
        let path = self.folder.join(id);
        let take = || -> std::io::Result<Option<File>> {
            let open = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path)?;
            let Some(mut file) = try_lock(open)? else { return Ok(None) };
            // A holder that ended in between has removed the file that is locked here. The next claimant creates
            // another one.
            if fs::metadata(&path).map_or(0, |data| data.ino()) != file.metadata()?.ino() {
                return Ok(None);
            }
            file.set_len(0)?;
            file.write_all(&serde_json::to_vec(&self.holder)?)?;
            Ok(Some(file))
        };
        let lock = take().with_context(|| path.display().to_string())?;
        Ok(lock.map(|lock| Claim { path, _lock: lock }))
    }

    /// Returns all present claims: unit and holder.
    pub fn all(sweep: &Path) -> Result<Vec<(String, ClaimHolder)>> {
        let folder = sweep.join("claims");
        let mut found = Vec::new();
        for entry in fs::read_dir(&folder).with_context(|| folder.display().to_string())? {
            let entry = entry?;
            // A claim may end while it is examined.
            let held = File::open(entry.path()).is_ok_and(|file| file.try_lock_shared().is_err());
            let text = fs::read(entry.path()).unwrap_or_default();
            if let (true, Ok(holder)) = (held, serde_json::from_slice(&text)) {
                found.push((entry.file_name().to_string_lossy().into_owned(), holder));
            }
        }
        found.sort_by(|a, b| a.0.cmp(&b.0));
        Ok(found)
    }
}

impl Drop for Claim {
    fn drop(&mut self) {
        // The lock is still held. A file that cannot be removed will be taken over.
        let _ = fs::remove_file(&self.path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_unit_is_claimed_once() {
        let folder = tempfile::tempdir().expect("a folder");
        let (one, other) = (Claims::new(folder.path()).expect("one"), Claims::new(folder.path()).expect("other"));
        let claim = one.try_claim("unit").expect("works").expect("free");
        assert!(other.try_claim("unit").expect("works").is_none());
        assert!(other.try_claim("another").expect("works").is_some());
        assert_eq!(Claims::all(folder.path()).expect("read"), [("unit".to_owned(), one.holder().clone())]);
        drop(claim);
        assert!(other.try_claim("unit").expect("works").is_some());
        assert_eq!(fs::read_dir(folder.path().join("claims")).expect("read").count(), 0);
    }

    #[test]
    fn of_many_threads_one_gets_it() {
        let folder = tempfile::tempdir().expect("a folder");
        let claims = Claims::new(folder.path()).expect("claims");
        let won = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..8).map(|_| scope.spawn(|| claims.try_claim("unit").expect("works"))).collect();
            // All are kept until the last one has tried: a dropped claim is free again.
            threads.into_iter().filter_map(|thread| thread.join().expect("ends")).collect::<Vec<_>>()
        });
        assert_eq!(won.len(), 1);
    }

    /// A killed process leaves a file without a holder.
    #[test]
    fn claims_of_the_dead_are_taken_over() {
        let folder = tempfile::tempdir().expect("a folder");
        let claims = Claims::new(folder.path()).expect("claims");
        let gone = ClaimHolder { host: "elsewhere".into(), process: 1, job: None };
        let path = folder.path().join("claims/unit");
        fs::write(&path, serde_json::to_vec(&gone).expect("text")).expect("written");
        assert_eq!(Claims::all(folder.path()).expect("read"), []);
        let _claim = claims.try_claim("unit").expect("works").expect("free");
        assert_eq!(Claims::all(folder.path()).expect("read"), [("unit".to_owned(), claims.holder().clone())]);
    }
}
