//! Third-party readers on our files: PyPI's mcap, with its protobuf decoder.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use robot_session_log::{Direction, SessionEvent, SessionWriter};
use serde_json::Value;

use crate::support::*;

const PACKAGES: [&str; 2] = ["mcap==1.6.0", "mcap-protobuf-support==0.6.0"];

/// Returns a Python with both packages; `None`, with a loud message, if there is no Python or no access to the
/// packages.
fn python() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("mcap-readers");
    let (python, ready) = (folder.join("bin/python"), folder.join("ready"));
    if ready.exists() {
        return Some(python);
    }
    let mut make = Command::new("python3");
    make.args(["-m", "venv", "--clear"]).arg(&folder);
    let mut install = Command::new(&python);
    install.args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"]).args(PACKAGES);
    for step in [&mut make, &mut install] {
        let failed = match step.output() {
            Ok(output) if output.status.success() => continue,
            Ok(output) => String::from_utf8_lossy(&output.stderr).into_owned(),
            Err(error) => error.to_string(),
        };
        eprintln!("SKIPPED: {PACKAGES:?} as readers of our sessions: {step:?}: {failed}");
        return None;
    }
    std::fs::write(ready, "").expect("written");
    Some(python)
}

fn read_by(python: &Path, path: &Path, how: &str) -> Value {
    let script = Path::new("tests/session_log/read_mcap.py");
    let output = Command::new(python).arg(script).arg(path).arg(how).output().expect("runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("JSON")
}

/// Parses Python's hexadecimal notation of a number, which keeps all bits.
fn from_python_hex(text: &str) -> f64 {
    let (sign, digits) = text.strip_prefix('-').map_or((1.0, text), |digits| (-1.0, digits));
    let (mantissa, exponent) = digits.trim_start_matches("0x").split_once('p').expect("a hexadecimal float");
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let digits = u64::from_str_radix(&format!("{whole}{fraction}"), 16).expect("digits") as f64;
    let exponent: i32 = exponent.parse().expect("an exponent");
    sign * digits * 2_f64.powi(exponent - 4 * fraction.len() as i32)
}

#[test]
fn pypi_mcap_reads_a_session() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("session.mcap");
    let mut writer = SessionWriter::create(&path, &session()).expect("a new file");
    let device = Duration::from_secs(5);
    writer.raw("arm_udp", Direction::Received, Duration::ZERO, device, &[0xDE, 0xAD, 0]).expect("written");
    let mut recorder = robot_session_log::SessionRecorder::new(ToyRobot::new(), writer);
    drive(&mut recorder, 50);
    recorder.finish().1.expect("written");

    let found = read_by(&python, &path, "finished");
    let topics = &found["topics"];
    for topic in ["observation", "command/requested", "command/sent", "tick"] {
        assert_eq!(topics[topic], 50, "{topics}");
    }
    assert_eq!((&topics["raw/arm_udp/received"], &found["raw"][0]), (&Value::from(1), &Value::from("dead00")));
    assert_eq!((found["statistics"].as_u64(), found["sorted"].as_bool()), (Some(204), Some(true)));
    assert_eq!(found["session"]["seed"], "7");
    assert_eq!(found["session"]["configuration_sha256"], found["files"]["configuration"]);

    let (events, _) = read(&path);
    let images: Vec<String> = (events.iter())
        .filter_map(|event| match event {
            SessionEvent::Observation(readings) => Some(&readings.tactile),
            _ => None,
        })
        .flatten()
        .map(|frame| frame.image.rgb.iter().map(|byte| format!("{byte:02x}")).collect())
        .collect();
    assert!(images.windows(2).any(|pair| pair[0] != pair[1]) && images.windows(2).any(|pair| pair[0] == pair[1]));
    assert_eq!(found["images"], Value::from(images), "new and repeated images");

    // The numbers themselves, bit by bit.
    let sent = events.iter().filter_map(|event| match event {
        SessionEvent::SentCommand(command) => Some(command),
        _ => None,
    });
    for (tick, command) in sent.enumerate() {
        for (joint, angle) in command.arm.iter().enumerate() {
            let theirs = from_python_hex(found["arm"][tick][joint].as_str().expect("text"));
            assert_eq!(theirs.to_bits(), angle.to_bits(), "tick {tick}, joint {}", joint + 1);
        }
    }
}

/// A file without an end, as a killed program leaves it, is read up to its last whole tick.
#[test]
fn pypi_mcap_reads_a_session_cut_short() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("session.mcap");
    record(&path, 20);
    let bytes = std::fs::read(&path).expect("readable");
    std::fs::write(&path, &bytes[..bytes.len() / 2]).expect("written");
    let (events, ended) = read(&path);
    assert!(matches!(ended, Ok(false)));
    let found = read_by(&python, &path, "cut");
    assert_eq!(found["topics"]["tick"].as_u64(), Some(ticks(&events) as u64));
    assert_eq!(found["cut"], true);
}
