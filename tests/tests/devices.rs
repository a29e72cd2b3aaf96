//! Emulated devices in real time, for tests of the hardware bridge.

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use e2e::ftac;
use serde_json::Value;

pub fn text(path: &Path) -> &str {
    path.to_str().expect("a UTF-8 path")
}

pub fn json(bytes: &[u8]) -> Value {
    serde_json::from_slice(bytes).unwrap_or_else(|error| panic!("{error}: {}", String::from_utf8_lossy(bytes)))
}

/// Lock for one real-time trial at a time: each keeps a simulator and a control stack busy.
static REAL_TIME_LOCK: Mutex<()> = Mutex::new(());

/// A running emulator in real time.
pub struct EmulatedDevices {
    _alone: MutexGuard<'static, ()>,
    pub child: Child,
    pub config: PathBuf,
}

impl EmulatedDevices {
    /// Starts calibrated devices, with additional arguments.
    pub fn start(folder: &Path, extra: &[&str]) -> Self {
        Self::start_cold(folder, &[&["--calibrated"], extra].concat())
    }

    /// Starts uncalibrated devices, with additional arguments.
    pub fn start_cold(folder: &Path, extra: &[&str]) -> Self {
        let alone = REAL_TIME_LOCK.lock().unwrap_or_else(PoisonError::into_inner);
        let dir = folder.join("devices");
        let usual = ["bridge", "emulate", "--patient", "--json", "--dir", text(&dir)];
        let arguments = [&usual, extra].concat();
        let mut child = ftac(&arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("starts");
        let mut line = String::new();
        BufReader::new(child.stdout.as_mut().expect("piped")).read_line(&mut line).expect("says where it is");
        assert!(json(line.as_bytes())["servos"].is_string(), "{line}");
        Self { _alone: alone, child, config: dir.join("bridge.toml") }
    }

    /// Sends a request or fault, which takes effect at once.
    pub fn happen(&mut self, what: &str) {
        writeln!(self.child.stdin.as_mut().expect("piped"), "{what}").expect("it listens");
    }

    /// Waits for the end of the emulator and returns its final JSON output.
    pub fn end(mut self) -> Value {
        let mut rest = String::new();
        self.child.stdout.take().expect("piped").read_to_string(&mut rest).expect("read");
        self.child.wait().expect("ours");
        json(rest.lines().last().unwrap_or_default().as_bytes())
    }
}

impl Drop for EmulatedDevices {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Waits until the trial under way has recorded some hundred ticks, on the arm's way to the first object. Its session
/// file grows with every tick.
pub fn wait_for_trial(host: &mut Child, sessions: &Path) {
    let recorded = || {
        fs::read_dir(sessions)
            .map_or(0, |files| files.flatten().map(|f| f.metadata().map_or(0, |m| m.len())).sum::<u64>())
    };
    // Only a hanging trial takes this long.
    let give_up = Instant::now() + Duration::from_secs(600);
    while recorded() < 6_000_000 {
        if host.try_wait().expect("ours").is_some() {
            let mut message = String::new();
            drop(host.stderr.take().map(|mut stderr| stderr.read_to_string(&mut message)));
            panic!("the trial ended by itself: {message}");
        }
        assert!(Instant::now() < give_up, "the trial does not begin");
        std::thread::sleep(Duration::from_millis(20));
    }
}
