use super::*;

const BALL: &str = "name = \"my_ball\"\nmass = 0.1\nfriction = 0.5\n[shape.sphere]\ndiameter = 0.05\n";

fn model(text: &str) -> Result<ObjectModel, DataError> {
    let path = Path::new("/home/me/my_ball.toml");
    ObjectFile::parse(text, path, FileAccess::Nothing)?.model(path)
}

fn refused(from: &str, to: &str) -> String {
    assert!(BALL.contains(from));
    model(&BALL.replacen(from, to, 1)).expect_err("refused").to_string()
}

#[test]
fn what_may_be_left_out_has_a_default() {
    let ball = model(BALL).unwrap();
    assert!(matches!(ball.shape, ObjectShape::Sphere { radius: 0.025 }));
    assert_eq!((ball.color, ball.symmetry, ball.rest), (DEFAULT_COLOR, Symmetry::None, UnitQuaternion::identity()));
}

#[test]
fn a_bad_value_is_refused_by_file_field_found_and_expected() {
    assert_eq!(refused("mass = 0.1", "mass = 100"), "/home/me/my_ball.toml: mass: found 100, expected 0.0001 to 4 kg");
    assert_eq!(
        refused("diameter = 0.05", "diameter = 50.0"),
        "/home/me/my_ball.toml: shape.sphere.diameter: found 50, expected 0.005 to 1 m"
    );
    assert!(refused("my_ball", "my ball").contains("name: found \"my ball\", expected small letters"));
    assert!(refused("friction = 0.5", "friction = -0.5").contains("friction: found -0.5, expected 0 to 2"));
    assert!(refused("friction = 0.5", "friction = 0.5\nrest = \"lying\"").contains("rest: found \"lying\""));
    let unknown = refused("diameter = 0.05", "diamter = 0.05");
    assert!(
        unknown.starts_with("/home/me/my_ball.toml:5: `diamter`: unexpected keys in table: diamter, available"),
        "{unknown}"
    );
    let missing = refused("mass = 0.1\n", "");
    assert!(missing.starts_with("/home/me/my_ball.toml:") && missing.contains("missing field `mass`"), "{missing}");
}

#[test]
fn a_box_is_not_rounder_than_it_is_thick() {
    let text =
        BALL.replace("[shape.sphere]\ndiameter = 0.05", "[shape.box]\nsize = [0.05, 0.04, 0.02]\nrounding = 0.01");
    let error = model(&text).unwrap_err().to_string();
    assert!(
        error.contains("shape.box.rounding: found 0.01, expected 0 to less than half the smallest side"),
        "{error}"
    );
    let thinner = model(&text.replace("rounding = 0.01", "rounding = 0.003")).unwrap();
    assert!((thinner.rest_height() - 0.01).abs() < 1e-12);
}

#[test]
fn what_falls_over_does_not_rest() {
    let cone = "[shape.lathe]\noutline = [[0.0, 0.0], [0.03, 0.08], [0.0, 0.08]]";
    let on_its_tip = BALL.replace("[shape.sphere]\ndiameter = 0.05", cone);
    let with = |rest: &str| on_its_tip.replace("friction = 0.5", &format!("friction = 0.5\nrest = {rest}"));
    let error = model(&with("\"upright\"")).unwrap_err().to_string();
    assert!(error.contains("rest: found a pose from which the object falls over"), "{error}");
    // The message suggests a stable pose. If the pose is left out, it is computed.
    let hint = error.split("such as ").nth(1).and_then(|rest| rest.split(';').next()).expect("a pose");
    let turned = "{ turned = [3.141592653589793, 0.0, 0.0] }";
    for text in [with(hint), with(turned), on_its_tip.clone()] {
        // The centre of volume of a cone is at a quarter of its height above its base.
        assert!((model(&text).unwrap().rest_height() - 0.02).abs() < 1e-4, "{text}");
    }
    let file = ObjectFile::parse(&on_its_tip, Path::new("my_ball.toml"), FileAccess::Nothing).expect("an object");
    let notes = file.notes(&model(&on_its_tip).expect("an object"));
    assert!(notes.len() == 1 && notes[0].contains("rests as with rest = { turned = ["), "{notes:?}");
}
