//! A robot instance: excited, interrupted, identified, used.

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use e2e::{ftac, run, stderr};
use serde_json::Value;
use tempfile::tempdir;

/// Excitation script: every actuator once, in one posture.
const EXCITATION_SCRIPT: &str = r#"
version = 1
open_current = 0.15
open_time = 1.0
stay = 0.2
slack = 0.3
arm_speed = 0.5
[[posture]]
name = "ready"
turn = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
[[motion]]
actuators = ["index", "middle", "ring", "little"]
current = 0.07
time = 1.0
[[motion]]
actuators = ["thumb"]
current = 0.065
time = 1.0
[[motion]]
actuators = ["opposition"]
current = 0.07
time = 1.0
"#;

fn text(path: &Path) -> &str {
    path.to_str().expect("a UTF-8 path")
}

/// Returns the JSON output of a successful run.
fn json(output: &Output) -> Value {
    assert!(output.status.success(), "{}", stderr(output));
    serde_json::from_slice(&output.stdout).expect("one JSON object")
}

/// Checks that a command is refused with exit code 2 and a message with every one of `words`.
fn refused(arguments: &[&str], words: &[&str]) {
    let output = run(arguments);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "ftac {arguments:?}: {said}");
    for word in words {
        assert!(said.contains(word), "ftac {arguments:?} does not name {word:?}: {said}");
    }
}

/// From a hidden instance to a file that trials use, and errors for invalid files.
#[test]
fn a_robot_is_excited_identified_and_used() {
    let folder = tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let (script, sessions, truth, found) = (at("short.toml"), at("sessions"), at("truth.json"), at("instance.toml"));
    fs::write(&script, EXCITATION_SCRIPT).expect("written");
    let excite = ["sysid", "excite", text(&sessions), "--instance", "3", "--script", text(&script)];

    let dry = json(&run(&[&excite[..], &["--dry-run", "--json"]].concat()));
    assert_eq!((&dry["steps"], &dry["done"]), (&3.into(), &0.into()));
    assert!(!sessions.exists(), "a dry run leaves nothing behind");

    let done = json(&run(&[&excite[..], &["--truth-out", text(&truth), "--json"]].concat()));
    assert_eq!(done["done"], 3);
    assert!(fs::read_to_string(&truth).expect("the truth").contains("\"index_1.spring\""));
    let another = [&excite[..4], &["4", "--script", text(&script)]].concat();
    refused(&another, &["excitation.json", "another robot, instance or script"]);

    let identified = json(&run(&["sysid", "identify", text(&sessions), "--out", text(&found), "--json"]));
    for row in identified["actuators"].as_array().expect("rows") {
        let [before, after] = ["residual_before", "residual_after"].map(|key| row[key].as_f64().expect("a number"));
        assert!(after < 0.2 * before, "{row}");
    }
    let page = fs::read_to_string(found.with_extension("html")).expect("the page");
    assert!(page.contains("index_1.spring") && page.contains("Further measurements"));

    // The same robot again, bit by bit, and a session that was cut short.
    let again = at("again");
    assert!(run(&["sysid", "excite", text(&again), "--instance", "3", "--script", text(&script)]).status.success());
    let cut = fs::read(again.join("part_1.mcap")).expect("a session");
    fs::write(again.join("part_1.mcap"), &cut[..cut.len() * 4 / 5]).expect("written");
    let second = at("second.toml");
    let output = run(&["sysid", "identify", text(&again), "--out", text(&second)]);
    assert!(output.status.success() && stderr(&output).contains("cut short"), "{}", stderr(&output));

    // A trial runs with the file, and not with an edited one.
    let record = at("trial.rrd");
    let trial = ["trial", "0", "--policy", "ideal", "--out", text(&record), "--instance"];
    let output = run(&[&trial[..], &[text(&found)]].concat());
    assert!(matches!(output.status.code(), Some(0 | 1)), "{}", stderr(&output));
    let written = fs::read_to_string(&found).expect("the file");
    let edited = at("edited.toml");
    let line = written.lines().find(|line| line.starts_with("deviation")).expect("a deviation");
    fs::write(&edited, written.replacen(line, "deviation = 0.0123", 1)).expect("written");
    refused(&[&trial[..], &[text(&edited)]].concat(), &["edited.toml", "digest", "identify the robot again"]);
    fs::write(&edited, &written[..written.len() / 2]).expect("written");
    refused(&[&trial[..], &[text(&edited)]].concat(), &["edited.toml"]);
    // The other commands refuse the edited file in the same words before they do anything, and accept the good one.
    let pads = at("pads");
    for endpoint in [
        &["touch", "train", "--presses", "1", "--out", text(&pads)][..],
        &["touch", "eval", "--combos", "1", "--trials", "1"],
        &["optics", "pads", "--out", text(&pads)],
        &["bridge", "register", "--emulated", "1", "--dry-run"],
    ] {
        refused(&[endpoint, &["--instance", text(&edited)]].concat(), &["--instance", "edited.toml"]);
    }
    assert!(!pads.exists(), "a refused command leaves nothing behind");
    let own = ["optics", "pads", "--out", text(&pads), "--instance", text(&found)];
    assert!(run(&own).status.success() && pads.join("index_distal.toml").exists());
    // Files and folders without sessions of an excitation are refused.
    let output = ["--out", text(&edited)];
    refused(&[&["sysid", "identify", text(&truth)], &output[..]].concat(), &["truth.json"]);
    refused(&[&["sysid", "identify", text(folder.path())], &output[..]].concat(), &["sessions: found none"]);
}

/// Presses of pads on a ball identify arm and mount, and yield a calibration of the pads or the reason why there is
/// none; an object of known mass identifies the torque sensors.
#[test]
fn presses_on_a_ball_show_the_arm() {
    let folder = tempdir().expect("a folder");
    let (script, sessions) = (folder.path().join("ball.toml"), folder.path().join("sessions"));
    let ball = r#"
[ball]
radius = 0.008
place = [0.50, 0.25, 0.25]
uncertain = 0.003
spots = [[0.0, 0.0]]
tilt = 0.35
standoff = 0.04
stride = 0.0004
settle = 0.2
depth = 0.0013
[ball.slide]
way = 0.004
friction = 0.8
uncertain = 0.02
[weight]
object = "vase"
mass = 0.18
mass_uncertain = 0.0005
place = [0.55, -0.20]
place_uncertain = 0.003
lift = 0.1
hold = 1.0
[[weight.posture]]
name = "ahead"
turn = [0.4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
[[weight.posture]]
name = "stretched"
turn = [0.4, 0.5, 0.0, 0.6, 0.0, 0.0, -1.4]
[[weight.posture]]
name = "forearm turned"
turn = [0.4, 0.0, 0.0, 0.0, 1.4, 0.6, 0.8]
"#;
    fs::write(&script, format!("{EXCITATION_SCRIPT}{ball}")).expect("written");
    let excite = ["sysid", "excite", text(&sessions), "--instance", "2", "--script", text(&script), "--json"];
    let done = json(&run(&excite));
    assert_eq!(done["done"], 3 + 18 + 3 + 1);
    let found = folder.path().join("instance.toml");
    let identified = json(&run(&["sysid", "identify", text(&sessions), "--out", text(&found), "--json"]));
    assert!(identified["touches"].as_u64().expect("a number") >= 6, "{}", identified["touches"]);
    let [drawn, own] = [0, 1].map(|n| identified["touches_rms_m"][n].as_f64().expect("a number"));
    assert!(own < 0.5 * drawn && own < 5e-4, "{own} {drawn}");
    let row = |name: &str| {
        let rows = identified["parameters"].as_array().expect("rows");
        rows.iter().find(|row| row["parameter"] == name).expect("a row")
    };
    assert_eq!(row("arm_4.encoder")["identified"], true);
    // Stiffness and friction of the pads are within three standard deviations of the values that only the truth file has.
    let truth = folder.path().join("truth.json");
    let again = [&excite[..7], &["--truth-out", text(&truth)]].concat();
    assert!(run(&again).status.success(), "an excitation that is done still says what the truth is");
    let truth: Value = serde_json::from_str(&fs::read_to_string(&truth).expect("the truth")).expect("JSON");
    assert_eq!(identified["payload_postures"], 3);
    for name in ["gel_stiffness", "pad_friction", "arm_2.torque_gain", "arm_4.torque_gain"] {
        let rows = truth["parameters"].as_array().expect("rows");
        let real = rows.iter().find(|row| row["parameter"] == name).expect("a parameter")["deviation"].as_f64();
        let [found, sigma] = ["deviation", "sigma"].map(|key| row(name)[key].as_f64().expect("a number"));
        assert_eq!(row(name)["identified"], true, "{name}");
        assert!((found - real.expect("a number")).abs() < 3.0 * sigma, "{name}: {found} {real:?} {sigma}");
    }
    assert_eq!(row("gel_thickness")["identified"], false);
    assert_eq!(row("arm_1.torque_gain")["identified"], false, "its axis is upright");
    if let Some(pads) = identified["pads"].as_str() {
        let record = folder.path().join("trial.rrd");
        let output = run(&["trial", "0", "--policy", "blind", "--out", text(&record), "--pads", pads]);
        assert!(matches!(output.status.code(), Some(0 | 1)), "{}", stderr(&output));
    }
    // Scripts with impossible balls and weights.
    for (from, to, says) in [
        ("depth = 0.0013", "depth = 0.9", "ball.toml: ball.depth: found 0.9, expected 0.0002 to 0.002"),
        ("way = 0.004", "way = 4.0", "ball.toml: ball.slide.way: found 4, expected 0.003 to 0.01"),
        ("mass = 0.18", "mass = 18", "ball.toml: weight.mass: found 18, expected 0.02 to 2"),
        (
            "\"vase\"",
            "\"multimeter\"",
            "ball.toml: weight.object: found `multimeter`, expected an object of which grasps by ftac_gen3 are known",
        ),
    ] {
        fs::write(&script, format!("{EXCITATION_SCRIPT}{}", ball.replace(from, to))).expect("written");
        refused(&excite[..7], &[says]);
    }
}

/// Ctrl-C keeps the finished steps, and the same command resumes from there.
#[test]
fn an_interrupted_excitation_goes_on() {
    let folder = tempdir().expect("a folder");
    let sessions = folder.path().join("sessions");
    let script = folder.path().join("short.toml");
    // The second step takes long enough to be interrupted.
    let long = EXCITATION_SCRIPT.replace("current = 0.065\ntime = 1.0", "current = 0.065\ntime = 12.0");
    assert_ne!(long, EXCITATION_SCRIPT);
    fs::write(&script, long).expect("written");
    let excite = ["sysid", "excite", text(&sessions), "--script", text(&script)];
    let mut child = ftac(&excite).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("starts");
    let state = || fs::read_to_string(sessions.join("excitation.json")).unwrap_or_default();
    while !state().contains("\"done\": 1") {
        assert!(child.try_wait().expect("ours").is_none(), "it ended before a step was done");
        std::thread::sleep(Duration::from_millis(2));
    }
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill runs").success());
    let output = child.wait_with_output().expect("ours");
    assert_eq!(output.status.code(), Some(130), "{}", stderr(&output));
    assert!(stderr(&output).contains("of 3 steps are done"), "{}", stderr(&output));
    let done = json(&run(&[&excite[..], &["--json"]].concat()));
    assert_eq!((&done["done"], done["sessions"].as_array().map(Vec::len)), (&3.into(), Some(2)));
    let found = folder.path().join("instance.toml");
    assert!(run(&["sysid", "identify", text(&sessions), "--out", text(&found)]).status.success());
    // A damaged state file is refused by name, and nothing moves.
    let kept = state();
    for (damaged, says) in [
        (kept.replace("\"done\": 3", "\"done\": 99"), "found 1, 99, expected 1 and at most 3"),
        (kept.replace("\"done\"", "\"finished\""), "excitation.json"),
        (kept[..kept.len() / 2].to_owned(), "excitation.json"),
    ] {
        assert_ne!(damaged, kept);
        fs::write(sessions.join("excitation.json"), damaged).expect("written");
        refused(&excite, &["excitation.json", says]);
    }
    assert!(!sessions.join("part_3.mcap").exists(), "a refused excitation begins no session");
}
