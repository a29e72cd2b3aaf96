//! The hardware bridge end to end: trials on emulated devices, replay of sessions, faults, and a host that dies.
//!
//! Emulated devices in lock-step do not depend on a clock. Those in real time run with `--patient`, and the tests wait
//! for events, not for seconds.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::devices::{EmulatedDevices, json, text, wait_for_trial};
use e2e::{ftac, run, stderr};
use serde_json::Value;
use tempfile::tempdir;

/// Returns the only file in a folder.
fn only_file(folder: &Path) -> PathBuf {
    let files: Vec<PathBuf> =
        fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path()).collect();
    assert_eq!(files.len(), 1, "{files:?}");
    files[0].clone()
}

/// Replays a session. Returns exit code and JSON output.
fn replay(file: &Path) -> (Option<i32>, Value) {
    let output = run(&["replay", text(file), "--json"]);
    assert!(matches!(output.status.code(), Some(0 | 1)), "{}", stderr(&output));
    (output.status.code(), json(&output.stdout))
}

/// The run without noise gives the same result on all backends, and each session replays to the last bit.
#[test]
fn the_same_trial_on_three_bodies() {
    let folder = tempdir().expect("a folder");
    let mut records = Vec::new();
    for robot in ["sim", "direct", "emulated"] {
        let sessions = folder.path().join(robot);
        let out = folder.path().join("trial.rrd");
        let arguments = [
            "trial",
            "0",
            "--policy",
            "ideal",
            "--robot",
            robot,
            "--session",
            text(&sessions),
            "--out",
            text(&out),
            "--json",
        ];
        let output = run(&arguments);
        assert_eq!(output.status.code(), Some(0), "{robot}: {}", stderr(&output));
        let record = json(&output.stdout);
        let decided = ["first", "second", "success", "contact", "switched", "retries"].map(|name| record[name].clone());
        records.push(decided);
        let (code, replayed) = replay(&only_file(&sessions));
        assert_eq!(
            (code, &replayed["difference"], &replayed["same_decisions"]),
            (Some(0), &Value::Null, &Value::Bool(true))
        );
        assert_eq!(replayed["ticks"], replayed["identical_commands"], "{robot}");
        assert_eq!(replayed["robot"], robot);
    }
    assert!(records.windows(2).all(|pair| pair[0] == pair[1]), "{records:?}");
}

/// The backend `direct` processes commands, measurements and images like the emulated devices, but without wires: a
/// trial with noise and touch is the same on both, command by command and image by image.
#[test]
fn wires_change_nothing() {
    let folder = tempdir().expect("a folder");
    let sessions = ["direct", "emulated"].map(|robot| {
        let sessions = folder.path().join(robot);
        let out = folder.path().join("trial.rrd");
        let arguments = ["trial", "1", "--trial", "1", "--policy", "touch", "--robot", robot, "--json"];
        let output = run(&[&arguments[..], &["--session", text(&sessions), "--out", text(&out)]].concat());
        assert!(matches!(output.status.code(), Some(0 | 1)), "{robot}: {}", stderr(&output));
        only_file(&sessions)
    });
    let output = run(&["replay", text(&sessions[0]), "--against", text(&sessions[1]), "--json"]);
    let compared = json(&output.stdout);
    assert_eq!((output.status.code(), &compared["difference"]), (Some(0), &Value::Null));
    assert!(compared["identical_ticks"].as_u64().is_some_and(|ticks| ticks > 500), "{compared}");
    assert!(compared["identical_images"].as_u64().is_some_and(|images| images >= 36), "{compared}");
    // The plain simulated robot differs from both: the comparison is able to detect differences.
    let sim = folder.path().join("sim");
    let out = folder.path().join("trial.rrd");
    let arguments = ["trial", "1", "--trial", "1", "--policy", "touch", "--session", text(&sim), "--out", text(&out)];
    assert!(matches!(run(&arguments).status.code(), Some(0 | 1)));
    a_session_becomes_a_bag(&only_file(&sim), &folder.path().join("bag.mcap"));
    let output = run(&["replay", text(&sessions[0]), "--against", text(&only_file(&sim)), "--json"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(json(&output.stdout)["difference"].is_string());
}

/// Exports a session as a ROS 2 bag: joint states and commands of every tick, images, and a definition of each message.
fn a_session_becomes_a_bag(session: &Path, bag: &Path) {
    let exported = run(&["--json", "export", "ros2", text(session), "--out", text(bag)]);
    assert_eq!(exported.status.code(), Some(0), "{}", stderr(&exported));
    assert!(json(&exported.stdout)["messages"].as_u64() > Some(2000));
    let bytes = fs::read(bag).expect("written");
    assert!(bytes.starts_with(b"\x89MCAP0\r\n") && bytes.ends_with(b"\x89MCAP0\r\n"));
    let has = |word: &str| bytes.windows(word.len()).any(|found| found == word.as_bytes());
    for word in
        ["ros2msg", "sensor_msgs/msg/JointState", "/hand/servo_states", "/tactile/thumb_distal/image_raw", "/outcome"]
    {
        assert!(has(word), "{word}");
    }
    let twice = run(&["export", "ros2", text(&bag.with_file_name("none.mcap"))]);
    assert_eq!(twice.status.code(), Some(2));
    assert!(stderr(&twice).contains("none.mcap"), "{}", stderr(&twice));
}

/// A trial with touch and noise makes the same decisions on the emulated devices and in the replay; a changed bit is
/// detected.
#[test]
fn a_session_is_held_to_every_bit() {
    let folder = tempdir().expect("a folder");
    let sessions = folder.path().join("sessions");
    let out = folder.path().join("out");
    let bench = ["bench", "--combos", "1", "--trials", "1", "--conditions", "reflex,touch", "--robot", "emulated"];
    let output = run(&[&bench[..], &["--record", "all", "--out", text(&out)]].concat());
    assert!(matches!(output.status.code(), Some(0 | 1)), "{}", stderr(&output));
    fs::rename(out.join("sessions"), &sessions).expect("recorded");
    let files: Vec<PathBuf> =
        fs::read_dir(&sessions).expect("a folder").map(|entry| entry.expect("an entry").path()).collect();
    assert_eq!(files.len(), 2, "{files:?}");
    for file in &files {
        let (code, replayed) = replay(file);
        assert_eq!(
            (code, &replayed["difference"], &replayed["complete"]),
            (Some(0), &Value::Null, &Value::Bool(true)),
            "{file:?}"
        );
    }
    // Cut in the middle, as by a power failure: everything before the cut is identical.
    let of = |condition: &str| files.iter().find(|file| text(file).contains(condition)).expect("its session");
    let file = of("reflex");
    let bytes = fs::read(file).expect("readable");
    fs::write(file, &bytes[..bytes.len() / 2]).expect("written");
    let (code, replayed) = replay(file);
    assert_eq!((code, &replayed["complete"], &replayed["difference"]), (Some(0), &Value::Bool(false), &Value::Null));
    assert!(replayed["ticks"].as_u64().is_some_and(|ticks| ticks > 100));
    // One changed bit means a damaged file, or another session.
    let touched = of("touch");
    let mut bytes = fs::read(touched).expect("readable");
    let middle = bytes.len() / 3;
    bytes[middle] ^= 1;
    fs::write(touched, bytes).expect("written");
    assert_ne!(run(&["replay", text(touched), "--json"]).status.code(), Some(0));
}

/// A few faults of the matrix, in all phases.
#[test]
fn faults_end_as_they_should() {
    let folder = tempdir().expect("a folder");
    for (n, fault) in ["emergency stop", "host killed", "JPEGs", "camera board"].into_iter().enumerate() {
        let out = folder.path().join(n.to_string());
        let output = run(&["bridge", "faults", "--rounds", "1", "--only", fault, "--out", text(&out), "--json"]);
        let matrix = json(&output.stdout);
        assert_eq!(output.status.code(), Some(0), "{fault}: {} {}", matrix["wrong"], stderr(&output));
        assert_eq!(matrix["injected"], 12, "{fault} in every phase");
        assert_eq!(matrix["rows"][0]["recordings_intact"], 12);
    }
    // No camera sends a readable image: the robot continues, and fault detection reports it.
    let out = folder.path().join("mirrored");
    let mirrored =
        ["bridge", "faults", "--rounds", "1", "--only", "JPEGs", "--phase", "second", "--detect-faults", "--json"];
    let output = run(&[&mirrored[..], &["--out", text(&out)]].concat());
    let matrix = json(&output.stdout);
    let named = &matrix["rows"][0]["diagnosis"];
    assert_eq!((&named["detected_by"], &named["rightly"]), (&"detector".into(), &matrix["injected"]), "{named}");
}

/// An interrupted fault matrix keeps its outcomes, and resumes to the same result as an uninterrupted one.
#[test]
fn an_interrupted_fault_matrix_goes_on() {
    let folder = tempdir().expect("a folder");
    let [whole, cut] = ["whole", "cut"].map(|name| folder.path().join(name));
    let asked = ["bridge", "faults", "--rounds", "1", "--only", "bridge stop", "--json"];
    let output = run(&[&asked[..], &["--out", text(&whole)]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let expected = json(&output.stdout);
    let lines = |folder: &Path| fs::read_to_string(folder.join("faults.jsonl")).unwrap_or_default();
    assert_eq!(Some(lines(&whole).lines().count() as u64), expected["injected"].as_u64());

    let mut host = ftac(&[&asked[..], &["--jobs", "1", "--out", text(&cut)]].concat());
    let host = host.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("starts");
    let give_up = Instant::now() + Duration::from_secs(300);
    while lines(&cut).is_empty() {
        assert!(Instant::now() < give_up, "nothing is written");
        std::thread::sleep(Duration::from_millis(2));
    }
    let interrupt = Command::new("kill").args(["-INT", &host.id().to_string()]).status();
    assert!(interrupt.expect("sent").success());
    let output = host.wait_with_output().expect("ends");
    assert_eq!(output.status.code(), Some(130), "{}", stderr(&output));
    assert!(stderr(&output).contains(&format!("--resume {}", text(&cut))), "{}", stderr(&output));
    let (kept, all) = (lines(&cut).lines().count(), lines(&whole).lines().count());
    assert!(kept < all, "it was over already");
    let resumed = run(&["bridge", "faults", "--json", "--resume", text(&cut)]);
    assert_eq!(resumed.status.code(), Some(0), "{}", stderr(&resumed));
    assert_eq!(json(&resumed.stdout), expected);
    assert!(lines(&cut).lines().count() == all && lines(&cut).lines().take(kept).count() == kept);
}

/// A host with `--robot hardware` is killed in mid-trial: servos and arm stop by their own watchdogs, and its recording
/// replays to the last tick.
#[test]
fn a_killed_host_leaves_everything_standing() {
    let folder = tempdir().expect("a folder");
    let devices = EmulatedDevices::start(folder.path(), &["--until-stopped"]);
    let sessions = folder.path().join("sessions");
    let arguments = [
        "trial",
        "0",
        "--policy",
        "blind",
        "--robot",
        "hardware",
        "--config",
        text(&devices.config),
        "--session",
        text(&sessions),
    ];
    let mut host =
        ftac(&arguments).stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("starts");
    host.stdin.as_mut().expect("piped").write_all(b"\n").expect("the operator says go");
    wait_for_trial(&mut host, &sessions);
    host.kill().expect("killed");
    host.wait().expect("ours");
    let end = devices.end();
    assert_eq!(end["servos_stopped"].as_array().map(Vec::len), Some(6), "{end}");
    assert!(end["arm_stopped"]["watchdog_after_ms"].is_u64(), "{end}");
    let (code, replayed) = replay(&only_file(&sessions));
    assert_eq!((code, &replayed["difference"]), (Some(0), &Value::Null));
    assert!(replayed["ticks"].as_u64().is_some_and(|ticks| ticks > 50), "{replayed}");
}

/// The camera board is unplugged in mid-trial: the robot holds and instructs the operator.
#[test]
fn an_unplugged_camera_board_ends_in_hold() {
    let folder = tempdir().expect("a folder");
    let mut devices = EmulatedDevices::start(folder.path(), &[]);
    let sessions = folder.path().join("sessions");
    let arguments = [
        "trial",
        "0",
        "--policy",
        "blind",
        "--robot",
        "hardware",
        "--config",
        text(&devices.config),
        "--session",
        text(&sessions),
    ];
    let mut host =
        ftac(&arguments).stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("starts");
    host.stdin.take().expect("piped").write_all(b"\nrelease\n").expect("the operator answers");
    wait_for_trial(&mut host, &sessions);
    devices.happen("usb=cameras");
    let output = host.wait_with_output().expect("ends");
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("hold: camera board: its port is gone; check the USB cable"), "{message}");
    assert!(message.contains("keeps hold of what it holds"), "{message}");
}
