//! A killed program leaves every tick that was reported as written.

use std::io::{BufRead, BufReader, Write};
use std::path::PathBuf;
use std::process::{Command, Stdio};

use hand_model::robot::{Readings, RobotBackend};
use robot_session_log::{SessionRecorder, SessionWriter};

use crate::support::*;

const PATH_VARIABLE: &str = "FTAC_TEST_SESSION";

/// Records until it is killed, and prints a line once each tick has been written.
#[test]
#[ignore = "run by the other test of this file"]
fn recording_process() {
    let path = PathBuf::from(std::env::var(PATH_VARIABLE).expect("set by the parent"));
    let mut recorder =
        SessionRecorder::new(ToyRobot::new(), SessionWriter::create(&path, &session()).expect("a new file"));
    let mut told = std::io::stderr();
    loop {
        let seen = recorder.observe().and_then(Readings::into_observation).expect("observed");
        recorder.send(&decide(&seen)).expect("sent");
        recorder.wait_for_tick();
        assert!(recorder.error().is_none());
        writeln!(told, "tick").expect("somebody listens");
    }
}

#[test]
fn a_killed_recording_keeps_every_tick() {
    let folder = tempfile::tempdir().expect("a folder");
    for kill_after in [1, 10, 1000] {
        let path = folder.path().join(format!("{kill_after}.mcap"));
        let mut child = Command::new(std::env::current_exe().expect("this program"))
            .args(["--ignored", "--exact", "--nocapture", "kill::recording_process"])
            .env(PATH_VARIABLE, &path)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("starts itself");
        let mut lines = BufReader::new(child.stderr.take().expect("piped")).lines();
        let mut told = 0;
        while told < kill_after {
            let line = lines.next().expect("goes on").expect("text");
            told += usize::from(line == "tick");
        }
        child.kill().expect("killed");
        child.wait().expect("ended");
        // Ticks that it reported before it died, beyond those that we waited for.
        told += lines.map_while(Result::ok).filter(|line| line == "tick").count();
        let (events, ended) = read(&path);
        assert!(matches!(ended, Ok(false)), "not finished: {ended:?}");
        assert!(ticks(&events) >= told, "{} ticks in the file, {told} promised", ticks(&events));
    }
}
