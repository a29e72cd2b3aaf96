//! The first day with a hand, on emulated devices in real time: bring-up from cold, and the first trial, without
//! cameras and watched by the operator.

use std::fs;
use std::io::{BufRead as _, BufReader, Write};
use std::path::Path;
use std::process::Stdio;

use crate::devices::{EmulatedDevices, json, text};
use e2e::{ftac, run, stderr};
use serde_json::Value;
use tempfile::tempdir;

/// Runs `ftac bridge` with a configuration.
fn bridge(arguments: &[&str], config: &Path) -> std::process::Output {
    run(&[&["bridge"], arguments, &["--config", text(config), "--json"]].concat())
}

/// All servos of the simulated hand are calibrated from cold, and the calibration holds at the next connection.
#[test]
fn a_cold_hand_is_calibrated() {
    let folder = tempdir().expect("a folder");
    let devices = EmulatedDevices::start_cold(folder.path(), &[]);
    let output = bridge(&["calibrate", "--yes"], &devices.config);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let crc = json(&output.stdout)["crc"].clone();
    let calibration = devices.config.with_file_name("calibration.json");
    let written = json(&fs::read(&calibration).expect("written"));
    assert_eq!(written["crc"], crc);
    // The emulated servo horns stand at multiples of 700 counts, where the cables are slack; an end stop gives by a few
    // counts.
    for (n, servo) in written["servos"].as_array().expect("six").iter().enumerate() {
        let mark = -servo["homing_offset"].as_i64().expect("a number");
        let off = (mark - 700 * (n as i64 + 1)).rem_euclid(4096);
        assert!(off.min(4096 - off) < 20, "{servo}");
        let travel = servo["travel"].as_f64().expect("a number");
        assert!((1.4..4.7).contains(&travel), "{servo}");
    }
    assert!(!calibration.with_file_name("calibration.json.part").exists());
    let doctor = json(&bridge(&["doctor"], &devices.config).stdout);
    let rows = doctor["rows"].as_array().expect("rows");
    let row = rows.iter().find(|row| row["what"] == "calibration").expect("its row");
    assert_eq!((&row["found"], &row["ok"]), (&crc, &Value::Bool(true)));
}

/// Applies an event to servo 6, and waits until this number of servos answers.
fn servo_6(devices: &mut EmulatedDevices, event: &str, servos: usize) {
    devices.happen(event);
    let found = || json(&bridge(&["scan"], &devices.config).stdout)["servos"].as_array().map_or(0, Vec::len);
    assert!((0..100).any(|_| found() == servos), "{servos} servos after {event}");
}

/// A calibration that fails at the last servo changes neither servos nor file, keeps its results so far, and resumes
/// from there.
#[test]
fn a_failed_calibration_changes_nothing_and_goes_on() {
    let folder = tempdir().expect("a folder");
    let mut devices = EmulatedDevices::start(folder.path(), &["--springs"]);
    let calibration = devices.config.with_file_name("calibration.json");
    let before = fs::read(&calibration).expect("there");
    // A missing servo is detected before any motion.
    servo_6(&mut devices, "unplug=6", 5);
    let output = bridge(&["calibrate", "--yes"], &devices.config);
    assert!(output.status.code() == Some(2) && stderr(&output).contains("before any motion"), "{}", stderr(&output));
    servo_6(&mut devices, "plug=6", 6);
    // Servo 6 is unplugged while the others are calibrated.
    let arguments = ["bridge", "calibrate", "--yes", "--json", "--config", text(&devices.config)];
    let mut felt = ftac(&arguments).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("starts");
    let mut lines = BufReader::new(felt.stderr.take().expect("piped")).lines().map_while(Result::ok);
    assert!(lines.any(|line| line.starts_with("thumb")), "the first is found");
    devices.happen("unplug=6");
    let message = lines.collect::<Vec<_>>().join("\n");
    assert_eq!(felt.wait().expect("ends").code(), Some(2), "{message}");
    for words in ["opposition", "the last calibration is kept", "--continue"] {
        assert!(message.contains(words), "{message}");
    }
    assert_eq!(fs::read(&calibration).expect("there"), before);
    let kept = json(&fs::read(calibration.with_file_name("calibration.json.part")).expect("kept"));
    assert_eq!(kept.as_array().map(Vec::len), Some(5));
    servo_6(&mut devices, "plug=6", 6);
    // The servos still have the homing offsets of the last calibration.
    let rows = json(&bridge(&["doctor"], &devices.config).stdout)["rows"].clone();
    let row = rows.as_array().expect("rows").iter().find(|row| row["what"] == "calibration");
    assert_eq!(row.expect("its row")["ok"], true, "{rows}");
    let output = bridge(&["calibrate", "--yes", "--continue"], &devices.config);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let felt = stderr(&output);
    assert!(felt.contains("opposition") && !felt.contains("little"), "only what was missing: {felt}");
}

/// A hand without cameras: `touch` is refused before anything moves; `blind` runs to its verdict, streams measurements
/// and estimates into a recording, and replays to the bit.
#[test]
fn a_hand_without_cameras_runs_blind() {
    let folder = tempdir().expect("a folder");
    let devices = EmulatedDevices::start(folder.path(), &[]);
    let whole = fs::read_to_string(&devices.config).expect("there");
    let start = whole.find("[cameras]").expect("its section");
    let end = start + whole[start + 1..].find('[').expect("the next section");
    fs::write(&devices.config, format!("{}{}", &whole[..start], &whole[end..])).expect("written");
    let sessions = folder.path().join("sessions");
    let recording = folder.path().join("trial.rrd");
    let usual = ["--robot", "hardware", "--config", text(&devices.config), "--session", text(&sessions)];
    let output = run(&[&["trial", "0", "--policy", "touch"], &usual[..]].concat());
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert!(stderr(&output).contains("[cameras]"), "{}", stderr(&output));
    assert!(!sessions.exists(), "nothing was begun");

    let arguments = [&["trial", "0", "--policy", "blind", "--out", text(&recording)], &usual[..]].concat();
    let mut host =
        ftac(&arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("starts");
    // Answers of the operator: go; no unwanted contact; both held; open the hand.
    host.stdin.take().expect("piped").write_all(b"\nno\nyes\nrelease\n").expect("the operator answers");
    let output = host.wait_with_output().expect("ends");
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let bytes = fs::metadata(&recording).expect("recorded").len();
    let session = fs::read_dir(&sessions).expect("a folder").next().expect("a file").expect("an entry").path();
    let replayed = run(&["replay", text(&session), "--json"]);
    let found = json(&replayed.stdout);
    assert_eq!((replayed.status.code(), &found["difference"]), (Some(0), &Value::Null), "{}", stderr(&replayed));
    assert!(found["identical_commands"].as_u64().is_some_and(|commands| commands > 500), "{found}");

    // A folder means all sessions in it.
    let all = run(&["replay", text(&sessions), "--json"]);
    let rows = json(&all.stdout)["sessions"].clone();
    assert_eq!((all.status.code(), rows.as_array().map(Vec::len)), (Some(0), Some(1)), "{}", stderr(&all));
    assert_eq!((&rows[0]["replayed"], &rows[0]["shortfall"]), (&found, &Value::Null));

    // The recording can be made again from the session alone.
    let exported = folder.path().join("exported.rrd");
    let output = run(&["export", "rrd", text(&session), "--out", text(&exported), "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert_eq!(json(&output.stdout)["ticks"], found["ticks"]);
    let again = fs::metadata(&exported).expect("exported").len();
    // Writing in larger pieces gives a smaller file.
    assert!(again > 500_000 && bytes > 500_000 && again < 2 * bytes, "{bytes} bytes live, {again} exported");
}
