//! Errors in a URDF's text, each by name.

use super::*;

const JOINT: &str = r#"<robot name="r"><link name="a"/><link name="b"/>
<joint name="j" type="revolute"><parent link="a"/><child link="b"/><limit lower="0" upper="1"/></joint></robot>"#;

fn refused(text: &[u8]) -> String {
    screen(text, Path::new("hand.urdf")).err().map(|error| error.to_string()).expect("refused")
}

#[test]
fn what_a_limit_need_not_say_is_filled_in() {
    let screened = screen(JOINT.as_bytes(), Path::new("hand.urdf")).expect("good");
    assert!(screened.text.contains(r#"<limit lower="0" upper="1" velocity="0"/>"#), "{}", screened.text);
    assert!(screened.unlimited.is_empty());
    for limit in ["", "<limit effort=\"1\" velocity=\"1\"/>"] {
        let text = JOINT.replace("<limit lower=\"0\" upper=\"1\"/>", limit);
        let screened = screen(text.as_bytes(), Path::new("hand.urdf")).expect("good");
        assert_eq!(screened.unlimited.iter().collect::<Vec<_>>(), ["j"], "{limit}");
    }
}

#[test]
fn a_mass_without_inertia_and_an_inertia_without_mass_get_zeros() {
    for (given, added) in
        [("<mass value=\"1\"/>", "<inertia ixx=\"0\""), ("<origin xyz=\"0 0 0\"/>", "<mass value=\"0\"/>")]
    {
        let text =
            JOINT.replace("<link name=\"a\"/>", &format!("<link name=\"a\"><inertial>{given}</inertial></link>"));
        let screened = screen(text.as_bytes(), Path::new("hand.urdf")).expect("good");
        assert!(screened.text.contains(added), "{}", screened.text);
        urdf_rs::read_from_string(&screened.text).expect("the parser takes it");
    }
}

#[test]
fn a_file_that_is_still_xacro_is_told_so() {
    let declared = JOINT.replace("<robot", "<robot xmlns:xacro=\"http://ros.org/wiki/xacro\"");
    assert!(screen(declared.as_bytes(), Path::new("hand.urdf")).is_ok(), "an expanded file may declare it");
    let used = declared.replace("</robot>", "<xacro:finger/></robot>");
    for text in [used.as_str(), &used.replace(" xmlns:xacro=\"http://ros.org/wiki/xacro\"", "")] {
        assert!(refused(text.as_bytes()).contains("<xacro:finger> in line 2: this file is still xacro"));
    }
    let number = JOINT.replace("upper=\"1\"", "upper=\"${limit}\"");
    assert_eq!(
        refused(number.as_bytes()),
        "hand.urdf: joint[j].limit.upper: found `${limit}` in line 2: this file is still xacro, expected a URDF: \
         `xacro FILE > hand.urdf` expands it"
    );
}

#[test]
fn an_unbound_prefix_is_told_with_its_line() {
    let text = JOINT.replace("</robot>", "<drake:joint/></robot>");
    assert!(refused(text.as_bytes()).contains("prefix: found `drake:joint` in line 2, whose prefix is not declared"));
    let bound = text.replace("<robot", "<robot xmlns:drake=\"http://drake.mit.edu\"");
    assert!(screen(bound.as_bytes(), Path::new("hand.urdf")).is_ok());
}

#[test]
fn a_file_that_is_not_utf_8_is_told_so() {
    let latin = [b"<robot name=\"r\">\n<!-- M", &[0xfc][..], b"nchen --></robot>"].concat();
    assert!(refused(&latin).contains("encoding: found byte 0xfc in line 2, which is not UTF-8"));
    let wide: Vec<u8> = [0xff, 0xfe].into_iter().chain(JOINT.encode_utf16().flat_map(u16::to_le_bytes)).collect();
    assert!(refused(&wide).contains("encoding: found UTF-16"));
    let marked = [&[0xef, 0xbb, 0xbf][..], JOINT.as_bytes()].concat();
    assert!(screen(&marked, Path::new("hand.urdf")).is_ok(), "a byte order mark is no fault");
}

#[test]
fn size_and_nesting_are_bounded() {
    let deep = format!("<robot>{}{}</robot>", "<a>".repeat(100_000), "</a>".repeat(100_000));
    assert!(refused(deep.as_bytes()).contains("nesting: found <a> in line 1, 65 elements deep, expected at most 64"));
    let wide = format!("<robot {}/>", (0..100_000).map(|n| format!("a{n}=\"\" ")).collect::<String>());
    assert!(refused(wide.as_bytes()).contains("more than 64 attributes"));
    assert!(refused(&vec![b' '; (MAX_FILE_SIZE + 1) as usize]).contains("size: found 16 MB"));
    let bomb = "<!DOCTYPE r [<!ENTITY a \"b\">]><robot/>";
    assert!(refused(bomb.as_bytes()).contains("a document type with declarations of its own"));
}

#[test]
fn numbers_and_names_are_told_by_element_and_line() {
    let cases = [
        (
            JOINT.replace("upper=\"1\"", "upper=\"1,5\""),
            "joint[j].limit.upper: found `1,5` in line 2, expected a number",
        ),
        (
            JOINT.replace("<limit", "<origin xyz=\"0 0\"/><limit"),
            "joint[j].origin.xyz: found `0 0` in line 2, expected 3 numbers",
        ),
        (JOINT.replace("<child link=\"b\"/>", ""), "joint[j].child: found none"),
        (JOINT.replace("revolute", "hinge"), "joint[j].type: found `hinge`"),
        (JOINT.replace("<limit", "<mimic/><limit"), "joint[j].mimic.joint: found none in line 2"),
        (
            JOINT.replace("<link name=\"a\"/>", "<link name=\"a\"><collision><geometry/></collision></link>"),
            "link[a].geometry: found none",
        ),
        (
            JOINT.replace(
                "<link name=\"a\"/>",
                "<link name=\"a\"><collision><geometry><ellipsoid/></geometry></collision></link>",
            ),
            "link[a].collision.geometry.ellipsoid: found <ellipsoid>",
        ),
        (JOINT.replace("</joint>", ""), "</robot> in line 2"),
        (JOINT.replace("</robot>", ""), "<robot> of line 1, which does not end"),
        (JOINT.replace("upper=\"1\"", "upper=\"1"), "does not end"),
        ("<mujoco/>".into(), "<mujoco>: an MJCF file"),
        (String::new(), "found no element"),
    ];
    for (text, expected) in cases {
        let error = refused(text.as_bytes());
        assert!(error.contains(expected), "{error}\n{expected}");
    }
}
