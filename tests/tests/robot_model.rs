//! `--robot-model`: another robot is checked, drawn, calibrated and used by the same commands, or refused by file and field.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

use e2e::{ftac, root, run, stderr};
use serde_json::Value;
use tempfile::tempdir;

fn text(path: &Path) -> &str {
    path.to_str().expect("a UTF-8 path")
}

/// Returns the path of a robot file in the sources.
fn shipped(name: &str) -> PathBuf {
    root().join("hand-model/data/robots").join(name)
}

const PLAIN_ROBOT_TOML: &str = "version = 1\nname = \"mine\"\narm = \"gen3\"\n[hand]\nparameters = \"ftac\"\n";

/// Returns the error message for a robot file with this text, from a command that runs it.
fn refused(robot: &str) -> String {
    let folder = tempdir().expect("a folder");
    let file = folder.path().join("mine.toml");
    fs::write(&file, robot).expect("written");
    let out = folder.path().join("out");
    let asked = ["bench", "--robot-model", text(&file), "--combos", "1", "--trials", "1", "--out", text(&out)];
    let output = ftac(&asked).env("XDG_CACHE_HOME", folder.path().join("cache")).output().expect("runs");
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert!(!out.exists(), "nothing is written");
    stderr(&output)
}

/// Bridge and emulated devices support only a Gen3: the hand on another arm is refused before any search.
#[test]
fn another_arm_is_simulated_alone() {
    let robot = shipped("ftac_panda.toml");
    for asked in [&["bench", "--combos", "1"][..], &["trial", "0"], &["bridge", "faults"], &["bridge", "emulate"]] {
        let folder = tempdir().expect("a folder");
        let mut command = ftac(asked);
        command.args(["--robot-model", text(&robot)]).current_dir(folder.path());
        if asked[0] != "bridge" {
            command.args(["--robot", "emulated"]);
        }
        let output = command.env("XDG_CACHE_HOME", folder.path().join("cache")).output().expect("runs");
        assert_eq!(output.status.code(), Some(2), "{asked:?}: {}", stderr(&output));
        let said = "ftac_panda.toml: arm: found `panda`, expected `gen3`";
        assert!(stderr(&output).contains(said), "{asked:?}: {}", stderr(&output));
    }
}

#[test]
fn a_wrong_robot_is_refused_by_file_and_field() {
    let pad = |link: &str, configuration: &str| {
        format!(
            "{PLAIN_ROBOT_TOML}[[hand.pad]]\nname = \"more\"\nlink = \"{link}\"\nconfiguration = \"{configuration}\"\n\
             center = [0.0145, -0.006, 0.0]\ny = [1.0, 0.0, 0.0]\nz = [0.0, -1.0, 0.0]\n"
        )
    };
    let gripper = "[[joint]]\nname = \"j\"\n";
    for (robot, said) in [
        (pad("ring_9", "b"), "mine.toml: hand.pad[more].link: found `ring_9`"),
        (pad("ring_2", "x"), "mine.toml: hand.pad[more].configuration: found `x`"),
        (format!("{PLAIN_ROBOT_TOML}scale = 3.0\n"), "mine.toml: hand.scale: found 3, expected 0.5 to 2"),
        // Pads of another size need their own calibration.
        (format!("{PLAIN_ROBOT_TOML}scale = 0.8\n"), "mine.toml: calibration: found none"),
        (
            PLAIN_ROBOT_TOML.replace("[hand]", "calibration = \"pads.json\"\n[hand]") + "scale = 0.8\n",
            "mine.toml: calibration: found no file pads.json",
        ),
        (PLAIN_ROBOT_TOML.replace("\"gen3\"", "\"arm.toml\""), "arm.toml: No such file"),
        (PLAIN_ROBOT_TOML.replace("\"ftac\"", "\"/nowhere/hand.toml\""), "/nowhere/hand.toml: No such file"),
        (PLAIN_ROBOT_TOML.replace("version = 1", "version = 2"), "mine.toml: version: found 2, expected 1"),
        (format!("{PLAIN_ROBOT_TOML}{gripper}"), "unknown field `joint`"),
    ] {
        let found = refused(&robot);
        assert!(found.contains(said), "{said}\n{found}");
    }
}

/// Wrong parameter files: a cable that crosses no joint, an arm with too few joints.
#[test]
fn parameter_files_of_a_robot_are_checked() {
    let folder = tempdir().expect("a folder");
    let data = root().join("hand-model/data");
    let robot = folder.path().join("mine.toml");
    let check = |from: &str, to: &str, said: &str| {
        fs::write(&robot, PLAIN_ROBOT_TOML.replace("\"ftac\"", "\"hand.toml\"").replace("\"gen3\"", "\"arm.toml\""))
            .expect("written");
        for (name, file) in [("hand.toml", "ftac_hand.toml"), ("arm.toml", "gen3.toml")] {
            let text = fs::read_to_string(data.join(file)).expect("data");
            fs::write(folder.path().join(name), text.replacen(from, to, 1)).expect("written");
        }
        let output =
            ftac(&["hand", "picture", "--robot-model", text(&robot), "--size", "64", "--out", "/dev/null/x.png"])
                .output()
                .expect("runs");
        assert!(stderr(&output).contains(said), "{said}\n{}", stderr(&output));
    };
    check("drives = \"thumb_1\"", "", "hand.toml: actuator[opposition].cable: found no joint");
    check(
        "velocity = 1.3963",
        "velocity = 0.0",
        "arm.toml: joint[joint_1].velocity: found 0, expected a positive number",
    );
    check("[[joint]]\nname = \"joint_7\"", "[[joints]]\nname = \"joint_7\"", "arm.toml");
}

/// A robot with the kinematics of the built-in one uses its grasps at once; a run is resumed without the robot's files.
#[test]
fn a_robot_with_more_pads_plays_and_is_resumed_without_its_files() {
    let folder = tempdir().expect("a folder");
    for name in ["ftac_more_pads.toml", "ftac_more_pads_pads.json"] {
        fs::copy(shipped(name), folder.path().join(name)).expect("copied");
    }
    let (robot, out) = (folder.path().join("ftac_more_pads.toml"), folder.path().join("out"));
    let asked =
        ["bench", "--robot-model", text(&robot), "--combos", "1", "--trials", "1", "--conditions", "blind,touch"];
    let output = run(&[&asked[..], &["--record", "none", "--json", "--out", text(&out)]].concat());
    assert!(matches!(output.status.code(), Some(0 | 1)), "{}", stderr(&output));
    let answer: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(answer["robot_model"], "ftac_more_pads");
    let rows = fs::read_to_string(out.join("trials.csv")).expect("trials");
    assert_eq!(rows.lines().count(), 3, "{rows}");
    fs::remove_file(&robot).expect("removed");
    let kept = fs::read_to_string(out.join("run.json")).expect("a run");
    assert!(kept.contains("ring_middle_back"), "the run keeps the robot's text");
    fs::write(out.join("journal.jsonl"), "").expect("emptied");
    let again = run(&["bench", "--resume", text(&out), "--json"]);
    assert!(matches!(again.status.code(), Some(0 | 1)), "{}", stderr(&again));
    let run_again = fs::read_to_string(out.join("trials.csv")).expect("trials");
    assert_eq!(without_times(&run_again), without_times(&rows));
    // A run cannot be resumed with another robot.
    let other = ftac(&["bench", "--resume", text(&out), "--robot-model", text(&shipped("ftac_right.toml"))]);
    let other = { other }.output().expect("runs");
    assert_eq!(other.status.code(), Some(2), "{}", stderr(&other));
}

/// Returns the rows without their last column, which is wall-clock time.
fn without_times(rows: &str) -> Vec<&str> {
    rows.lines().filter_map(|line| line.rsplit_once(',')).map(|(row, _)| row).collect()
}

/// Grasps of one robot are not valid for another.
#[test]
fn a_repertoire_of_another_robot_is_refused() {
    let folder = tempdir().expect("a folder");
    let out = folder.path().join("repertoire.json");
    let of = |robot: &str| {
        let robot = shipped(robot);
        let asked = ["grasps", "repertoire", "--robot-model", text(&robot), "--object", "ball_45", "--role", "first"];
        ftac(&[&asked[..], &["--n", "16", "--out", text(&out)]].concat()).output().expect("runs")
    };
    let made = of("ftac_right.toml");
    assert_eq!(made.status.code(), Some(0), "{}", stderr(&made));
    let kept: Value = serde_json::from_str(&fs::read_to_string(&out).expect("a repertoire")).expect("JSON");
    assert_eq!(kept["robot"][0], "ftac_right");
    let other = of("ftac_85.toml");
    assert_eq!(other.status.code(), Some(2), "{}", stderr(&other));
    assert!(
        stderr(&other).contains("robot: found grasps of ftac_right, expected those of ftac_85"),
        "{}",
        stderr(&other)
    );
    // Without a file, a robot with other kinematics has no grasps to plan with.
    let robot = shipped("ftac_right.toml");
    let plans = folder.path().join("plans.json");
    let plan = run(&["grasps", "pairs", "--robot-model", text(&robot), "--combos", "1", "--out", text(&plans)]);
    assert_eq!(plan.status.code(), Some(2));
    assert!(stderr(&plan).contains("--repertoire: found none, expected grasps of ftac_right"), "{}", stderr(&plan));
}

/// A gripper has no digits to hold one object while others pick the next: a benchmark of pairs is refused before any search.
#[test]
fn two_objects_are_refused_for_a_gripper() {
    let folder = tempdir().expect("a folder");
    let robot = folder.path().join("gripper.toml");
    fs::copy(shipped("franka_hand.toml"), folder.path().join("franka_hand.toml")).expect("copied");
    let pads = folder.path().join("pads.json");
    let described = PLAIN_ROBOT_TOML
        .replace("[hand]", "calibration = \"pads.json\"\n[hand]")
        .replace("\"ftac\"", "\"franka_hand.toml\"");
    fs::write(&robot, described).expect("written");
    let trained = run(&["touch", "train", "--robot-model", text(&robot), "--presses", "6", "--out", text(&pads)]);
    assert_eq!(trained.status.code(), Some(0), "{}", stderr(&trained));
    let out = folder.path().join("out");
    let finished =
        ftac(&["bench", "--robot-model", text(&robot), "--combos", "1", "--trials", "1", "--out", text(&out)])
            .output()
            .expect("runs");
    assert_eq!(finished.status.code(), Some(2), "{}", stderr(&finished));
    assert!(stderr(&finished).contains("gripper.toml: hand: found 2 digits, expected 4 or 5"), "{}", stderr(&finished));
}

/// A gripper finds grasps of a single object from above, lifts it, and estimates its pose in the hand.
#[test]
fn a_gripper_picks_one_object() {
    let folder = tempdir().expect("a folder");
    let (robot, out) = (shipped("franka_panda.toml"), folder.path().join("out"));
    let scenario = folder.path().join("one.toml");
    let one = "version = 1\nname = \"one\"\nextends = \"benchmark\"\nfirst = [\"ball_45\"]\nsecond = []\n";
    fs::write(&scenario, one).expect("written");
    let asked = ["bench", "--robot-model", text(&robot), "--scenario", text(&scenario), "--trials", "1"];
    let asked = [&asked[..], &["--conditions", "ideal,blind,touch", "--record", "none", "--out", text(&out)]].concat();
    let output = ftac(&asked).env("XDG_CACHE_HOME", folder.path().join("cache")).output().expect("runs");
    assert!(matches!(output.status.code(), Some(0 | 1)), "{}", stderr(&output));
    assert!(stderr(&output).contains("ball_45: 4 grasps by thumb and index finger"), "{}", stderr(&output));
    let mut table = csv::Reader::from_path(out.join("trials.csv")).expect("trials.csv");
    let rows: Vec<HashMap<String, String>> = table.deserialize().collect::<Result<_, _>>().expect("rows");
    let of = |name: &str| rows.iter().find(|row| row["condition"] == name).expect(name);
    assert_eq!((&of("ideal")["success"][..], &of("ideal")["second"][..]), ("true", ""));
    let off: f64 = of("touch")["pose_error_mm"].parse().expect("a pose error");
    assert!(off < 10.0, "{off} mm");
}

/// Each robot in the sources can be drawn, and a press into one of its pads is rendered.
#[test]
fn robots_that_come_with_the_sources_are_whole() {
    let folder = tempdir().expect("a folder");
    let mesh = folder.path().join("wedge.obj");
    let points = "v -0.004 -0.004 0\nv 0.004 -0.004 0\nv 0 0.004 0\nv 0 0 0.006\n";
    fs::write(&mesh, format!("{points}f 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")).expect("written");
    for (robot, pad) in [
        ("ftac_right", "index_distal"),
        ("ftac_85", "thumb_distal"),
        ("ftac_115", "palm_ulnar"),
        ("ftac_more_pads", "ring_middle_back"),
        ("allegro_gen3", "thumb_distal"),
        ("franka_panda", "index_distal"),
    ] {
        let file = shipped(&format!("{robot}.toml"));
        let picture = folder.path().join(format!("{robot}.png"));
        let drawn = run(&["hand", "picture", "--robot-model", text(&file), "--size", "64", "--out", text(&picture)]);
        assert_eq!(drawn.status.code(), Some(0), "{}", stderr(&drawn));
        let image = folder.path().join(format!("{robot}_{pad}.png"));
        let asked =
            ["optics", "render", text(&mesh), "--robot-model", text(&file), "--pad", pad, "--out", text(&image)];
        let rendered = ftac(&asked).output().expect("runs");
        assert_eq!(rendered.status.code(), Some(0), "{}", stderr(&rendered));
    }
}
