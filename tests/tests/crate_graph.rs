//! Dependencies between the crates, checked against the design: the controller never depends on the robot that it drives.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

/// Normal and build dependencies by package name. Dev-dependencies are not part of the program.
struct Graph {
    arrows: BTreeMap<String, BTreeSet<String>>,
    members: BTreeSet<String>,
}

impl Graph {
    fn read() -> Self {
        let output = Command::new(env!("CARGO"))
            .args(["metadata", "--format-version", "1", "--locked", "--offline", "--filter-platform", &host()])
            .current_dir(e2e::root())
            .output()
            .expect("cargo metadata runs");
        assert!(output.status.success(), "{}", e2e::stderr(&output));
        let metadata: Value = serde_json::from_slice(&output.stdout).expect("cargo metadata is JSON");
        let list = |value: &Value| value.as_array().cloned().unwrap_or_default();
        let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
        let names: BTreeMap<String, String> =
            list(&metadata["packages"]).iter().map(|p| (text(&p["id"]), text(&p["name"]))).collect();
        let members = list(&metadata["workspace_members"]).iter().map(|id| names[&text(id)].clone()).collect();
        let mut arrows: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
        for node in list(&metadata["resolve"]["nodes"]) {
            let from = arrows.entry(names[&text(&node["id"])].clone()).or_default();
            for dependency in list(&node["deps"]) {
                if list(&dependency["dep_kinds"]).iter().any(|kind| kind["kind"] != "dev") {
                    from.insert(names[&text(&dependency["pkg"])].clone());
                }
            }
        }
        Self { arrows, members }
    }

    fn direct(&self, from: &str) -> &BTreeSet<String> {
        self.arrows.get(from).unwrap_or_else(|| panic!("no package {from}"))
    }

    /// Returns all packages in a build of `from`.
    fn reach(&self, from: &str) -> BTreeSet<String> {
        let mut seen = BTreeSet::new();
        let mut open = vec![from.to_owned()];
        while let Some(next) = open.pop() {
            for to in self.direct(&next) {
                if seen.insert(to.clone()) {
                    open.push(to.clone());
                }
            }
        }
        seen
    }

    /// Returns the members that depend directly on `dependency`.
    fn users(&self, dependency: &str) -> Vec<&str> {
        self.members.iter().filter(|member| self.direct(member).contains(dependency)).map(String::as_str).collect()
    }
}

/// Returns the host platform: only its packages are sure to have been downloaded.
fn host() -> String {
    let output = Command::new("rustc").arg("-vV").output().expect("rustc runs");
    let text = String::from_utf8_lossy(&output.stdout);
    text.lines().find_map(|line| line.strip_prefix("host: ")).expect("rustc names its host").to_owned()
}

/// Foundation of the claim "same control stack": crates that decide cannot name the simulator, a device, or the true scene.
#[test]
fn what_decides_never_reaches_a_body() {
    let graph = Graph::read();
    for decides in ["control", "tactile-perception", "dexterous-grasping", "grasp-analysis"] {
        let reach = graph.reach(decides);
        for body in [
            "scenarios",
            "plant",
            "sim",
            "tactile-optics",
            "hardware-bridge",
            "dynamixel-bus",
            "kinova-kortex",
            "robot-session-log",
            "robot-ros2",
            "bench",
            "grasp-verification",
            "identification",
            "rapier3d-f64",
        ] {
            assert!(!reach.contains(body), "{decides} reaches {body}");
        }
    }
}

/// Policies exist only in `control`, which cannot name the true scene.
#[test]
fn policies_live_behind_the_wall() {
    let is_policy = |(_, text): &(PathBuf, String)| text.contains("impl TrialPolicy for");
    assert!(rust_files(&e2e::root().join("twin/control/src")).iter().any(is_policy), "control has no policy");
    let elsewhere = [
        "twin/robot-backends/src",
        "twin/fault-detection/src",
        "twin/external-policy/src",
        "twin/bench/src",
        "twin/board/src",
        "twin/registration/src",
        "twin/learning-environment/src",
        "twin/transport/src",
        "twin/fault-injection/src",
        "twin/object-detector/src",
        "twin/grasp-verification/src",
        "twin/sensor-calibration/src",
        "twin/lab/src",
        "twin/app/src",
        "sim/src",
        "hardware-bridge",
    ];
    for folder in elsewhere {
        for file in rust_files(&e2e::root().join(folder)) {
            assert!(!is_policy(&file), "{} implements a policy", file.0.display());
        }
    }
}

/// Returns every Rust file below a folder, with its text.
pub(crate) fn rust_files(folder: &Path) -> Vec<(PathBuf, String)> {
    let mut files = Vec::new();
    let mut open = vec![folder.to_owned()];
    while let Some(next) = open.pop() {
        for entry in std::fs::read_dir(&next).expect("a folder").map(|entry| entry.expect("an entry").path()) {
            if entry.is_dir() {
                if entry.file_name().is_none_or(|name| name != "target") {
                    open.push(entry);
                }
            } else if entry.extension().is_some_and(|ending| ending == "rs") {
                files.push((entry.clone(), std::fs::read_to_string(&entry).expect("text")));
            }
        }
    }
    assert!(!files.is_empty(), "{} holds no Rust file", folder.display());
    files
}

#[test]
fn only_one_crate_names_each_engine() {
    let graph = Graph::read();
    assert_eq!(graph.users("rerun"), ["telemetry"]);
    assert_eq!(graph.users("rapier3d-f64"), ["sim"]);
    assert_eq!(graph.users("clap"), ["ftac", "ftac-lab"]);
    assert_eq!(graph.users("burn"), ["ftac-lab"]);
    assert_eq!(graph.users("linfa"), ["grasp-analysis"]);
    assert_eq!(graph.users("parquet"), ["sweep"]);
    assert_eq!(graph.users("rustdds"), ["robot-ros2"]);
}

/// Packages for validation, grasp analysis and training are in `ftac-lab` only.
#[test]
fn what_people_run_carries_no_training() {
    let graph = Graph::read();
    for program in ["ftac", "ftac-python"] {
        let reach = graph.reach(program);
        for heavy in ["burn", "linfa", "grasp-analysis", "ftac-lab"] {
            assert!(!reach.contains(heavy), "{program} reaches {heavy}");
        }
    }
}

/// `cargo run` and `cargo test` share one build: every package of a program has the same features as in a build of the
/// whole workspace. A missing feature belongs in `workspace-hack`.
#[test]
fn a_program_alone_is_built_of_the_workspaces_parts() {
    let packages = |arguments: &[&str]| -> BTreeSet<String> {
        let output = Command::new(env!("CARGO"))
            .args(["tree", "--locked", "--offline", "--prefix", "none", "--format", "{p} [{f}]"])
            .args(arguments)
            .env_remove("CARGO_RESOLVER_FEATURE_UNIFICATION")
            .current_dir(e2e::root())
            .output()
            .expect("cargo tree runs");
        assert!(output.status.success(), "{}", e2e::stderr(&output));
        let text = String::from_utf8_lossy(&output.stdout);
        text.lines().map(|line| line.trim_end_matches(" (*)").to_owned()).filter(|line| !line.is_empty()).collect()
    };
    let whole = packages(&["--workspace"]);
    for program in ["ftac", "ftac-lab", "ftac-python"] {
        let alone = packages(&["-e", "normal,build", "-p", program]);
        let other: Vec<&String> = alone.difference(&whole).collect();
        assert!(alone.len() > 100 && other.is_empty(), "{program} has {other:?}");
    }
}

/// Each member depends on the members listed here and on no others ("Crates and arrows" in ARCHITECTURE.md).
#[test]
fn members_know_only_whom_they_may() {
    let graph = Graph::read();
    let allowed = [
        ("ftac-platform", ""),
        ("ftac-least-squares", ""),
        ("statistics", ""),
        ("hand-model", "ftac-platform"),
        ("world", "ftac-platform hand-model"),
        ("tactile-optics", "ftac-platform ftac-least-squares hand-model"),
        ("tactile-perception", "ftac-platform hand-model"),
        ("dexterous-grasping", "ftac-platform hand-model"),
        ("control", "ftac-platform hand-model world tactile-perception dexterous-grasping"),
        ("grasp-analysis", "ftac-platform hand-model dexterous-grasping"),
        ("dynamixel-bus", ""),
        ("kinova-kortex", ""),
        ("robot-ros2-messages", "hand-model"),
        ("robot-ros2", "hand-model robot-ros2-messages"),
        ("robot-session-log", "ftac-platform hand-model robot-ros2-messages"),
        ("hardware-bridge", "ftac-platform hand-model dynamixel-bus kinova-kortex robot-session-log"),
        ("plant", "ftac-platform hand-model world"),
        ("scenarios", "statistics ftac-platform hand-model world plant"),
        ("sim", "hand-model world plant tactile-optics"),
        ("telemetry", "ftac-platform hand-model"),
        ("progress", ""),
        (
            "grasp-verification",
            "statistics ftac-platform hand-model world plant scenarios sim dexterous-grasping control progress",
        ),
        (
            "report",
            "statistics ftac-platform hand-model world plant scenarios sim dexterous-grasping grasp-verification telemetry progress",
        ),
        ("object-detector", "world scenarios control progress"),
        (
            "fault-injection",
            "ftac-platform hand-model plant scenarios sim dexterous-grasping control hardware-bridge kinova-kortex robot-session-log grasp-verification telemetry bench robot-backends fault-detection progress",
        ),
        (
            "robot-backends",
            "object-detector ftac-platform hand-model world plant scenarios sim control hardware-bridge kinova-kortex robot-ros2 robot-session-log grasp-verification progress python-process",
        ),
        ("fault-detection", "hand-model world scenarios sim dexterous-grasping control grasp-verification"),
        ("python-process", "ftac-platform progress"),
        ("external-policy", "hand-model world control python-process"),
        (
            "registration",
            "ftac-platform hand-model world scenarios sim tactile-perception dexterous-grasping control grasp-verification robot-backends",
        ),
        (
            "learning-environment",
            "hand-model world scenarios sim control grasp-verification report bench robot-backends",
        ),
        (
            "transport",
            "ftac-platform hand-model world scenarios sim tactile-perception dexterous-grasping control grasp-verification telemetry bench progress",
        ),
        (
            "bench",
            "robot-backends fault-detection external-policy ftac-platform hand-model world plant scenarios sim tactile-optics tactile-perception dexterous-grasping control grasp-verification telemetry report progress",
        ),
        ("board", "statistics ftac-platform hand-model scenarios external-policy bench report progress"),
        (
            "identification",
            "statistics ftac-platform ftac-least-squares hand-model world plant scenarios sim tactile-optics tactile-perception dexterous-grasping control robot-session-log",
        ),
        ("sensor-calibration", "ftac-platform hand-model world sim tactile-optics tactile-perception report"),
        (
            "ftac-lab",
            "ftac statistics ftac-platform hand-model world scenarios sim tactile-optics tactile-perception dexterous-grasping control grasp-analysis grasp-verification bench report telemetry progress sensor-calibration",
        ),
        ("sweep", "statistics hand-model ftac-platform scenarios control robot-backends bench report progress"),
        ("workspace-hack", ""),
        (
            "ftac",
            "object-detector robot-backends fault-detection python-process external-policy registration transport fault-injection statistics ftac-platform hand-model world plant scenarios sim tactile-optics tactile-perception dexterous-grasping control hardware-bridge dynamixel-bus kinova-kortex robot-ros2 robot-session-log grasp-verification bench identification sensor-calibration report telemetry sweep board progress workspace-hack",
        ),
        (
            "ftac-python",
            "ftac hand-model world scenarios sim tactile-optics tactile-perception control robot-session-log grasp-verification external-policy learning-environment bench ftac-platform",
        ),
        ("e2e", "statistics"),
    ];
    let known: BTreeSet<&str> = allowed.iter().map(|(member, _)| *member).collect();
    let members: BTreeSet<&str> = graph.members.iter().map(String::as_str).collect();
    assert_eq!(known, members, "every crate has its row");
    for (member, may) in allowed {
        let knows: Vec<&String> = graph.direct(member).intersection(&graph.members).collect();
        for known in knows {
            assert!(may.split(' ').any(|may| may == known), "{member} knows {known}");
        }
    }
    // `telemetry` only draws: it neither controls nor simulates.
    for stranger in ["sim", "control", "hardware-bridge", "ftac"] {
        assert!(!graph.reach("telemetry").contains(stranger), "telemetry reaches {stranger}");
    }
    // The Python package wraps the libraries and brings the program. Nothing depends on it, and nothing else depends on
    // Python.
    assert_eq!(graph.users("ftac"), ["ftac-lab", "ftac-python"]);
    assert_eq!(graph.users("ftac-lab"), Vec::<&str>::new());
    assert_eq!(graph.users("ftac-python"), Vec::<&str>::new());
    assert_eq!(graph.users("pyo3"), ["ftac-python"]);
    for stranger in ["clap", "rapier3d-f64", "rerun"] {
        assert!(!graph.direct("ftac-python").contains(stranger), "ftac-python knows {stranger}");
    }
}

/// Cargo builds the tests of these packages as one program: a file that it does not name would never run.
#[test]
fn every_file_of_tests_is_in_its_program() {
    for folder in ["tests/tests", "sim/tests", "twin/bench/tests", "hardware-bridge/tests"] {
        let folder = e2e::root().join(folder);
        let program = std::fs::read_to_string(folder.join("main.rs")).expect("a program of tests");
        let listed: BTreeSet<&str> =
            program.lines().filter_map(|line| line.strip_prefix("mod ")?.strip_suffix(';')).collect();
        for file in std::fs::read_dir(&folder).expect("a folder of tests") {
            let path = file.expect("an entry").path();
            let name = path.file_stem().and_then(|stem| stem.to_str()).expect("UTF-8");
            if path.extension().is_some_and(|extension| extension == "rs") && name != "main" {
                assert!(listed.contains(name), "{} is not in main.rs", path.display());
            }
        }
    }
}
