//! Grasp synthesis as a user runs it: a collection that resumes after a kill, display of grasps, broken and huge meshes.

use std::fs;
use std::path::Path;

use e2e::{root, run, stderr};
use serde_json::Value;
use tempfile::tempdir;

fn text(path: &Path) -> &str {
    path.to_str().expect("a UTF-8 path")
}

fn make(parts: &Path, out: &Path, each: &str) -> Value {
    let arguments = [
        "grasps",
        "collection",
        "--object",
        "ball",
        "--each",
        each,
        "--chains",
        "64",
        "--seed",
        "3",
        "--json",
        "--parts",
        text(parts),
        "--out",
        text(out),
    ];
    let output = run(&arguments);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    serde_json::from_slice(&output.stdout).expect("JSON")
}

/// A part cut off in the middle of a line, as by a kill, is resumed; the file is the same as from an undisturbed run.
#[test]
fn an_interrupted_collection_goes_on() {
    let folder = tempdir().expect("a folder");
    let (whole, cut) = (folder.path().join("whole"), folder.path().join("cut"));
    let answer = make(&whole, &folder.path().join("whole.jsonl"), "4");
    assert_eq!((answer["grasps"].as_u64(), answer["requested"].as_u64()), (Some(4), Some(4)), "{answer}");
    fs::create_dir(&cut).expect("a folder");
    let part = fs::read(whole.join("ball.jsonl")).expect("a part");
    fs::write(cut.join("ball.jsonl"), &part[..part.len() * 3 / 5]).expect("written");
    make(&cut, &folder.path().join("cut.jsonl"), "4");
    let read = |name: &str| fs::read_to_string(folder.path().join(name)).expect("written");
    assert_eq!(read("whole.jsonl"), read("cut.jsonl"));
    // If fewer are wanted, they are the first of the same ones.
    make(&cut, &folder.path().join("two.jsonl"), "2");
    let (two, four) = (read("two.jsonl"), read("whole.jsonl"));
    assert_eq!(two.lines().skip(2).collect::<Vec<_>>(), four.lines().skip(2).take(2).collect::<Vec<_>>());
}

/// The built-in collection is shown as a table, a recording and pictures.
#[test]
fn grasps_are_shown() {
    let folder = tempdir().expect("a folder");
    let (file, pictures) = (folder.path().join("pawn.rrd"), folder.path().join("report"));
    let output = run(&["grasps", "show", "pawn", "--out", text(&file)]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(fs::metadata(&file).expect("a recording").len() > 100_000);
    let output = run(&["grasps", "show", "pawn", "--report", text(&pictures)]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    for name in ["grasps.html", "pawn.png", "pawn_0_0.png", "pawn_11_0.png"] {
        assert!(fs::metadata(pictures.join(name)).expect(name).len() > 1000, "{name}");
    }
    let output = run(&["grasps", "show", "--json"]);
    let answer: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(answer["objects"].as_array().map(Vec::len), Some(23));
}

/// Grasps of one type are found, and the rules classify every one of them as that type. An unknown type is refused,
/// with the list of known ones.
#[test]
fn grasps_of_one_type() {
    let folder = tempdir().expect("a folder");
    let file = folder.path().join("rings.jsonl");
    let wanted = ["grasps", "generate", "--object", "cube_45", "--contacts", "2-5", "--n", "16", "--json", "--type"];
    let output = run(&[&wanted[..], &["ring", "--closings", "24", "--seed", "3", "--out", text(&file)]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let answer: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert!(answer["of_type"].as_u64() < answer["verified"]["all"].as_u64(), "others are left out: {answer}");
    let output = run(&["grasps", "classify", "--grasps", text(&file), "--json"]);
    let types: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let decisions = types["decisions"].as_array().expect("a list");
    assert_eq!(Some(decisions.len() as u64), answer["kept"].as_u64());
    for decision in decisions {
        assert_eq!(decision["type"], "Ring");
        assert!(decision["margin"].as_f64() >= Some(0.0), "{decision}");
    }
    let output = run(&[&wanted[..], &["no such type"]].concat());
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("Writing Tripod"), "{}", stderr(&output));
}

/// The largest subset of the built-in collection with the type shares of human grasping.
#[test]
fn grasps_with_the_shares_of_people() {
    let folder = tempdir().expect("a folder");
    let file = folder.path().join("like_people.jsonl");
    let output = run(&["grasps", "classify", "--like-people", text(&file)]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let output = run(&["grasps", "classify", "--grasps", text(&file), "--json"]);
    let answer: Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let ways = answer["people"].as_array().expect("a list");
    assert_eq!(ways.len(), 5);
    for way in ways {
        let [people, share] = ["people", "share"].map(|field| way[field].as_f64().expect("a number"));
        assert!((people - share).abs() < 0.02, "{way}");
    }
    assert!(answer["grasps"].as_u64() > Some(100), "{answer}");
}

/// Radius of the ball, m.
const BALL_RADIUS: f64 = 0.025;

/// Returns a ball (OBJ) of `rings` by twice as many facets, radius [`BALL_RADIUS`]; the facets of the last `left_out` rings
/// are missing.
fn ball(rings: usize, left_out: usize) -> String {
    let mut content = String::new();
    let around = 2 * rings;
    for ring in 0..=rings {
        let tilt = std::f64::consts::PI * ring as f64 / rings as f64;
        for k in 0..around {
            let turn = std::f64::consts::TAU * k as f64 / around as f64;
            let (x, y) = (tilt.sin() * turn.cos(), tilt.sin() * turn.sin());
            content += &format!("v {:.6} {:.6} {:.6}\n", BALL_RADIUS * x, BALL_RADIUS * y, BALL_RADIUS * tilt.cos());
        }
    }
    for ring in 0..rings - left_out {
        for k in 0..around {
            let (a, b) = (ring * around + k + 1, ring * around + (k + 1) % around + 1);
            // At the poles one of the two triangles has no area.
            if ring + 1 < rings {
                content += &format!("f {a} {} {}\n", a + around, b + around);
            }
            if ring > 0 {
                content += &format!("f {a} {} {b}\n", b + around);
            }
        }
    }
    content
}

/// A mesh with a hole is closed, and one of a million triangles is simplified; both are reported. A flat mesh is
/// refused, and so is an invalid mass.
#[test]
fn broken_and_huge_meshes() {
    let folder = tempdir().expect("a folder");
    let mesh = folder.path().join("thing.obj");
    for (content, done, chains) in
        [(ball(24, 1), "1 hole closed", "8"), (ball(501, 0), "1001768 triangles made 40000", "1")]
    {
        fs::write(&mesh, content).expect("written");
        let output = run(&["grasps", "generate", "--mesh", text(&mesh), "--n", chains, "--seed", "3", "--json"]);
        let said = stderr(&output);
        // The ball has 65.4 cm3, the coarse one 64.9.
        let volume = [", 64.9 cm3", ", 65.0 cm3", ", 65.4 cm3"].iter().any(|volume| said.contains(volume));
        assert!(said.contains("mended: ") && said.contains(done) && volume, "{said}");
        let answer: Value = serde_json::from_slice(&output.stdout).expect("JSON");
        assert!(answer["verified"]["all"].as_u64() > Some(0), "{answer}");
    }
    let refused = |options: &[&str], expected: &str| {
        let output = run(&[&["grasps", "generate", "--mesh", text(&mesh), "--n", "1"], options].concat());
        assert_eq!(output.status.code(), Some(2));
        assert!(stderr(&output).contains(expected), "{}", stderr(&output));
    };
    fs::write(&mesh, ball(24, 0)).expect("written");
    refused(&["--density", "1.0"], "--density: found an object of 6.5");
    refused(&["--mass", "0.00001"], "--mass: found 0.00001, expected 0.0001 to 10");
    let sheet: String = "v 0 0 0\nv 0.05 0 0\nv 0.05 0.05 0\nv 0 0.05 0\nv 0.02 0.02 0\n\
                         f 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\n"
        .into();
    fs::write(&mesh, sheet).expect("written");
    refused(&[], "it cannot be mended: ");
}

/// Third-party hands, from their URDF alone. Their grasp file is shown, closed again and exported; commands that depend
/// on the digits of our own hand refuse it, and a changed hand is detected. The models are not part of this repository.
#[test]
fn other_hands_grasp() {
    for (urdf, pulls, chains) in [
        ("allegro/allegro_hand_right.urdf", "allegro.toml", "8"),
        ("ezgripper_gen2/urdf/ezgripper_dual_gen2_expanded.urdf", "ezgripper.toml", "24"),
    ] {
        let Some(urdf) = e2e::shared_data(&format!("hands/{urdf}")) else { continue };
        let folder = tempdir().expect("a folder");
        let pulls_file = folder.path().join(pulls);
        fs::copy(root().join("hand-model/data/hands").join(pulls), &pulls_file).expect("copied");
        let file = folder.path().join("grasps.jsonl");
        let asked = ["grasps", "generate", "--urdf", text(&urdf), "--pulls", text(&pulls_file), "--out", text(&file)];
        let output = run(&[&asked[..], &["--object", "ball", "--n", chains, "--contacts", "4", "--json"]].concat());
        let answer: Value = serde_json::from_slice(&output.stdout).expect("JSON");
        let found = answer["verified"]["all"].as_u64().expect("a count");
        assert!(found > 0, "{answer}");
        assert!(answer["notes"].as_array().is_some_and(|notes| notes.len() > 4), "{answer}");
        other_file_is_read(&file, found, folder.path());
        let refused = run(&["grasps", "classify", "--grasps", text(&file)]);
        assert_eq!(refused.status.code(), Some(2));
        assert!(stderr(&refused).contains(":1: hand: found "), "{}", stderr(&refused));
        let changed = fs::read_to_string(&pulls_file).expect("read") + "# another\n";
        fs::write(&pulls_file, changed).expect("written");
        let refused = run(&["grasps", "show", "--grasps", text(&file)]);
        assert_eq!(refused.status.code(), Some(2));
        assert!(stderr(&refused).contains("it has changed since"), "{}", stderr(&refused));
    }
}

/// Checks that the `found` grasps of a ball in another hand's file can be read.
fn other_file_is_read(file: &Path, found: u64, folder: &Path) {
    let shown = run(&["--json", "grasps", "show", "ball", "--grasps", text(file), "--report", text(folder)]);
    let answer: Value = serde_json::from_slice(&shown.stdout).expect("JSON");
    let kinds = answer["objects"][0]["kinds"].as_array().expect("kinds");
    assert_eq!(kinds.iter().filter_map(|kind| kind["count"].as_u64()).sum::<u64>(), found);
    assert!(fs::metadata(folder.join("ball.png")).expect("a sheet").len() > 5_000);
    let again = run(&["--json", "grasps", "eval", "--grasps", text(file)]);
    assert_eq!(again.status.code(), Some(0), "{}", stderr(&again));
    let answer: Value = serde_json::from_slice(&again.stdout).expect("JSON");
    assert_eq!((&answer["verified"]["all"]["count"], &answer["verified"]["all"]["of"]), (&found.into(), &found.into()));
    assert!(answer["controls"]["no_tension"]["count"].as_u64() < Some(found.div_ceil(2)), "{answer}");
    let scenes = folder.join("scenes");
    let exported =
        run(&["--json", "grasps", "export", "ball", "--grasps", text(file), "--n", "1", "--mjcf", text(&scenes)]);
    let answer: Value = serde_json::from_slice(&exported.stdout).expect("JSON");
    let read = |n: usize| fs::read_to_string(answer["files"][0][n].as_str().expect("a path")).expect("written");
    let (scene, test) = (read(0), serde_json::from_str::<Value>(&read(1)).expect("JSON"));
    let count = |field: &str| test[field].as_array().map_or(0, Vec::len);
    assert_eq!(scene.matches("<fixed ").count(), count("tensions"));
    assert_eq!(scene.matches("type=\"hinge\"").count(), test["closed"]["joints"].as_array().map_or(0, Vec::len));
    assert_eq!(
        (count("open_tensions"), scene.matches("<body ").count()),
        (count("tensions"), scene.matches("</body>").count())
    );
}

/// Poses of a mesh are in the frame of its file, wherever its centre is. The grasp file is read with the mesh that it names.
#[test]
fn grasps_of_a_mesh_are_in_its_own_frame() {
    let folder = tempdir().expect("a folder");
    let (mesh, file) = (folder.path().join("away.obj"), folder.path().join("away.jsonl"));
    let aside = [0.03, -0.05, 0.2];
    let content = ball(24, 0);
    let moved = content.lines().map(|line| match line.strip_prefix("v ") {
        Some(rest) => {
            let at: Vec<f64> = rest.split_whitespace().map(|word| word.parse().expect("a number")).collect();
            format!("v {} {} {}\n", at[0] + aside[0], at[1] + aside[1], at[2] + aside[2])
        }
        None => format!("{line}\n"),
    });
    fs::write(&mesh, moved.collect::<String>()).expect("written");
    let output = run(&["grasps", "generate", "--mesh", text(&mesh), "--n", "12", "--seed", "3", "--out", text(&file)]);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let lines = fs::read_to_string(&file).expect("written");
    let grasps: Vec<Value> = lines.lines().skip(1).map(|line| serde_json::from_str(line).expect("JSON")).collect();
    assert!(!grasps.is_empty());
    for grasp in &grasps {
        let pose: Vec<f64> = serde_json::from_value(grasp["palm_from_object"].clone()).expect("a pose");
        let center = turned(&pose[3..], &aside);
        for contact in grasp["contacts"].as_array().expect("contacts") {
            let point: Vec<f64> = serde_json::from_value(contact[1].clone()).expect("a point");
            let radius = (0..3).map(|n| (point[n] - pose[n] - center[n]).powi(2)).sum::<f64>().sqrt();
            assert!((radius - BALL_RADIUS).abs() < 1.5e-3, "{radius}");
        }
    }
    let again = run(&["--json", "grasps", "eval", "--grasps", text(&file)]);
    let answer: Value = serde_json::from_slice(&again.stdout).expect("JSON");
    // Poses in the file are rounded: a grasp that barely holds may be lost.
    assert!(answer["verified"]["c"]["count"].as_u64() >= Some(grasps.len() as u64 / 2), "{answer}");
}

/// Rotates a vector by a quaternion i, j, k, w.
fn turned(q: &[f64], v: &[f64; 3]) -> [f64; 3] {
    let cross =
        |a: [f64; 3], b: [f64; 3]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let axis = [q[0], q[1], q[2]];
    let twice = cross(axis, *v).map(|x| 2.0 * x);
    let again = cross(axis, twice);
    std::array::from_fn(|n| v[n] + q[3] * twice[n] + again[n])
}

/// Export of a grasp as a scene for another engine: a model whose keyframe has every joint and the object, and the
/// commands that close it.
#[test]
fn grasps_are_exported() {
    let folder = tempdir().expect("a folder");
    let out = folder.path().join("scenes");
    let exported = run(&["--json", "grasps", "export", "ball", "--n", "2", "--mjcf", text(&out)]);
    assert_eq!(exported.status.code(), Some(0), "{}", stderr(&exported));
    let answer: Value = serde_json::from_slice(&exported.stdout).expect("JSON");
    let files = answer["files"].as_array().expect("files");
    assert_eq!(files.len(), 2);
    for pair in files {
        let read = |n: usize| fs::read_to_string(pair[n].as_str().expect("a path")).expect("written");
        let (scene, test) = (read(0), serde_json::from_str::<Value>(&read(1)).expect("JSON"));
        let values = |name: &str| {
            let start = scene.find(&format!(" {name}=\"")).expect("a keyframe") + name.len() + 3;
            scene[start..].split('"').next().map_or(0, |values| values.split_whitespace().count())
        };
        // 15 joints, and position and quaternion of the object; five cables and the opposition.
        assert_eq!((values("qpos"), values("ctrl")), (15 + 7, 6));
        assert_eq!((scene.matches("<spatial ").count(), scene.matches("<freejoint ").count()), (5, 1));
        assert!(test["tensions"].as_array().is_some_and(|all| all.iter().any(|tension| tension.as_f64() > Some(1.0))));
    }
    let refused = run(&["grasps", "export", "ball", "--chain", "999999", "--mjcf", text(&out)]);
    assert!(
        refused.status.code() == Some(2) && stderr(&refused).contains("--chain: found 999999"),
        "{}",
        stderr(&refused)
    );
}

/// Grasp verification skips pairs that were verified with as much effort, and requires a grasp pair table.
#[test]
fn verified_pairs_stay() {
    let folder = tempdir().expect("a folder");
    let (of, out) = (folder.path().join("of.json"), folder.path().join("out.json"));
    let built_in =
        fs::read_to_string(root().join("twin/grasp-verification/data/grasp_pairs.json")).expect("the built-in plans");
    let mut plans: Value = serde_json::from_str(&built_in).expect("JSON");
    let all = plans["pairs"].as_array_mut().expect("pairs");
    all.truncate(2);
    all.iter_mut().for_each(|plan| plan["verification_level"] = 2.into());
    fs::write(&of, plans.to_string()).expect("written");
    let prove = ["grasps", "pairs", "--pairs", text(&of), "--verify", "--effort", "2", "--quiet", "--out", text(&out)];
    let output = run(&prove);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let written: Value = serde_json::from_str(&fs::read_to_string(&out).expect("written")).expect("JSON");
    assert_eq!(written, plans);
    let without_of = run(&["grasps", "pairs", "--verify", "--out", text(&out)]);
    assert!(stderr(&without_of).contains("--pairs"), "{}", stderr(&without_of));
    let none = run(&[&prove[..6], &["0", "--out", text(&out)]].concat());
    assert_eq!(none.status.code(), Some(2), "{}", stderr(&none));
}

/// Grasps by the little finger alone against the palm are found, and touch with nothing else.
#[test]
fn grasps_use_the_parts_that_are_asked_for() {
    let folder = tempdir().expect("a folder");
    let out = folder.path().join("little.jsonl");
    let generate = ["grasps", "generate", "--object", "can_50", "--n", "16", "--seed", "5", "--quiet"];
    let output = run(&[&generate[..], &["--parts", "palm,little", "--out", text(&out)]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let written = fs::read_to_string(&out).expect("written");
    let grasps: Vec<Value> = written.lines().skip(1).map(|line| serde_json::from_str(line).expect("JSON")).collect();
    let found: Vec<&Value> = grasps.iter().filter(|line| line.get("contacts").is_some()).collect();
    assert!(!found.is_empty(), "{written}");
    assert!(
        found.iter().all(|grasp| grasp["digits"] == serde_json::json!(["little"]) && grasp["palm"] == true),
        "{written}"
    );
    let one = run(&[&generate[..], &["--parts", "palm"]].concat());
    assert!(stderr(&one).contains("--parts: found one part"), "{}", stderr(&one));
}

/// A search replaces no file, and leaves none behind if it finds nothing.
#[test]
fn a_search_writes_only_what_it_finds() {
    let folder = tempdir().expect("a folder");
    let (mesh, out) = (root().join("twin/guide/files/box.obj"), folder.path().join("grasps.jsonl"));
    let generate = ["grasps", "generate", "--mesh", text(&mesh), "--n", "1", "--closings", "1", "--out", text(&out)];
    fs::write(&out, "mine").expect("written");
    let refused = run(&generate);
    assert_eq!(refused.status.code(), Some(2), "{}", stderr(&refused));
    assert!(stderr(&refused).contains("grasps.jsonl: found a file, expected none"), "{}", stderr(&refused));
    assert_eq!(fs::read_to_string(&out).expect("a file"), "mine");
    fs::remove_file(&out).expect("removed");
    let nothing = run(&generate);
    assert_eq!(nothing.status.code(), Some(1), "{}", stderr(&nothing));
    assert!(!out.exists());
}
