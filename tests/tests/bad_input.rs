//! Bad input by users: each case ends with exit code 2, a message that names place and fault, and leaves nothing behind.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;

use e2e::{ftac, root, run, stderr};
use tempfile::tempdir;

/// Runs `ftac` on bad input and checks these three promises; `named` are the words that its message must contain.
fn refused(arguments: &[&str], named: &[&str]) {
    let output = run(arguments);
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "ftac {arguments:?} said: {message}");
    for word in named {
        assert!(message.contains(word), "ftac {arguments:?} does not name {word:?}: {message}");
    }
    assert!(!message.contains("panicked"), "{message}");
    assert!(output.stdout.is_empty(), "errors go to stderr");
}

fn text(path: &Path) -> &str {
    path.to_str().expect("a UTF-8 path")
}

#[test]
fn no_combinations() {
    let folder = tempdir().expect("a folder");
    let out = folder.path().join("out");
    refused(&["bench", "--combos", "0", "--out", text(&out)], &["--combos", "0"]);
    assert!(!out.exists(), "left a result folder behind");
}

#[test]
fn unknown_ablation() {
    let folder = tempdir().expect("a folder");
    let out = folder.path().join("out");
    refused(&["bench", "--ablations", "thumbs", "--out", text(&out)], &["thumbs", "no_retry", "true_pose"]);
    refused(&["bench", "--without", "ghosts", "--out", text(&out)], &["ghosts", "pads", "time"]);
    let emulated = ["bench", "--robot", "emulated", "--ablations", "palm_only", "--out", text(&out)];
    refused(&emulated, &["--ablations", "emulated", "expected sim"]);
    refused(&["bench", "--noise-scale", "nan", "--out", text(&out)], &["--noise-scale", "NaN", "0 to 10"]);
    assert!(!out.exists(), "left a result folder behind");
}

#[test]
fn unknown_robot() {
    let folder = tempdir().expect("a folder");
    let out = folder.path().join("out");
    refused(&["bench", "--robot", "teapot", "--out", text(&out)], &["--robot", "teapot", "sim"]);
    assert!(!out.exists(), "left a result folder behind");
}

#[test]
fn scenario_with_a_wrong_field() {
    let folder = tempdir().expect("a folder");
    let scenario = folder.path().join("scenario.toml");
    let good = fs::read_to_string(root().join("scenarios/data/benchmark.toml")).expect("the benchmark's scenario");
    fs::write(&scenario, format!("no_such_field = 3\n{good}")).expect("written");
    let out = folder.path().join("out");
    let arguments = ["bench", "--combos", "1", "--trials", "1", "--scenario", text(&scenario), "--out", text(&out)];
    refused(&arguments, &["scenario.toml", "no_such_field", "expected"]);
    assert!(!out.exists(), "left a result folder behind");
}

#[test]
fn scenario_that_is_not_there() {
    let folder = tempdir().expect("a folder");
    let (scenario, out) = (folder.path().join("missing.toml"), folder.path().join("out"));
    refused(&["bench", "--combos", "1", "--scenario", text(&scenario), "--out", text(&out)], &["missing.toml"]);
    assert!(!out.exists(), "left a result folder behind");
}

#[test]
fn unreadable_mesh() {
    let folder = tempdir().expect("a folder");
    let mesh = folder.path().join("thing.obj");
    fs::write(&mesh, "v 0 0 0\nv 1 0 zero\nf 1 2 9\n").expect("written");
    let out = folder.path().join("image.png");
    refused(&["optics", "render", text(&mesh), "--out", text(&out)], &["thing.obj"]);
    assert!(!out.exists(), "left an image behind");
}

/// Returns a tetrahedron of edge `size` (OBJ), with or without its last face.
fn tetrahedron(size: f64, closed: bool) -> String {
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let vertices: String =
        corners.iter().map(|[x, y, z]| format!("v {} {} {}\n", x * size, y * size, z * size)).collect();
    let faces = "f 1 3 2\nf 1 2 4\nf 1 4 3\n";
    format!("{vertices}{faces}{}", if closed { "f 2 3 4\n" } else { "" })
}

/// Meshes that cannot be grasped are refused with a reason, before anything is written.
#[test]
fn meshes_that_cannot_be_grasped() {
    let folder = tempdir().expect("a folder");
    let (mesh, out) = (folder.path().join("thing.obj"), folder.path().join("grasps.jsonl"));
    let cases = [
        (String::new(), "0 triangles"),
        (tetrahedron(0.05, false), "3 triangles"),
        (tetrahedron(0.002, true), "a largest extent of 2.00 mm"),
        (tetrahedron(0.4, true), "110 mm: the F-TAC Hand does not open wider"),
        (tetrahedron(50.0, true), "millimetres"),
        (tetrahedron(0.05, true).replacen("v 0.05 0 0", "v nan 0 0", 1), "three finite numbers after v"),
    ];
    for (content, reason) in cases {
        fs::write(&mesh, content).expect("written");
        let arguments = ["grasps", "generate", "--mesh", text(&mesh), "--n", "1", "--out", text(&out)];
        refused(&arguments, &["--mesh", "thing.obj", reason]);
        assert!(!out.exists(), "left a file behind");
    }
}

#[test]
fn grasps_of_nothing_known() {
    refused(&["grasps", "generate", "--object", "teapot"], &["--object", "teapot", "golf_ball"]);
    refused(&["grasps", "generate", "--object", "ball", "--contacts", "1"], &["--contacts", "`1`"]);
    refused(&["grasps", "eval", "--object", "ball", "--n", "0"], &["--n", "at least 1"]);
}

#[test]
fn urdf_with_a_missing_joint() {
    let folder = tempdir().expect("a folder");
    let good = fs::read_to_string(root().join("hand-model/data/ftac_hand.urdf")).expect("the hand's URDF");
    let (start, _) = first_moving_joint(&good);
    let end = start + good[start..].find("</joint>").expect("an end") + "</joint>".len();
    // The joint's element is removed with it: the link that no joint carries any more is named.
    let link =
        good[start..end].split("<child link=\"").nth(1).and_then(|rest| rest.split('"').next()).expect("a child");
    let urdf = folder.path().join("hand.urdf");
    fs::write(&urdf, format!("{}{}", &good[..start], &good[end..])).expect("written");
    refused(&["hand", "check", "--urdf", text(&urdf)], &["hand.urdf", &format!("no joint carries `{link}`")]);
}

/// Finds the first moving joint in a URDF: its offset in the text, and its name.
fn first_moving_joint(urdf: &str) -> (usize, String) {
    urdf.match_indices("<joint ")
        .find_map(|(start, _)| {
            let tag = &urdf[start..start + urdf[start..].find('>')?];
            let name = tag.split("name=\"").nth(1)?.split('"').next()?;
            tag.contains("revolute").then(|| (start, name.to_owned()))
        })
        .expect("a revolute joint")
}

/// The path lies below a regular file: not even root can make a folder there.
#[test]
fn results_that_cannot_be_written() {
    let folder = tempdir().expect("a folder");
    let file = folder.path().join("file");
    fs::write(&file, "mine").expect("written");
    let out = file.join("out");
    refused(&["bench", "--combos", "1", "--trials", "1", "--out", text(&out)], &[text(&out)]);
    assert_eq!(fs::read_to_string(&file).expect("still there"), "mine");
}

#[test]
fn nothing_to_feel() {
    refused(&["touch", "eval", "--combos", "0"], &["--combos", "found 0", "expected 1 to"]);
}

#[test]
fn grasps_of_another_run() {
    let folder = tempdir().expect("a folder");
    let file = folder.path().join("grasps.json");
    let other = r#"{"played": {"combos": 9, "trials": 9, "seed": 9}, "grasps": []}"#;
    fs::write(&file, other).expect("written");
    let arguments = ["touch", "eval", "--combos", "1", "--trials", "1", "--grasps", text(&file)];
    refused(&arguments, &["grasps.json", "combos: 9", "combos: 1"]);
    fs::write(&file, "no grasps").expect("written");
    refused(&arguments, &["grasps.json", "not a file of grasps"]);
    assert_eq!(fs::read_to_string(&file).expect("still there"), "no grasps");
}

/// A scenario from someone else names files outside its folder: they are not read, and nothing of them is printed.
#[test]
fn a_scenario_reads_no_file_outside_its_folder() {
    let folder = tempdir().expect("a folder");
    let (secret, theirs) = (folder.path().join("secret.toml"), folder.path().join("theirs"));
    fs::create_dir(&theirs).expect("made");
    fs::write(&secret, "root:$6$hunter2:19000:0:99999:7:::\n").expect("written");
    std::os::unix::fs::symlink(&secret, theirs.join("link.toml")).expect("linked");
    let (scenario, out) = (theirs.join("scenario.toml"), folder.path().join("out"));
    let arguments = ["bench", "--combos", "1", "--trials", "1", "--scenario", text(&scenario), "--out", text(&out)];
    let names = |named: &str| {
        let objects = format!("version = 1\nname = \"n\"\nextends = \"benchmark\"\nobjects = [\"{named}\"]\n");
        fs::write(&scenario, objects).expect("written");
    };
    for named in ["/etc/shadow", "../secret.toml", "link.toml"] {
        names(named);
        refused(&arguments, &["scenario.toml: objects[0]: found ", named, "expected a file below ", "--any-files"]);
    }
    // With the user's permission the file is read; its content is still not printed.
    names("../secret.toml");
    let output = run(&[&arguments[..], &["--any-files"]].concat());
    let message = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(message.contains("secret.toml:1: found no TOML") && !message.contains("hunter2"), "{message}");
    assert!(!out.exists(), "left a result folder behind");
}

/// A pipe in the place of a file is refused by name: reading it would never end.
#[test]
fn a_pipe_is_no_file() {
    let folder = tempdir().expect("a folder");
    let pipe = folder.path().join("pipe.mcap");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().expect("mkfifo runs").success());
    let pipe = text(&pipe);
    for arguments in [
        &["replay", pipe][..],
        &["export", "mcap", text(folder.path())],
        &["export", "rrd", pipe],
        &["bench", "--combos", "1", "--scenario", pipe],
        &["bench", "--combos", "1", "--uncertainty", pipe],
        &["trial", "0", "--instance", pipe],
        &["trial", "0", "--pads", pipe],
        &["sweep", "plan", pipe],
        &["grasps", "generate", "--mesh", pipe],
    ] {
        refused(arguments, &["pipe.mcap", "found a pipe, expected a regular file"]);
    }
}

/// No child process gets our secrets in its environment.
#[test]
fn no_child_is_told_the_arm_s_password() {
    let folder = tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    for program in ["python", "rerun", "sbatch", "git"] {
        let file = at(program);
        fs::write(&file, format!("#!/bin/sh\nenv > {}\nexit 1\n", text(&at(&format!("{program}.told")))))
            .expect("written");
        fs::set_permissions(&file, fs::Permissions::from_mode(0o755)).expect("made a program");
    }
    fs::write(at("mine.py"), "class Mine: ...\n").expect("written");
    fs::write(at("trial.mcap"), "").expect("written");
    fs::write(at("trial.rrd"), "").expect("written");
    let sweep = "version = 1\nname = \"n\"\ncombos = 1\ntrials = 1\n[axes]\nseed = [1]\n";
    fs::write(at("sweep.toml"), sweep).expect("written");
    let policy = format!("{}:Mine", text(&at("mine.py")));
    let path = format!("{}:{}", text(folder.path()), std::env::var("PATH").unwrap_or_default());
    for (program, arguments) in [
        ("python", &["bench", "--combos", "1", "--policy", &policy, "--out", text(&at("bench"))][..]),
        ("python", &["export", "lerobot", text(folder.path())]),
        ("rerun", &["view", text(&at("trial.rrd"))]),
        ("sbatch", &["sweep", "submit", text(&at("sweep.toml")), "--out", text(&at("sweep"))]),
    ] {
        let mut command = ftac(arguments);
        command.env("FTAC_ARM_PASSWORD", "hunter2").env("PATH", &path);
        command.env("FTAC_POLICY_PYTHON", at("python")).env("RERUN_BIN", at("rerun"));
        let output = command.output().expect("it runs");
        let told = at(&format!("{program}.told"));
        let words =
            fs::read_to_string(&told).unwrap_or_else(|_| panic!("{program} was not started: {}", stderr(&output)));
        assert!(
            words.contains("PATH=") && !words.contains("hunter2") && !words.contains("FTAC_ARM_PASSWORD"),
            "{words}"
        );
        fs::remove_file(told).expect("removed");
    }
}

/// With --json an error is one JSON object too, with message and exit code.
#[test]
fn errors_are_json_too() {
    let output = run(&["--json", "touch", "eval", "--combos", "0"]);
    assert_eq!(output.status.code(), Some(2));
    let error: serde_json::Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    assert_eq!(error["code"], 2);
    assert!(stderr(&output).contains(error["error"].as_str().expect("words")), "{error}");
}

/// Options that would do nothing, and numbers that a run could not be resumed with.
#[test]
fn options_without_an_effect() {
    let folder = tempdir().expect("a folder");
    let out = folder.path().join("out");
    for (options, named) in [
        (&["--trials", "200000"][..], &["--trials", "200000", "1 to 100000"][..]),
        (&["--film", "--conditions", "ideal"], &["--film", "ideal"]),
        (&["--film", "--shard", "2/2"], &["--film", "shard 2 of 2"]),
        (&["--ablations", "palm_only", "--conditions", "ideal"], &["--ablations", "ideal"]),
        (&["--shard", "3/3"], &["--shard", "3 shards", "2 combinations"]),
    ] {
        refused(&[&["bench", "--combos", "2", "--out", text(&out)], options].concat(), named);
    }
    refused(&["trial", "0", "--trial", "100000", "--out", text(&out)], &["--trial", "100000", "0 to 99999"]);
    refused(&["transport", "--n", "4"], &["--search-skills"]);
    let file = folder.path().join("session");
    fs::write(&file, "").expect("written");
    refused(&["trial", "0", "--session", text(&file), "--out", text(&out)], &["--session", "session"]);
    assert!(!out.exists(), "left a result behind");
}

/// A sweep whose points are the same trials, and a seed that it would not use.
#[test]
fn sweeps_that_count_twice() {
    let folder = tempdir().expect("a folder");
    let file = folder.path().join("sweep.toml");
    let head = "version = 1\nname = \"twice\"\ncombos = 2\ntrials = 1\n\n[axes]\npolicy = [\"blind\"]\n";
    for (axis, named) in [
        ("noise_scale = [1, 1.0]", &["noise_scale", "twice"][..]),
        ("without = [\"detector,arm\", \"arm,detector\"]", &["axes", "twice"]),
    ] {
        fs::write(&file, format!("{head}{axis}\n")).expect("written");
        refused(&["sweep", "plan", text(&file)], named);
    }
    fs::write(&file, format!("{head}noise_scale = [1, 2]\n")).expect("written");
    refused(&["sweep", "plan", text(&file), "--seed", "7"], &["--seed", "7", "[axes]"]);
}

/// Files that would be written over what is read, and results of nothing.
#[test]
fn results_over_what_is_read() {
    let folder = tempdir().expect("a folder");
    let session = folder.path().join("session.mcap");
    fs::write(&session, "a session").expect("written");
    for kind in ["ros2", "rrd"] {
        let export = ["export", kind, text(&session), "--out", text(&session)];
        refused(&export, &["--out", "session.mcap", "expected another file"]);
    }
    let grasps = folder.path().join("grasps.jsonl");
    fs::write(&grasps, "grasps").expect("written");
    let classify = ["grasps", "classify", "--grasps", text(&grasps), "--like-people", text(&grasps)];
    refused(&classify, &["--like-people", "expected another file"]);
    let typo = folder.path().join("typo");
    let pack = ["grasps", "collection", "--pack", "--parts", text(&typo), "--out", text(&grasps)];
    refused(&pack, &["--parts", "typo", "expected the parts to pack"]);
    assert!(!typo.exists(), "made the folder that is missing");
    let calibration = folder.path().join("pads.toml");
    refused(&["touch", "train", "--presses", "0", "--out", text(&calibration)], &["--presses", "0"]);
    refused(&["grasps", "eval", "--grasps", text(&grasps), "--friction", "0.05"], &["--grasps", "--friction"]);
    refused(&["grasps", "show", "--out", text(&calibration)], &["--out", "OBJECT"]);
    assert!(!calibration.exists(), "wrote a result of nothing");
    assert_eq!(fs::read_to_string(&session).expect("still there"), "a session");
    assert_eq!(fs::read_to_string(&grasps).expect("still there"), "grasps");
}

/// A socket on which nobody listens: the servos of another robot, which a file in this folder names, are left alone.
#[test]
fn a_socket_of_nobody() {
    let folder = tempdir().expect("a folder");
    let socket = folder.path().join("typo");
    let output = run(&["bridge", "stop", "--release", "--socket", text(&socket)]);
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert!(
        stderr(&output).contains("no bridge is running") && stderr(&output).contains("--config"),
        "{}",
        stderr(&output)
    );
}

/// Folders that hold something else: a benchmark, a sweep.
#[test]
fn folders_of_other_results() {
    let folder = tempdir().expect("a folder");
    let file = folder.path().join("sweep.toml");
    let sweep = "version = 1\nname = \"other\"\ncombos = 1\ntrials = 1\n\n[axes]\npolicy = [\"blind\"]\n";
    fs::write(&file, sweep).expect("written");
    for (inside, command) in [
        ("run.json", &["sweep", "run", text(&file)][..]),
        ("plan.json", &["bench", "--combos", "1", "--trials", "1", "--conditions", "blind", "--record", "none"]),
    ] {
        let out = folder.path().join(inside.trim_end_matches(".json"));
        fs::create_dir(&out).expect("made");
        fs::write(out.join(inside), "{}").expect("written");
        refused(&[command, &["--out", text(&out)]].concat(), &["--out", "already holds a"]);
        assert_eq!(fs::read_dir(&out).expect("read").count(), 1, "nothing was added beside {inside}");
    }
}
