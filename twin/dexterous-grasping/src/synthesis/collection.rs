//! Collection: the synthesized grasps of many objects in one compact file, for distribution with the code and for other
//! programs.
//!
//! The format is JSON lines. The first is the header: version, command, seed. Then, object by object, there is a line
//! with the summary of the search and a line for each of its grasps: an array of integers in
//! fixed units (lengths 0.01 mm, angles 1e-4 rad, forces 1 mN; the palm is link -1). They are the chain's number; the
//! pose of the object in the palm frame; joints; the pose at the start; open joints; tensions; opposition; contacts (link,
//! point, normal, force); approach; clearance; margin and penetration, with mass, friction and payload if the load is
//! stated; motion; energy. Derived fields (digits, palm
//! contact) are not stored. A grasp is read bit for bit as [`HeldGrasp::at_file_precision`] left it.

use std::fmt::Write as _;
use std::path::Path;

use hand_model::Digit;
use serde::{Deserialize, Serialize};

use super::grasp_file::GraspFileError;
use super::held::{ClosedPose, DigitUse, HeldContact, HeldGrasp, VerifiedLoad, per_unit};

/// Version of the file format.
pub const VERSION: u32 = 1;

/// First line of the file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CollectionHeader {
    /// Version of the file format, [`VERSION`].
    pub version: u32,
    /// Command that generated it.
    pub command: String,
    /// Seed of the search.
    pub seed: u64,
}

/// Summary of the search for one object.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schemars", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct SearchSummary {
    /// Name of the object.
    pub object: String,
    /// Number of grasps requested.
    #[serde(alias = "wanted")]
    pub requested: usize,
    /// Number of grasps kept; their lines follow.
    pub kept: usize,
    /// Number of chains run.
    pub chains: u64,
    /// Reason why fewer grasps were kept than requested.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub short: Option<String>,
}

/// The grasps of one object.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectGrasps {
    /// Summary of the search.
    pub summary: SearchSummary,
    /// Grasps, ordered by chain.
    pub grasps: Vec<HeldGrasp>,
}

/// Synthesized grasps of many objects.
///
/// ```
/// use std::path::Path;
///
/// use dexterous_grasping::synthesis::collection::{Collection, CollectionHeader, ObjectGrasps, SearchSummary, VERSION};
///
/// let header = CollectionHeader { version: VERSION, command: "a search".into(), seed: 1 };
/// let short = Some("no chain ended in a grasp that holds".into());
/// let summary = SearchSummary { object: "needle".into(), requested: 10, kept: 0, chains: 500, short };
/// let collection = Collection { header, objects: vec![ObjectGrasps { summary, grasps: Vec::new() }] };
///
/// let text = collection.to_text()?;
/// let read = Collection::parse(&text, Path::new("collection.jsonl"))?;
/// assert_eq!(read.for_object("needle").map(|entry| entry.summary.chains), Some(500));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Collection {
    /// Origin of the collection.
    pub header: CollectionHeader,
    /// Grasps by object, in the file's order.
    pub objects: Vec<ObjectGrasps>,
}

/// Link (-1 is the palm), point, normal, force.
type ContactRow = (i64, [i64; 3], [i64; 3], i64);

/// Numbers of joints and digits of the F-TAC Hand, whose grasps a collection holds.
const JOINT_COUNT: usize = 15;
const DIGIT_COUNT: usize = 5;

/// Chain; palm_from_object; joints; start; open joints; tensions; opposition; contacts; approach; room; margin and
/// penetration, and in files that have them mass, friction and payload; moved; energy.
type GraspRow = (
    u64,
    [i64; 7],
    [i64; JOINT_COUNT],
    [i64; 7],
    [i64; JOINT_COUNT],
    [i64; DIGIT_COUNT],
    i64,
    Vec<ContactRow>,
    [i64; 3],
    Option<i64>,
    Vec<i64>,
    [i64; 2],
    i64,
);

/// # Panics
/// If there are not `N` values.
fn to_steps<const N: usize>(values: &[f64], per_unit: f64) -> [i64; N] {
    std::array::from_fn(|n| (values[n] * per_unit).round() as i64)
}

fn from_steps<const N: usize>(steps: &[i64; N], per_unit: f64) -> [f64; N] {
    steps.map(|n| n as f64 / per_unit)
}

/// Fields of a record of the F-TAC Hand, for error messages.
pub const EXPECTED_FIELDS: &str =
    "15 joints, 5 tensions, opposition, digits, palm, approach, room, moved and energy of the F-TAC Hand";

/// Converts a grasp to a row. Returns `None` for a grasp that is not of the F-TAC Hand.
fn to_row(grasp: &HeldGrasp) -> Option<GraspRow> {
    if [grasp.joints.len(), grasp.open_joints.len(), grasp.tensions.len()] != [JOINT_COUNT, JOINT_COUNT, DIGIT_COUNT] {
        return None;
    }
    let used = grasp.digit_use.as_ref()?;
    let one = |value: f64, per_unit: f64| (value * per_unit).round() as i64;
    let contacts = grasp.contacts.iter().map(|contact| {
        let link = contact.link.map_or(-1, |link| link as i64);
        let (point, normal) =
            (to_steps(&contact.point, per_unit::POSE), to_steps(&contact.normal, per_unit::DIRECTION));
        (link, point, normal, one(contact.force, per_unit::FORCE))
    });
    let mut checks = vec![one(grasp.margin, per_unit::FORCE), one(grasp.penetration, per_unit::DEPTH)];
    if let Some(VerifiedLoad { mass, friction, payload }) = grasp.verified_load {
        checks.extend([one(mass, per_unit::MASS), one(friction, per_unit::FRICTION), one(payload, per_unit::MASS)]);
    }
    Some((
        grasp.chain,
        to_steps(&*grasp.closed, per_unit::POSE),
        to_steps(&grasp.joints, per_unit::ANGLE),
        to_steps(&grasp.start, per_unit::POSE),
        to_steps(&grasp.open_joints, per_unit::ANGLE),
        to_steps(&grasp.tensions, per_unit::FORCE),
        one(grasp.opposition?, per_unit::ANGLE),
        contacts.collect(),
        to_steps(&used.approach, per_unit::DIRECTION),
        used.room.map(|room| one(room, per_unit::POSE)),
        checks,
        to_steps(&grasp.moved?, per_unit::MOTION),
        one(grasp.energy?, per_unit::ENERGY),
    ))
}

/// Converts a row to a grasp. An error names the field, the found value and the expected one.
fn from_row(object: &str, row: GraspRow) -> Result<HeldGrasp, String> {
    let (chain, pose, joints, start, open, tensions, opposition, rows, approach, room, checks, moved, energy) = row;
    let mut contacts = Vec::with_capacity(rows.len());
    for (n, (link, point, normal, force)) in rows.into_iter().enumerate() {
        let link = match usize::try_from(link) {
            Ok(link) if link < JOINT_COUNT => Some(link),
            Err(_) if link == -1 => None,
            _ => return Err(format!("contacts[{n}].link: found {link}, expected -1 to {}", JOINT_COUNT - 1)),
        };
        contacts.push(HeldContact {
            link,
            point: from_steps(&point, per_unit::POSE),
            normal: from_steps(&normal, per_unit::DIRECTION),
            force: force as f64 / per_unit::FORCE,
        });
    }
    if contacts.is_empty() {
        return Err("contacts: found none, expected at least one".into());
    }
    for (field, pose) in [("palm_from_object", &pose), ("start", &start)] {
        let length = from_steps(pose, per_unit::POSE)[3..].iter().map(|x| x * x).sum::<f64>().sqrt();
        if (length - 1.0).abs() > 1e-3 {
            return Err(format!("{field}: found a quaternion of length {length:.4}, expected 1"));
        }
    }
    let (margin, penetration, verification) = match checks[..] {
        [margin, penetration] => (margin, penetration, None),
        [margin, penetration, mass, friction, payload] => {
            let kg = |grams: i64| grams as f64 / per_unit::MASS;
            let friction = friction as f64 / per_unit::FRICTION;
            (margin, penetration, Some(VerifiedLoad { mass: kg(mass), friction, payload: kg(payload) }))
        }
        _ => return Err(format!("checks: found {} numbers, expected 2 or 5", checks.len())),
    };
    let touches = |link: Option<usize>| contacts.iter().any(|contact| contact.link == link);
    let digits = Digit::ALL.into_iter().filter(|digit| digit.ftac_joints().into_iter().any(|link| touches(Some(link))));
    Ok(HeldGrasp {
        object: object.into(),
        chain,
        closed: ClosedPose::PalmFromObject(from_steps(&pose, per_unit::POSE)),
        joints: from_steps(&joints, per_unit::ANGLE).into_iter().collect(),
        start: from_steps(&start, per_unit::POSE),
        open_joints: from_steps(&open, per_unit::ANGLE).into_iter().collect(),
        open_tensions: None,
        tensions: from_steps(&tensions, per_unit::FORCE).into_iter().collect(),
        opposition: Some(opposition as f64 / per_unit::ANGLE),
        digit_use: Some(DigitUse {
            digits: digits.collect(),
            palm: touches(None),
            approach: from_steps(&approach, per_unit::DIRECTION),
            room: room.map(|room| room as f64 / per_unit::POSE),
        }),
        contacts,
        margin: margin as f64 / per_unit::FORCE,
        penetration: penetration as f64 / per_unit::DEPTH,
        held_without_tension: None,
        moved: Some(from_steps(&moved, per_unit::MOTION)),
        energy: Some(energy as f64 / per_unit::ENERGY),
        verified_load: verification,
    })
}

/// True if the grasp is a complete record of the F-TAC Hand.
pub fn is_complete(grasp: &HeldGrasp) -> bool {
    to_row(grasp).is_some()
}

impl Collection {
    /// Returns the grasps of an object.
    pub fn for_object(&self, object: &str) -> Option<&ObjectGrasps> {
        self.objects.iter().find(|entry| entry.summary.object == object)
    }

    /// Iterates over the grasps of all objects.
    pub fn grasps(&self) -> impl Iterator<Item = &HeldGrasp> {
        self.objects.iter().flat_map(|entry| &entry.grasps)
    }

    /// Formats the collection as the file's text. Grasps that are not complete records of the F-TAC Hand
    /// ([`is_complete`]) are left out.
    ///
    /// # Errors
    /// An error of the JSON formatter; none is known.
    pub fn to_text(&self) -> Result<String, serde_json::Error> {
        let mut text = serde_json::to_string(&self.header)? + "\n";
        for entry in &self.objects {
            text += &(serde_json::to_string(&entry.summary)? + "\n");
            for row in entry.grasps.iter().filter_map(to_row) {
                // Writing to a string cannot fail.
                let _ = writeln!(text, "{}", serde_json::to_string(&row)?);
            }
        }
        Ok(text)
    }

    /// Reads a file.
    ///
    /// # Errors
    /// [`GraspFileError`], with the line of the fault.
    pub fn read(path: &Path) -> Result<Self, GraspFileError> {
        let text =
            ftac_platform::file::read_text(path).map_err(|source| GraspFileError::Io { path: path.into(), source })?;
        Self::parse(&text, path)
    }

    /// Parses the text of a file. `path` is used in errors.
    ///
    /// # Errors
    /// [`GraspFileError::Line`].
    pub fn parse(text: &str, path: &Path) -> Result<Self, GraspFileError> {
        let fault = |line: usize, message: String| GraspFileError::Line { path: path.into(), line: line + 1, message };
        let mut lines = text.lines().enumerate();
        let (_, first) = lines.next().ok_or_else(|| fault(0, "found nothing, expected a header".into()))?;
        let header: CollectionHeader = serde_json::from_str(first).map_err(|error| fault(0, error.to_string()))?;
        if header.version != VERSION {
            return Err(fault(0, format!("version: found {}, expected {VERSION}", header.version)));
        }
        let mut objects: Vec<ObjectGrasps> = Vec::new();
        while let Some((at, line)) = lines.next() {
            let summary: SearchSummary = serde_json::from_str(line).map_err(|error| fault(at, error.to_string()))?;
            if objects.iter().any(|entry| entry.summary.object == summary.object) {
                return Err(fault(at, format!("object: found {} again, expected it once", summary.object)));
            }
            let mut grasps = Vec::with_capacity(summary.kept);
            for n in 0..summary.kept {
                let (at, line) = lines.next().ok_or_else(|| {
                    fault(at, format!("{}: found {n} grasps, expected {}", summary.object, summary.kept))
                })?;
                let row: GraspRow = serde_json::from_str(line).map_err(|error| fault(at, error.to_string()))?;
                grasps.push(from_row(&summary.object, row).map_err(|message| fault(at, message))?);
            }
            objects.push(ObjectGrasps { summary, grasps });
        }
        Ok(Self { header, objects })
    }
}

#[cfg(test)]
mod tests {
    use super::super::held::tests::grasp as example;
    use super::*;

    fn collection() -> Collection {
        let grasps: Vec<HeldGrasp> = (0..3)
            .map(|n| {
                let mut grasp = example();
                grasp.chain = n;
                grasp.joints[4] = 0.1 * n as f64 + 0.01234;
                grasp.contacts.push(HeldContact { link: None, ..grasp.contacts[0] });
                if let Some(used) = &mut grasp.digit_use {
                    (used.palm, used.room) = (true, (n > 0).then_some(0.0123));
                }
                grasp.at_file_precision()
            })
            .collect();
        let summary =
            SearchSummary { object: "ball".into(), requested: 5, kept: 3, chains: 7, short: Some("slippery".into()) };
        let header = CollectionHeader { version: VERSION, command: "test".into(), seed: 4 };
        Collection { header, objects: vec![ObjectGrasps { summary, grasps }] }
    }

    #[test]
    fn written_is_read_bit_for_bit() {
        let collection = collection();
        let text = collection.to_text().expect("text");
        let back = Collection::parse(&text, Path::new("x")).expect("read");
        assert_eq!(back, collection);
        assert_eq!(back.to_text().expect("text"), text);
        assert_eq!(back.for_object("ball").map(|entry| entry.grasps.len()), Some(3));
        assert!(back.for_object("pawn").is_none());
    }

    /// The error names the line of each kind of damage.
    #[test]
    fn damage_is_named() {
        let text = collection().to_text().expect("text");
        let lines: Vec<&str> = text.lines().collect();
        let cases = [
            (text.replace("\"version\":1", "\"version\":2"), ":1: version: found 2, expected 1"),
            (lines[..4].join("\n"), ":2: ball: found 2 grasps, expected 3"),
            (text.replace("[[2,", "[[15,"), ":3: contacts[0].link: found 15, expected -1 to 14"),
            (text.clone() + lines[1], ":6: object: found ball again, expected it once"),
            (text.replacen("98335]", "50000]", 1), ":3: palm_from_object: found a quaternion of length"),
            (text[..text.len() - 9].into(), ":5: "),
            (String::new(), ":1: found nothing, expected a header"),
        ];
        for (damaged, expected) in cases {
            let error = Collection::parse(&damaged, Path::new("x")).expect_err(expected).to_string();
            assert!(error.contains(expected), "{error}\n{expected}");
        }
    }
}
