//! The Kapandji test: the thumb's tip to ten points of the hand, reached by the six servos in physics.
//!
//! The points are those of Kapandji (1986), each on our covers. Where a crease lies from its joint is measured on 53 hands by
//! Bugbee and Botte (Clin Orthop 296, 1993): the distal digital crease 7 to 8 mm and the middle one 2 to 3 mm on the wrist's side
//! of their joints, the proximal one 14 to 20 mm on the fingertip's side of the MCP joint (ours ends with the palm's cover, at
//! 14.5 mm), the distal palmar crease 6.8 to 10.3 mm on the wrist's side of the MCP joints, from the ulnar edge to the
//! middle finger. The commands are found by search: many random commands are looked at in static equilibrium, the nearest ones are
//! run in physics on the stand, and the best of those are varied until the thumb is there.

mod reach;

use std::sync::Arc;

use anyhow::Result;
use hand_model::statics::{self, Slid};
use hand_model::{Digit, HAND_JOINTS, Hand};
use nalgebra::{Isometry3, Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde_json::json;
use sim::engine::EngineSettings;
use sim::stand::{HandStand, tension_goals};

use self::reach::{Reach, reach};
use super::Options;
use super::row::{Row, Verdict};
use report::picture::{Picture, View, save, tile};

/// The thumb's tip is there within this, m.
const REACHED: f64 = 0.003;
/// Covers may overlap by this much, m: the engine's contacts give way a little.
const OVERLAP: f64 = 5e-4;
/// Good enough to stop the search, m.
const ENOUGH: f64 = 0.002;
/// Random commands looked at in static equilibrium.
const LOOKS: usize = 6000;
/// Commands run in physics before variation, and variations.
const STARTS: usize = 30;
const VARIATIONS: usize = 200;
/// The best of those run so far, which are varied.
const PARENTS: usize = 4;
/// Largest cable tensions tried, N.
const THUMB_TENSION: f64 = 30.0;
const FINGER_TENSION: f64 = 20.0;
/// Largest opposition command, rad: a little past the joint's stop, because the shaft gives way under the spring.
const OPPOSITION: f64 = 1.05 * std::f64::consts::FRAC_PI_2;
/// How long the first to move is alone, and how long both move then, s.
const FIRST: f64 = 0.7;
const REST: f64 = 1.8;
/// Cables that are eased are pulled up to this many times as hard before, for so long, s. From the second factor on all their
/// guides have turned round.
const HARDER: f64 = 3.0;
const TURNED: f64 = 1.3;
const HARD: f64 = 0.5;

/// Creases from their joints, the middle of what was measured, m: DIP, PIP, distal palmar crease from the MCP joints.
const DIP_CREASE: f64 = 0.0075;
const PIP_CREASE: f64 = 0.0025;
const PALMAR_CREASE: f64 = 0.0085;
/// Points of a crease that runs across the palm.
const ALONG: usize = 24;

/// One of the ten points.
struct Target {
    name: &'static str,
    /// Link that carries it; `None` is the palm.
    link: Option<usize>,
    /// In the link's frame, m; a crease across the palm is many points, any of which will do.
    points: Vec<Point3<f64>>,
}

/// A command: opposition angle (rad), thumb's and the target finger's tension (N), who moves first, and how many times as hard the
/// two cables are pulled before they are eased to that: friction in the guides leaves the far joints more tension so.
#[derive(Debug, Clone, Copy)]
struct Command {
    opposition: f64,
    thumb: f64,
    finger: f64,
    thumb_first: bool,
    harder: [f64; 2],
}

struct Outcome {
    distance: f64,
    overlap: f64,
    command: Command,
    angles: Vec<f64>,
}

impl Outcome {
    fn cost(&self) -> f64 {
        self.distance + 10.0 * (self.overlap - OVERLAP).max(0.0)
    }
}

fn targets(hand: &Hand) -> Vec<Target> {
    let side = |link: usize| {
        // Radial is the thumb's side: minus z of a finger's link.
        let cover = &hand.covers[link];
        cover.link_from_cover * Point3::new(0.0, 0.0, -cover.half.z)
    };
    // On the rounded edge between pad and end, half way round.
    let tip = |link: usize| {
        let cover = &hand.covers[link];
        let inner = cover.half.add_scalar(-cover.radius);
        let edge = Vector3::new(1.0, 1.0, 0.0).normalize() * cover.radius;
        cover.link_from_cover * Point3::from(Vector3::new(inner.x, inner.y, 0.0) + edge)
    };
    let palmar = |link: usize| hand.covers[link].link_from_cover.translation.y + hand.covers[link].half.y;
    let [i1, i2] = [Digit::Index.joints()[1], Digit::Index.joints()[2]];
    let [l0, l1, l2] = Digit::Little.joints();
    let mcp = |digit: Digit| hand.tree.joints[digit.joints()[0]].origin.translation.vector;
    let palm = &hand.palm_cover;
    let (skin, end) =
        (palm.link_from_cover.translation.z - palm.half.z, palm.link_from_cover.translation.y + palm.half.y);
    let on =
        |name: &'static str, link: usize, point: Point3<f64>| Target { name, link: Some(link), points: vec![point] };
    let [dip, pip] = [l2, l1].map(|link| hand.tree.joints[link].origin.translation.x);
    // Across the palm through the MCP joints of little, ring and middle finger, from the flat part's ulnar edge on.
    let knuckles = [Digit::Little, Digit::Ring, Digit::Middle].map(mcp);
    let edge = palm.link_from_cover.translation.x - palm.half.x + palm.radius;
    let palmar_crease = (0..ALONG)
        .map(|n| {
            let x = edge + (knuckles[2].x - edge) * n as f64 / (ALONG - 1) as f64;
            let [a, b] = if x < knuckles[1].x { [knuckles[0], knuckles[1]] } else { [knuckles[1], knuckles[2]] };
            let y = a.y + (b.y - a.y) * ((x - a.x) / (b.x - a.x)).max(0.0);
            Point3::new(x, y - PALMAR_CREASE, skin)
        })
        .collect();
    vec![
        on("side of index, second phalanx", i1, side(i1)),
        on("side of index, third phalanx", i2, side(i2)),
        on("tip of index", i2, tip(i2)),
        on("tip of middle", Digit::Middle.joints()[2], tip(Digit::Middle.joints()[2])),
        on("tip of ring", Digit::Ring.joints()[2], tip(Digit::Ring.joints()[2])),
        on("tip of little", l2, tip(l2)),
        on("DIP crease of little", l1, Point3::new(dip - DIP_CREASE, palmar(l1), 0.0)),
        on("PIP crease of little", l0, Point3::new(pip - PIP_CREASE, 0.5 * (palmar(l0) + palmar(l1)), 0.0)),
        on("proximal crease of little", l0, Point3::new(end - mcp(Digit::Little).y, palmar(l0), 0.0)),
        Target { name: "distal palmar crease", link: None, points: palmar_crease },
    ]
}

/// The thumb's tip: the distal half of its last link's skin, palmar side and end, link frame.
fn thumb_tip(hand: &Hand) -> Vec<Point3<f64>> {
    let cover = &hand.covers[Digit::Thumb.joints()[2]];
    let middle = cover.link_from_cover.translation.x;
    let on_pad = |n: &Vector3<f64>| n.y >= 0.25 || n.x >= 0.5;
    cover
        .skin(0.001)
        .into_iter()
        .filter(|element| element.point.x >= middle && on_pad(&element.normal))
        .map(|element| element.point)
        .collect()
}

fn distance(target: &Target, tip: &[Point3<f64>], links: &[Isometry3<f64>]) -> f64 {
    nearest(target, tip, links).0
}

/// The smallest distance (m) of the thumb's tip from the target, and the target's place there, palm frame.
fn nearest(target: &Target, tip: &[Point3<f64>], links: &[Isometry3<f64>]) -> (f64, Point3<f64>) {
    let carrier = target.link.map_or(Isometry3::identity(), |link| links[link]);
    let mut best = (f64::INFINITY, Point3::origin());
    for place in target.points.iter().map(|point| carrier * point) {
        let local = links[Digit::Thumb.joints()[2]].inverse_transform_point(&place);
        let distance = tip.iter().map(|point| (point - local).norm()).fold(f64::INFINITY, f64::min);
        if distance < best.0 {
            best = (distance, place);
        }
    }
    best
}

fn tensions(target: &Target, command: &Command) -> [f64; 5] {
    let mut tensions = [0.0; 5];
    tensions[0] = command.thumb;
    if let Some(link) = target.link {
        tensions[link / 3] = command.finger;
    }
    tensions
}

fn draw(rng: &mut ChaCha8Rng) -> Command {
    // Small tensions move the joints most: draw them evenly in their square root.
    let mut tension = |most: f64| most * rng.random_range(0.0..1.0f64).powi(2);
    let (thumb, finger) = (tension(THUMB_TENSION), tension(FINGER_TENSION));
    let opposition = rng.random_range(0.0..OPPOSITION);
    let mut harder = || if rng.random_bool(0.5) { 1.0 } else { rng.random_range(1.0..HARDER) };
    let harder = [harder(), harder()];
    Command { opposition, thumb, finger, thumb_first: rng.random_bool(0.3), harder }
}

fn run(hand: &Arc<Hand>, target: &Target, tip: &[Point3<f64>], command: Command) -> (Outcome, HandStand) {
    let mut stand = HandStand::new(hand.clone(), EngineSettings::default());
    let all = tensions(target, &command);
    let mut first = all;
    if command.thumb_first {
        first[1..].fill(0.0);
    } else {
        first[0] = 0.0;
    }
    let turned = if command.thumb_first { command.opposition } else { 0.0 };
    stand.run(&tension_goals(hand, &first, turned), FIRST);
    if command.harder != [1.0, 1.0] {
        let factor = |cable: usize| command.harder[usize::from(cable > 0)];
        let hard = std::array::from_fn(|cable| all[cable] * factor(cable));
        stand.run(&tension_goals(hand, &hard, command.opposition), HARD);
    }
    stand.run(&tension_goals(hand, &all, command.opposition), REST);
    let outcome = Outcome {
        distance: distance(target, tip, &stand.links()),
        overlap: stand.self_penetration(),
        command,
        angles: stand.angles().to_vec(),
    };
    (outcome, stand)
}

/// Joint angles (rad) that a command leads to where nothing is in the way.
fn expected(hand: &Hand, target: &Target, command: &Command) -> [f64; HAND_JOINTS] {
    let opposition = command.opposition.min(std::f64::consts::FRAC_PI_2);
    let [mut thumb, finger] = command.harder.map(|harder| {
        let state = if harder > TURNED { -1.0 } else { 1.0 };
        let slid = Slid { friction: hand.parameters.cable.friction, state };
        statics::free_sliding(hand, &tensions(target, command), opposition, &slid)
    });
    thumb[Digit::Thumb.joints().len()..].copy_from_slice(&finger[Digit::Thumb.joints().len()..]);
    thumb
}

fn search(hand: &Arc<Hand>, target: &Target, tip: &[Point3<f64>], rng: &mut ChaCha8Rng) -> Outcome {
    let mut looks: Vec<(f64, Command)> = (0..LOOKS)
        .map(|_| {
            let command = draw(rng);
            (distance(target, tip, &hand.tree.forward(&expected(hand, target, &command))), command)
        })
        .collect();
    looks.sort_by(|a, b| a.0.total_cmp(&b.0));
    // The best of each neighbourhood.
    let mut starts: Vec<Command> = Vec::new();
    for (_, command) in &looks {
        let near = |other: &Command| {
            (command.opposition - other.opposition).abs() < 0.1
                && (command.thumb / other.thumb.max(0.1)).ln().abs() < 0.2
                && command.thumb_first == other.thumb_first
                && command.harder.map(|harder| harder > TURNED) == other.harder.map(|harder| harder > TURNED)
        };
        if starts.len() < STARTS && !starts.iter().any(near) {
            starts.push(*command);
        }
    }
    let mut found: Vec<Outcome> = starts.into_iter().map(|command| run(hand, target, tip, command).0).collect();
    found.sort_by(|a, b| a.cost().total_cmp(&b.cost()));
    for tried in 0..VARIATIONS {
        if found[0].cost() < ENOUGH {
            break;
        }
        found.truncate(PARENTS);
        let spread = 0.25 * 0.985f64.powi(tried as i32);
        let mut command = found[rng.random_range(0..found.len())].command;
        let mut stretch = || (2.0 * spread * rng.random_range(-1.0..1.0f64)).exp();
        command.thumb = (command.thumb * stretch()).min(THUMB_TENSION);
        command.finger = (command.finger * stretch()).min(FINGER_TENSION);
        command.harder = command.harder.map(|harder| (harder * stretch()).clamp(1.0, HARDER));
        let turn = spread * rng.random_range(-1.0..1.0);
        command.opposition = (command.opposition + turn).clamp(0.0, OPPOSITION);
        found.push(run(hand, target, tip, command).0);
        found.sort_by(|a, b| a.cost().total_cmp(&b.cost()));
    }
    found.swap_remove(0)
}

/// Each point that is not reached: how near the servos come, and how near the joints could.
fn missed(targets: &[Target], outcomes: &[Outcome], reaches: &[Reach]) -> String {
    let lines: Vec<String> = targets
        .iter()
        .zip(outcomes.iter().zip(reaches))
        .enumerate()
        .filter(|(_, (_, (outcome, _)))| outcome.distance > REACHED || outcome.overlap > OVERLAP)
        .map(|(n, (target, (outcome, reach)))| {
            let why = if reach.any > REACHED {
                "out of the joints' reach"
            } else if reach.clear > REACHED {
                "covers are in the way"
            } else {
                "one cable a finger does not take it there"
            };
            let [by_servos, any, clear] = [outcome.distance, reach.any, reach.clear].map(|distance| distance * 1e3);
            format!(
                "\n    missed: {:2} {:26} {by_servos:5.1} mm by servos; {any:5.1} mm with any joint angles, {clear:5.1} mm of those \
                 without overlap: {why}",
                n + 1,
                target.name,
            )
        })
        .collect();
    lines.concat()
}

/// The row, with a picture of all ten.
pub fn row(hand: &Arc<Hand>, options: &Options<'_>) -> Result<Row> {
    let tip = thumb_tip(hand);
    let targets = targets(hand);
    let outcomes: Vec<Outcome> = targets
        .par_iter()
        .enumerate()
        .map(|(n, target)| {
            let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
            rng.set_stream(n as u64);
            search(hand, target, &tip, &mut rng)
        })
        .collect();
    let reaches: Vec<Reach> = targets
        .par_iter()
        .enumerate()
        .map(|(n, target)| {
            let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
            rng.set_stream((targets.len() + n) as u64);
            reach(hand, target, &tip, &mut rng)
        })
        .collect();
    let good = |outcome: &Outcome| outcome.distance <= REACHED && outcome.overlap <= OVERLAP;
    let reached = outcomes.iter().filter(|outcome| good(outcome)).count();
    let details: Vec<_> = targets
        .iter()
        .zip(outcomes.iter().zip(&reaches))
        .enumerate()
        .map(|(n, (target, (outcome, reach)))| {
            json!({
                "point": n + 1,
                "name": target.name,
                "distance_mm": outcome.distance * 1e3,
                "kinematic_mm": reach.any * 1e3,
                "kinematic_clear_mm": reach.clear * 1e3,
                "overlap_mm": outcome.overlap * 1e3,
                "reached": good(outcome),
                "opposition_deg": outcome.command.opposition.to_degrees(),
                "thumb_tension_n": outcome.command.thumb,
                "finger_tension_n": outcome.command.finger,
                "thumb_first": outcome.command.thumb_first,
                "harder_before": outcome.command.harder,
                "angles_deg": outcome.angles.iter().map(|q| q.to_degrees()).collect::<Vec<_>>(),
            })
        })
        .collect();
    let mut row = Row::new(
        "Kapandji test",
        format!("{reached} of 10"),
        "10 of 10",
        &format!(
            "thumb tip (distal half of the last link's skin, palmar side and end) within 3 mm of each point, no covers overlapping by \
             more than 0.5 mm, moved by the servos on the stand; commands by seeded search.{}",
            missed(&targets, &outcomes, &reaches)
        ),
        Verdict::of(reached == 10),
    )
    .with(json!(details));
    if let Some(folder) = options.out {
        let pictures: Vec<_> = targets
            .iter()
            .zip(&outcomes)
            .enumerate()
            .map(|(n, (target, outcome))| {
                let links = hand.tree.forward(&outcome.angles);
                let (_, at) = nearest(target, &tip, &links);
                let mut picture = Picture::new(300, View::palm().at(Point3::new(0.01, -0.005, 0.0), 0.23));
                picture.hand(hand, &outcome.angles);
                picture.dot(&at, 0.0025, [220.0, 40.0, 40.0]);
                let mark = if good(outcome) { "" } else { "  NOT REACHED" };
                picture.finish(&format!(
                    "{} {}\n{:.1} mm, overlap {:.2} mm{mark}",
                    n + 1,
                    target.name,
                    outcome.distance * 1e3,
                    outcome.overlap * 1e3
                ))
            })
            .collect();
        save(&tile(&pictures, 5), &folder.join("kapandji.png"))?;
        row.picture = Some("kapandji.png".into());
    }
    Ok(row)
}
