//! A user's object: a file beside the scenario that refers to it, with a mesh beside that.

use std::path::{Path, PathBuf};

use e2e::shared_data;
use ftac_platform::file_access::FileAccess;
use scenarios::Scenario;
use world::ObjectFile;
use world::geometry::{Mesh, RepairReport};

/// A wedge, 40 mm long and wide, 30 mm high on one side.
const WEDGE: &str = "v 0 0 0\nv 0.04 0 0\nv 0.04 0.04 0\nv 0 0.04 0\nv 0 0 0.03\nv 0 0.04 0.03\n\
                     f 1 4 3 2\nf 1 2 5\nf 4 6 3\nf 2 3 6 5\nf 1 5 6 4\n";
const OBJECT: &str = "name = \"my_wedge\"\nmass = 0.02\nfriction = 0.6\n[shape.mesh]\nfile = \"meshes/wedge.obj\"\n";
const SCENARIO: &str = "version = 1\nname = \"a wedge\"\nextends = \"benchmark\"\nobjects = [\"things/my_wedge.toml\"]\n\
                        first = [\"golf_ball\"]\nsecond = [\"my_wedge\"]\n";

/// Creates a folder for a test with a scenario, its object and its mesh.
fn folder(test: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("own_object").join(test);
    std::fs::create_dir_all(folder.join("things/meshes")).expect("a folder for the test");
    for (file, text) in [("mine.toml", SCENARIO), ("things/my_wedge.toml", OBJECT), ("things/meshes/wedge.obj", WEDGE)]
    {
        std::fs::write(folder.join(file), text).expect("a file of the test");
    }
    folder
}

#[test]
fn a_scenario_brings_its_own_object_and_it_stands_on_the_table() {
    let path = folder("stands").join("mine.toml");
    let scenario = Scenario::read(&path).expect("a good scenario");
    let set = scenario.object_set().expect("good objects");
    let wedge = set.get("my_wedge").expect("the user's object");
    // A prism has half its block's volume; the centroid of a right triangle is a third of its height over its base.
    assert!((wedge.shape.volume() - 0.5 * 0.04 * 0.04 * 0.03).abs() < 1e-12);
    let pose = scenario.layout.second.pose(wedge);
    assert!(
        (pose.translation.z - 0.01).abs() < 1e-12
            && wedge.shape.lowest_height(&pose.rotation) + pose.translation.z < 1e-12
    );
    assert!(set.get("golf_ball").is_some());
}

/// The text that a run stores of its scenario needs neither the object's file nor the mesh.
#[test]
fn a_self_contained_text_is_the_same_scenario_elsewhere() {
    let path = folder("elsewhere").join("mine.toml");
    let text = Scenario::self_contained(SCENARIO, &path, FileAccess::in_folder_of(&path)).expect("a good scenario");
    let moved = Scenario::parse(&text, Path::new("/nowhere/run.json")).expect("a scenario that needs no file");
    assert_eq!(moved, Scenario::read(&path).expect("a good scenario"));
    assert!(moved.object_set().expect("good objects").get("my_wedge").is_some());
    let benchmark =
        Scenario::self_contained(scenarios::scenario::BENCHMARK_TOML, Path::new("benchmark.toml"), FileAccess::Nothing);
    assert_eq!(benchmark.expect("the benchmark"), scenarios::scenario::BENCHMARK_TOML);
}

#[test]
fn an_error_names_the_file_that_it_is_in() {
    let folder = folder("errors");
    let scenario = folder.join("mine.toml");
    let refused = |file: &str, text: &str| {
        let before = std::fs::read_to_string(folder.join(file)).expect("a file of the test");
        std::fs::write(folder.join(file), text).expect("a file of the test");
        let error = Scenario::read(&scenario).expect_err("refused").to_string();
        std::fs::write(folder.join(file), before).expect("a file of the test");
        error
    };
    let heavy = refused("things/my_wedge.toml", &OBJECT.replace("0.02", "20"));
    assert!(heavy.ends_with("my_wedge.toml: mass: found 20, expected 0.0001 to 4 kg"), "{heavy}");
    let open = refused("things/meshes/wedge.obj", &WEDGE.replace("f 1 5 6 4\n", ""));
    assert!(open.contains("my_wedge.toml: shape.mesh.file: found meshes/wedge.obj: mesh is not watertight"), "{open}");
    let millimetres = refused("things/meshes/wedge.obj", &WEDGE.replace("0.0", ""));
    assert!(
        millimetres.contains("my_wedge.toml: shape.mesh.file: found meshes/wedge.obj: mesh extent: found 4.000 m"),
        "{millimetres}"
    );
    let taken = refused("things/my_wedge.toml", &OBJECT.replace("my_wedge", "golf_ball"));
    assert!(taken.contains("object.name: found \"golf_ball\", expected a name that no other object has"), "{taken}");
    let missing = refused("mine.toml", &SCENARIO.replace("things/", "thngs/"));
    assert!(missing.contains("thngs/my_wedge.toml: "), "{missing}");
    let unnamed = refused("mine.toml", &SCENARIO.replace("second = [\"my_wedge\"]", "second = [\"my_wdge\"]"));
    assert!(unnamed.contains("my_wdge"), "{unnamed}");
}

#[test]
fn a_mesh_that_is_not_there_is_named() {
    let folder = folder("missing");
    std::fs::write(folder.join("things/my_wedge.toml"), OBJECT.replace("wedge.obj", "wege.obj"))
        .expect("a file of the test");
    let file = folder.join("things/my_wedge.toml");
    let error = ObjectFile::read(&file, FileAccess::in_folder_of(&file)).expect_err("refused").to_string();
    assert!(error.contains("my_wedge.toml: shape.mesh.file: found ") && error.contains("wege.obj"), "{error}");
}

/// If an untrusted scenario, its object or its mesh refers to a file elsewhere, the contents of that file are neither
/// read nor revealed.
#[test]
fn a_scenario_reads_no_file_outside_its_folder() {
    let folder = folder("outside");
    let scenario = folder.join("mine.toml");
    let secret = Path::new(env!("CARGO_TARGET_TMPDIR")).join("own_object/secret.toml");
    std::fs::write(&secret, "root:$6$hunter2:19000:0:99999:7:::\n").expect("written");
    let mesh = secret.with_extension("obj");
    std::fs::write(&mesh, "v hunter2\n").expect("written");
    let link = folder.join("things/link.toml");
    if !link.is_symlink() {
        std::os::unix::fs::symlink(&secret, &link).expect("linked");
    }
    let refused = |objects: &str, object: &str, words: &str| {
        std::fs::write(folder.join("things/my_wedge.toml"), object).expect("written");
        let text = SCENARIO.replace("things/my_wedge.toml", objects);
        std::fs::write(&scenario, &text).expect("written");
        let error = Scenario::read(&scenario).expect_err("refused").to_string();
        assert!(error.contains(words) && !error.contains("hunter2"), "{error}");
        let error = Scenario::parse(&text, Path::new("trial.mcap")).expect_err("refused").to_string();
        assert!(error.contains("objects[0]: found ") && error.contains("expected no file"), "{error}");
    };
    for outside in ["/etc/shadow", "../../secret.toml", secret.to_str().expect("text"), "things/link.toml"] {
        refused(outside, OBJECT, "expected a file below ");
    }
    let beyond = OBJECT.replace("meshes/wedge.obj", mesh.to_str().expect("text"));
    refused("things/my_wedge.toml", &beyond, "shape.mesh.file: found ");
    // The user may allow it.
    let anywhere = Scenario::parse_within(SCENARIO, &folder.join("things/deeper/x.toml"), FileAccess::Anywhere);
    assert!(anywhere.expect_err("no such file").to_string().contains("things/deeper/things/my_wedge.toml"));
}

/// A pipe in place of an object's file or its mesh is refused by name, because reading it would not end.
#[test]
fn a_pipe_for_an_object_is_refused() {
    let folder = folder("pipe");
    for name in ["things/my_wedge.toml", "things/meshes/wedge.obj"] {
        let file = folder.join(name);
        let before = std::fs::read(&file).expect("a file of the test");
        std::fs::remove_file(&file).expect("removed");
        assert!(std::process::Command::new("mkfifo").arg(&file).status().expect("mkfifo runs").success());
        let error = Scenario::read(&folder.join("mine.toml")).expect_err("refused").to_string();
        std::fs::remove_file(&file).expect("removed");
        std::fs::write(&file, before).expect("written");
        assert!(error.contains(name.rsplit('/').next().expect("a name")), "{error}");
        assert!(error.contains("found a pipe, expected a regular file"), "{error}");
    }
}

/// Implausibly large counts in a file are refused.
#[test]
fn counts_that_cannot_be_are_refused() {
    let path = Path::new("my_wedge.toml");
    let text = "name = \"ball\"\nmass = 0.1\nfriction = 0.5\nsymmetry = { fold = { n = 4000000000, flip = true } }\n\
                [shape.sphere]\ndiameter = 0.05\n";
    let object = ObjectFile::parse(text, path, FileAccess::Nothing).expect("an object's file");
    let error = object.model(path).expect_err("refused").to_string();
    assert!(error.contains("symmetry.fold.n: found 4000000000, expected 1 to 360"), "{error}");
}

/// Returns the volume (m3) of a loaded mesh, the greatest distance between its surface and that of another (m), and the
/// repairs.
fn against(broken: &Path, sound: &Path) -> (f64, f64, RepairReport) {
    let (mesh, repair) = Mesh::load(broken).expect("mended");
    let sound = Mesh::load(sound).expect("a sound mesh").0;
    let off = mesh.vertices().iter().map(|vertex| sound.signed_distance(vertex).0.abs());
    let missing = sound.vertices().iter().map(|vertex| mesh.signed_distance(vertex).0.abs());
    (mesh.volume(), off.chain(missing).fold(0.0, f64::max), repair)
}

#[test]
fn one_triangle_of_no_area_does_not_rebuild_a_cup() {
    let (Some(broken), Some(sound)) = (shared_data("faults/cup_one_degenerate.obj"), shared_data("faults/cup.obj"))
    else {
        return;
    };
    let (volume, off, repair) = against(&broken, &sound);
    assert!((volume / 52.3e-6 - 1.0).abs() < 0.01 && off < 3e-4, "{volume} m3, {off} m");
    assert!(repair.rebuilt.is_none() && repair.degenerate == 1, "{repair}");
}

#[test]
fn half_flipped_windings_keep_a_blobs_volume() {
    let (Some(broken), Some(sound)) = (shared_data("faults/blob_half_flipped.obj"), shared_data("faults/blob.obj"))
    else {
        return;
    };
    let (volume, off, repair) = against(&broken, &sound);
    assert!((volume / 115.3e-6 - 1.0).abs() < 0.01 && off < 3e-4, "{volume} m3, {off} m");
    assert!(repair.rebuilt.is_none() && repair.flipped > 500, "{repair}");
}

/// Scan of a bottle with two triangles of no area where its surface touches itself.
#[test]
fn a_scan_that_touches_itself_is_not_rebuilt() {
    let Some(bottle) = shared_data("objects/ycb/006_mustard_bottle.obj") else { return };
    let (mesh, repair) = Mesh::load(&bottle).expect("mended");
    assert!((mesh.volume() / 612.04e-6 - 1.0).abs() < 1e-4, "{} m3", mesh.volume());
    assert!(repair.rebuilt.is_none() && repair.max_deviation < 1e-6 && mesh.triangles().len() > 16_000, "{repair}");
}

/// A scenario mends the same faults as `grasps generate --mesh`, and a run stores the mended mesh and the report.
#[test]
fn a_scenario_mends_what_other_commands_mend() {
    let folder = folder("mends");
    // One inside-out face, a duplicate triangle, and one without an area.
    let broken = WEDGE.replace("f 2 3 6 5\n", "f 5 6 3 2\nf 5 6 3\nf 1 2 2\n");
    std::fs::write(folder.join("things/meshes/wedge.obj"), broken).expect("a file of the test");
    let (mesh, repair) = Mesh::load(&folder.join("things/meshes/wedge.obj")).expect("mended");
    let scenario = Scenario::read(&folder.join("mine.toml")).expect("a good scenario");
    let set = scenario.object_set().expect("good objects");
    let wedge = set.get("my_wedge").expect("the user's object");
    assert!((wedge.shape.volume() - 0.5 * 0.04 * 0.04 * 0.03).abs() < 1e-12 && mesh.volume() > 0.0);
    let notes = scenario.object[0].notes(wedge);
    assert!(notes.len() == 1 && notes[0].contains(&repair.to_string()), "{notes:?}");
    let text =
        Scenario::self_contained(SCENARIO, &folder.join("mine.toml"), FileAccess::Anywhere).expect("a good scenario");
    let moved = Scenario::parse(&text, Path::new("/nowhere/run.json")).expect("a scenario that needs no file");
    assert_eq!(moved, scenario);
}
