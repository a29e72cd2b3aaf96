//! The 33 grasp types: a suitable object for each, closed on by the servos, held against gravity in six directions.
//!
//! The thumb is turned, then the object is put into the open hand, held in place while the digits close, and let go
//! of. A type is *formed* when the digits of its virtual fingers touch the object, the palm touches where the type
//! opposes to the palm and does not where it opposes pads, no digit touches that the type does not name, and the
//! thumb is abducted or adducted as it says. It is *held* when, formed, the object stays within a centimetre under
//! gravity from each of six directions. Placement and commands are found by a seeded search: fresh proposals, and
//! steps away from the best so far that grow with success and shrink with failure, led by how far the missing digits
//! are from the object and how far it moves under gravity. Nothing about a type is relaxed to make it pass.

mod aim;
mod curl;
mod opposed;
pub mod types;

use std::path::Path;
use std::sync::Arc;

use anyhow::Result;
use hand_model::{Digit, HAND_JOINTS, Hand};
use nalgebra::{Isometry3, Point3, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::Serialize;
use sim::engine::EngineSettings;
use sim::stand::{HandStand, tension_goals};

use self::aim::{Attempt, propose, vary};
use self::curl::Curls;
use self::types::{GraspType, Opposition};
use super::picture::{Picture, View, save, tile};

/// Times to turn the thumb, close, and let the object settle after release, s.
const TURN: f64 = 0.4;
const CLOSE: f64 = 1.4;
const SETTLE: f64 = 0.8;
/// Gravity from each direction for this long, s.
const PULL: f64 = 0.8;
/// The object is held if it moves less than this, m, and is slower than that in the end, m/s.
const STAYS: f64 = 0.01;
const STILL: f64 = 0.01;
/// An abducted thumb opposes by more than this, an adducted one by less, rad.
const ABDUCTED: f64 = 0.6;
/// Forces below this are no touch, N.
const TOUCH: f64 = 0.01;
/// The object may start this deep in the open hand, m; proposals drawn at most until one does not.
const BURIED: f64 = 1e-3;
const DRAWS: usize = 24;
/// A fault costs this, a digit that does not touch its distance over this, m, besides.
const FAULT: f64 = 10.0;
const MISSING: f64 = 0.005;
/// Share of the tries that are fresh, at the beginning, and one in so many afterwards.
const FRESH: usize = 4;
/// Least and greatest step from the best attempt, in units of the usual one.
const STEPS: (f64, f64) = (0.15, 1.6);

/// How a type came out.
#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    /// 1 to 33.
    pub number: usize,
    /// Name in the taxonomy.
    pub name: &'static str,
    /// All virtual fingers touch and nothing else does.
    pub formed: bool,
    /// Directions of gravity withstood, of six.
    pub directions: usize,
    /// Formed, and held in all six.
    pub held: bool,
    /// What is wrong, in words.
    pub reason: String,
    /// Simplification of the object.
    pub note: &'static str,
    /// The best attempt.
    pub attempt: Attempt,
    /// Joint angles after settling, rad.
    pub angles: Vec<f64>,
    #[serde(skip)]
    place: Isometry3<f64>,
    #[serde(skip)]
    cost: f64,
}

/// Tries types `tries` times: those with these numbers, or all where none is named.
pub fn run(hand: &Arc<Hand>, seed: u64, tries: usize, numbers: &[usize]) -> Vec<Outcome> {
    let curls = Curls::new(hand);
    let kinds: Vec<GraspType> =
        types::all().into_iter().filter(|kind| numbers.is_empty() || numbers.contains(&kind.number)).collect();
    kinds.par_iter().map(|kind| search(hand, &curls, kind, seed, tries)).collect()
}

fn search(hand: &Arc<Hand>, curls: &Curls, kind: &GraspType, seed: u64, tries: usize) -> Outcome {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(kind.number as u64);
    let mut best = try_it(hand, kind, fresh(hand, curls, kind, &mut rng));
    let mut step = 1.0;
    for n in 1..tries {
        if best.held {
            break;
        }
        let away = n > tries / FRESH && n % FRESH != 0;
        let attempt = if away { vary(&best.attempt, step, &mut rng) } else { fresh(hand, curls, kind, &mut rng) };
        let outcome = try_it(hand, kind, attempt);
        let better = outcome.cost < best.cost;
        if away {
            step = (step * if better { 1.6 } else { 0.93f64 }).clamp(STEPS.0, STEPS.1);
        }
        if better {
            best = outcome;
        }
    }
    best
}

/// A proposal whose object does not start inside the open hand, if one is drawn in time.
fn fresh(hand: &Arc<Hand>, curls: &Curls, kind: &GraspType, rng: &mut ChaCha8Rng) -> Attempt {
    let mut attempt = propose(hand, curls, kind, rng);
    for _ in 1..DRAWS {
        let mut angles = [0.0; HAND_JOINTS];
        angles[hand.transmission.opposition_joint] = attempt.opposition;
        if curls.buried(&hand.tree.forward(&angles), &kind.prop, &attempt.place()) <= BURIED {
            break;
        }
        attempt = propose(hand, curls, kind, rng);
    }
    attempt
}

/// How far a digit's skin is from the object, m.
fn gap(stand: &HandStand, digit: Digit) -> f64 {
    let (links, pose) = (stand.links(), stand.pose(0));
    let skin = digit
        .joints()
        .into_iter()
        .flat_map(|link| stand.hand().covers[link].skin(0.004).into_iter().map(move |element| (link, element.point)));
    skin.map(|(link, point)| stand.prop(0).signed_distance(&pose.inverse_transform_point(&(links[link] * point))).0)
        .fold(f64::INFINITY, f64::min)
        .max(0.0)
}

fn try_it(hand: &Arc<Hand>, kind: &GraspType, attempt: Attempt) -> Outcome {
    let mut stand = HandStand::new(hand.clone(), EngineSettings::default());
    stand.run(&tension_goals(hand, &[0.0; 5], attempt.opposition), TURN);
    let prop = stand.put(kind.prop.clone(), &attempt.place());
    let buried = stand.prop_penetration(prop) > BURIED;
    let goals = tension_goals(hand, &attempt.tensions, attempt.opposition);
    stand.run(&goals, CLOSE);
    stand.release(prop);
    stand.run(&goals, SETTLE);
    let mut faults = faults(kind, &stand);
    if buried {
        faults.push("the object starts inside the hand".into());
    }
    let angles = stand.angles().to_vec();
    let place = stand.pose(prop);
    let formed = faults.is_empty();
    let mut lost = Vec::new();
    let missing: f64 = kind.digits.iter().map(|digit| gap(&stand, *digit)).sum();
    let mut cost = FAULT * faults.len() as f64 + (missing / MISSING).min(FAULT - 1.0);
    if formed {
        cost = -FAULT;
        for (way, name) in [
            (Vector3::x(), "thumb side"),
            (-Vector3::x(), "little side"),
            (Vector3::y(), "fingers"),
            (-Vector3::y(), "wrist"),
            (Vector3::z(), "back"),
            (-Vector3::z(), "palm"),
        ] {
            let mut branch = stand.clone();
            branch.set_gravity(&(way * 9.81));
            branch.run(&goals, PULL);
            let moved = (branch.pose(prop).translation.vector - place.translation.vector).norm();
            cost += (moved / STAYS).min(1.5);
            if moved > STAYS || branch.prop_velocity(prop).norm() > STILL {
                lost.push(name);
            }
        }
    }
    let reason = match (formed, lost.is_empty()) {
        (false, _) => faults.join(", "),
        (true, true) => String::new(),
        (true, false) => format!("lost with gravity towards {}", lost.join(", ")),
    };
    Outcome {
        number: kind.number,
        name: kind.name,
        formed,
        directions: if formed { 6 - lost.len() } else { 0 },
        held: formed && lost.is_empty(),
        reason,
        note: kind.note,
        attempt,
        angles,
        place,
        cost,
    }
}

/// What keeps the posture from being of its type.
fn faults(kind: &GraspType, stand: &HandStand) -> Vec<String> {
    let mut forces = [0.0; 6];
    let mut sideways = [0.0; 6];
    let links = stand.links();
    for contact in stand.contacts() {
        let part = contact.link.map_or(5, |link| link / 3);
        forces[part] += contact.force.norm();
        if let Some(link) = contact.link {
            sideways[part] += (links[link].inverse_transform_vector(&contact.force)).z.abs();
        }
    }
    let mut faults = Vec::new();
    for digit in Digit::ALL {
        let touches = forces[digit.index()] > TOUCH;
        let named = kind.digits.contains(&digit);
        if named && !touches {
            faults.push(format!("{} does not touch", digit.name()));
        }
        if !named && touches && !kind.helpers.contains(&digit) {
            faults.push(format!("{} touches", digit.name()));
        }
    }
    let palm = forces[5] > TOUCH;
    match kind.opposition {
        Opposition::Palm if !palm => faults.push("the palm does not touch".into()),
        Opposition::Pad if palm => faults.push("the palm touches".into()),
        Opposition::Side => {
            // The finger next to the thumb (or both fingers, where there is no thumb) takes part with its side.
            let of_side = |digit: Digit| sideways[digit.index()] > 0.5 * forces[digit.index()];
            let sided = match kind.digits {
                [Digit::Thumb, rest @ ..] => rest.iter().any(|digit| of_side(*digit)),
                fingers => fingers.iter().all(|digit| of_side(*digit)),
            };
            if !sided {
                faults.push("no finger touches with its side".into());
            }
        }
        _ => {}
    }
    let opposed = stand.angles()[stand.hand().transmission.opposition_joint];
    if kind.digits.contains(&Digit::Thumb) || kind.helpers.contains(&Digit::Thumb) {
        if kind.abducted && opposed < ABDUCTED {
            faults.push("the thumb is not abducted".into());
        }
        if !kind.abducted && opposed > ABDUCTED {
            faults.push("the thumb is not adducted".into());
        }
    }
    faults
}

/// A picture of each type's best attempt.
pub fn draw(hand: &Arc<Hand>, outcomes: &[Outcome], folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder)?;
    let types = types::all();
    let pictures: Vec<_> = outcomes
        .iter()
        .map(|outcome| {
            let kind = &types[outcome.number - 1];
            let mut picture = Picture::new(300, View::palm().at(Point3::new(0.01, -0.005, 0.0), 0.23));
            picture.hand(hand, &outcome.angles);
            picture.prop(&kind.prop, &outcome.place, super::picture::PROPS[0]);
            let verdict = match (outcome.held, outcome.formed) {
                (true, _) => "held".to_string(),
                (_, true) => format!("held in {} of 6", outcome.directions),
                _ => "NOT FORMED".to_string(),
            };
            let reason: String = outcome.reason.chars().take(36).collect();
            picture.finish(&format!("{} {}\n{verdict}\n{reason}", outcome.number, outcome.name))
        })
        .collect();
    save(&tile(&pictures, 6), &folder.join("feix.png"))
}

/// The table as text.
pub fn table(outcomes: &[Outcome]) -> String {
    let mut text = String::new();
    for outcome in outcomes {
        let verdict = if outcome.held {
            "held".into()
        } else if outcome.formed {
            format!("{} of 6", outcome.directions)
        } else {
            "not formed".to_string()
        };
        text += &format!("{:>2} {:24} {verdict:12} {}", outcome.number, outcome.name, outcome.reason);
        if !outcome.note.is_empty() {
            text += &format!(" ({})", outcome.note);
        }
        text.push('\n');
    }
    let count = |test: fn(&Outcome) -> bool| outcomes.iter().filter(|outcome| test(outcome)).count();
    let (held, formed) = (count(|outcome| outcome.held), count(|outcome| outcome.formed));
    text += &format!("{held} of {} held, {formed} formed\n", outcomes.len());
    text
}
