use std::path::Path;

use super::*;
use ftac_platform::data::DataError;

use crate::scenario::Scenario;
use world::objects::ObjectSet;

const HEAD: &str = "version = 1\nname = \"mine\"\nextends = \"benchmark\"\n";

fn parse(tables: &str) -> Result<Scenario, DataError> {
    Scenario::parse(&format!("{HEAD}{tables}"), Path::new("mine.toml"))
}

fn error(tables: &str) -> String {
    parse(tables).unwrap_err().to_string()
}

/// Every built-in scenario file is valid and contains the disturbance of its name.
#[test]
fn the_files_are_sound() {
    let set = ObjectSet::standard();
    let mut kinds = Vec::new();
    for entry in std::fs::read_dir("data").unwrap() {
        let path = entry.unwrap().path();
        // Transports are another kind of file with a separate test.
        if path.is_dir() {
            continue;
        }
        let scenario = Scenario::read(&path).unwrap();
        scenario.check_objects(&set, &path).unwrap();
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        let undisturbed = ["benchmark", "three"].contains(&name.as_str());
        assert_eq!(scenario.disturbance.is_none(), undisturbed, "{name}");
        kinds.push(name);
    }
    for kind in ["push", "slip", "wrong_position", "wrong_size", "disabled_digits", "blind_pads", "size_sweep"] {
        assert!(kinds.iter().any(|name| name.starts_with(kind)), "no file {kind}.toml");
    }
}

/// Omitted fields are the benchmark's; without a base, a file must state everything.
#[test]
fn a_file_extends_the_benchmark() {
    let mine = parse("").unwrap();
    let benchmark = Scenario::benchmark();
    assert_eq!(mine, Scenario { name: "mine".into(), ..benchmark });
    let alone = Scenario::parse("version = 1\nname = \"mine\"\n", Path::new("mine.toml")).unwrap_err().to_string();
    assert!(alone.contains("mine.toml: first: found nothing, expected a value, or extends"), "{alone}");
    let unknown = error("extends_more = 1\n");
    assert!(unknown.contains("mine.toml:4: `extends_more`") && unknown.contains("unknown field"), "{unknown}");
}

#[test]
fn errors_name_line_and_field() {
    let push = "[disturbance.push]\non = \"first\"\nforce = [0.0, 3.0, 0.0]\nphase = \"grasp_first\"\nat = 0.5\nduration = 0.2\n";
    assert!(parse(push).is_ok());
    let unknown = error(&push.replace("duration", "durration"));
    assert!(unknown.starts_with("mine.toml:9: `durration`"), "{unknown}");
    assert!(unknown.contains("unknown field `durration`, expected one of"), "{unknown}");
    let kind = error("[disturbance.earthquake]\nforce = 1\n");
    assert!(kind.contains("mine.toml:4:") && kind.contains("earthquake") && kind.contains("`push`"), "{kind}");
    let phase = error(&push.replace("grasp_first", "grasp_tenth"));
    assert!(phase.starts_with("mine.toml:7:") && phase.contains("grasp_tenth"), "{phase}");
    let third = error(&push.replace("grasp_first", "grasp_third"));
    assert!(
        third.contains("disturbance.push.phase: found \"grasp third\"") && third.contains("two objects"),
        "{third}"
    );
    let timeless = error(&push.replace("grasp_first", "decide"));
    assert!(timeless.contains("disturbance.push.phase: found \"decide\", expected a phase"), "{timeless}");
    let late = error(&push.replace("at = 0.5", "at = 50"));
    assert!(late.contains("disturbance.push.at: found 50.0, expected 0 to 1"), "{late}");
    let weak = error(&push.replace("3.0", "0.0"));
    assert!(weak.contains("disturbance.push.force: found [0.0, 0.0, 0.0], expected a force"), "{weak}");
    let digits = error("[disturbance.disabled_digits]\ndigits = [\"index\", \"index\"]\n");
    assert!(digits.contains("disturbance.disabled_digits.digits: found [Index, Index]"), "{digits}");
    let toe = error("[disturbance.disabled_digits]\ndigits = [\"toe\"]\n");
    assert!(toe.starts_with("mine.toml:5:") && toe.contains("unknown variant `toe`"), "{toe}");
    let nameless = error("[disturbance.blind_pads]\npads = []\nframes = \"black\"\n");
    assert!(nameless.contains("disturbance.blind_pads.pads: found [], expected at least one"), "{nameless}");
    let elbow = parse("[disturbance.blind_pads]\npads = [\"elbow\"]\nframes = \"black\"\n").unwrap();
    let (field, found, expected) = elbow.disturbance.check_pads(&Hand::ftac()).unwrap_err();
    assert_eq!((field.as_str(), found.as_str()), ("disturbance.blind_pads.pads", "\"elbow\""));
    assert!(expected.contains("little_distal"), "{expected}");
    let size = error("[disturbance.wrong_size]\nobject = \"first\"\nfactor = 20\n");
    assert!(size.contains("disturbance.wrong_size.factor: found 20.0, expected 0.5 to 2"), "{size}");
}

#[test]
fn only_balls_have_any_size() {
    let sweep = "[disturbance.size_sweep]\nobject = \"first\"\ndiameters = [0.04, 0.05]\n";
    let wrong = parse(sweep).unwrap_err();
    assert!(wrong.to_string().contains("first: found \"cube_45\", expected balls only"), "{wrong}");
    let balls = parse(&format!("first = [\"golf_ball\"]\n{sweep}")).unwrap();
    assert_eq!(balls.first, ["golf_ball"]);
}

/// A size sweep is cyclic. A scaled object has the requested size and the corresponding mass.
#[test]
fn sizes_go_round() {
    let sweep = SizeSweep { object: TargetObject::First, diameters: vec![0.04, 0.05] };
    assert_eq!([0, 1, 2].map(|trial| sweep.diameter(trial)), [0.04, 0.05, 0.04]);
    let wrong = WrongSize { object: TargetObject::Second, factor: 1.2 };
    let sizes = Disturbances { wrong_size: Some(wrong), ..Disturbances::default() }.size_factors();
    assert_eq!(sizes, [1.0, 1.2, 1.0]);
    let set = ObjectSet::standard();
    for object in set.iter() {
        let larger = object.scaled(1.2).unwrap();
        let ratio = larger.shape.volume() / object.shape.volume();
        assert!((ratio - 1.2_f64.powi(3)).abs() < 1e-9, "{}: {ratio}", object.name);
        assert!((larger.mass / object.mass - ratio).abs() < 1e-9, "{}", object.name);
        assert!((larger.rest_height() / object.rest_height() - 1.2).abs() < 1e-9, "{}", object.name);
    }
}
