//! Reading of hands, and refusal of invalid files.

use proptest::prelude::*;

use nalgebra::Vector3;

use super::*;
use crate::hand_mechanism::{JointDynamics, SolidShape};

const URDF: &str = r#"<robot name="clamp">
  <link name="base"/>
  <link name="jaw"><inertial><mass value="0.1"/><origin xyz="0.02 0 0" rpy="0 0 0"/>
    <inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-5" iyz="0" izz="1e-5"/></inertial>
    <collision><geometry><box size="0.04 0.01 0.02"/></geometry></collision></link>
  <link name="tip"><inertial><mass value="0.1"/>
    <inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-5" iyz="0" izz="1e-5"/></inertial></link>
  <link name="other"><inertial><mass value="0.1"/>
    <inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-5" iyz="0" izz="1e-5"/></inertial></link>
  <joint name="hinge" type="revolute"><parent link="base"/><child link="jaw"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="1" effort="1" velocity="1"/></joint>
  <joint name="weld" type="fixed"><parent link="jaw"/><child link="tip"/><origin xyz="0.04 0 0" rpy="0 0 0"/></joint>
  <joint name="second" type="revolute"><parent link="base"/><child link="other"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="1" effort="1" velocity="1"/><mimic joint="hinge" multiplier="-2"/></joint>
</robot>"#;
const PULLS: &str = "version = 1\ndamping = 0.01\narmature = 1e-4\nspring = 0.02\n[[actuator]]\nname = \"close\"\narms = { hinge = 0.01 }\n";

fn parse(urdf: &str, pulls: &str) -> Result<HandMechanism, String> {
    HandMechanism::parse(urdf, Path::new("clamp.urdf"), pulls, Path::new("clamp.toml"), MeshTools::NONE)
        .map_err(|error| error.to_string())
}

/// Replaces the first `from` in the text behind `after`.
fn behind(text: &str, after: &str, from: &str, to: &str) -> String {
    let at = text.find(after).expect("the place");
    let (before, rest) = text.split_at(at);
    format!("{before}{}", rest.replacen(from, to, 1))
}

const LIMIT: &str = "<limit lower=\"0\" upper=\"1\" effort=\"1\" velocity=\"1\"/>";

#[test]
fn a_hand_whose_joint_has_no_limit_still_moves() {
    for limit in ["", "<limit effort=\"1\" velocity=\"1\"/>"] {
        let hand = parse(&URDF.replacen(LIMIT, limit, 1), PULLS).expect("valid");
        let hinge = &hand.tree.joints[0];
        assert_eq!((hinge.lower, hinge.upper), (f64::NEG_INFINITY, f64::INFINITY), "{limit}");
        let note = "clamp.urdf: joint[hinge].limit: no lower and upper of a revolute joint; it turns without limits";
        assert!(hand.notes.iter().any(|line| line == note), "{:?}", hand.notes);
    }
}

#[test]
fn a_joint_that_slides_needs_its_limits() {
    let slide = URDF.replacen("type=\"revolute\"", "type=\"prismatic\"", 1);
    let error = parse(&slide.replacen(LIMIT, "", 1), PULLS).expect_err("no limits");
    assert_eq!(
        error,
        "clamp.urdf: joint[hinge].limit: found none, expected lower and upper in m of a joint that slides"
    );
    let hand = parse(&slide.replacen("upper=\"1\"", "upper=\"0.03\"", 1), PULLS).expect("valid");
    assert_eq!(hand.tree.joints[0].kind, JointKind::Slide);
    // The jaw translates along its axis and does not turn; it is driven by a pinion of 10 mm.
    let pose = hand.tree.forward(&[0.02, 0.0])[0];
    assert!((pose.translation.vector - Vector3::new(0.0, 0.02, 0.0)).norm() < 1e-12 && pose.rotation.angle() < 1e-12);
    assert!(
        (hand.joint_dynamics[0].damping - 100.0).abs() < 1e-9 && hand.joint_dynamics[1].damping == 0.01,
        "{:?}",
        hand.joint_dynamics[0]
    );
    let given = format!("{PULLS}[slide]\ndamping = 5.0\narmature = 0.1\nspring = 3.0\n");
    let feel = parse(&slide.replacen("upper=\"1\"", "upper=\"0.03\"", 1), &given).expect("valid").joint_dynamics[0];
    assert_eq!(feel, JointDynamics { spring: 3.0, damping: 5.0, armature: 0.1 });
}

#[test]
fn a_limit_without_velocity_and_effort_loads() {
    let hand = parse(&URDF.replacen(LIMIT, "<limit lower=\"0\" upper=\"1\"/>", 1), PULLS).expect("valid");
    assert_eq!((hand.tree.joints[0].upper, hand.effort_limits[0]), (1.0, None));
    assert!(hand.notes.iter().any(|line| line.contains("joint.limit.effort: none of hinge")), "{:?}", hand.notes);
}

/// A moving link without <inertial>, with an empty one, or with a mass of zero gets the mass of a box around its shape,
/// or of a small ball. The note names the link and the mass.
#[test]
fn a_moving_link_without_mass_gets_one() {
    let inertial = &URDF[URDF.find("<inertial>").expect("one")..URDF.find("</inertial>").expect("one") + 11];
    for none in ["", "<inertial/>", "<inertial><origin xyz=\"0 0 0\"/></inertial>"] {
        let urdf = URDF
            .replacen(inertial, none, 1)
            .replace("<link name=\"tip\"><inertial>", "<link name=\"tip\"><!--")
            .replace("izz=\"1e-5\"/></inertial></link>\n  <link name=\"other\">", "--></link><link name=\"other\">");
        let hand = parse(&urdf, PULLS).expect("valid");
        assert!((hand.masses[0].mass - 500.0 * 0.04 * 0.01 * 0.02).abs() < 1e-12, "{none}: {}", hand.masses[0].mass);
        assert!(hand.masses[0].inertia.symmetric_eigenvalues().min() > 0.0);
        assert!(
            hand.notes.iter().any(|line| line.contains("link[jaw].inertial.mass: none; taken as 4.0 g")),
            "{:?}",
            hand.notes
        );
    }
    let other = behind(URDF, "<link name=\"other\">", "<mass value=\"0.1\"/>", "<mass value=\"0\"/>");
    let hand = parse(&other, PULLS).expect("valid");
    assert!((hand.masses[1].mass - 1e-3).abs() < 1e-12, "no shape: a ball of 1 g");
}

#[test]
fn links_without_collision_shape_are_named() {
    let hand = parse(URDF, PULLS).expect("valid");
    assert_eq!(hand.links_without_collision, ["tip", "other"], "not the base, which has neither mass nor shape");
    assert!(
        hand.notes
            .iter()
            .any(|line| line.contains("link.collision: none of tip, other; everything passes through them"))
    );
    let visual = "<visual><geometry><sphere radius=\"0.01\"/></geometry></visual></link>";
    let urdf = behind(URDF, "<link name=\"tip\">", "</link>", visual);
    let offered = parse(&urdf, PULLS).expect("valid");
    assert!(
        offered.notes.iter().any(|line| line.contains("`visuals = true` in the pulls file")),
        "{:?}",
        offered.notes
    );
    assert_eq!(offered.solids.len(), 1);
    let taken = parse(&urdf, &format!("visuals = true\n{PULLS}")).expect("valid");
    assert_eq!((taken.solids.len(), &taken.links_without_collision[..]), (2, &["other".to_owned()][..]));
}

#[test]
fn a_hand_with_visuals_only_is_taken_by_them_and_says_so() {
    let hand = parse(&URDF.replace("collision>", "visual>"), PULLS).expect("valid");
    assert_eq!(
        (hand.solids.len(), &hand.links_without_collision[..]),
        (1, &["tip".to_owned(), "other".to_owned()][..])
    );
    let note = "clamp.urdf: link.collision: none of jaw; their visual shapes are taken for it";
    assert!(hand.notes.iter().any(|line| line == note), "{:?}", hand.notes);
}

#[test]
fn capsules_are_read() {
    let capsule = URDF.replace("<box size=\"0.04 0.01 0.02\"/>", "<capsule radius=\"0.01\" length=\"0.03\"/>");
    let hand = parse(&capsule, PULLS).expect("valid");
    assert!(matches!(hand.solids[0].shape, SolidShape::Capsule(radius, half) if radius == 0.01 && half == 0.015));
    assert_eq!(hand.solids[0].shape.extent().1, Vector3::new(0.01, 0.01, 0.025));
}

/// An actuator's tension is limited by a joint's effort limit or by its own.
#[test]
fn tensions_keep_the_efforts() {
    let hand = parse(URDF, PULLS).expect("valid");
    let (most, by) = hand.actuators[0].max_tension.clone().expect("bounded");
    assert!((most - 100.0).abs() < 1e-9 && by == "the effort of hinge, 1 N m", "{most} {by}");
    assert_eq!(hand.limit_tensions(&[120.0]), (vec![100.0], vec![0]));
    assert_eq!(hand.limit_tensions(&[80.0]), (vec![80.0], vec![]));
    let own = parse(URDF, &format!("{PULLS}max_tension = 30\n")).expect("valid");
    assert_eq!(own.actuators[0].max_tension, Some((30.0, "max_tension".to_owned())));
    let silent = parse(&URDF.replacen("effort=\"1\"", "effort=\"0\"", 1), PULLS).expect("valid");
    assert_eq!(silent.actuators[0].max_tension, None, "an effort of 0 says nothing");
}

/// A gripper that is closed at coordinate zero opens to the coordinate of `[open]`, where its springs rest.
#[test]
fn a_hand_that_is_closed_at_zero_has_its_open_coordinates() {
    let closing = PULLS.replace("hinge = 0.01", "hinge = -0.01");
    let hand = parse(URDF, &format!("{closing}[open]\nhinge = 0.9\n")).expect("valid");
    assert_eq!(hand.rest_coordinates(), [0.9, 0.0]);
    assert!(hand.torques(&[0.9, 0.0], &[0.0])[0].abs() < 1e-12);
    for (open, expected) in [
        ("hinge = 1.5", "clamp.toml: open.hinge: found 1.5, expected within the joint's limits, 0 to 1 rad"),
        ("second = 0.1", "clamp.toml: open.second: found no joint that an actuator pulls"),
    ] {
        let error = parse(URDF, &format!("{closing}[open]\n{open}\n")).expect_err(expected);
        assert!(error.starts_with(expected), "{error}");
    }
}

#[test]
fn a_wrong_sign_is_named() {
    let error = parse(URDF, &PULLS.replace("hinge = 0.01", "hinge = -0.01")).expect_err("against its limit");
    let expected = "clamp.toml: actuator[close].arms.hinge: found -0.01, which pulls the joint against its limit 0 rad, where it rests, \
                    expected a positive arm, or the joint's open coordinate in [open]";
    assert_eq!(error, expected);
    let wide = URDF.replacen("lower=\"0\"", "lower=\"-0.1\"", 1);
    let hand = parse(&wide, &PULLS.replace("hinge = 0.01", "hinge = -0.01")).expect("it can move a little");
    assert!(hand.notes.iter().any(|line| line.contains("is its sign right?")), "{:?}", hand.notes);
    let both = format!("{PULLS}[[actuator]]\nname = \"open\"\narms = {{ hinge = -0.01 }}\n");
    assert!(parse(URDF, &both).is_ok(), "of two cables one may open");
}

#[test]
fn a_doubled_actuator_a_pulled_mimic_and_an_unknown_palm_are_named() {
    let second = "[[actuator]]\nname = \"close\"\narms = { hinge = 0.02 }\n";
    let cases = [
        (format!("{PULLS}{second}"), "clamp.toml: actuator[close].name: found it twice"),
        (
            PULLS.replace("hinge = 0.01", "second = 0.01"),
            "clamp.toml: actuator[close].arms.second: found a joint that mimics another, expected the joint that it mimics, `hinge`",
        ),
        (PULLS.replace("hinge = 0.01", "weld = 0.01"), "clamp.toml: actuator[close].arms.weld: found a fixed joint"),
        (format!("{PULLS}max_tension = -3\n"), "clamp.toml: actuator[close].max_tension: found -3"),
        (format!("{PULLS}[palm]\nlinks = [\"plate\"]\n"), "clamp.toml: palm.links: found `plate`"),
        (format!("{PULLS}[palm]\nfacing = [0, 0, 0]\n"), "clamp.toml: palm.facing: found"),
    ];
    for (pulls, expected) in cases {
        let error = parse(URDF, &pulls).expect_err(expected);
        assert!(error.starts_with(expected), "{error}\n{expected}");
    }
}

/// Two equal masses, 20 mm apart on either side, add up to the total mass, the midpoint, and the parallel-axis term.
#[test]
fn what_is_fixed_to_a_link_is_part_of_it() {
    let hand = parse(URDF, PULLS).expect("valid");
    let jaw = hand.masses[0];
    assert!((jaw.mass - 0.2).abs() < 1e-12 && (jaw.com.x - 0.03).abs() < 1e-12);
    assert!((jaw.inertia[(1, 1)] - (2e-5 + 0.2 * 1e-4)).abs() < 1e-12, "{}", jaw.inertia);
    assert_eq!(hand.followers, [Follower { joint: 1, leader: 0, multiplier: -2.0, offset: 0.0 }]);
    assert!((hand.torques(&[0.5, 0.0], &[4.0])[0] - (0.04 - 0.01)).abs() < 1e-12);
}

/// A frame without mass takes on that of what is fixed to it.
#[test]
fn a_frame_without_mass_moves_what_is_fixed_to_it() {
    let hand =
        parse(&URDF.replace("<mass value=\"0.1\"/><origin", "<mass value=\"0\"/><origin"), PULLS).expect("valid");
    assert!((hand.masses[0].mass - 0.1).abs() < 1e-12 && (hand.masses[0].com.x - 0.04).abs() < 1e-12);
}

/// A tip frame with mass and no inertia adds its mass and the parallel-axis term, with a note. Alone on a joint, or in
/// line with another such mass, it has no inertia about some axis and is refused.
#[test]
fn a_mass_without_inertia_is_a_point() {
    let none = |text: &str, link: &str| {
        let at = text.find(link).expect("the link");
        let (before, after) = text.split_at(at);
        format!("{before}{}", after.replacen("1e-5", "0", 3))
    };
    let tip = none(URDF, "<link name=\"tip\">");
    let hand = parse(&tip, PULLS).expect("valid");
    let jaw = hand.masses[0];
    assert!((jaw.mass - 0.2).abs() < 1e-12 && (jaw.com.x - 0.03).abs() < 1e-12);
    assert!((jaw.inertia[(1, 1)] - (1e-5 + 0.2 * 1e-4)).abs() < 1e-12, "{}", jaw.inertia);
    let note = "clamp.urdf: link[tip].inertial: 0.1 kg without inertia; taken as a point mass";
    assert!(hand.notes.iter().any(|line| line == note), "{:?}", hand.notes);
    for (urdf, link) in [(none(&tip, "<link name=\"jaw\">"), "jaw"), (none(URDF, "<link name=\"other\">"), "other")] {
        let error = parse(&urdf, PULLS).expect_err(link);
        assert!(
            error.starts_with(&format!("clamp.urdf: link[{link}].inertial.inertia: found principal moments")),
            "{error}"
        );
    }
}

/// An unpulled joint makes its link a part of the one that carries it, at the given angle or at rest. A joint that
/// follows it does the same, with its offset. A joint that follows a pulled one rests at its offset.
#[test]
fn joints_that_nothing_pulls_are_held() {
    let spread = URDF.replace(
        "<parent link=\"jaw\"/><child link=\"tip\"/><origin xyz=\"0.04 0 0\" rpy=\"0 0 0\"/>",
        "<parent link=\"jaw\"/><child link=\"tip\"/><origin xyz=\"0.04 0 0\" rpy=\"0 0 0\"/><axis xyz=\"0 0 1\"/>\
         <limit lower=\"0.2\" upper=\"2\" effort=\"1\" velocity=\"1\"/>",
    );
    let spread = spread.replace("\"weld\" type=\"fixed\"", "\"spread\" type=\"revolute\"");
    let solid = "<collision><origin xyz=\"0.01 0 0\"/><geometry><sphere radius=\"0.005\"/></geometry></collision>";
    let spread =
        spread.replacen("izz=\"1e-5\"/></inertial></link>", &format!("izz=\"1e-5\"/></inertial>{solid}</link>"), 1);
    let tip =
        |hand: &HandMechanism| hand.solids.last().map(|solid| (solid.link, solid.link_from_solid.translation.vector));
    let rest = parse(&spread, PULLS).expect("valid");
    assert_eq!((rest.tree.len(), &rest.held_joints[..]), (2, &[("spread".to_owned(), 0.2)][..]));
    let (link, at) = tip(&rest).expect("a tip");
    assert!(link == Some(0) && (at.x - 0.04 - 0.01 * 0.2f64.cos()).abs() < 1e-9, "{at}");
    let given = format!("{PULLS}[held]\nspread = 1.5\n");
    let (_, at) = tip(&parse(&spread, &given).expect("valid")).expect("a tip");
    assert!((at.y - 0.01 * 1.5f64.sin()).abs() < 1e-9, "{at}");
    for (held, expected) in [
        ("spread = 3.0", "clamp.toml: held.spread: found 3"),
        ("hinge = 0.1", "clamp.toml: held.hinge: found a joint"),
        ("wrist = 0.1", "clamp.toml: held.wrist: found no such joint"),
    ] {
        let error = parse(&spread, &format!("{PULLS}[held]\n{held}\n")).expect_err(expected);
        assert!(error.starts_with(expected), "{error}\n{expected}");
    }
    let shifted = spread.replace("multiplier=\"-2\"", "multiplier=\"-2\" offset=\"0.3\"");
    assert_eq!(parse(&shifted, PULLS).expect("valid").rest_coordinates(), [0.0, 0.3]);
    let only = PULLS.replace("hinge = 0.01", "spread = 0.01");
    let held = parse(&shifted, &only).expect("valid").held_joints;
    assert_eq!(held, [("hinge".to_owned(), 0.0), ("second".to_owned(), 0.3)]);
}

#[test]
fn faults_name_file_element_and_field() {
    let cases = [
        (URDF.replacen("ixx=\"1e-5\"", "ixx=\"0\"", 1), PULLS.into(), "clamp.urdf: link[jaw].inertial.inertia"),
        (
            URDF.replace("<mimic joint=\"hinge\"", "<mimic joint=\"hing\""),
            PULLS.into(),
            "clamp.urdf: joint[second].mimic.joint: found `hing`",
        ),
        (
            URDF.replace("<box size=\"0.04 0.01 0.02\"/>", "<mesh filename=\"no.stl\"/>"),
            PULLS.into(),
            "clamp.urdf: link[jaw].collision[0].mesh.filename",
        ),
        (
            URDF.replace("<parent link=\"jaw\"/>", "<parent link=\"jam\"/>"),
            PULLS.into(),
            "clamp.urdf: joint[weld].parent: found `jam`",
        ),
        (
            URDF.replace(
                "<parent link=\"base\"/><child link=\"other\"/>",
                "<parent link=\"base\"/><child link=\"tip\"/>",
            ),
            PULLS.into(),
            "clamp.urdf: joint[second].child: found `tip`",
        ),
        (URDF.into(), PULLS.replace("hinge", "hings"), "clamp.toml: actuator[close].arms.hings: found no such joint"),
        (URDF.into(), PULLS.replace("hinge", "second"), "clamp.toml: actuator[close].arms.second"),
        (URDF.into(), PULLS.replace("0.02", "-1"), "clamp.toml: spring: found -1"),
        (URDF.into(), PULLS.replace("hinge = 0.01", "hinge = 0"), "clamp.toml: actuator[close].arms.hinge: found 0"),
        (
            URDF.into(),
            PULLS.replace("hinge = 0.01", "hinge = nan"),
            "clamp.toml: actuator[close].arms.hinge: found NaN",
        ),
        (URDF.into(), PULLS.replace("hinge = 0.01", ""), "clamp.toml: actuator[close].arms: found none"),
        (
            URDF.replacen("lower=\"0\"", "lower=\"2\"", 1),
            PULLS.into(),
            "clamp.urdf: joint[hinge].limit: found lower 2 and upper 1",
        ),
        (URDF.replacen("xyz=\"0 1 0\"", "xyz=\"0 0 0\"", 1), PULLS.into(), "clamp.urdf: joint[hinge].axis.xyz"),
        (URDF.replacen("xyz=\"0.04 0 0\"", "xyz=\"nan 0 0\"", 1), PULLS.into(), "clamp.urdf: joint[weld].origin.xyz"),
        (URDF.replacen("size=\"0.04", "size=\"-0.04", 1), PULLS.into(), "clamp.urdf: link[jaw].collision[0].box.size"),
        (URDF.replacen("size=\"0.04", "size=\"nan", 1), PULLS.into(), "clamp.urdf: link[jaw].collision[0].box.size"),
        (
            URDF.replacen("mass value=\"0.1\"", "mass value=\"nan\"", 1),
            PULLS.into(),
            "clamp.urdf: link[jaw].inertial.mass",
        ),
        (
            URDF.replace("mimic joint=\"hinge\"", "mimic joint=\"second\""),
            PULLS.into(),
            "clamp.urdf: joint[second].mimic.joint: found `second`, a loop",
        ),
    ];
    for (urdf, pulls, expected) in cases {
        let error = parse(&urdf, &pulls).expect_err(expected);
        assert!(error.starts_with(expected), "{error}\n{expected}");
    }
}

/// Typical mistyped numbers.
fn number() -> impl Strategy<Value = String> {
    prop_oneof![
        Just("nan".to_owned()),
        Just("inf".to_owned()),
        Just("-1e300".to_owned()),
        Just(String::new()),
        any::<f64>().prop_map(|x| x.to_string())
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    /// Any number in any place is either read or refused, and a hand that was read can be moved.
    #[test]
    fn no_number_makes_it_panic(at in 0usize..100, number in number()) {
        for (text, urdf) in [(URDF, true), (PULLS, false)] {
            let digits: Vec<(usize, &str)> = text.match_indices(|c: char| c.is_ascii_digit()).collect();
            let start = digits[at % digits.len()].0;
            let changed = format!("{}{number}{}", &text[..start], &text[start + 1..]);
            let read = if urdf { parse(&changed, PULLS) } else { parse(URDF, &changed) };
            if let Ok(hand) = read {
                let q: Vec<f64> = hand.tree.joints.iter().map(|joint| 0f64.clamp(joint.lower, joint.upper)).collect();
                prop_assert!(hand.tree.forward(&q).iter().all(|pose| pose.translation.vector.iter().all(|x| x.is_finite())));
                prop_assert!(hand.masses.iter().all(|mass| mass.mass > 0.0));
            }
        }
    }

    /// Arbitrary bytes in place of any part of a file.
    #[test]
    fn no_bytes_make_it_panic(at in 0usize..1500, cut in 0usize..60, bytes in proptest::collection::vec(any::<u8>(), 0..12)) {
        for (text, urdf) in [(URDF, true), (PULLS, false)] {
            let start = at % text.len();
            let end = (start + cut).min(text.len());
            let changed = [&text.as_bytes()[..start], &bytes, &text.as_bytes()[end..]].concat();
            let changed = String::from_utf8_lossy(&changed);
            let _ = if urdf { parse(&changed, PULLS) } else { parse(URDF, &changed) };
        }
    }
}
