//! `ftac hand check --urdf`: inspects a hand's files, and reports deviations from their content.

use std::path::Path;

use ftac::terminal::{Outcome, Terminal};
use grasp_verification::synthesis::urdf_hand::describe;
use hand_model::hand_mechanism::HandMechanism;
use hand_model::kinematics::{Joint, JointKind};
use hand_model::{RobotModel, urdf};
use schemars::JsonSchema;
use serde::Serialize;
use world::geometry::LINK_MESHES;

/// Output for a URDF tree with the joints of the built-in hand.
#[derive(Debug, Serialize, JsonSchema)]
pub struct TreeOutput<'a> {
    /// URDF file.
    urdf: &'a Path,
    /// Number of joints.
    joints: usize,
}

/// A joint of a hand.
#[derive(Debug, Serialize, JsonSchema)]
struct JointRow {
    name: String,
    /// Kind of joint: turns or slides.
    kind: &'static str,
    /// Unit of its limits.
    unit: &'static str,
    /// Lower limit; null if there is none.
    lower: Option<f64>,
    /// Upper limit; null if there is none.
    upper: Option<f64>,
    /// Largest torque, N m, or force, N; null if there is none.
    effort: Option<f64>,
    /// Leader of a mimic joint with the multiplier.
    follows: Option<String>,
    /// Mass of its link, kg.
    mass_kg: f64,
    /// Number of collision shapes of its link.
    shapes: usize,
}

/// An actuator that pulls on joints.
#[derive(Debug, Serialize, JsonSchema)]
struct Actuator {
    name: String,
    /// Number of joints that it moves.
    joints: usize,
    /// Largest tension, N.
    max_tension_n: Option<f64>,
}

/// Output for a hand.
#[derive(Debug, Serialize, JsonSchema)]
pub struct InspectionOutput<'a> {
    /// Name of the hand.
    hand: &'a str,
    /// One row per joint.
    joints: Vec<JointRow>,
    /// Actuators, with --pulls only.
    actuators: Vec<Actuator>,
    /// Number of collision shapes of the root link.
    shapes_of_the_root: usize,
    /// Links without a collision shape, which pass through everything.
    links_without_shape: &'a [String],
    /// Findings about the hand; warnings begin with WARNING.
    notes: &'a [String],
}

/// Reads a hand's URDF, and its pulls file if there is one, and reports their content.
pub fn run(terminal: &Terminal, path: &Path, pulls: Option<&Path>) -> Outcome {
    let ours: Vec<String> =
        RobotModel::ftac_gen3().hand.tree.joints.iter().map(|joint| format!("{}_joint", joint.name)).collect();
    let frames = urdf::read_frames(path, &[])?;
    if pulls.is_none() && frames.joints.iter().any(|joint| ours.contains(&joint.name)) {
        // The built-in hand's URDF, which must have all of the joints.
        let names: Vec<&str> = ours.iter().map(String::as_str).collect();
        let tree = urdf::read_tree(path, &names)?;
        let text = format!("{}: {} joints, all of the hand's joints are there\n", path.display(), tree.len());
        terminal.print(&TreeOutput { urdf: path, joints: tree.len() }, &text)?;
        return Ok(None);
    }
    let (hand, notes) = match pulls {
        Some(pulls) => {
            let described = describe::read(path, pulls)?;
            ((**described.mechanism()).clone(), described.notes)
        }
        None => {
            let hand = HandMechanism::read_unactuated(path, LINK_MESHES)?;
            let notes = hand.notes.clone();
            (hand, notes)
        }
    };
    terminal.print(&inspection_output(&hand, &notes), &text(&hand, &notes))?;
    let warnings = notes.iter().filter(|note| note.starts_with("WARNING")).count();
    Ok((warnings > 0).then(|| format!("{warnings} warnings")))
}

/// Returns the leader of a mimic joint with the multiplier.
fn leader(hand: &HandMechanism, joint: usize) -> Option<String> {
    let follower = hand.followers.iter().find(|follower| follower.joint == joint)?;
    Some(format!("{} times {}", hand.tree.joints[follower.leader].name, follower.multiplier))
}

fn inspection_output<'a>(hand: &'a HandMechanism, notes: &'a [String]) -> InspectionOutput<'a> {
    let joints = hand.tree.joints.iter().enumerate().map(|(n, joint)| {
        let finite = |limit: f64| limit.is_finite().then_some(limit);
        JointRow {
            name: joint.name.clone(),
            kind: match joint.kind {
                JointKind::Turn => "turns",
                JointKind::Slide => "slides",
            },
            unit: joint.kind.unit(),
            lower: finite(joint.lower),
            upper: finite(joint.upper),
            effort: hand.effort_limits[n],
            follows: leader(hand, n),
            mass_kg: hand.masses[n].mass,
            shapes: hand.solids.iter().filter(|solid| solid.link == Some(n)).count(),
        }
    });
    let actuators = hand.actuators.iter().map(|pull| Actuator {
        name: pull.name.clone(),
        joints: pull.levers.len(),
        max_tension_n: pull.max_tension.as_ref().map(|(most, _)| *most),
    });
    InspectionOutput {
        hand: &hand.name,
        joints: joints.collect(),
        actuators: actuators.collect(),
        shapes_of_the_root: hand.solids.iter().filter(|solid| solid.link.is_none()).count(),
        links_without_shape: &hand.links_without_collision,
        notes,
    }
}

fn range(joint: &Joint) -> String {
    if !(joint.lower.is_finite() && joint.upper.is_finite()) {
        return "without limits".into();
    }
    match joint.kind {
        JointKind::Turn => format!("{:.0} to {:.0} deg", joint.lower.to_degrees(), joint.upper.to_degrees()),
        JointKind::Slide => format!("{:.1} to {:.1} mm", 1e3 * joint.lower, 1e3 * joint.upper),
    }
}

fn text(hand: &HandMechanism, notes: &[String]) -> String {
    let mut text = format!("{}: {} moving joints, {} actuators\n", hand.name, hand.tree.len(), hand.actuators.len());
    let width = hand.tree.joints.iter().map(|joint| joint.name.chars().count()).fold(5, usize::max);
    text +=
        &format!("{:width$} {:>18} {:>12} {:>9} {:>6}  follows\n", "joint", "range", "effort", "its link", "shapes");
    for (n, joint) in hand.tree.joints.iter().enumerate() {
        let effort =
            hand.effort_limits[n].map_or("-".into(), |effort| format!("{effort} {}", joint.kind.effort_unit()));
        let shapes = hand.solids.iter().filter(|solid| solid.link == Some(n)).count();
        text += &format!(
            "{:width$} {:>18} {effort:>12} {:>7.1} g {shapes:>6}  {}\n",
            joint.name,
            range(joint),
            1e3 * hand.masses[n].mass,
            leader(hand, n).unwrap_or_default()
        );
    }
    for note in notes {
        text += &format!("{note}\n");
    }
    text
}
