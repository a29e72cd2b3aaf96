//! Damaged files of hands, objects, meshes and scenarios are either read or refused; none makes the program panic.
//!
//! `PROPTEST_CASES=1000000 cargo test --release -p scenarios --test broken_files` tries a million of each.

use std::path::Path;

use ftac_platform::file_access::FileAccess;
use hand_model::hand_mechanism::HandMechanism;
use proptest::prelude::*;
use scenarios::Scenario;
use scenarios::transport::TransportTask;
use world::ObjectFile;
use world::geometry::{LINK_MESHES, Mesh};

const URDF: &str = include_str!("../../twin/guide/files/clamp.urdf");
const PULLS: &str = include_str!("../../twin/guide/files/clamp.toml");
const BOX: &str = include_str!("../../twin/guide/files/box.obj");
const OBJECTS: [&str; 3] = [
    include_str!("../world/data/objects/vase.toml"),
    include_str!("../world/data/objects/bar.toml"),
    include_str!("../world/data/objects/ball.toml"),
];
const SCENARIO: &str = include_str!("../data/benchmark.toml");
const TRANSPORT: &str = include_str!("../data/transport/four_balls.toml");

/// Odd text to insert in unexpected places.
const ODD_TEXTS: [&str; 16] = [
    "nan",
    "inf",
    "-inf",
    "-1",
    "0",
    "1e308",
    "-1e-308",
    "99999999999999999999",
    "",
    "\n",
    "[[",
    "\"",
    "é",
    "\0",
    "<a>",
    "true",
];

/// One damage: position, kind, extent.
type Damage = (usize, u8, usize);

fn damages() -> impl Strategy<Value = Vec<Damage>> {
    prop::collection::vec((any::<usize>(), 0u8..5, 0usize..40), 1..5)
}

/// Returns `text` with each damage applied: odd text inserted, or put in place of a number or a byte, or a piece
/// removed or doubled.
fn damaged(text: &str, damages: &[Damage]) -> String {
    let mut bytes = text.as_bytes().to_vec();
    for &(at, kind, much) in damages {
        let at = at % bytes.len().max(1);
        let end = (at + much).min(bytes.len());
        let odd = ODD_TEXTS[much % ODD_TEXTS.len()].bytes();
        match kind {
            0 => drop(bytes.splice(at..at, odd)),
            1 => drop(bytes.drain(at..end)),
            2 => {
                let piece = bytes[at..end].to_vec();
                drop(bytes.splice(at..at, piece));
            }
            3 => {
                let digit = |byte: &u8| byte.is_ascii_digit();
                let start = at + bytes[at..].iter().position(digit).unwrap_or(0);
                let length = bytes[start..].iter().take_while(|byte| digit(byte) || **byte == b'.').count();
                drop(bytes.splice(start..start + length, odd));
            }
            _ => {
                if let Some(byte) = bytes.get_mut(at) {
                    *byte = byte.wrapping_add(much as u8 + 1);
                }
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

proptest! {
    #[test]
    fn hands(damages in damages()) {
        let path = Path::new("clamp");
        for (urdf, pulls) in [(damaged(URDF, &damages), PULLS.to_owned()), (URDF.to_owned(), damaged(PULLS, &damages))] {
            if let Ok(hand) = HandMechanism::parse(&urdf, path, &pulls, path, LINK_MESHES) {
                prop_assert!(hand.rest_coordinates().iter().all(|angle| angle.is_finite()));
            }
        }
    }

    #[test]
    fn meshes(damages in damages()) {
        if let Ok(mesh) = Mesh::parse_obj(&damaged(BOX, &damages), Path::new("box.obj")) {
            prop_assert!(mesh.volume().is_finite());
        }
    }

    #[test]
    fn objects(damages in damages(), which in 0usize..3) {
        let path = Path::new("object.toml");
        if let Ok(file) = ObjectFile::parse(&damaged(OBJECTS[which], &damages), path, FileAccess::Nothing)
            && let Ok(object) = file.model(path)
        {
            prop_assert!(object.mass > 0.0 && object.shape.volume() > 0.0);
        }
    }

    #[test]
    fn scenario_files(damages in damages()) {
        let path = Path::new("scenario.toml");
        drop(Scenario::parse(&damaged(SCENARIO, &damages), path));
        drop(TransportTask::parse(&damaged(TRANSPORT, &damages), path));
    }
}
