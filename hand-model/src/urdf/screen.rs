//! Screening of a URDF's text before it is parsed: its size and nesting, its namespace prefixes, and the attributes
//! that links and joints need.
//!
//! The parser that follows reports neither line nor element. Here an error has both, and values that a hand does not
//! need (`velocity` of a limit, zeros of an inertia) are filled in.

mod attributes;
mod tags;

use std::collections::BTreeSet;
use std::ops::Range;
use std::path::Path;

use self::attributes::{apply_edits, check_attributes};
use self::tags::{Tag, Tags};
use ftac_platform::data::DataError;

/// Largest size of a URDF, bytes.
pub(crate) const MAX_FILE_SIZE: u64 = 16 << 20;
/// Deepest nesting of elements; those of the URDF format nest seven deep.
const MAX_NESTING: usize = 64;
/// Joint types that URDF defines.
const JOINT_TYPES: [&str; 7] = ["revolute", "continuous", "prismatic", "fixed", "floating", "planar", "spherical"];
/// Shapes that URDF defines.
const SHAPE_TYPES: [&str; 5] = ["box", "cylinder", "sphere", "capsule", "mesh"];

/// Elements that an <inertial> requires, with zeros.
const INERTIAL_DEFAULTS: [(&str, &str); 2] = [
    ("mass", "<mass value=\"0\"/>"),
    ("inertia", "<inertia ixx=\"0\" ixy=\"0\" ixz=\"0\" iyy=\"0\" iyz=\"0\" izz=\"0\"/>"),
];

/// A URDF that the parser accepts.
pub(crate) struct ScreenedUrdf {
    /// The text, with optional parts filled in.
    pub text: String,
    /// Joints of types with limits (revolute, prismatic) for which the file gives none.
    pub unlimited: BTreeSet<String>,
}

/// An element that is open.
struct OpenElement {
    name: String,
    /// Namespace prefixes that it declares.
    prefixes: Vec<String>,
    /// Names of its children so far.
    children: Vec<String>,
    line: usize,
    /// For a joint: its type, and whether it has a range.
    joint_type: String,
    has_range: bool,
}

/// Decodes the URDF's bytes as UTF-8, without a byte order mark.
fn text<'a>(bytes: &'a [u8], path: &Path) -> Result<&'a str, DataError> {
    let expected = "UTF-8 text; an editor or `iconv -t UTF-8` saves it so";
    if bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]) {
        return Err(DataError::field(path, "encoding", "UTF-16", expected));
    }
    let text = std::str::from_utf8(bytes).map_err(|error| {
        let at = error.valid_up_to();
        let line = bytes[..at].iter().filter(|byte| **byte == b'\n').count() + 1;
        let found = format!("byte 0x{:02x} in line {line}, which is not UTF-8", bytes[at]);
        DataError::field(path, "encoding", found, expected)
    })?;
    Ok(text.trim_start_matches('\u{feff}'))
}

/// Screens the bytes of a URDF; `path` is used in errors only.
pub(crate) fn screen(bytes: &[u8], path: &Path) -> Result<ScreenedUrdf, DataError> {
    if bytes.len() as u64 > MAX_FILE_SIZE {
        let found = format!("{} MB", bytes.len() >> 20);
        return Err(DataError::field(path, "size", found, format!("at most {} MB", MAX_FILE_SIZE >> 20)));
    }
    let text = text(bytes, path)?;
    let mut screen = Screener { path, stack: Vec::new(), edits: Vec::new(), unlimited: BTreeSet::new(), element: None };
    let mut seen_root = false;
    for tag in Tags::new(text, path) {
        match tag? {
            Tag::Open(start) => {
                if screen.stack.is_empty() && start.name != "robot" {
                    let kind = match start.name {
                        "mujoco" => ": an MJCF file",
                        "sdf" => ": an SDF file",
                        _ => "",
                    };
                    let found = format!("<{}>{kind}", start.name);
                    return Err(DataError::field(path, "robot", found, "a URDF, whose root element is <robot>"));
                }
                seen_root = true;
                screen.open(&start)?;
            }
            Tag::Close { name, line, at } => screen.close(name, line, Some(at))?,
        }
    }
    if let Some(open) = screen.stack.last() {
        let found = format!("<{}> of line {}, which does not end", open.name, open.line);
        return Err(DataError::field(path, "robot", found, "every element to end: is the file cut off?"));
    }
    if !seen_root {
        return Err(DataError::field(path, "robot", "no element", "a URDF, whose root element is <robot>"));
    }
    Ok(ScreenedUrdf { text: apply_edits(text, screen.edits), unlimited: screen.unlimited })
}

struct Screener<'a> {
    path: &'a Path,
    stack: Vec<OpenElement>,
    /// Replacements of the text: byte range and new text.
    edits: Vec<(Range<usize>, String)>,
    unlimited: BTreeSet<String>,
    /// The link or joint that is open, as errors name it.
    element: Option<String>,
}

impl Screener<'_> {
    fn element_error(&self, field: &str, found: String, expected: &str) -> DataError {
        let element = self.element.as_deref().unwrap_or("robot");
        DataError::field(self.path, format!("{element}.{field}"), found, expected)
    }

    fn open(&mut self, start: &tags::StartTag<'_>) -> Result<(), DataError> {
        self.check_prefixes(start)?;
        let depth = self.stack.len();
        if depth >= MAX_NESTING {
            let found = format!("<{}> in line {}, {} elements deep", start.name, start.line, depth + 1);
            return Err(DataError::field(self.path, "nesting", found, format!("at most {MAX_NESTING}")));
        }
        if depth == 1 {
            let named = start.attribute("name").unwrap_or_default();
            self.element = matches!(start.name, "link" | "joint").then(|| format!("{}[{named}]", start.name));
            if self.element.is_some() && named.is_empty() {
                let found = format!("none in line {}", start.line);
                return Err(self.element_error("name", found, "a name"));
            }
        }
        let mut joint_type = String::new();
        if depth == 1 && start.name == "joint" {
            joint_type = start.attribute("type").unwrap_or_default().to_owned();
            if !JOINT_TYPES.contains(&joint_type.as_str()) {
                return Err(self.element_error(
                    "type",
                    format!("`{joint_type}`"),
                    &format!("one of {}", JOINT_TYPES.join(", ")),
                ));
            }
        }
        if self.element.is_some() && depth >= 2 {
            self.check_nested(start)?;
        }
        if let Some(parent) = self.stack.last_mut() {
            parent.children.push(start.name.to_owned());
            if depth == 2 && start.name == "limit" {
                parent.has_range = start.attribute("lower").is_some() || start.attribute("upper").is_some();
            }
        }
        self.stack.push(OpenElement {
            name: start.name.to_owned(),
            prefixes: start.prefixes().map(str::to_owned).collect(),
            children: Vec::new(),
            line: start.line,
            joint_type,
            has_range: false,
        });
        if start.self_closing {
            if depth == 2 && start.name == "inertial" {
                let zeros = format!(">{}{}</inertial>", INERTIAL_DEFAULTS[0].1, INERTIAL_DEFAULTS[1].1);
                self.edits.push((start.end - 2..start.end, zeros));
            }
            self.close(start.name, start.line, None)?;
        }
        Ok(())
    }

    /// Checks an element inside a link or a joint.
    fn check_nested(&mut self, start: &tags::StartTag<'_>) -> Result<(), DataError> {
        let names: Vec<&str> = self.stack[1..].iter().map(|open| open.name.as_str()).chain([start.name]).collect();
        let field = names[1..].join(".");
        if let Some((name, value)) =
            start.attributes.iter().find(|(_, value)| value.contains("${") || value.contains("$("))
        {
            let found = format!("`{value}` in line {}: this file is still xacro", start.line);
            let expected = "a URDF: `xacro FILE > hand.urdf` expands it";
            return Err(self.element_error(&format!("{field}.{name}"), found, expected));
        }
        if names[names.len() - 2] == "geometry" && !SHAPE_TYPES.contains(&start.name) {
            return Err(self.element_error(
                &field,
                format!("<{}>", start.name),
                &format!("one of {}", SHAPE_TYPES.join(", ")),
            ));
        }
        let wrong =
            |name: &str, found: String, expected: &str| self.element_error(&format!("{field}.{name}"), found, expected);
        let added = check_attributes(&names, start, &wrong)?;
        if !added.is_empty() {
            self.edits.push((start.attributes_end..start.attributes_end, added));
        }
        Ok(())
    }

    fn check_prefixes(&self, start: &tags::StartTag<'_>) -> Result<(), DataError> {
        let own: Vec<&str> = start.prefixes().collect();
        let names = std::iter::once(start.name).chain(start.attributes.iter().map(|(name, _)| *name));
        for (prefix, name) in names.filter_map(|name| Some((name.split_once(':')?.0, name))) {
            if prefix == "xacro" {
                let found = format!("<{}> in line {}: this file is still xacro", start.name, start.line);
                let expected = "a URDF: `xacro FILE > hand.urdf` expands it";
                return Err(DataError::field(self.path, "robot", found, expected));
            }
            let known = own.contains(&prefix)
                || matches!(prefix, "xml" | "xmlns")
                || self.stack.iter().any(|open| open.prefixes.iter().any(|known| known == prefix));
            if !known {
                let found = format!("`{name}` in line {}, whose prefix is not declared", start.line);
                let expected = format!("xmlns:{prefix}=\"...\" in <robot>, or the element taken out");
                return Err(DataError::field(self.path, "prefix", found, expected));
            }
        }
        Ok(())
    }

    /// Closes an element; `at` is the byte offset of the end tag, none for a self-closing element.
    fn close(&mut self, name: &str, line: usize, at: Option<usize>) -> Result<(), DataError> {
        let Some(open) = self.stack.pop().filter(|open| open.name == name) else {
            let found = format!("</{name}> in line {line}");
            return Err(DataError::field(self.path, "robot", found, "the end of the element that is open there"));
        };
        let depth = self.stack.len();
        if self.element.is_none() || depth == 0 {
            return Ok(());
        }
        let has = |child: &str| open.children.iter().any(|known| known == child);
        let none = |field: &str, expected: &str| Err(self.element_error(field, "none".into(), expected));
        match (depth, name) {
            (1, "joint") => {
                for child in ["parent", "child"] {
                    if !has(child) {
                        return none(child, "the link that it joins, <parent link=\"...\"/> and <child link=\"...\"/>");
                    }
                }
                if matches!(open.joint_type.as_str(), "revolute" | "prismatic") && !open.has_range {
                    let named = self.element.as_deref().and_then(|element| element.strip_prefix("joint["));
                    self.unlimited.extend(named.and_then(|named| named.strip_suffix(']')).map(str::to_owned));
                }
                self.element = None;
            }
            (1, _) => self.element = None,
            (2, "collision" | "visual") if !has("geometry") => {
                return none(&format!("{name}.geometry"), "one with a shape in it");
            }
            (3, "geometry") if open.children.is_empty() => {
                return none("geometry", &format!("one of {}", SHAPE_TYPES.join(", ")));
            }
            (2, "inertial") => {
                let missing = INERTIAL_DEFAULTS.iter().filter(|(child, _)| !has(child));
                self.edits.extend(
                    at.into_iter().flat_map(|at| missing.clone().map(move |(_, zero)| (at..at, (*zero).into()))),
                );
            }
            _ => {}
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
