//! Poses of objects and devices: objects from a vision system, the arm's base from registration, devices in the wrong
//! place, and an emulated table that a script rearranges.

use std::fs;
use std::io::Write as _;
use std::net::TcpListener;
use std::path::Path;
use std::process::{Command, Output};

use crate::devices::{EmulatedDevices, json, text};
use e2e::{run, stderr};
use serde_json::Value;
use tempfile::tempdir;

/// Registers an emulated robot with a hidden base pose drawn from this seed.
fn register(mount: &str, file: &Path) -> Value {
    let output = run(&["bridge", "register", "--emulated", mount, "--out", text(file), "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    json(&output.stdout)
}

/// The hidden base is found to 2 mm and a fifth of a degree, and no better than the fit itself states. With it, and
/// with its own vision, a trial on the emulated robot runs to its end, and its session replays to the bit without
/// either.
#[test]
fn a_registered_robot_with_a_detector_runs_and_replays() {
    let folder = tempdir().expect("a folder");
    let file = folder.path().join("registration.toml");
    let found = register("5", &file);
    let off = |which: &str, unit: &str| found[which][unit].as_f64().expect("a number");
    assert!(off("error_before", "mm") > 5.0, "{found}");
    assert!(off("error", "mm") < 2.0 && off("error", "deg") < 0.2, "{found}");
    let sigma = found["sigma_mm"].as_f64().expect("a number");
    assert!((0.3..3.0).contains(&sigma), "{found}");

    let sessions = folder.path().join("sessions");
    let usual = ["trial", "0", "--policy", "blind", "--robot", "emulated", "--mount", "5", "--json"];
    let registered = ["--registration", text(&file), "--detector", "emulated", "--session", text(&sessions)];
    let recording = folder.path().join("trial.rrd");
    let output = run(&[&usual[..], &registered, &["--out", text(&recording)]].concat());
    assert!(output.status.code().is_some_and(|code| code <= 1), "{}", stderr(&output));
    assert_eq!(json(&output.stdout)["condition"], "blind");
    let session = fs::read_dir(&sessions).expect("a folder").next().expect("a file").expect("an entry").path();
    let replayed = run(&["replay", text(&session), "--json"]);
    let found = json(&replayed.stdout);
    assert_eq!((replayed.status.code(), &found["difference"]), (Some(0), &Value::Null), "{}", stderr(&replayed));
    assert!(found["identical_commands"].as_u64().is_some_and(|commands| commands > 500), "{found}");
}

/// Invalid poses and addresses are refused before anything moves, by file, field or address.
#[test]
fn places_that_cannot_be_are_refused() {
    let folder = tempdir().expect("a folder");
    let refused = |arguments: &[&str], words: &[&str]| {
        let out = folder.path().join("trial.rrd");
        let output: Output = run(&[&["trial", "0", "--policy", "blind", "--out", text(&out)], arguments].concat());
        let message = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{message}");
        words.iter().for_each(|words| assert!(message.contains(words), "{message}"));
    };
    refused(&["--detector", "emulated"], &["--detector: found --robot sim, expected emulated, hardware"]);
    refused(&["--mount", "1"], &["--mount: found --robot sim"]);
    refused(&["--robot", "emulated", "--detector", "nowhere"], &["expected HOST:PORT or unix:PATH"]);
    refused(&["--robot", "emulated", "--detector", "unix:/nowhere/eyes"], &["--detector unix:/nowhere/eyes"]);
    let file = folder.path().join("registration.toml");
    fs::write(
        &file,
        "version = 1\nposition = [0.5, 0, 0]\nquaternion = [0, 0, 0, 1]\nsigma = [1, 1, 1, 1, 1, 1]\nresiduals = []\n",
    )
    .expect("written");
    refused(
        &["--robot", "emulated", "--registration", text(&file)],
        &["registration.toml", "position", "at most 0.1 m"],
    );
    // A vision system that knows neither object.
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("its address").to_string();
    std::thread::spawn(move || {
        for mut stream in listener.incoming().flatten() {
            let _ = stream.write_all(b"{\"object\": \"plum\", \"time\": 1.0, \"hidden\": true}\n");
            std::thread::park();
        }
    });
    refused(
        &["--robot", "emulated", "--detector", &address],
        &["salt_mill", "line 1: object: found plum, expected one of", "within 3 s"],
    );
}

/// A vision system that sends nothing usable ends a trial: its session says why, and replays to the same failure.
/// Escape sequences in its messages, or in a scenario from someone else, do not reach the terminal.
#[test]
fn a_failed_look_replays_and_escape_sequences_reach_no_terminal() {
    let folder = tempdir().expect("a folder");
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("its address").to_string();
    std::thread::spawn(move || {
        for mut stream in listener.incoming().flatten() {
            let _ = stream.write_all(b"{\"object\": \"\\u001b[2Jplum\\u009b1m\", \"time\": 1.0, \"hidden\": true}\n");
            std::thread::park();
        }
    });
    let harmless = |output: &Output, words: &str| {
        let said = format!("{}{}", stderr(output), String::from_utf8_lossy(&output.stdout));
        assert!(said.contains(words), "{said:?}");
        let order = said.chars().find(|letter| letter.is_control() && !matches!(letter, '\n' | '\t'));
        assert_eq!(order, None, "{said:?}");
    };
    let (sessions, out) = (folder.path().join("sessions"), folder.path().join("trial.rrd"));
    let detector = ["trial", "0", "--policy", "blind", "--robot", "emulated", "--detector", &address];
    let output = run(&[&detector[..], &["--session", text(&sessions), "--out", text(&out)]].concat());
    assert_eq!(output.status.code(), Some(2));
    harmless(&output, "found \\u001b[2Jplum\\u009b1m, expected one of");
    let session = fs::read_dir(&sessions).expect("a folder").next().expect("a file").expect("an entry").path();
    let replayed = run(&["replay", text(&session), "--json"]);
    harmless(&replayed, "plum");
    assert_eq!(replayed.status.code(), Some(0), "{}", stderr(&replayed));
    let found = json(&replayed.stdout);
    let why = found["failed_detection"].as_str().expect("why");
    assert!(why.contains("salt_mill") && why.contains("\u{1b}[2Jplum"), "{found}");
    harmless(&run(&["replay", text(&session)]), "it ends in the same failed detection: --detector 127.0.0.1");

    let scenario = folder.path().join("scenario.toml");
    fs::write(&scenario, "version = 1\n\"\\u001b]0;owned\\u0007\" = 1\n").expect("written");
    let output = run(&["trial", "0", "--scenario", text(&scenario)]);
    assert_eq!(output.status.code(), Some(2));
    harmless(&output, "owned");
}

/// The emulated table in real time: a script requests other objects and puts them back, the vision system measures
/// their poses, and the true scene is recorded.
#[test]
fn a_script_rearranges_the_emulated_table() {
    let folder = tempdir().expect("a folder");
    let (truth, detector) = (folder.path().join("truth.rrd"), folder.path().join("eyes"));
    let address = format!("unix:{}", detector.display());
    let devices = EmulatedDevices::start(folder.path(), &["--truth", text(&truth), "--detector", &address]);
    let dir = devices.config.parent().expect("its folder").to_owned();
    let told = |line: &str| run(&["bridge", "emulate", "--dir", text(&dir), "--send", line, "--json"]);
    let answer = |line: &str| {
        let output = told(line);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        json(&output.stdout)["answer"].as_str().expect("words").to_owned()
    };
    assert_eq!(answer("objects=back"), "back in place: salt_mill, lemon");
    assert!(answer("objects=7").starts_with("on the table: "));
    assert_eq!(answer("objects=balls"), "on the table: billiard_ball, billiard_ball, billiard_ball");
    assert_eq!(answer("unplug=6"), "done");
    for fault in ["break=ring", "slip=index:3", "weak=thumb:0.6", "heavy=1:0.3", "push=12", "dim=7:red:0.5", "snatch=1"]
    {
        assert_eq!(answer(fault), "done", "{fault}");
    }
    for (line, words) in [
        ("objects=60", "expected 0 to 59"),
        ("objects=", "expected back, balls"),
        ("dance", "dance"),
        ("dance=1", "break=DIGIT, slip=DIGIT:MM"),
        ("slip=toe:3", "found `toe`, expected a digit"),
    ] {
        let output = told(line);
        assert!(output.status.code() == Some(2) && stderr(&output).contains(words), "{}", stderr(&output));
    }
    // Any program can read the measurements of the vision system from its socket.
    let stream = std::os::unix::net::UnixStream::connect(&detector).expect("it listens");
    let mut line = String::new();
    std::io::BufRead::read_line(&mut std::io::BufReader::new(stream), &mut line).expect("a measurement");
    let seen = json(line.as_bytes());
    assert_eq!(seen["object"], "billiard_ball", "{seen}");
    assert_eq!(seen["covariance"].as_array().map(Vec::len), Some(36), "{seen}");
    let interrupt = Command::new("kill").args(["-INT", &devices.child.id().to_string()]).status();
    assert!(interrupt.expect("sent").success());
    let end = devices.end();
    assert!(end["ticks"].as_u64().is_some_and(|ticks| ticks > 0), "{end}");
    for recording in ["truth.rrd", "truth-2.rrd", "truth-3.rrd"] {
        assert!(fs::metadata(folder.path().join(recording)).is_ok_and(|file| file.len() > 10_000), "{recording}");
    }
    let output = told("objects=back");
    assert!(stderr(&output).contains("expected a running emulator"), "{}", stderr(&output));
}

/// Exchanged ids or cameras and a servo of another model are named by `doctor` and before anything moves.
#[test]
fn devices_in_the_wrong_place_are_named() {
    let folder = tempdir().expect("a folder");
    let mut devices = EmulatedDevices::start(folder.path(), &[]);
    let config = devices.config.clone();
    let bridge = |arguments: &[&str]| run(&[&["bridge"], arguments, &["--config", text(&config), "--json"]].concat());
    let row = |what: &str| {
        let rows = json(&bridge(&["doctor"]).stdout)["rows"].clone();
        let named = |row: &&Value| row["what"].as_str().is_some_and(|row| row.contains(what));
        let mut named: Vec<&Value> = rows.as_array().expect("rows").iter().filter(named).collect();
        // Bad rows come first.
        named.sort_by_key(|row| row["ok"] == true);
        named.first().copied().cloned()
    };
    let until_wrong = |what: &str| {
        // Some rows exist only once something is wrong.
        std::iter::repeat_with(|| row(what)).take(200).flatten().find(|row| row["ok"] == false).expect("it is noticed")
    };
    let refused = |arguments: &[&str]| {
        let output = bridge(arguments);
        assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
        stderr(&output)
    };
    let pads = "every camera shows its own pad";
    assert_eq!(row(pads).expect("its row")["found"], "unknown: no references");
    bridge(&["doctor", "--store-references"]);
    assert_eq!(row(pads).expect("its row")["found"], "yes");
    devices.happen("swap=7");
    let found = until_wrong(pads)["found"].clone();
    assert_eq!(found, "camera 7 shows the pad of 8, camera 8 shows the pad of 7");
    let message = refused(&["register", "--yes"]);
    assert!(message.contains("camera 7 shows the pad of 8"), "{message}");

    devices.happen("ids=2");
    until_wrong("homing offset");
    let message = refused(&["exercise", "--yes"]);
    assert!(message.contains("index: found homing offset") && message.contains("it is that of middle"), "{message}");
    devices.happen("model=3");
    until_wrong("Model Number");
    for command in ["calibrate", "exercise"] {
        let message = refused(&[command, "--yes"]);
        assert!(message.contains("1200") && message.contains("1220"), "{message}");
    }
    // The adapter is unplugged: the message is in plain words, not that of the operating system.
    devices.happen("usb=servos");
    let message = (0..200).map(|_| stderr(&bridge(&["calibrate", "--yes"]))).find(|message| !message.contains("1200"));
    let message = message.expect("it is noticed");
    assert!(message.contains("the port is gone") || message.contains("No such file"), "{message}");
}
