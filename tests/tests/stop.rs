//! `ftac bridge stop` as an operator uses it in another terminal: by the stop socket alone, with the state read back.

use std::fs;
use std::io::{Read as _, Write as _};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::Duration;

use crate::devices::{EmulatedDevices, json, text};
use e2e::{ftac, stderr};
use tempfile::tempdir;

/// Runs `ftac bridge stop` with an empty environment.
fn stop(config: &Path, extra: &[&str]) -> Output {
    let arguments = [&["bridge", "stop", "--json", "--config", text(config)], extra].concat();
    let mut bare = Command::new(ftac(&[]).get_program());
    bare.args(arguments).env_clear().env("FTAC_LOG", "").current_dir("/").output().expect("runs")
}

/// Returns the state from the robot's stop socket beside its configuration; empty if there is none.
fn state(config: &Path) -> String {
    let mut answer = String::new();
    if let Ok(mut stream) = UnixStream::connect(config.with_file_name("stop")) {
        let _ = stream.write_all(b"state\n").and_then(|()| stream.read_to_string(&mut answer));
    }
    answer
}

/// Starts a robot that moves until it is stopped. The password of its arm is only in its environment.
fn exercising(config: &Path, password: &str) -> Child {
    let arguments = ["bridge", "exercise", "--yes", "--times", "100000", "--current", "0.02", "--config", text(config)];
    let mut command = ftac(&arguments);
    command.env("FTAC_ARM_PASSWORD", password).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
    command.spawn().expect("starts")
}

/// The stop needs only the socket: the other terminal has no password, and the configuration is half-edited. The robot
/// that was started with it holds, and the reported state was measured.
#[test]
fn a_stop_needs_the_socket_alone() {
    let folder = tempdir().expect("a folder");
    let devices = EmulatedDevices::start(folder.path(), &[]);
    let config = devices.config.clone();
    let secret = config.with_file_name("arm-password");
    let password = fs::read_to_string(&secret).expect("there").trim().to_owned();
    fs::remove_file(&secret).expect("removed");
    let whole = fs::read_to_string(&config).expect("there");
    let without = whole.lines().filter(|line| !line.starts_with("password_file")).collect::<Vec<_>>().join("\n");
    fs::write(&config, without).expect("written");

    let nobody = stop(&config, &[]);
    assert_eq!(nobody.status.code(), Some(1), "{}", stderr(&nobody));
    assert!(
        stderr(&nobody).contains("no bridge is running that this user may stop (looked in "),
        "{}",
        stderr(&nobody)
    );

    let mut robot = exercising(&config, &password);
    fs::write(config.with_file_name("other.toml"), "").expect("written");
    // Wait until the robot moves; then cut the file to half a line.
    while !state(&config).contains("running") {
        assert!(robot.try_wait().expect("ours").is_none(), "the robot ended by itself");
        std::thread::sleep(Duration::from_millis(20));
    }
    fs::write(&config, "version = 1\n[serv").expect("written");
    let other = stop(&config.with_file_name("other.toml"), &[]);
    assert_eq!(other.status.code(), Some(1), "another robot's configuration does not mean this one");
    let held = stop(&config, &[]);
    assert_eq!(held.status.code(), Some(0), "{}", stderr(&held));
    let told = json(&held.stdout)["robots"][0].clone();
    let words = told["state"].as_str().expect("words");
    // The number of recent answers depends on the machine.
    assert!(words.starts_with("hold: the operator stopped it; ") && words.ends_with("of 6 servos answer"), "{told}");
    assert!(told["robot"].as_str().expect("words").contains(text(&config)), "{told}");
    let mut said = String::new();
    robot.stderr.take().expect("piped").read_to_string(&mut said).expect("read");
    assert_eq!(robot.wait().expect("ours").code(), Some(1));
    assert!(said.contains("hold: the operator stopped it; "), "{said}");
}

/// A release without a running bridge reports the number of servos whose torque was read back as off, and fails if
/// these are not all.
#[test]
fn a_release_states_what_was_read_back() {
    let folder = tempdir().expect("a folder");
    let mut devices = EmulatedDevices::start(folder.path(), &[]);
    let config = devices.config.clone();
    let whole = fs::read_to_string(&config).expect("there");
    fs::write(&config, whole.replace("slack = 0.5", "slack = 0.1")).expect("written");
    let output = stop(&config, &["--release"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert_eq!(json(&output.stdout)["state"], "torque read back as off from 6 of 6 servos");
    (1..=6).for_each(|id| devices.happen(&format!("unplug={id}")));
    let output = loop {
        let output = stop(&config, &["--release"]);
        if !output.status.success() {
            break output;
        }
    };
    let (told, said) = (json(&output.stdout), stderr(&output));
    assert_eq!(output.status.code(), Some(1), "{said}");
    // The plugs are pulled one after the other.
    assert!(told["torque_unknown"].as_array().is_some_and(|unsure| !unsure.is_empty()), "{told}");
    assert!(said.contains("the torque may be on: ") && said.contains("no answer"), "{said}");
}
