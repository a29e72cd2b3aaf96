//! Kapandji test (Kapandji 1986): the thumb's tip reaches ten points of the hand, driven by the six servos in physics.
//!
//! [`target`] has the points, `reach` the limits of the joints alone. The commands are found by search: many random
//! commands are evaluated in static equilibrium, the nearest ones are run in physics on the stand, and the best of
//! those are varied until the thumb reaches the point, or the search restarts.

mod reach;
mod target;

use std::path::Path;
use std::sync::Arc;

use anyhow::Result;
use hand_model::statics::{self, GuideFriction};
use hand_model::{Digit, DigitVector, Hand, HandVector};
use image::RgbImage;
use nalgebra::Point3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use report::picture::{Picture, View, save, tile};
use serde_json::{Value, json};
use sim::engine::EngineSettings;
use sim::test_stand::{HandTestStand, tension_goals};

use self::reach::{Reach, reach};
use self::target::{KapandjiTarget, OVERLAP_TOLERANCE, distance, nearest, targets, thumb_tip};
use super::row::{CheckRow, Verdict};

/// Tolerance within which the thumb's tip reaches a point, m.
const REACH_TOLERANCE: f64 = 0.003;
/// Distance that stops the search, m.
const SEARCH_END_DISTANCE: f64 = 0.002;
/// Number of random commands evaluated in static equilibrium.
const COMMAND_SAMPLES: usize = 6000;
/// Numbers of commands run in physics: before variation, and as variations.
const START_COUNT: usize = 30;
const VARIATION_COUNT: usize = 200;
/// Number of the best commands so far that are varied.
const PARENT_COUNT: usize = 4;
/// Maximum number of restarts, if the joints could reach the point and no search has.
const MAX_RESTARTS: usize = 16;
/// Largest cable tensions tried, N.
const MAX_THUMB_TENSION: f64 = 30.0;
const MAX_FINGER_TENSION: f64 = 20.0;
/// Largest opposition command, rad: slightly beyond the joint's stop, because the shaft yields under the spring.
const MAX_OPPOSITION: f64 = 1.05 * std::f64::consts::FRAC_PI_2;
/// Times during which the first digit moves alone, and then both, s.
const FIRST_DIGIT_TIME: f64 = 0.7;
const BOTH_DIGITS_TIME: f64 = 1.8;
/// Largest overdrive factor of a cable that is pulled harder before it is eased, the factor from which all of its
/// guides reverse their friction, and the time of the harder pull, s.
const MAX_OVERDRIVE: f64 = 3.0;
const FRICTION_REVERSAL_FACTOR: f64 = 1.3;
const OVERDRIVE_TIME: f64 = 0.5;

/// Command: opposition angle (rad), tensions of the thumb's and the target finger's cables (N), order of motion, and
/// overdrive factors of the two cables. A cable is first pulled harder by its factor and then eased, because friction
/// in the guides then leaves the far joints more tension.
#[derive(Debug, Clone, Copy)]
struct ThumbCommand {
    opposition: f64,
    thumb: f64,
    finger: f64,
    thumb_first: bool,
    overdrive: [f64; 2],
}

/// Result of a command.
struct CommandResult {
    /// Distance of the thumb's tip from the point, m.
    distance: f64,
    /// Largest overlap of two covers, m.
    overlap: f64,
    command: ThumbCommand,
    angles: Vec<f64>,
}

impl CommandResult {
    fn reached(&self) -> bool {
        self.distance <= REACH_TOLERANCE && self.overlap <= OVERLAP_TOLERANCE
    }

    fn cost(&self) -> f64 {
        self.distance + 10.0 * (self.overlap - OVERLAP_TOLERANCE).max(0.0)
    }
}

fn tensions(target: &KapandjiTarget, command: &ThumbCommand) -> DigitVector {
    let mut tensions = DigitVector::from([0.0; 5]);
    tensions[0] = command.thumb;
    if let Some(link) = target.link {
        tensions[link / 3] = command.finger;
    }
    tensions
}

fn draw(rng: &mut ChaCha8Rng) -> ThumbCommand {
    // Small tensions move the joints most, so tensions are drawn uniformly in their square root.
    let mut tension = |most: f64| most * rng.random_range(0.0..1.0f64).powi(2);
    let (thumb, finger) = (tension(MAX_THUMB_TENSION), tension(MAX_FINGER_TENSION));
    let opposition = rng.random_range(0.0..MAX_OPPOSITION);
    let mut harder = || if rng.random_bool(0.5) { 1.0 } else { rng.random_range(1.0..MAX_OVERDRIVE) };
    let harder = [harder(), harder()];
    ThumbCommand { opposition, thumb, finger, thumb_first: rng.random_bool(0.3), overdrive: harder }
}

fn run(
    hand: &Arc<Hand>,
    target: &KapandjiTarget,
    tip: &[Point3<f64>],
    command: ThumbCommand,
) -> (CommandResult, HandTestStand) {
    let mut stand = HandTestStand::new(hand.clone(), EngineSettings::default());
    let all = tensions(target, &command);
    let mut first = all;
    if command.thumb_first {
        first[1..].fill(0.0);
    } else {
        first[0] = 0.0;
    }
    let turned = if command.thumb_first { command.opposition } else { 0.0 };
    stand.run(&tension_goals(hand, &first, turned), FIRST_DIGIT_TIME);
    if command.overdrive != [1.0, 1.0] {
        let factor = |cable: usize| command.overdrive[usize::from(cable > 0)];
        let hard = hand.each_digit(|cable| all[cable] * factor(cable));
        stand.run(&tension_goals(hand, &hard, command.opposition), OVERDRIVE_TIME);
    }
    stand.run(&tension_goals(hand, &all, command.opposition), BOTH_DIGITS_TIME);
    let outcome = CommandResult {
        distance: distance(target, tip, &stand.links()),
        overlap: stand.self_penetration(),
        command,
        angles: stand.angles().to_vec(),
    };
    (outcome, stand)
}

/// Predicts the joint angles (rad) of a command without obstacles.
fn predicted_angles(hand: &Hand, target: &KapandjiTarget, command: &ThumbCommand) -> HandVector {
    let opposition = command.opposition.min(std::f64::consts::FRAC_PI_2);
    let [mut thumb, finger] = command.overdrive.map(|harder| {
        let state = if harder > FRICTION_REVERSAL_FACTOR { -1.0 } else { 1.0 };
        let slid = GuideFriction { friction: hand.parameters.cable.friction, state };
        statics::free_equilibrium_with_friction(hand, &tensions(target, command), opposition, &slid)
    });
    thumb[Digit::Thumb.ftac_joints().len()..].copy_from_slice(&finger[Digit::Thumb.ftac_joints().len()..]);
    thumb
}

/// Repeats the search until the point is reached; searches only once if no joint angles reach it.
fn search_rounds(
    hand: &Arc<Hand>,
    target: &KapandjiTarget,
    tip: &[Point3<f64>],
    reach: &Reach,
    rng: &mut ChaCha8Rng,
) -> CommandResult {
    let mut best = search(hand, target, tip, rng);
    for _ in 1..MAX_RESTARTS {
        if best.reached() || reach.without_overlap > REACH_TOLERANCE {
            break;
        }
        let other = search(hand, target, tip, rng);
        if other.cost() < best.cost() {
            best = other;
        }
    }
    best
}

fn search(hand: &Arc<Hand>, target: &KapandjiTarget, tip: &[Point3<f64>], rng: &mut ChaCha8Rng) -> CommandResult {
    let mut looks: Vec<(f64, ThumbCommand)> = (0..COMMAND_SAMPLES)
        .map(|_| {
            let command = draw(rng);
            (distance(target, tip, &hand.tree.forward(&predicted_angles(hand, target, &command))), command)
        })
        .collect();
    looks.sort_by(|a, b| a.0.total_cmp(&b.0));
    // The best command of each neighbourhood.
    let mut starts: Vec<ThumbCommand> = Vec::new();
    for (_, command) in &looks {
        let near = |other: &ThumbCommand| {
            (command.opposition - other.opposition).abs() < 0.1
                && (command.thumb / other.thumb.max(0.1)).ln().abs() < 0.2
                && command.thumb_first == other.thumb_first
                && command.overdrive.map(|harder| harder > FRICTION_REVERSAL_FACTOR)
                    == other.overdrive.map(|harder| harder > FRICTION_REVERSAL_FACTOR)
        };
        if starts.len() < START_COUNT && !starts.iter().any(near) {
            starts.push(*command);
        }
    }
    let mut found: Vec<CommandResult> = starts.into_iter().map(|command| run(hand, target, tip, command).0).collect();
    found.sort_by(|a, b| a.cost().total_cmp(&b.cost()));
    for tried in 0..VARIATION_COUNT {
        if found[0].cost() < SEARCH_END_DISTANCE {
            break;
        }
        found.truncate(PARENT_COUNT);
        let spread = 0.25 * 0.985f64.powi(tried as i32);
        let mut command = found[rng.random_range(0..found.len())].command;
        let mut stretch = || (2.0 * spread * rng.random_range(-1.0..1.0f64)).exp();
        command.thumb = (command.thumb * stretch()).min(MAX_THUMB_TENSION);
        command.finger = (command.finger * stretch()).min(MAX_FINGER_TENSION);
        command.overdrive = command.overdrive.map(|harder| (harder * stretch()).clamp(1.0, MAX_OVERDRIVE));
        let turn = spread * rng.random_range(-1.0..1.0);
        command.opposition = (command.opposition + turn).clamp(0.0, MAX_OPPOSITION);
        found.push(run(hand, target, tip, command).0);
        found.sort_by(|a, b| a.cost().total_cmp(&b.cost()));
    }
    found.swap_remove(0)
}

/// Describes each missed point: the smallest distance with the servos, and the smallest with free joints.
fn describe_missed(targets: &[KapandjiTarget], outcomes: &[CommandResult], reaches: &[Reach]) -> String {
    let lines: Vec<String> = targets
        .iter()
        .zip(outcomes.iter().zip(reaches))
        .enumerate()
        .filter(|(_, (_, (outcome, _)))| outcome.distance > REACH_TOLERANCE || outcome.overlap > OVERLAP_TOLERANCE)
        .map(|(n, (target, (outcome, reach)))| {
            let why = if reach.unconstrained > REACH_TOLERANCE {
                "out of the joints' reach"
            } else if reach.without_overlap > REACH_TOLERANCE {
                "covers collide"
            } else {
                "not reachable with one cable per finger"
            };
            let [by_servos, any, clear] = [outcome.distance, reach.unconstrained, reach.without_overlap].map(|distance| distance * 1e3);
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

/// Returns a separate random generator for each search of a seed.
fn stream(seed: u64, n: usize) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(n as u64);
    rng
}

/// Returns the row for `seeds` seeds from the first on. A picture of all ten points as reached with the first seed goes
/// to `out`.
pub fn row(hand: &Arc<Hand>, out: Option<&Path>, (seed, seeds): (u64, u64)) -> Result<CheckRow> {
    let tip = thumb_tip(hand);
    let targets = targets(hand);
    let all: Vec<(u64, usize)> = (seed..seed.saturating_add(seeds))
        .flat_map(|seed| (0..targets.len()).map(move |point| (seed, point)))
        .collect();
    let reaches: Vec<Reach> = targets
        .par_iter()
        .enumerate()
        .map(|(n, target)| reach(hand, target, &tip, &mut stream(seed, targets.len() + n)))
        .collect();
    let mut results: Vec<CommandResult> = all
        .par_iter()
        .with_max_len(1)
        .map(|(seed, n)| search_rounds(hand, &targets[*n], &tip, &reaches[*n], &mut stream(*seed, *n)))
        .collect();
    let counts: Vec<usize> = results.chunks(targets.len()).map(count_reached).collect();
    let others = missed_over_seeds(&targets, &results);
    results.truncate(targets.len());
    let fewest = counts.iter().min().copied().unwrap_or_default();
    let most = counts.iter().max().copied().unwrap_or_default();
    let details: Vec<Value> = targets
        .iter()
        .zip(results.iter().zip(&reaches))
        .enumerate()
        .map(|(n, (target, (result, reach)))| details(n + 1, target, result, reach))
        .collect();
    let mut row = CheckRow::new(
        "Kapandji test",
        match (fewest == most, seeds) {
            (true, 1) => format!("{most} of 10"),
            (true, _) => format!("{most} of 10 ({seeds} seeds)"),
            (false, _) => format!("{fewest} to {most} of 10 ({seeds} seeds)"),
        },
        "10 of 10",
        &format!(
            "thumb tip (distal half of the last link's skin, palmar side and end) within 3 mm of each point, no covers overlapping by \
             more than 0.5 mm, moved by the servos on the stand; commands by seeded search.{}{others}",
            describe_missed(&targets, &results, &reaches)
        ),
        Verdict::from_good(fewest == 10),
    )
    .with_details(json!(details));
    if let Some(folder) = out {
        let pictures: Vec<RgbImage> = targets
            .iter()
            .zip(&results)
            .enumerate()
            .map(|(n, (target, result))| picture(hand, n + 1, target, &tip, result))
            .collect();
        save(&tile(&pictures, 5), &folder.join("kapandji.png"))?;
        row.picture = Some("kapandji.png".into());
    }
    Ok(row)
}

/// Counts the reached points.
fn count_reached(results: &[CommandResult]) -> usize {
    results.iter().filter(|result| result.reached()).count()
}

/// With more than one seed, lists the missed points with the number of seeds.
fn missed_over_seeds(targets: &[KapandjiTarget], results: &[CommandResult]) -> String {
    let seeds = results.len() / targets.len();
    let line = |(n, target): (usize, &KapandjiTarget)| {
        let missed: Vec<&CommandResult> =
            results.iter().skip(n).step_by(targets.len()).filter(|result| !result.reached()).collect();
        let worst = missed.iter().map(|result| result.distance).fold(0.0, f64::max);
        (seeds > 1 && !missed.is_empty()).then(|| {
            format!(
                "\n    {:2} {:26} missed with {} of {seeds} seeds, by {:.1} mm at most",
                n + 1,
                target.name,
                missed.len(),
                1e3 * worst
            )
        })
    };
    targets.iter().enumerate().filter_map(line).collect()
}

fn details(number: usize, target: &KapandjiTarget, result: &CommandResult, reach: &Reach) -> Value {
    json!({
        "point": number,
        "name": target.name,
        "distance_mm": result.distance * 1e3,
        "kinematic_mm": reach.unconstrained * 1e3,
        "kinematic_clear_mm": reach.without_overlap * 1e3,
        "overlap_mm": result.overlap * 1e3,
        "reached": result.reached(),
        "opposition_deg": result.command.opposition.to_degrees(),
        "thumb_tension_n": result.command.thumb,
        "finger_tension_n": result.command.finger,
        "thumb_first": result.command.thumb_first,
        "harder_before": result.command.overdrive,
        "angles_deg": result.angles.iter().map(|q| q.to_degrees()).collect::<Vec<_>>(),
    })
}

/// Draws the hand at the end of the command, with a dot on the point.
fn picture(
    hand: &Hand,
    number: usize,
    target: &KapandjiTarget,
    tip: &[Point3<f64>],
    result: &CommandResult,
) -> RgbImage {
    let links = hand.tree.forward(&result.angles);
    let (_, at) = nearest(target, tip, &links);
    let mut picture = Picture::new(300, View::palm().recentered(Point3::new(0.01, -0.005, 0.0), 0.23));
    picture.hand(hand, &result.angles);
    picture.dot(&at, 0.0025, [220.0, 40.0, 40.0]);
    let mark = if result.reached() { "" } else { "  NOT REACHED" };
    let (distance, overlap) = (result.distance * 1e3, result.overlap * 1e3);
    picture.finish(&format!("{number} {}\n{distance:.1} mm, overlap {overlap:.2} mm{mark}", target.name))
}
