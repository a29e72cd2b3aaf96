use std::path::Path;

use super::*;
use world::objects::ObjectSet;

const TEXT: &str = include_str!("../../data/benchmark.toml");

fn error(from: &str, to: &str) -> String {
    assert!(TEXT.contains(from));
    Scenario::parse(&TEXT.replacen(from, to, 1), Path::new("mine.toml")).unwrap_err().to_string()
}

#[test]
fn the_benchmark_is_sound() {
    let scenario = Scenario::benchmark();
    scenario.check_objects(&ObjectSet::standard(), Path::new("benchmark.toml")).unwrap();
    assert!(scenario.combination_count() >= 60);
}

#[test]
fn errors_name_the_place_and_what_is_wrong() {
    let kind = error("position_sigma = 0.005", "position_sigma = \"4 mm\"");
    assert!(kind.starts_with("mine.toml:38: `position_sigma = \"4 mm\""), "{kind}");
    assert!(kind.contains("invalid type: string \"4 mm\", expected f64"), "{kind}");
    let unknown = error("hold_time", "hold_tiem");
    assert!(
        unknown.starts_with("mine.toml:") && unknown.contains("unknown field `hold_tiem`, expected one of"),
        "{unknown}"
    );
    let missing = error("carry_distance = 0.20", "");
    assert!(missing.contains("[protocol]") && missing.contains("missing field `carry_distance`"), "{missing}");
    let broken = error("version = 1", "version = = 1");
    assert!(broken.starts_with("mine.toml:3:"), "{broken}");
    assert_eq!(error("version = 1", "version = 2"), "mine.toml: version: found 2, expected 1");
    let far = error("first = { x = 0.62", "first = { x = 0.90");
    assert_eq!(
        far,
        "mine.toml: layout.first.x: found 0.9, expected within reach, 0.5 to 0.72 m, with shifts of 0.02 m"
    );
    let millimetres = error("xy_sigma = 0.0065", "xy_sigma = 4");
    assert!(millimetres.contains("noise.perception.xy_sigma: found 4, expected 0 to 1"), "{millimetres}");
}

#[test]
fn objects_must_exist_and_stand_clear() {
    let mut scenario = Scenario::benchmark();
    let set = ObjectSet::standard();
    scenario.layout.second.y = 0.08;
    let close = scenario.check_objects(&set, Path::new("a.toml")).unwrap_err().to_string();
    assert!(close.contains("0.003 m apart"), "{close}");
    scenario.first[0] = "anvil".into();
    let unknown = scenario.check_objects(&set, Path::new("a.toml")).unwrap_err().to_string();
    assert!(unknown.contains("first: found \"anvil\", expected one of golf_ball"), "{unknown}");
}

/// A file that extends the benchmark changes the fields that it names and no others, at any depth.
#[test]
fn a_field_alone_can_be_changed() {
    let parse = |text: &str| {
        Scenario::parse(&format!("version = 1\nname = \"n\"\nextends = \"benchmark\"\n{text}"), Path::new("n.toml"))
    };
    let mut expected = Scenario::benchmark();
    expected.name = "n".into();
    expected.noise.execution.position_sigma = 0.01;
    expected.referee.slip = 0.03;
    let found = parse("[noise.execution]\nposition_sigma = 0.01\n[referee]\nslip = 0.03\n").expect("valid");
    assert_eq!(found, expected);
    let wrong = parse("[noise.execution]\nposition = 0.01\n").expect_err("no such field").to_string();
    assert!(wrong.starts_with("n.toml:5: `position`: unknown field `position`"), "{wrong}");
    let wrong = parse("[noise.execution]\nposition_sigma = \"wide\"\n").expect_err("no number").to_string();
    assert!(wrong.contains("n.toml") && wrong.contains("wide"), "{wrong}");
}

/// Every place within the arm's reach is over the table, whose top is z = 0.
#[test]
fn the_table_lies_under_every_place_within_reach() {
    let world::physics::Physics { table, contact, .. } = world::physics::Physics::standard();
    assert_eq!(table.center[2] + table.half[2], 0.0);
    let layout = Scenario::benchmark().layout;
    for (axis, [low, high]) in [(0, layout.reach_x), (1, layout.reach_y)] {
        assert!(table.center[axis] - table.half[axis] < low && high < table.center[axis] + table.half[axis]);
    }
    assert!(table.friction > table.rolling_resistance && contact.damping_ratio >= 1.0);
}

/// Robot instances differ in encoders and mount by as much as the arms of the benchmark's trials.
#[test]
fn instances_and_trials_have_the_same_arms() {
    use plant::prior::{Quantity, parameters};
    let arm = Scenario::benchmark().effects.arm.unwrap();
    let all = parameters(&hand_model::RobotModel::ftac_gen3());
    for (quantity, sigma) in [
        (Quantity::ArmEncoder, arm.encoder_sigma),
        (Quantity::MountPosition, arm.mount_position_sigma),
        (Quantity::MountTurn, arm.mount_rotation_sigma),
    ] {
        let of_quantity = all.iter().filter(|parameter| parameter.quantity == quantity);
        assert!(of_quantity.map(|parameter| parameter.prior.sigma).all(|found| found == sigma));
    }
}

/// A file lists the objects of one, two or three places. Errors of invalid lists name the field.
#[test]
fn one_two_or_three_lists() {
    let parse = |text: &str| {
        Scenario::parse(&format!("version = 1\nname = \"n\"\nextends = \"benchmark\"\n{text}"), Path::new("n.toml"))
    };
    let error = |text: &str| parse(text).expect_err("refused").to_string();
    let counts = |text: &str| {
        let scenario = parse(text).expect("a scenario");
        (scenario.object_lists().len(), scenario.combination_count())
    };
    let third = "third = [\"lemon\"]\nlayout = { third = { x = 0.62, y = 0.0, yaw = 0.0 }, spread_xy = 0.0 }";
    assert_eq!(counts("first = [\"egg\", \"gem\"]\nsecond = []"), (1, 2));
    assert_eq!(counts("first = [\"egg\"]\nsecond = [\"pear\", \"gem\"]"), (2, 2));
    assert_eq!(counts(&format!("first = [\"egg\"]\nsecond = [\"gem\"]\n{third}")), (3, 1));
    assert_eq!(
        error("second = []\nthird = [\"lemon\"]"),
        "n.toml: second: found no object, expected at least one, because third names some"
    );
    assert_eq!(
        error("third = [\"lemon\"]"),
        "n.toml: layout.third: found none, expected the place of the third object"
    );
    assert_eq!(error("first = []"), "n.toml: first: found no object, expected at least one");
    let pushed = error("second = []\n[disturbance.wrong_size]\nobject = \"second\"\nfactor = 1.1");
    assert_eq!(
        pushed,
        "n.toml: disturbance.wrong_size.object: found second, expected an object of the trial, which has 1"
    );
    let near = error(&format!(
        "first = [\"egg\"]\nsecond = [\"gem\"]\n{}",
        third.replace("x = 0.62, y = 0.0", "x = 0.62, y = 0.12")
    ));
    assert!(near.contains("layout: found places that may be 0.020 m apart"), "{near}");
    let scenario = parse("first = [\"egg\"]\nsecond = []").expect("a scenario");
    let text = serde_json::to_string(&scenario).expect("text");
    assert!(!text.contains("\"second\":[") && !text.contains("third"), "{text}");
}
