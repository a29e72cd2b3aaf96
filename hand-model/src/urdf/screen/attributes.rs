//! The attributes that elements of links and joints require, and those that are filled in.

use std::ops::Range;

use super::tags::StartTag;
use ftac_platform::data::DataError;

/// Content of an attribute.
#[derive(Clone, Copy)]
enum AttributeContent {
    Text,
    /// This many numbers.
    Numbers(usize),
}

/// Treatment of a missing attribute.
#[derive(Clone, Copy)]
enum IfMissing {
    Refused,
    Allowed,
    Filled(&'static str),
}

use AttributeContent::{Numbers, Text};
use IfMissing::{Allowed, Filled, Refused};

type Attribute = (&'static str, AttributeContent, IfMissing);

/// Attributes of the elements, by the path of element names from the link or joint on.
const ELEMENT_ATTRIBUTES: [(&[&str], &[Attribute]); 19] = [
    (&["joint", "origin"], ORIGIN_ATTRIBUTES),
    (&["link", "inertial", "origin"], ORIGIN_ATTRIBUTES),
    (&["link", "visual", "origin"], ORIGIN_ATTRIBUTES),
    (&["link", "collision", "origin"], ORIGIN_ATTRIBUTES),
    (&["joint", "parent"], &[("link", Text, Refused)]),
    (&["joint", "child"], &[("link", Text, Refused)]),
    (&["joint", "axis"], &[("xyz", Numbers(3), Filled("1 0 0"))]),
    (
        &["joint", "limit"],
        &[
            ("lower", Numbers(1), Allowed),
            ("upper", Numbers(1), Allowed),
            ("effort", Numbers(1), Allowed),
            ("velocity", Numbers(1), Filled("0")),
        ],
    ),
    (
        &["joint", "mimic"],
        &[("joint", Text, Refused), ("multiplier", Numbers(1), Allowed), ("offset", Numbers(1), Allowed)],
    ),
    (&["joint", "dynamics"], &[("damping", Numbers(1), Allowed), ("friction", Numbers(1), Allowed)]),
    (&["joint", "safety_controller"], &[("k_velocity", Numbers(1), Filled("0"))]),
    (&["link", "inertial", "mass"], &[("value", Numbers(1), Refused)]),
    (
        &["link", "inertial", "inertia"],
        &[
            ("ixx", Numbers(1), Refused),
            ("iyy", Numbers(1), Refused),
            ("izz", Numbers(1), Refused),
            ("ixy", Numbers(1), Filled("0")),
            ("ixz", Numbers(1), Filled("0")),
            ("iyz", Numbers(1), Filled("0")),
        ],
    ),
    (&["link", "visual", "material"], &[("name", Text, Filled(""))]),
    (&["box"], &[("size", Numbers(3), Refused)]),
    (&["sphere"], &[("radius", Numbers(1), Refused)]),
    (&["cylinder"], ROUND_ATTRIBUTES),
    (&["capsule"], ROUND_ATTRIBUTES),
    (&["mesh"], &[("filename", Text, Refused), ("scale", Numbers(3), Allowed)]),
];

const ORIGIN_ATTRIBUTES: &[Attribute] = &[("xyz", Numbers(3), Allowed), ("rpy", Numbers(3), Allowed)];
const ROUND_ATTRIBUTES: &[Attribute] = &[("radius", Numbers(1), Refused), ("length", Numbers(1), Refused)];

/// Checks the attributes of an element and returns those to fill in, as text. An attribute that is required and
/// missing, or not a number, is an error. `names` is the path from the link or joint to the element.
pub(crate) fn check_attributes(
    names: &[&str],
    start: &StartTag<'_>,
    fault: &dyn Fn(&str, String, &str) -> DataError,
) -> Result<String, DataError> {
    let shape = (names.len() >= 2 && names[names.len() - 2] == "geometry").then(|| &names[names.len() - 1..]);
    let Some((_, attributes)) = ELEMENT_ATTRIBUTES.iter().find(|(own, _)| Some(*own) == shape || *own == names) else {
        return Ok(String::new());
    };
    let mut added = String::new();
    for (name, holds, missing) in *attributes {
        let Some(value) = start.attribute(name) else {
            match missing {
                Refused => return Err(fault(name, format!("none in line {}", start.line), &holds.text())),
                Allowed => {}
                Filled(value) => added += &format!(" {name}=\"{value}\""),
            }
            continue;
        };
        if let Numbers(count) = holds {
            let numbers = value.split_whitespace().map(str::parse::<f64>).collect::<Result<Vec<_>, _>>();
            if !numbers.is_ok_and(|numbers| numbers.len() == *count) {
                return Err(fault(name, format!("`{value}` in line {}", start.line), &holds.text()));
            }
        }
    }
    Ok(added)
}

impl AttributeContent {
    fn text(self) -> String {
        match self {
            Text => "a name".into(),
            Numbers(1) => "a number".into(),
            Numbers(count) => format!("{count} numbers"),
        }
    }
}

/// Applies the edits to `text`; each replaces its byte range.
pub(crate) fn apply_edits(text: &str, mut edits: Vec<(Range<usize>, String)>) -> String {
    edits.sort_by_key(|(range, _)| range.start);
    let (mut out, mut done) = (String::with_capacity(text.len()), 0);
    for (range, edit) in edits {
        out += &text[done..range.start];
        out += &edit;
        done = range.end;
    }
    out + &text[done..]
}
