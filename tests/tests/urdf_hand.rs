//! Third-party hands: `ftac hand close` closes them on a ball, and names the wrong file, element and field.

use std::fs;
use std::path::Path;

use e2e::{run, stderr};
use tempfile::{TempDir, tempdir};

/// A clamp of two jaws, each on its own hinge, that closes on an object between them. It has no palm.
const CLAMP_URDF: &str = r#"<robot name="clamp">
  <link name="base"/>
  <link name="left"><inertial><origin xyz="0.04 0 0" rpy="0 0 0"/><mass value="0.1"/>
    <inertia ixx="2e-5" ixy="0" ixz="0" iyy="6e-5" iyz="0" izz="6e-5"/></inertial>
    <collision><origin xyz="0.05 0 0" rpy="0 0 0"/><geometry><box size="0.10 0.01 0.03"/></geometry></collision></link>
  <link name="right"><inertial><origin xyz="0.04 0 0" rpy="0 0 0"/><mass value="0.1"/>
    <inertia ixx="2e-5" ixy="0" ixz="0" iyy="6e-5" iyz="0" izz="6e-5"/></inertial>
    <collision><origin xyz="0.05 0 0" rpy="0 0 0"/><geometry><box size="0.10 0.01 0.03"/></geometry></collision></link>
  <joint name="turn_left" type="revolute"><origin xyz="0 0.03 0" rpy="0 0 0"/><parent link="base"/><child link="left"/>
    <axis xyz="0 0 -1"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint>
  <joint name="turn_right" type="revolute"><origin xyz="0 -0.03 0" rpy="0 0 0"/><parent link="base"/><child link="right"/>
    <axis xyz="0 0 1"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint>
</robot>"#;
const PULLS_TOML: &str = "version = 1\ndamping = 0.02\narmature = 1e-4\nspring = 0.02\n\
    [[actuator]]\nname = \"close\"\narms = { turn_left = 0.01, turn_right = 0.01 }\n";

struct HandFiles {
    folder: TempDir,
}

impl HandFiles {
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
        let mut arguments = vec!["hand", "close", "--urdf", &urdf, "--pulls", &pulls, "--at", "0.07,0,0"];
        arguments.extend(["--ball-diameter-mm", "40", "--json"]);
        arguments.extend(more);
        run(&arguments)
    }
}

#[test]
fn a_clamp_closes_on_a_ball() {
    let files = HandFiles::new(CLAMP_URDF, PULLS_TOML);
    let picture = files.at("picture/clamp.png");
    let output = files.close(&["--out", &picture]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let text: serde_json::Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    assert_eq!(text["touching"], 2, "{text}");
    let [left, right] = [0, 1].map(|n| text["joints"][n]["force_n"].as_f64().expect("a force"));
    assert!(left > 1.0 && (left - right).abs() < 0.05 * left, "both jaws press alike: {left} {right}");
    assert!(Path::new(&picture).exists());
}

/// A mesh with a hole is accepted: its convex hull replaces it, with a note to the user.
#[test]
fn a_mesh_with_a_hole_is_taken_as_its_hull() {
    let urdf = CLAMP_URDF.replacen("<box size=\"0.10 0.01 0.03\"/>", "<mesh filename=\"jaw.obj\"/>", 1);
    let files = HandFiles::new(&urdf, PULLS_TOML);
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

/// Sliding jaws whose limit gives neither effort nor velocity load, and each moves in by half of the gap around the ball.
#[test]
fn a_parallel_gripper_slides_onto_a_ball() {
    let urdf = CLAMP_URDF
        .replace("type=\"revolute\"", "type=\"prismatic\"")
        .replace("xyz=\"0 0 -1\"", "xyz=\"0 -1 0\"")
        .replace("xyz=\"0 0 1\"", "xyz=\"0 1 0\"")
        .replace("lower=\"0\" upper=\"1\" effort=\"1\" velocity=\"1\"", "lower=\"0\" upper=\"0.02\"");
    let files = HandFiles::new(&urdf, &PULLS_TOML.replace("0.01", "1.0"));
    let output = files.close(&[]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let text: serde_json::Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    assert_eq!(text["touching"], 2, "{text}");
    for n in [0, 1] {
        let at = text["joints"][n]["position_m"].as_f64().expect("a position");
        assert!((at - 0.005).abs() < 1e-3, "25 mm to the jaw's face, 20 mm to the ball: {at}");
    }
}

/// A revolute joint without `<limit>` moves, with a note; a link without a collision shape gets a note too.
#[test]
fn a_joint_without_limit_moves_and_a_bare_link_is_named() {
    let urdf = CLAMP_URDF.replace("<limit lower=\"0\" upper=\"1\" effort=\"1\" velocity=\"1\"/>", "");
    let files = HandFiles::new(&urdf, PULLS_TOML);
    let output = files.close(&[]);
    let text: serde_json::Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    assert!(text["joints"][0]["angle_rad"].as_f64().is_some_and(|angle| angle > 0.05), "{text}");
    assert!(stderr(&output).contains("joint[turn_left].limit: no lower and upper"), "{}", stderr(&output));
    let shape = "<collision><origin xyz=\"0.05 0 0\" rpy=\"0 0 0\"/><geometry><box size=\"0.10 0.01 0.03\"/></geometry></collision>";
    let files = HandFiles::new(&CLAMP_URDF.replacen(shape, "", 1), PULLS_TOML);
    let output = files.close(&[]);
    assert!(stderr(&output).contains("link.collision: none of left; everything passes through"), "{}", stderr(&output));
}

/// The mesh of a jaw is found as PLY and COLLADA, with Windows path separators, with a blank as %20, and in a package
/// beside that of the URDF.
#[test]
fn meshes_of_any_kind_and_spelling_are_found() {
    let corner = |n: usize| {
        let side = |bit: usize, half: f64| if n >> bit & 1 == 1 { half } else { -half };
        format!("{} {} {}", side(0, 0.05), side(1, 0.005), side(2, 0.015))
    };
    let corners: Vec<String> = (0..8).map(corner).collect();
    let faces = ["0 2 3 1", "4 5 7 6", "0 1 5 4", "2 6 7 3", "0 4 6 2", "1 3 7 5"];
    let ply = format!(
        "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\nproperty float z\nelement face 6\n\
         property list uchar int vertex_indices\nend_header\n{}\n{}\n",
        corners.join("\n"),
        faces.map(|face| format!("4 {face}")).join("\n")
    );
    let dae = format!(
        "<COLLADA xmlns=\"http://www.collada.org/2005/11/COLLADASchema\" version=\"1.4.1\"><library_geometries><geometry id=\"g\"><mesh>\
         <source id=\"s\"><float_array id=\"a\" count=\"24\">{}</float_array></source>\
         <vertices id=\"v\"><input semantic=\"POSITION\" source=\"#s\"/></vertices>\
         <polylist count=\"6\"><input semantic=\"VERTEX\" source=\"#v\" offset=\"0\"/><vcount>4 4 4 4 4 4</vcount><p>{}</p></polylist>\
         </mesh></geometry></library_geometries></COLLADA>",
        corners.join(" "),
        faces.join(" ")
    );
    for (file, name, text) in [
        ("jaw.ply", "jaw.ply", &ply),
        ("jaw.dae", "jaw.dae", &dae),
        ("meshes/left jaw.ply", "meshes\\left%20jaw.ply", &ply),
        ("parts/meshes/jaw.ply", "package://parts/meshes/jaw.ply", &ply),
    ] {
        let urdf = CLAMP_URDF.replacen("<box size=\"0.10 0.01 0.03\"/>", &format!("<mesh filename=\"{name}\"/>"), 1);
        let files = HandFiles::new(&urdf, PULLS_TOML);
        let path = files.at(file);
        fs::create_dir_all(Path::new(&path).parent().expect("a folder")).expect("made");
        fs::write(&path, text).expect("written");
        let output = files.close(&[]);
        assert_eq!(output.status.code(), Some(0), "{name}: {}", stderr(&output));
        let text: serde_json::Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
        assert_eq!(text["touching"], 2, "{name}: {text}");
    }
}

/// `hand check --urdf` reads any hand, with its pulls file and without.
#[test]
fn a_hand_is_checked() {
    let files = HandFiles::new(CLAMP_URDF, PULLS_TOML);
    let output = run(&["hand", "check", "--urdf", &files.at("clamp.urdf"), "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let text: serde_json::Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    assert_eq!(
        (&text["joints"][1]["name"], &text["joints"][1]["effort"]),
        (&"turn_right".into(), &1.0.into()),
        "{text}"
    );
    let output =
        run(&["hand", "check", "--urdf", &files.at("clamp.urdf"), "--pulls", &files.at("clamp.toml"), "--json"]);
    let text: serde_json::Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    let notes = text["notes"].to_string();
    assert!(notes.contains("the fingers take up to") && text["actuators"][0]["max_tension_n"] == 100.0, "{text}");
}

/// The options of a hand have one name each; the old names still work and print a note.
#[test]
fn old_option_names_work_and_say_so() {
    let files = HandFiles::new(CLAMP_URDF, PULLS_TOML);
    let output = files.close(&[]);
    assert!(!stderr(&output).contains("is called"), "{}", stderr(&output));
    let (urdf, pulls) = (files.at("clamp.urdf"), files.at("clamp.toml"));
    let old = run(&["hand", "close", "--hand", &urdf, "--transmission", &pulls, "--at", "0.07,0,0", "--json"]);
    for note in ["--hand is called --urdf now", "--transmission is called --pulls now"] {
        assert!(stderr(&old).contains(note), "{}", stderr(&old));
    }
    assert!(serde_json::from_slice::<serde_json::Value>(&old.stdout).is_ok_and(|answer| answer["touching"].is_u64()));
}

impl HandFiles {
    /// Runs a grasp search for a golf ball and returns its JSON output.
    fn generate(&self, chains: &str) -> serde_json::Value {
        let (urdf, pulls) = (self.at("clamp.urdf"), self.at("clamp.toml"));
        let asked = ["grasps", "generate", "--urdf", &urdf, "--pulls", &pulls, "--object", "golf_ball", "--n", chains];
        let output = run(&[&asked[..], &["--contacts", "2", "--closings", "4", "--json"]].concat());
        serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {}", stderr(&output)))
    }
}

/// Returns the URDF of a parallel gripper: jaws that slide in on both sides.
fn gripper() -> String {
    CLAMP_URDF
        .replace("type=\"revolute\"", "type=\"prismatic\"")
        .replace("xyz=\"0 0 -1\"", "xyz=\"0 -1 0\"")
        .replace("xyz=\"0 0 1\"", "xyz=\"0 1 0\"")
        .replace("upper=\"1\" effort=\"1\"", "upper=\"0.02\" effort=\"40\"")
}

/// A ball that physics holds between two soft jaws passes the cone program too: the contacts bear friction torques
/// about their normals.
#[test]
fn cone_program_and_physics_agree_on_a_parallel_gripper() {
    let answer = HandFiles::new(&gripper(), &PULLS_TOML.replace("0.01", "1.0")).generate("8");
    let count = |field: &str| answer["verified"][field].as_u64().expect("a count");
    assert!(count("all") >= 4 && count("a") >= count("c"), "{answer}");
    assert_eq!(answer["opposed"].as_u64(), Some(count("all")), "{answer}");
    assert!(answer["surface_gap"].as_f64().is_some_and(|gap| gap < 1e-6), "boxes are their own surface: {answer}");
}

/// A jaw that presses against a fixed wall makes no grasp, unless the pulls file calls the wall a palm; then a warning
/// says that no digits oppose each other.
#[test]
fn a_grasp_against_a_fixed_wall_is_none_but_against_a_palm() {
    let wall = "<link name=\"base\"><collision><origin xyz=\"0.05 -0.035 0\"/><geometry><box size=\"0.10 0.01 0.06\"/></geometry></collision></link>";
    let (start, end) = (
        CLAMP_URDF.find("<link name=\"right\"").expect("it"),
        CLAMP_URDF.find("<joint name=\"turn_left\"").expect("it"),
    );
    let right = CLAMP_URDF.find("<joint name=\"turn_right\"").expect("it");
    let urdf =
        format!("{}{}</robot>", &CLAMP_URDF[..start], &CLAMP_URDF[end..right]).replace("<link name=\"base\"/>", wall);
    let urdf = urdf
        .replace("type=\"revolute\"", "type=\"prismatic\"")
        .replace("xyz=\"0 0 -1\"", "xyz=\"0 -1 0\"")
        .replace("upper=\"1\" effort=\"1\"", "upper=\"0.04\" effort=\"40\"");
    let pulls = PULLS_TOML.replace("turn_left = 0.01, turn_right = 0.01", "turn_left = 1.0");
    let wall = HandFiles::new(&urdf, &pulls).generate("6");
    assert_eq!(wall["verified"]["all"], 0, "{wall}");
    assert!(wall["notes"].to_string().contains("a grasp that leans on a fixed part (base) is none"), "{wall}");
    let palm = HandFiles::new(&urdf, &format!("{pulls}[palm]\nlinks = [\"base\"]\n")).generate("6");
    assert!(palm["verified"]["all"].as_u64() > Some(0), "{palm}");
    assert_eq!(palm["opposed"], 0, "{palm}");
    assert!(palm["notes"].to_string().contains("uses opposed digits"), "{palm}");
}

/// Tensions are limited by the efforts of the joints.
#[test]
fn a_tension_above_the_efforts_is_scaled_and_told() {
    let files = HandFiles::new(&CLAMP_URDF.replace("effort=\"1\"", "effort=\"0.06\""), PULLS_TOML);
    let output = files.close(&["--tensions", "60"]);
    assert!(stderr(&output).contains("close: 60 N requested, 6.0 N used: the effort of turn_"), "{}", stderr(&output));
    let weak: serde_json::Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    let given: serde_json::Value = serde_json::from_slice(&files.close(&["--tensions", "6"]).stdout).expect("JSON");
    assert_eq!(weak["joints"], given["joints"]);
}

#[test]
fn faults_name_file_element_and_field() {
    let mesh = |file: &str, scale: &str| {
        CLAMP_URDF.replacen("<box size=\"0.10 0.01 0.03\"/>", &format!("<mesh filename=\"{file}\"{scale}/>"), 1)
    };
    let cases: [(String, String, &[&str]); 16] = [
        (
            CLAMP_URDF.replacen("<child link=\"left\"/>", "<child link=\"lift\"/>", 1),
            PULLS_TOML.into(),
            &["clamp.urdf", "joint[turn_left].child", "`lift`"],
        ),
        (
            CLAMP_URDF.replacen("<child link=\"right\"/>", "<child link=\"left\"/>", 1),
            PULLS_TOML.into(),
            &["clamp.urdf", "joint[turn_right].child", "without loops"],
        ),
        (
            CLAMP_URDF.replacen("ixx=\"2e-5\"", "ixx=\"0\"", 1),
            PULLS_TOML.into(),
            &["clamp.urdf", "link[left].inertial.inertia", "positive definite"],
        ),
        (
            CLAMP_URDF.replacen("<mass value=\"0.1\"/>", "<mass value=\"-1\"/>", 1),
            PULLS_TOML.into(),
            &["clamp.urdf", "link[left].inertial.mass"],
        ),
        (
            mesh("nowhere.stl", ""),
            PULLS_TOML.into(),
            &["clamp.urdf", "link[left].collision[0].mesh.filename", "nowhere.stl"],
        ),
        (
            mesh("jaw.obj", ""),
            PULLS_TOML.into(),
            &["clamp.urdf", "link[left].collision[0].mesh.scale", "0.001 0.001 0.001"],
        ),
        (
            mesh("flat.obj", ""),
            PULLS_TOML.into(),
            &["clamp.urdf", "link[left].collision[0].mesh.filename", "span a volume"],
        ),
        (
            CLAMP_URDF.into(),
            PULLS_TOML.replace("turn_right", "turn_up"),
            &["clamp.toml", "actuator[close].arms.turn_up", "turn_left"],
        ),
        (
            CLAMP_URDF.replacen("lower=\"0\"", "lower=\"2\"", 1),
            PULLS_TOML.into(),
            &["clamp.urdf", "joint[turn_left].limit", "lower 2 and upper 1"],
        ),
        (
            CLAMP_URDF.replacen("xyz=\"0 0 -1\"", "xyz=\"0 0 0\"", 1),
            PULLS_TOML.into(),
            &["clamp.urdf", "joint[turn_left].axis"],
        ),
        (
            CLAMP_URDF.replacen("xyz=\"0 0.03 0\"", "xyz=\"0 nan 0\"", 1),
            PULLS_TOML.into(),
            &["clamp.urdf", "joint[turn_left].origin.xyz", "NaN"],
        ),
        (
            CLAMP_URDF.replacen("size=\"0.10", "size=\"-0.10", 1),
            PULLS_TOML.into(),
            &["clamp.urdf", "link[left].collision[0].box.size", "-0.1"],
        ),
        (
            CLAMP_URDF.replacen("size=\"0.10", "size=\"nan", 1),
            PULLS_TOML.into(),
            &["clamp.urdf", "link[left].collision[0].box.size", "NaN"],
        ),
        (
            CLAMP_URDF.into(),
            PULLS_TOML.replace("turn_left = 0.01", "turn_left = 0.0"),
            &["clamp.toml", "arms.turn_left: found 0"],
        ),
        (
            CLAMP_URDF.into(),
            PULLS_TOML.replace("turn_left = 0.01", "turn_left = nan"),
            &["clamp.toml", "arms.turn_left: found NaN"],
        ),
        (
            CLAMP_URDF.into(),
            PULLS_TOML.replace("turn_left = 0.01, turn_right = 0.01", ""),
            &["clamp.toml", "actuator[close].arms: found none", "at least one joint"],
        ),
    ];
    for (urdf, pulls, named) in cases {
        let files = HandFiles::new(&urdf, &pulls);
        // One mesh in millimetres, and one in a single plane.
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
    let files = HandFiles::new(CLAMP_URDF, PULLS_TOML);
    for (arguments, named) in [
        (["--tensions", "1,2,3"], "--tensions: found 3 values, expected 1 or 1 (close)"),
        (["--tensions", "-4"], "--tensions: found -4"),
    ] {
        let output = files.close(&arguments);
        assert_eq!(output.status.code(), Some(2));
        assert!(stderr(&output).contains(named), "{}", stderr(&output));
    }
}
