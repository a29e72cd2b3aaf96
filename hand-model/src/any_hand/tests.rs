//! Reading, and refusing what cannot be read.

use proptest::prelude::*;

use super::*;

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

fn parse(urdf: &str, pulls: &str) -> Result<AnyHand, String> {
    AnyHand::parse(urdf, Path::new("clamp.urdf"), pulls, Path::new("clamp.toml")).map_err(|error| error.to_string())
}

/// Two equal masses 20 mm apart on either side: the sum, the middle, and the parallel-axis term.
#[test]
fn what_is_fixed_to_a_link_is_part_of_it() {
    let hand = parse(URDF, PULLS).expect("valid");
    let jaw = hand.masses[0];
    assert!((jaw.mass - 0.2).abs() < 1e-12 && (jaw.com.x - 0.03).abs() < 1e-12);
    assert!((jaw.inertia[(1, 1)] - (2e-5 + 0.2 * 1e-4)).abs() < 1e-12, "{}", jaw.inertia);
    assert_eq!(hand.followers, [Follower { joint: 1, leader: 0, multiplier: -2.0, offset: 0.0 }]);
    assert!((hand.torques(&[0.5, 0.0], &[4.0])[0] - (0.04 - 0.01)).abs() < 1e-12);
}

/// A frame without mass has that of what is fixed to it.
#[test]
fn a_frame_without_mass_moves_what_is_fixed_to_it() {
    let hand =
        parse(&URDF.replace("<mass value=\"0.1\"/><origin", "<mass value=\"0\"/><origin"), PULLS).expect("valid");
    assert!((hand.masses[0].mass - 0.1).abs() < 1e-12 && (hand.masses[0].com.x - 0.04).abs() < 1e-12);
}

/// A tip frame with mass and no inertia adds its mass and the parallel-axis term, with a note; alone on a joint, or in line with
/// another such mass, it gives no inertia to turn against.
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
    assert_eq!(hand.notes, ["clamp.urdf: link[tip].inertial: 0.1 kg without inertia; taken as a point mass"]);
    for (urdf, link) in [(none(&tip, "<link name=\"jaw\">"), "jaw"), (none(URDF, "<link name=\"other\">"), "other")] {
        let error = parse(&urdf, PULLS).expect_err(link);
        assert!(
            error.starts_with(&format!("clamp.urdf: link[{link}].inertial.inertia: found principal moments")),
            "{error}"
        );
    }
}

/// A joint that nothing pulls turns its link into a part of the one that carries it, at the given angle or at rest; so does a
/// joint that follows it, with its offset. A joint that follows a pulled one rests at its offset.
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
    let tip = |hand: &AnyHand| hand.solids.last().map(|solid| (solid.link, solid.link_from_solid.translation.vector));
    let rest = parse(&spread, PULLS).expect("valid");
    assert_eq!((rest.tree.len(), &rest.held[..]), (2, &[("spread".to_owned(), 0.2)][..]));
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
    assert_eq!(parse(&shifted, PULLS).expect("valid").rest(), [0.0, 0.3]);
    let only = PULLS.replace("hinge = 0.01", "spread = 0.01");
    let held = parse(&shifted, &only).expect("valid").held;
    assert_eq!(held, [("hinge".to_owned(), 0.0), ("second".to_owned(), 0.3)]);
}

#[test]
fn faults_name_file_element_and_field() {
    let cases = [
        (
            URDF.replace("<mass value=\"0.1\"/>", "<mass value=\"0\"/>"),
            PULLS.into(),
            "clamp.urdf: link[jaw].inertial.mass: found 0",
        ),
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

/// Numbers as a slip of the hand makes them.
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

    /// Whatever number stands wherever there is one: read or refused, and what is read can be moved.
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

    /// Any bytes in place of any part of a file.
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
