//! Hands of other people: `ftac hand close` closes them on a ball, and says which file, element and field is wrong.

use std::fs;
use std::path::Path;

use e2e::{run, stderr};
use tempfile::{TempDir, tempdir};

/// A clamp of two jaws, each on its own hinge, that closes on what is between them.
const CLAMP: &str = include_str!("../../twin/guide/files/clamp.urdf");
const PULLS: &str = "version = 1\ndamping = 0.02\narmature = 1e-4\nspring = 0.02\n\
    [[actuator]]\nname = \"close\"\narms = { turn_left = 0.01, turn_right = 0.01 }\n";

struct Files {
    folder: TempDir,
}

impl Files {
    fn new(urdf: &str, pulls: &str) -> Self {
        let folder = tempdir().expect("a folder");
        fs::write(folder.path().join("clamp.urdf"), urdf).expect("written");
        fs::write(folder.path().join("clamp.toml"), pulls).expect("written");
        Self { folder }
    }

    fn at(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().expect("a UTF-8 path").to_owned()
    }

    fn close(&self, more: &[&str]) -> std::process::Output {
        let (urdf, pulls) = (self.at("clamp.urdf"), self.at("clamp.toml"));
        let mut arguments = vec!["hand", "close", "--urdf", &urdf, "--transmission", &pulls, "--at", "0.07,0,0"];
        arguments.extend(["--ball-diameter-mm", "40", "--json"]);
        arguments.extend(more);
        run(&arguments)
    }
}

#[test]
fn a_clamp_closes_on_a_ball() {
    let files = Files::new(CLAMP, PULLS);
    let picture = files.at("picture/clamp.png");
    let output = files.close(&["--out", &picture]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let text: serde_json::Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    assert_eq!(text["touching"], 2, "{text}");
    let [left, right] = [0, 1].map(|n| text["joints"][n]["force_n"].as_f64().expect("a force"));
    assert!(left > 1.0 && (left - right).abs() < 0.05 * left, "both jaws press alike: {left} {right}");
    assert!(Path::new(&picture).exists());
}

/// A mesh with a hole is no fault: its hull stands for it, and the user is told.
#[test]
fn a_mesh_with_a_hole_is_taken_as_its_hull() {
    let urdf = CLAMP.replacen("<box size=\"0.10 0.01 0.03\"/>", "<mesh filename=\"jaw.obj\"/>", 1);
    let files = Files::new(&urdf, PULLS);
    let corners = (0..8).map(|n| {
        let side = |bit: usize, half: f64| if n >> bit & 1 == 1 { half } else { -half };
        format!("v {} {} {}\n", side(0, 0.05), side(1, 0.005), side(2, 0.015))
    });
    // A box without its last face.
    let faces = "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\n";
    fs::write(files.at("jaw.obj"), corners.collect::<String>() + faces).expect("written");
    let output = files.close(&[]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    for word in
        ["clamp.urdf", "link[left].collision[0].mesh", "jaw.obj", "not watertight (4 open edges)", "convex hull"]
    {
        assert!(stderr(&output).contains(word), "{word}: {}", stderr(&output));
    }
}

#[test]
fn faults_name_file_element_and_field() {
    let mesh = |file: &str, scale: &str| {
        CLAMP.replacen("<box size=\"0.10 0.01 0.03\"/>", &format!("<mesh filename=\"{file}\"{scale}/>"), 1)
    };
    let cases: [(String, String, &[&str]); 16] = [
        (
            CLAMP.replacen("<child link=\"left\"/>", "<child link=\"lift\"/>", 1),
            PULLS.into(),
            &["clamp.urdf", "joint[turn_left].child", "`lift`"],
        ),
        (
            CLAMP.replacen("<child link=\"right\"/>", "<child link=\"left\"/>", 1),
            PULLS.into(),
            &["clamp.urdf", "joint[turn_right].child", "without loops"],
        ),
        (
            CLAMP.replacen("ixx=\"2e-5\"", "ixx=\"0\"", 1),
            PULLS.into(),
            &["clamp.urdf", "link[left].inertial.inertia", "positive definite"],
        ),
        (
            CLAMP.replacen("<mass value=\"0.1\"/>", "<mass value=\"0\"/>", 1),
            PULLS.into(),
            &["clamp.urdf", "link[left].inertial.mass"],
        ),
        (
            mesh("nowhere.stl", ""),
            PULLS.into(),
            &["clamp.urdf", "link[left].collision[0].mesh.filename", "nowhere.stl"],
        ),
        (mesh("jaw.obj", ""), PULLS.into(), &["clamp.urdf", "link[left].collision[0].mesh.scale", "0.001 0.001 0.001"]),
        (mesh("flat.obj", ""), PULLS.into(), &["clamp.urdf", "link[left].collision[0].mesh.filename", "span a volume"]),
        (
            CLAMP.into(),
            PULLS.replace("turn_right", "turn_up"),
            &["clamp.toml", "actuator[close].arms.turn_up", "turn_left"],
        ),
        (
            CLAMP.replacen("lower=\"0\"", "lower=\"2\"", 1),
            PULLS.into(),
            &["clamp.urdf", "joint[turn_left].limit", "lower 2 and upper 1"],
        ),
        (CLAMP.replacen("xyz=\"0 0 -1\"", "xyz=\"0 0 0\"", 1), PULLS.into(), &["clamp.urdf", "joint[turn_left].axis"]),
        (
            CLAMP.replacen("xyz=\"0 0.03 0\"", "xyz=\"0 nan 0\"", 1),
            PULLS.into(),
            &["clamp.urdf", "joint[turn_left].origin.xyz", "NaN"],
        ),
        (
            CLAMP.replacen("size=\"0.10", "size=\"-0.10", 1),
            PULLS.into(),
            &["clamp.urdf", "link[left].collision[0].box.size", "-0.1"],
        ),
        (
            CLAMP.replacen("size=\"0.10", "size=\"nan", 1),
            PULLS.into(),
            &["clamp.urdf", "link[left].collision[0].box.size", "NaN"],
        ),
        (
            CLAMP.into(),
            PULLS.replace("turn_left = 0.01", "turn_left = 0.0"),
            &["clamp.toml", "arms.turn_left: found 0"],
        ),
        (
            CLAMP.into(),
            PULLS.replace("turn_left = 0.01", "turn_left = nan"),
            &["clamp.toml", "arms.turn_left: found NaN"],
        ),
        (
            CLAMP.into(),
            PULLS.replace("turn_left = 0.01, turn_right = 0.01", ""),
            &["clamp.toml", "actuator[close].arms: found none", "at least one joint"],
        ),
    ];
    for (urdf, pulls, named) in cases {
        let files = Files::new(&urdf, &pulls);
        // In millimetres, and all in one plane.
        fs::write(files.at("jaw.obj"), "v 0 0 0\nv 100 0 0\nv 0 10 0\nv 0 0 30\nf 1 2 3\n").expect("written");
        fs::write(files.at("flat.obj"), "v 0 0 0\nv 0.1 0 0\nv 0.1 0.1 0\nv 0 0.1 0\nf 1 2 3 4\n").expect("written");
        let picture = files.at("picture.png");
        let output = files.close(&["--out", &picture]);
        let message = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{message}");
        for word in named {
            assert!(message.contains(word), "{word:?} is not named: {message}");
        }
        let answer: serde_json::Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
        assert!(answer["joints"].is_null() && !Path::new(&picture).exists(), "left something behind: {answer}");
    }
}

#[test]
fn faults_on_the_command_line_are_named() {
    let files = Files::new(CLAMP, PULLS);
    for (arguments, named) in [
        (["--tensions", "1,2,3"], "--tensions: found 3 values, expected 1 or 1 (close)"),
        (["--tensions", "-4"], "--tensions: found -4"),
    ] {
        let output = files.close(&arguments);
        assert_eq!(output.status.code(), Some(2));
        assert!(stderr(&output).contains(named), "{}", stderr(&output));
    }
}
