//! The libraries that others can depend on: what goes into their packages.

use std::fs;
use std::process::Command;

use e2e::{root, stderr};
use tempfile::tempdir;

/// Libraries, with their folders.
const LIBRARIES: [(&str, &str); 11] = [
    ("ftac-platform", "hand-model/platform"),
    ("ftac-least-squares", "twin/least-squares"),
    ("hand-model", "hand-model"),
    ("tactile-optics", "sim/optics"),
    ("tactile-perception", "twin/tactile-perception"),
    ("dexterous-grasping", "twin/dexterous-grasping"),
    ("kinova-kortex", "hardware-bridge/kortex"),
    ("dynamixel-bus", "hardware-bridge/dynamixel-bus"),
    ("robot-ros2-messages", "hardware-bridge/ros2-messages"),
    ("robot-ros2", "hardware-bridge/ros2"),
    ("robot-session-log", "hardware-bridge/session-log"),
];

/// All libraries can be packed, together and without the rest of the workspace; each package explains itself.
#[test]
fn libraries_can_be_packed() {
    let target = tempdir().expect("a folder");
    let names = LIBRARIES.map(|(name, _)| ["-p", name]).concat();
    let packed = Command::new(env!("CARGO"))
        .args(["package", "--offline", "--no-verify", "--allow-dirty"])
        .args(&names)
        .env("CARGO_TARGET_DIR", target.path())
        .current_dir(root())
        .output()
        .expect("cargo package runs");
    assert!(packed.status.success(), "{}", stderr(&packed));
    for (name, _) in LIBRARIES {
        let archive = target.path().join(format!("package/{name}-{}.crate", env!("CARGO_PKG_VERSION")));
        let listed = Command::new("tar").arg("-tzf").arg(&archive).output().expect("tar runs");
        assert!(listed.status.success(), "{name}: {}", stderr(&listed));
        let list = String::from_utf8_lossy(&listed.stdout).into_owned();
        for file in ["/README.md", "/LICENSE-MIT", "/LICENSE-APACHE", "/src/lib.rs"] {
            assert!(list.lines().any(|line| line.ends_with(file)), "{name} has no {file}:\n{list}");
        }
        // The two helpers show their use in doc examples.
        let shows = name.starts_with("ftac-") || list.lines().any(|line| line.contains("/examples/"));
        assert!(shows, "{name} has no example:\n{list}");
    }
}

/// Nothing public of a library is without documentation, and nothing is public that cannot be reached.
#[test]
fn libraries_deny_undocumented_items() {
    for (name, folder) in LIBRARIES {
        let text = fs::read_to_string(root().join(folder).join("src/lib.rs")).expect("lib.rs");
        for lint in ["missing_docs", "unreachable_pub"] {
            let denied = text.lines().any(|line| line.starts_with("#![deny(") && line.contains(lint));
            assert!(denied, "{name}: found no #![deny({lint})] in src/lib.rs");
        }
    }
}
