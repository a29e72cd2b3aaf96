//! Test of the 33 grasp types: for each a suitable object on which the servos close, held against gravity in six
//! directions.
//!
//! The thumb is turned (and if two fingers take the object between them, they are bent). The object is then put into
//! the hand, held in place while the digits close, and released. A type is *formed* if the digits of its virtual
//! fingers touch the object, the palm touches if the type opposes to the palm and does not if it opposes pads, no other
//! digit touches, and the thumb is abducted or adducted as the type requires. It is *held* if it is formed and the
//! object stays within a centimetre under gravity from each of six directions. Placement and commands are found by a
//! seeded search ([`search`]; [`seeds`] repeats it) over attempts in physics ([`trial`]). Its cost consists of the
//! distance of the missing digits from the object, the motion of the object under gravity, and the time of its loss. No
//! criterion of a type is relaxed to make it pass; the choice of objects is this project's.

mod aim;
mod attempt;
mod free_postures;
mod opposed;
mod search;
pub mod seeds;
mod trial;
pub mod types;

use std::path::Path;
use std::sync::Arc;

use anyhow::Result;
use hand_model::Hand;
use nalgebra::{Isometry3, Point3};
use rayon::prelude::*;
use report::picture::{Picture, View, save, tile};
use schemars::JsonSchema;
use serde::Serialize;

use self::attempt::GraspAttempt;
use self::free_postures::FreePostureTable;
use self::search::SearchResult;
use self::types::GraspType;

/// Radius of a drawn contact point, m, and its colour.
const CONTACT_DOT_RADIUS: f64 = 2e-3;
const CONTACT_COLOR: [f64; 3] = [200.0, 30.0, 60.0];

/// Result of one grasp type.
#[derive(Debug, Clone, Serialize, JsonSchema)]
pub struct GraspTypeResult {
    /// Number of the type, 1 to 33.
    pub number: usize,
    /// Name in the taxonomy.
    pub name: &'static str,
    /// True if all virtual fingers touch and nothing else does.
    pub formed: bool,
    /// Number of directions of gravity withstood, of six.
    pub directions: usize,
    /// True if formed, and held in all six directions.
    pub held: bool,
    /// Reason why the type is not held, in words.
    pub reason: String,
    /// Simplification of the object.
    pub note: &'static str,
    /// Number of attempts made.
    pub tries: usize,
    pub attempt: GraspAttempt,
    /// Joint angles after settling, rad.
    pub angles: Vec<f64>,
    #[serde(skip)]
    place: Isometry3<f64>,
    /// Contact points of the hand on the object, palm frame.
    #[serde(skip)]
    contacts: Vec<Point3<f64>>,
}

/// Searches for grasps of the types with these `numbers`, or of all types if none is given, with at most `tries`
/// attempts each. `done` is called after each type.
pub fn run(
    hand: &Arc<Hand>,
    seed: u64,
    tries: usize,
    numbers: &[usize],
    done: impl Fn() + Sync,
) -> Vec<GraspTypeResult> {
    let curls = FreePostureTable::new(hand);
    let kinds: Vec<GraspType> =
        types::all_types().into_iter().filter(|kind| numbers.is_empty() || numbers.contains(&kind.number)).collect();
    // One type per task: the last ones take longest.
    let search = |kind| {
        let found = search::run(hand, &curls, kind, seed, tries).map(|found| type_result(kind, found));
        done();
        found
    };
    kinds.par_iter().with_max_len(1).filter_map(search).collect()
}

fn type_result(kind: &GraspType, SearchResult { tries, attempt, trial }: SearchResult) -> GraspTypeResult {
    let (formed, held) = (trial.formed(), trial.held());
    let reason = match (formed, held) {
        (false, _) => trial.faults.join(", "),
        (true, true) => String::new(),
        (true, false) => format!("lost with gravity towards {}", trial.lost.join(", ")),
    };
    GraspTypeResult {
        number: kind.number,
        name: kind.name,
        formed,
        directions: if formed { 6 - trial.lost.len() } else { 0 },
        held,
        reason,
        note: kind.note,
        tries,
        attempt,
        angles: trial.angles.to_vec(),
        place: trial.place,
        contacts: trial.contacts,
    }
}

/// Draws three pictures of each type's best attempt, with the contacts and the object's size: onto the palm, from the
/// thumb's side and along the fingers.
pub fn draw(hand: &Arc<Hand>, outcomes: &[GraspTypeResult], folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder)?;
    let types = types::all_types();
    let pictures: Vec<_> = outcomes
        .iter()
        .flat_map(|outcome| {
            let kind = &types[outcome.number - 1];
            let verdict = match (outcome.held, outcome.formed) {
                (true, _) => "held".to_string(),
                (_, true) => format!("held in {} of 6", outcome.directions),
                _ => "NOT FORMED".to_string(),
            };
            let reason: String = outcome.reason.chars().take(36).collect();
            let caption = format!("{} {}\n{verdict}, {}\n{reason}", outcome.number, outcome.name, format_size(kind));
            views().map(|(view, name)| {
                let mut picture = Picture::new(300, view);
                picture.hand(hand, &outcome.angles);
                picture.prop(&kind.prop, &outcome.place, report::picture::PROP_COLORS[0]);
                outcome.contacts.iter().for_each(|point| picture.dot(point, CONTACT_DOT_RADIUS, CONTACT_COLOR));
                picture.finish(&format!("{caption}{name}"))
            })
        })
        .collect();
    save(&tile(&pictures, 6), &folder.join("feix.png"))
}

/// Returns the views of a type, each with its name.
fn views() -> [(View, &'static str); 3] {
    let width = 0.23;
    [
        (View::palm().recentered(Point3::new(0.01, -0.005, 0.0), width), ""),
        (View::thumb_side().recentered(Point3::new(0.0, 0.0, -0.01), width), "from the thumb's side"),
        (View::tips().recentered(Point3::new(0.01, 0.0, -0.01), width), "along the fingers"),
    ]
}

/// Formats extent (mm) and mass of a type's object.
fn format_size(kind: &GraspType) -> String {
    let extent = kind.prop.extent() * 1e3;
    format!("{:.0} x {:.0} x {:.0} mm, {:.0} g", extent.x, extent.y, extent.z, 1e3 * kind.prop.mass)
}

/// Returns the table as text.
pub fn table(outcomes: &[GraspTypeResult]) -> String {
    let mut text = String::new();
    for outcome in outcomes {
        let verdict = if outcome.held {
            "held".into()
        } else if outcome.formed {
            format!("{} of 6", outcome.directions)
        } else {
            "not formed".to_string()
        };
        text += &format!(
            "{:>2} {:24} {verdict:12} {:>4} tries {}",
            outcome.number, outcome.name, outcome.tries, outcome.reason
        );
        if !outcome.note.is_empty() {
            text += &format!(" ({})", outcome.note);
        }
        text.push('\n');
    }
    let count = |test: fn(&GraspTypeResult) -> bool| outcomes.iter().filter(|outcome| test(outcome)).count();
    let (held, formed) = (count(|outcome| outcome.held), count(|outcome| outcome.formed));
    text += &format!("{held} of {} held, {formed} formed\n", outcomes.len());
    text
}
