//! The operator's actions and information beside a trial, on emulated devices: faults of the arm distinguished and
//! cleared, Ctrl-C, secrets, locks, disk space.

use std::fs::{self, Permissions};
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use crate::devices::{EmulatedDevices, json, text, wait_for_trial};
use e2e::{ftac, run, stderr};
use serde_json::Value;
use tempfile::tempdir;

/// Runs `ftac bridge` with a configuration.
fn bridge(arguments: &[&str], config: &Path) -> Output {
    run(&[&["bridge"], arguments, &["--config", text(config), "--json"]].concat())
}

/// Returns the row of `bridge doctor` about the arm.
fn arm_row(config: &Path) -> Value {
    let rows = json(&bridge(&["doctor"], config).stdout)["rows"].clone();
    rows.as_array().expect("rows").iter().find(|row| row["what"] == "arm").expect("its row").clone()
}

/// Waits until `there` is true of the row of `bridge doctor` about the arm.
fn arm_until(config: &Path, there: impl Fn(&Value) -> bool) -> Value {
    std::iter::repeat_with(|| arm_row(config)).take(200).find(there).expect("the arm gets there")
}

fn replace(config: &Path, from: &str, to: &str) {
    let before = fs::read_to_string(config).expect("there");
    assert!(before.contains(from), "{before}");
    fs::write(config, before.replace(from, to)).expect("written");
}

/// Each fault of the arm is named, and cleared only when it is over and the operator agrees.
#[test]
fn faults_of_the_arm_are_told_apart_and_cleared() {
    let folder = tempdir().expect("a folder");
    let mut devices = EmulatedDevices::start(folder.path(), &[]);
    let config = devices.config.clone();
    assert_eq!(arm_row(&config)["ok"], true);

    // Emergency stop: clearing is refused while it is pressed.
    devices.happen("arm=stop");
    let row = arm_until(&config, |row| row["ok"] == false);
    assert!(row["found"].as_str().is_some_and(|found| found.contains("emergency stop")), "{row}");
    let output = bridge(&["clear-faults", "--yes"], &config);
    assert_ne!(output.status.code(), Some(0));
    assert_eq!(arm_row(&config)["ok"], false);
    devices.happen("arm=free");
    // The operator does not agree.
    let mut asked = ftac(&["bridge", "clear-faults", "--config", text(&config)]);
    let mut asked = asked.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("starts");
    asked.stdin.take().expect("piped").write_all(b"no\n").expect("answered");
    assert_eq!(asked.wait().expect("ends").code(), Some(2));
    assert_eq!(arm_row(&config)["ok"], false);
    let output = bridge(&["clear-faults", "--yes"], &config);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let cleared = json(&output.stdout);
    assert!(cleared["before"].as_str().is_some_and(|before| before.contains("emergency")), "{cleared}");
    assert_eq!(cleared["now"], "none");
    assert_eq!(arm_row(&config)["ok"], true);

    // A fault of a joint.
    devices.happen("arm=fault");
    let row = arm_until(&config, |row| row["ok"] == false);
    let found = row["found"].as_str().expect("text");
    assert!(found.contains("joint 3: following error") && !found.contains("emergency"), "{row}");
    assert_eq!(bridge(&["clear-faults", "--yes"], &config).status.code(), Some(0));

    // A wrong password, which is not printed.
    let password = config.with_file_name("arm-password");
    let right = fs::read(&password).expect("there");
    fs::write(&password, "hunter2hunter2\n").expect("written");
    let row = arm_row(&config);
    assert!(row["found"].as_str().is_some_and(|found| found.contains("wrong user or password")), "{row}");
    assert!(!row.to_string().contains("hunter2"), "{row}");
    fs::write(&password, right).expect("written");

    // A port without a listener (port 1 of the loopback interface).
    let whole = fs::read_to_string(&config).expect("there");
    let line = whole.lines().find(|line| line.starts_with("tcp_port")).expect("the emulated arm's port").to_owned();
    replace(&config, &line, "tcp_port = 1");
    let row = arm_row(&config);
    assert!(row["found"].as_str().is_some_and(|found| found.contains("no arm at this port")), "{row}");
}

/// The arm ends a session without a heartbeat for 2 s. A question to the operator takes longer, and the arm is still
/// connected at the answer.
#[test]
fn an_operator_who_thinks_does_not_lose_the_arm() {
    let folder = tempdir().expect("a folder");
    let mut devices = EmulatedDevices::start(folder.path(), &[]);
    let config = devices.config.clone();
    devices.happen("arm=fault");
    arm_until(&config, |row| row["ok"] == false);
    let mut asked = ftac(&["bridge", "clear-faults", "--config", text(&config), "--json"]);
    let mut asked = asked.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("starts");
    let mut said = BufReader::new(asked.stderr.take().expect("piped"));
    // The fault is printed right before the question.
    let mut line = String::new();
    said.read_line(&mut line).expect("told");
    assert!(line.contains("following error"), "{line}");
    std::thread::sleep(Duration::from_secs(4));
    asked.stdin.take().expect("piped").write_all(b"yes\n").expect("answered");
    let output = asked.wait_with_output().expect("ends");
    let mut rest = String::new();
    said.read_to_string(&mut rest).expect("read");
    assert_eq!(output.status.code(), Some(0), "{rest}");
    assert_eq!(json(&output.stdout)["now"], "none");
}

/// A servo that shut down, and a supply voltage that was too low: servos are restarted on request, and checked afterwards.
#[test]
fn servos_that_shut_down_are_restarted() {
    let folder = tempdir().expect("a folder");
    let mut devices = EmulatedDevices::start(folder.path(), &[]);
    let config = devices.config.clone();
    let none = bridge(&["reboot", "--yes"], &config);
    assert_eq!((none.status.code(), json(&none.stdout)["restarted"].clone()), (Some(0), serde_json::json!([])));
    let row = |output: &Output, what: &str| {
        let rows = json(&output.stdout)["rows"].as_array().cloned().expect("rows");
        rows.into_iter().find(|row| row["what"] == what).unwrap_or_else(|| panic!("{what}: {}", json(&output.stdout)))
    };
    devices.happen("overload=3");
    let error = "middle (3): Hardware Error Status";
    let mut looks = std::iter::repeat_with(|| bridge(&["doctor"], &config)).take(200);
    let doctor = looks.find(|output| row(output, error)["ok"] == false).expect("it shuts down");
    assert_eq!(row(&doctor, error)["found"], "overload");

    // The operator does not agree: the servo stays as it is.
    let mut asked = ftac(&["bridge", "reboot", "--config", text(&config)]);
    let mut asked = asked.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("starts");
    asked.stdin.take().expect("piped").write_all(b"no\n").expect("answered");
    let output = asked.wait_with_output().expect("ends");
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("middle (id 3) reports: overload") && said.contains("which drops its object"), "{said}");
    assert_eq!(row(&bridge(&["doctor"], &config), error)["ok"], false);

    let output = bridge(&["reboot", "--yes"], &config);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let restarted = json(&output.stdout)["restarted"].clone();
    assert_eq!(restarted, serde_json::json!([{"actuator": "middle", "id": 3, "reported": "overload"}]));
    assert_eq!(row(&output, "middle (3): torque")["found"], "off");
    assert_eq!(row(&bridge(&["doctor"], &config), error)["ok"], true);

    // While the supply voltage is too low, a restart does not help, and the command reports it.
    devices.happen("voltage=5.2");
    let low = || bridge(&["reboot", "--actuator", "thumb", "--yes"], &config);
    let mut tries = std::iter::repeat_with(low).take(200);
    let low = tries.find(|output| output.status.code() == Some(1)).expect("too low");
    assert!(stderr(&low).contains("thumb (1)"), "{}", stderr(&low));
    devices.happen("voltage=11.1");
    let mut tries = std::iter::repeat_with(|| bridge(&["reboot", "--yes"], &config)).take(20);
    assert!(tries.any(|output| output.status.code() == Some(0)), "all are back");
    assert_eq!(row(&bridge(&["doctor"], &config), error)["ok"], true);
}

/// Faults of the robot are reported before anybody is asked to lay out objects.
#[test]
fn nobody_lays_out_objects_for_a_robot_that_is_not_in_order() {
    let folder = tempdir().expect("a folder");
    let mut devices = EmulatedDevices::start(folder.path(), &[]);
    let (config, sessions) = (devices.config.clone(), folder.path().join("sessions"));
    let trial = ["trial", "0", "--policy", "blind", "--robot", "hardware", "--session", text(&sessions)];
    let told = |command: &[&str], config: &Path, what: &str| {
        let output = run(&[command, &["--config", text(config)]].concat());
        let message = stderr(&output);
        assert!(matches!(output.status.code(), Some(1 | 2)), "{what}: {message}");
        assert!(message.contains(what), "{what}: {message}");
        for question in ["  put ", "Enter begins", "on their marks"] {
            assert!(!message.contains(question), "{what}: {message}");
        }
    };
    let password = config.with_file_name("arm-password");
    let right = fs::read(&password).expect("there");
    fs::write(&password, "wrong\n").expect("written");
    for command in [&trial[..], &["bridge", "register"]] {
        told(command, &config, "wrong user or password");
    }
    fs::write(&password, right).expect("written");
    let calibration = config.with_file_name("calibration.json");
    let kept = fs::read(&calibration).expect("there");
    fs::remove_file(&calibration).expect("removed");
    told(&trial, &config, "calibration.json");
    fs::write(&calibration, kept).expect("written");
    devices.happen("overload=2");
    let doctor = || !bridge(&["doctor"], &config).status.success();
    assert!(std::iter::repeat_with(doctor).take(200).any(|bad| bad), "it shuts down");
    told(&trial, &config, "overload");
    told(&["bridge", "calibrate"], &config, "overload");
}

/// Ctrl-C in mid-trial: the robot holds, the program asks, opens the hand on request, and ends; the recording is complete.
#[test]
fn ctrl_c_ends_in_order() {
    let folder = tempdir().expect("a folder");
    let devices = EmulatedDevices::start(folder.path(), &[]);
    let sessions = folder.path().join("sessions");
    let (config, recording) = (text(&devices.config), folder.path().join("trial.rrd"));
    let arguments = ["trial", "0", "--policy", "blind", "--robot", "hardware", "--config", config];
    let arguments = [&arguments[..], &["--session", text(&sessions), "--out", text(&recording)]].concat();
    let mut host =
        ftac(&arguments).stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("starts");
    let mut operator = host.stdin.take().expect("piped");
    operator.write_all(b"\n").expect("go");
    wait_for_trial(&mut host, &sessions);
    // A second program gets an error that names the process that uses the servos.
    let second = bridge(&["scan"], &devices.config);
    assert_eq!(second.status.code(), Some(2));
    let message = stderr(&second);
    assert!(message.contains(&format!("in use by process {}", host.id())) && message.contains("trial 0"), "{message}");
    // Only the owner may use the stop socket.
    let socket = devices.config.with_file_name("stop");
    assert_eq!(fs::metadata(&socket).expect("open").permissions().mode() & 0o777, 0o600);

    let interrupt = Command::new("kill").args(["-INT", &host.id().to_string()]).status();
    assert!(interrupt.expect("sent").success());
    operator.write_all(b"release\n").expect("answered");
    let output = host.wait_with_output().expect("ends");
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("STOPPED: hold: the operator stopped it"), "{message}");
    assert!(!message.contains("left holding"), "{message}");
    // Torque is off: a released hand can be calibrated, as a held one could, but the servos themselves report it.
    let session = fs::read_dir(&sessions).expect("a folder").next().expect("a file").expect("an entry").path();
    let replayed = json(&run(&["replay", text(&session), "--json"]).stdout);
    assert_eq!((&replayed["complete"], &replayed["difference"]), (&Value::Bool(true), &Value::Null));
    assert!(recording.exists(), "what was seen until then");
    // The password is in no recording.
    let secret = fs::read_to_string(devices.config.with_file_name("arm-password")).expect("there");
    let bytes = fs::read(&session).expect("readable");
    assert!(!bytes.windows(secret.trim().len()).any(|window| window == secret.trim().as_bytes()));
}

/// A file with a password that others can read is refused; no output contains the password.
#[test]
fn passwords_are_for_their_owner_alone() {
    let folder = tempdir().expect("a folder");
    let config = folder.path().join("bridge.toml");
    let toml = "version = 1\ncalibration = \"c.json\"\nstop_socket = \"stop\"\n[servos]\nport = \"/dev/null\"\n\
                ids = [1, 2, 3, 4, 5, 6]\n[arm]\nkind = \"kortex\"\nhost = \"localhost\"\nuser = \"ftac\"\n";
    let inline = format!("{toml}password = \"hunter2hunter2\"\n");
    let doctor = |mode: u32, content: &str| {
        fs::write(&config, content).expect("written");
        fs::set_permissions(&config, Permissions::from_mode(mode)).expect("set");
        let output = ftac(&["bridge", "doctor", "--config", text(&config)])
            .env_remove("FTAC_ARM_PASSWORD")
            .output()
            .expect("runs");
        let said = format!("{}{}", stderr(&output), String::from_utf8_lossy(&output.stdout));
        assert!(!said.contains("hunter2"), "{said}");
        (output.status.code(), said)
    };
    let (code, said) = doctor(0o644, &inline);
    assert!(code == Some(2) && said.contains("mode 644") && said.contains("chmod 600"), "{said}");
    assert_eq!(doctor(0o600, &inline).0, Some(1), "read, and nothing found at /dev/null");
    let (code, said) = doctor(0o644, toml);
    assert!(code == Some(2) && said.contains("password_file") && said.contains("FTAC_ARM_PASSWORD"), "{said}");
    // Nor if the file is invalid TOML.
    let (code, said) = doctor(0o600, &format!("{toml}password = hunter2hunter2\n"));
    assert!(code == Some(2) && said.contains("line 11"), "{said}");
    let output = ftac(&["bridge", "doctor", "--config", text(&config)]).env("FTAC_ARM_PASSWORD", "hunter2").output();
    assert!(!stderr(&output.expect("runs")).contains("hunter2"));
}

/// If a session cannot be written, nothing is asked and nothing moves.
#[test]
fn a_folder_without_room_is_found_before_the_first_motion() {
    let folder = tempdir().expect("a folder");
    let devices = EmulatedDevices::start(folder.path(), &[]);
    let file = folder.path().join("file");
    fs::write(&file, "x").expect("written");
    let sessions = file.join("sessions");
    let arguments = ["trial", "0", "--policy", "blind", "--robot", "hardware", "--config", text(&devices.config)];
    let output = run(&[&arguments[..], &["--session", text(&sessions)]].concat());
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    let message = stderr(&output);
    assert!(message.contains(text(&sessions)) && !message.contains("The arm will move"), "{message}");
}

/// A session that ends before its first command is not identical.
#[test]
fn a_session_without_a_command_is_not_called_identical() {
    let folder = tempdir().expect("a folder");
    let (sessions, out) = (folder.path().join("sessions"), folder.path().join("trial.rrd"));
    let output = run(&["trial", "0", "--policy", "ideal", "--session", text(&sessions), "--out", text(&out)]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let session = fs::read_dir(&sessions).expect("a folder").next().expect("a file").expect("an entry").path();
    let bytes = fs::read(&session).expect("readable");
    // The header is longer than 4 kB, and the first chunk of a tick ends later: the first images are in the second chunk.
    let cut = (1..).map(|n| 1000 * n).find(|cut| {
        fs::write(&session, &bytes[..*cut]).expect("written");
        run(&["replay", text(&session), "--json"]).status.code() != Some(2)
    });
    let output = run(&["replay", text(&session), "--json"]);
    assert_eq!(output.status.code(), Some(1), "cut at {cut:?}: {}", stderr(&output));
    assert!(stderr(&output).contains("nothing was compared"), "{}", stderr(&output));
    let exported = run(&["export", "rrd", text(&session), "--json"]);
    assert_eq!(exported.status.code(), Some(2), "{}", stderr(&exported));
    assert!(!session.with_extension("rrd").exists() && !session.with_extension("partial.rrd").exists());
}

/// The setup of the computer is written below a folder: the files name the port; the stop at shutdown runs nothing that
/// a user can change; without root, no system file is touched; files of others stay.
#[test]
fn the_computer_is_set_up() {
    let folder = tempdir().expect("a folder");
    let (config, root) = (folder.path().join("bridge.toml"), folder.path().join("root"));
    let port = "/dev/serial/by-id/usb-FTDI_USB__-__Serial_Converter_FT4TFKX0-if00-port0";
    let content = format!(
        "version = 1\ncalibration = \"calibration.json\"\nstop_socket = \"stop\"\n[servos]\nport = \"{port}\"\n\
         ids = [1, 2, 3, 4, 5, 6]\n[arm]\nkind = \"loopback\"\n"
    );
    fs::write(&config, content).expect("written");
    let asked = ["bridge", "install", "--config", text(&config), "--root", text(&root), "--json"];
    let output = run(&asked);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let files = json(&output.stdout)["files"].as_array().cloned().expect("files");
    let path = |n: usize| Path::new(files[n]["path"].as_str().expect("a path"));
    let [rules, unit] = [0, 5].map(|n| fs::read_to_string(path(n)).expect("written"));
    assert!(files.len() == 6 && rules.contains("ATTRS{serial}==\"FT4TFKX0\""), "{files:?} {rules}");
    // The copied program runs at shutdown, without a configuration.
    let program = fs::metadata(path(4)).expect("copied");
    assert!(program.permissions().mode() & 0o777 == 0o755 && program.len() > 1_000_000);
    assert!(unit.contains("DynamicUser=yes") && !unit.contains(text(folder.path())), "{unit}");
    let removed = run(&[&asked[..], &["--remove"]].concat());
    assert_eq!(removed.status.code(), Some(0), "{}", stderr(&removed));
    assert!(files.iter().all(|file| !Path::new(file["path"].as_str().expect("a path")).exists()));
    let unit = files[5]["path"].as_str().expect("a path");
    fs::write(unit, "[Unit]\n").expect("written");
    let refused = run(&asked);
    assert_eq!(refused.status.code(), Some(2));
    assert!(stderr(&refused).contains("a foreign file"), "{}", stderr(&refused));
}

/// The sheet for the table has full size: the objects of the benchmark stand 280 mm apart.
#[test]
fn objects_are_drawn_where_they_stand() {
    let folder = tempdir().expect("a folder");
    let sheet = folder.path().join("sheet.svg");
    let output = run(&["bridge", "sheet", "0", "--out", text(&sheet), "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let objects = json(&output.stdout)["objects"].clone();
    let place = |n: usize, axis: &str| objects[n][axis].as_f64().expect("a number");
    let svg = fs::read_to_string(&sheet).expect("drawn");
    assert!(svg.contains("width=\"420mm\" height=\"297mm\" viewBox=\"0 0 420 297\""), "A3 in millimetres");
    // Marks of the two centres: `M<left> <y>H...`, 4 mm to the left of each.
    let centres: Vec<[f64; 2]> = svg
        .lines()
        .filter(|line| line.contains("stroke=\"#036\""))
        .map(|line| {
            let path = line.split('"').nth(1).expect("its path");
            let mut numbers = path.split(|c: char| c.is_ascii_uppercase() || c == ' ').filter_map(|n| n.parse().ok());
            [numbers.next().map(|left: f64| left + 4.0).expect("x"), numbers.next().expect("y")]
        })
        .collect();
    assert_eq!(centres.len(), 2, "{svg}");
    // On the sheet the world's y points to the left, its x upwards.
    let apart = [place(0, "y_m") - place(1, "y_m"), place(0, "x_m") - place(1, "x_m")].map(|metres| 1e3 * metres);
    assert!((apart[0] - 280.0).abs() < 1.0, "{objects}");
    assert!((centres[1][0] - centres[0][0] - apart[0]).abs() < 1e-6, "{centres:?}");
    assert!((centres[1][1] - centres[0][1] - apart[1]).abs() < 1e-6, "{centres:?}");
    let wrong = run(&["bridge", "sheet", "99", "--out", text(&sheet)]);
    assert_eq!(wrong.status.code(), Some(2), "{}", stderr(&wrong));
}
