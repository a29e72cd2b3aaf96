//! Claims: who plays a unit now, so that no two workers play the same.
//!
//! A claim is a file that is made by a hard link, which a network file system does for one of two at most, and whose age its holder keeps small.
//! One that has grown old, or whose holder is known to be gone, may be taken over: by renaming it away, which again one alone can do. Ages are
//! told by the file system's clock, not by those of the machines.
//!
//! A claim only saves work: should two workers play a unit after all (a node that is taken for dead and is not), both write the same results.

use std::fs::{self, File, OpenOptions};
use std::io::{ErrorKind, Write as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime};

use anyhow::{Context as _, Result};
use serde::{Deserialize, Serialize};

/// How often a held claim is made young again.
const BEAT: Duration = Duration::from_secs(15);
/// From what age on the holder of a claim is taken for dead.
const LEASE: Duration = Duration::from_secs(150);

/// Who holds a claim.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Holder {
    pub host: String,
    pub process: u32,
    /// Name of the processes' name space: a number means the same in it only.
    pub space: String,
    /// When the process began, in the kernel's ticks: numbers are used again.
    pub began: String,
    /// The Slurm job, or task of an array, that it is.
    pub job: Option<String>,
}

impl Holder {
    /// This process.
    pub fn this() -> Self {
        let variable = |name: &str| std::env::var(name).ok();
        let task = variable("SLURM_ARRAY_JOB_ID").zip(variable("SLURM_ARRAY_TASK_ID"));
        let job = task.map(|(job, task)| format!("{job}_{task}")).or_else(|| variable("SLURM_JOB_ID"));
        let process = std::process::id();
        Self {
            host: variable("SLURMD_NODENAME").unwrap_or_else(machine),
            process,
            space: name_space(),
            began: began(process).unwrap_or_default(),
            job,
        }
    }

    /// Whether it is known to be gone, as `me` can tell.
    fn is_gone(&self, me: &Self) -> bool {
        // Slurm runs a task once at a time: an earlier run of this one is over.
        let earlier = self.job.is_some() && self.job == me.job && self.process != me.process;
        let here = self.host == me.host && self.space == me.space;
        earlier || (here && began(self.process).is_none_or(|began| began != self.began))
    }
}

impl std::fmt::Display for Holder {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{} process {}", self.host, self.process)?;
        self.job.iter().try_for_each(|job| write!(formatter, " (job {job})"))
    }
}

/// The machine's name.
fn machine() -> String {
    fs::read_to_string("/proc/sys/kernel/hostname").map_or_else(|_| "unknown".to_owned(), |name| name.trim().to_owned())
}

fn name_space() -> String {
    fs::read_link("/proc/self/ns/pid").map_or_else(|_| String::new(), |link| link.to_string_lossy().into_owned())
}

/// When a process of this machine began; none if there is none of that number.
fn began(process: u32) -> Option<String> {
    let stat = fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    // The second field is the program's name, in brackets, with whatever is in it.
    stat.rsplit_once(')')?.1.split_whitespace().nth(19).map(str::to_owned)
}

/// The claims of a process.
pub struct Claims {
    folder: PathBuf,
    me: Holder,
    shared: Arc<Shared>,
    beats: Option<JoinHandle<()>>,
}

struct Shared {
    held: Mutex<Vec<PathBuf>>,
    text: Vec<u8>,
    over: AtomicBool,
}

/// A unit that is one's own as long as this lives.
pub struct Claim<'a> {
    claims: &'a Claims,
    path: PathBuf,
}

impl Claims {
    /// In a sweep's folder.
    pub fn new(sweep: &Path) -> Result<Self> {
        let folder = sweep.join("claims");
        fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
        let me = Holder::this();
        let text = serde_json::to_vec(&me)?;
        let shared = Arc::new(Shared { held: Mutex::default(), text, over: AtomicBool::new(false) });
        let beating = shared.clone();
        let beats = std::thread::spawn(move || {
            while !beating.over.load(Ordering::Relaxed) {
                std::thread::park_timeout(BEAT);
                beating.beat();
            }
        });
        Ok(Self { folder, me, shared, beats: Some(beats) })
    }

    /// Who claims.
    pub fn holder(&self) -> &Holder {
        &self.me
    }

    /// A name that nobody else uses.
    fn unique(&self, what: &str) -> PathBuf {
        static COUNT: AtomicU64 = AtomicU64::new(0);
        let n = COUNT.fetch_add(1, Ordering::Relaxed);
        self.folder.join(format!(".{what}.{}.{}.{n}", self.me.host, self.me.process))
    }

    /// Claims a unit; none if somebody else has it.
    pub fn take(&self, id: &str) -> Result<Option<Claim<'_>>> {
        let path = self.folder.join(id);
        for _ in 0..2 {
            let draft = self.unique("claim");
            let mut file = File::create(&draft).with_context(|| draft.display().to_string())?;
            file.write_all(&self.shared.text)
                .and_then(|()| file.sync_all())
                .with_context(|| draft.display().to_string())?;
            let linked = fs::hard_link(&draft, &path);
            // The last one's clock: the draft was written just now.
            let now = file.metadata().and_then(|data| data.modified());
            let removed = fs::remove_file(&draft);
            match linked {
                Ok(()) => {
                    removed.with_context(|| draft.display().to_string())?;
                    if let Ok(mut held) = self.shared.held.lock() {
                        held.push(path.clone());
                    }
                    return Ok(Some(Claim { claims: self, path }));
                }
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
                Err(error) => return Err(error).with_context(|| path.display().to_string()),
            }
            if !self.end_if_dead(&path, now?)? {
                return Ok(None);
            }
        }
        Ok(None)
    }

    /// Removes a claim whose holder is gone; whether it did, or somebody else had.
    fn end_if_dead(&self, path: &Path, now: SystemTime) -> Result<bool> {
        let seen = match fs::read(path) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(true),
            seen => seen.with_context(|| path.display().to_string())?,
        };
        let age = |path: &Path| {
            fs::metadata(path).and_then(|data| data.modified()).map(|beat| now.duration_since(beat).unwrap_or_default())
        };
        let gone = serde_json::from_slice::<Holder>(&seen).is_ok_and(|holder| holder.is_gone(&self.me));
        if !gone && age(path).is_ok_and(|age| age < LEASE) {
            return Ok(false);
        }
        let away = self.unique("gone");
        match fs::rename(path, &away) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(true),
            renamed => renamed.with_context(|| path.display().to_string())?,
        }
        let mut mine = true;
        if fs::read(&away).is_ok_and(|found| found != seen) {
            // Somebody was faster, and this is that one's new claim: back with it.
            mine = false;
            let _ = fs::hard_link(&away, path);
        }
        fs::remove_file(&away).with_context(|| away.display().to_string())?;
        Ok(mine)
    }

    /// Who holds which unit now.
    pub fn all(sweep: &Path) -> Result<Vec<(String, Holder)>> {
        let folder = sweep.join("claims");
        let mut found = Vec::new();
        for entry in fs::read_dir(&folder).with_context(|| folder.display().to_string())? {
            let entry = entry?;
            let name = entry.file_name().to_string_lossy().into_owned();
            let Ok(text) = fs::read(entry.path()) else { continue };
            if let (false, Ok(holder)) = (name.starts_with('.'), serde_json::from_slice(&text)) {
                found.push((name, holder));
            }
        }
        found.sort_by(|a, b| a.0.cmp(&b.0));
        Ok(found)
    }
}

impl Shared {
    /// Makes what is held young again: what a server writes has the server's time.
    fn beat(&self) {
        let held = self.held.lock().map_or_else(|_| Vec::new(), |held| held.clone());
        for path in held {
            // A claim that was taken away stays away: the file must be there.
            if let Ok(mut file) = OpenOptions::new().write(true).open(path) {
                let _ = file.write_all(&self.text);
            }
        }
    }
}

impl Drop for Claims {
    fn drop(&mut self) {
        self.shared.over.store(true, Ordering::Relaxed);
        if let Some(beats) = self.beats.take() {
            beats.thread().unpark();
            let _ = beats.join();
        }
    }
}

impl Drop for Claim<'_> {
    fn drop(&mut self) {
        if let Ok(mut held) = self.claims.shared.held.lock() {
            held.retain(|path| *path != self.path);
        }
        // One that cannot be removed grows old.
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
        let claim = one.take("unit").expect("works").expect("free");
        assert!(other.take("unit").expect("works").is_none());
        assert!(other.take("another").expect("works").is_some());
        assert_eq!(Claims::all(folder.path()).expect("read"), [("unit".to_owned(), one.holder().clone())]);
        drop(claim);
        assert!(other.take("unit").expect("works").is_some());
        assert_eq!(fs::read_dir(folder.path().join("claims")).expect("read").count(), 0);
    }

    #[test]
    fn of_many_threads_one_gets_it() {
        let folder = tempfile::tempdir().expect("a folder");
        let claims = Claims::new(folder.path()).expect("claims");
        let won = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..8).map(|_| scope.spawn(|| claims.take("unit").expect("works"))).collect();
            // All are kept until the last one has tried: one that is dropped is free again.
            threads.into_iter().filter_map(|thread| thread.join().expect("ends")).collect::<Vec<_>>()
        });
        assert_eq!(won.len(), 1);
    }

    /// Of a process that is gone, of an earlier run of the same task, and of one that has not been heard of for long.
    #[test]
    fn claims_of_the_dead_are_taken_over() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut claims = Claims::new(folder.path()).expect("claims");
        claims.me.job = Some("7_1".into());
        let me = claims.me.clone();
        let path = folder.path().join("claims/unit");
        let left = |holder: &Holder| fs::write(&path, serde_json::to_vec(holder).expect("text")).expect("written");
        let elsewhere = Holder { host: "elsewhere".into(), job: None, ..me.clone() };
        left(&elsewhere);
        assert!(claims.take("unit").expect("works").is_none(), "its holder may live");
        left(&Holder { began: "0".into(), job: None, ..me.clone() });
        assert!(claims.take("unit").expect("works").is_some(), "the process is another one now");
        left(&Holder { job: Some("7_1".into()), process: 1, ..elsewhere.clone() });
        assert!(claims.take("unit").expect("works").is_some(), "an earlier run of this task");
        left(&elsewhere);
        let old = SystemTime::now() - 2 * LEASE;
        File::options().write(true).open(&path).and_then(|file| file.set_modified(old)).expect("made old");
        assert!(claims.take("unit").expect("works").is_some(), "not heard of for long");
    }
}
