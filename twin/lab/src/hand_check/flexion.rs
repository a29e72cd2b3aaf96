//! Flexion of a finger: PIP and DIP against MCP in free closing, and the motion of the other joints when one phalanx is
//! blocked.

use std::path::Path;
use std::sync::Arc;

use anyhow::Result;
use hand_model::statics::{self, GuideFriction};
use hand_model::{Digit, Hand};
use nalgebra::{Isometry3, Vector3};
use report::picture::{Picture, View, save, tile};
use report::plot::Plot;
use serde_json::json;
use sim::engine::EngineSettings;
use sim::test_stand::{HandTestStand, Prop, tension_goals};
use world::ObjectShape;

use super::row::{CheckRow, Verdict};

/// The tested finger.
const TESTED_DIGIT: Digit = Digit::Middle;
/// The cable tension rises at a constant rate to this, N, in this time, s.
const MAX_TENSION: f64 = 18.0;
/// Tension a little above which the fingertip meets the palm in free closing, N; the static path ends there.
const FREE_TENSION: f64 = 13.5;
/// Flexion that all joints must exceed at the end, deg: nearly their whole range of 90.
const CLOSED_FLEXION: f64 = 80.0;
const PULL_TIME: f64 = 24.0;
/// Tolerance of free closing against the static path, deg.
const STATIC_TOLERANCE: f64 = 3.0;
/// Further flexion of a joint after the contact with the block from which it counts as having continued, deg.
const CONTINUED_FLEXION: f64 = 30.0;
/// Tolerance on the motion of the blocked joint, deg.
const BLOCKED_TOLERANCE: f64 = 6.0;

/// Recorded path: angles (deg) of MCP, PIP and DIP with the tension (N) at each sample.
struct FlexionPath {
    tension: Vec<f64>,
    angles: Vec<[f64; 3]>,
}

fn close_finger(hand: &Arc<Hand>, block: Option<(Prop, Isometry3<f64>)>) -> (FlexionPath, HandTestStand) {
    let mut stand = HandTestStand::new(hand.clone(), EngineSettings::default());
    if let Some((prop, pose)) = block {
        stand.add_prop(prop, &pose);
    }
    let mut path = FlexionPath { tension: Vec::new(), angles: Vec::new() };
    let steps = 240;
    for n in 0..=steps {
        let tension = MAX_TENSION * n as f64 / steps as f64;
        let mut tensions = [0.0; 5];
        tensions[TESTED_DIGIT.index()] = tension;
        stand.run(&tension_goals(hand, &tensions, 0.0), PULL_TIME / steps as f64);
        // The tension in the cable lags behind the servo's command while the cable moves.
        path.tension.push(stand.tensions()[TESTED_DIGIT.index()]);
        path.angles.push(TESTED_DIGIT.ftac_joints().map(|joint| stand.angles()[joint].to_degrees()));
    }
    (path, stand)
}

fn lines(path: &FlexionPath, mark: &str) -> Vec<(String, Vec<[f64; 2]>)> {
    let of = |joint: usize| path.tension.iter().zip(&path.angles).map(|(t, a)| [*t, a[joint]]).collect();
    ["MCP", "PIP", "DIP"].iter().enumerate().map(|(joint, name)| (format!("{name}{mark}"), of(joint))).collect()
}

/// Returns a block below the finger's `phalanx`, which meets it at about 20 deg of flexion of its joint.
fn block(hand: &Hand, phalanx: usize) -> (Prop, Isometry3<f64>) {
    let link = TESTED_DIGIT.ftac_joints()[phalanx];
    let mut q = hand.open_angles();
    q[link] = 20f64.to_radians();
    if phalanx == 1 {
        // Pose of the proximal phalanx when the middle one has flexed so far.
        let tension = 3.5;
        let mut tensions = [0.0; 5];
        tensions[TESTED_DIGIT.index()] = tension;
        q = statics::free_equilibrium(hand, &tensions, 0.0);
    }
    let pose = hand.tree.forward(&q)[link];
    let cover = &hand.covers[link];
    let half = Vector3::new(0.004, 0.004, 0.009);
    let along = cover.link_from_cover.translation.x + 0.4 * cover.half.x;
    let below = cover.link_from_cover.translation.y + cover.half.y + half.y;
    let prop = Prop::new("block", ObjectShape::Cuboid { half, radius: 0.001 }, 0.1, 0.0);
    (prop, pose * Isometry3::translation(along, below, 0.0))
}

/// Returns the rows; pictures go to `out`.
pub fn rows(hand: &Arc<Hand>, out: Option<&Path>) -> Result<Vec<CheckRow>> {
    let (free, stand) = close_finger(hand, None);
    let mut rows = vec![free_row(hand, &free)];
    let mut blocked = Vec::new();
    for (phalanx, name) in [(0, "proximal"), (1, "middle")] {
        let (path, stand) = close_finger(hand, Some(block(hand, phalanx)));
        rows.push(blocked_row(&free, &path, phalanx, name));
        blocked.push((name, path, stand));
    }
    if let Some(folder) = out {
        draw(hand, &free, &stand, &blocked, &folder.join("flexion.png"))?;
        for row in &mut rows {
            row.picture = Some("flexion.png".into());
        }
    }
    Ok(rows)
}

/// Compares free closing with static equilibrium under cable friction.
fn free_row(hand: &Hand, free: &FlexionPath) -> CheckRow {
    let count = free.tension.iter().filter(|tension| **tension <= FREE_TENSION).count();
    let last = free.angles[free.angles.len() - 1];
    // The cable has been pulled in throughout, so friction in every guide opposes that.
    let closing = GuideFriction { friction: hand.parameters.cable.friction, state: 1.0 };
    let mut difference = 0.0f64;
    for (tension, angles) in free.tension.iter().zip(&free.angles).take(count) {
        let mut tensions = [0.0; 5];
        tensions[TESTED_DIGIT.index()] = *tension;
        let still = statics::free_equilibrium_with_friction(hand, &tensions, 0.0, &closing);
        for (joint, angle) in TESTED_DIGIT.ftac_joints().into_iter().zip(angles) {
            difference = difference.max((still[joint].to_degrees() - angle).abs());
        }
    }
    let monotone =
        free.angles[..count].windows(2).all(|pair| (0..3).all(|joint| pair[1][joint] > pair[0][joint] - 0.2));
    CheckRow::new(
        "free flexion of a finger",
        format!("MCP/PIP/DIP {:.0}/{:.0}/{:.0} deg", last[0], last[1], last[2]),
        "0-90 deg, coordinated",
        &format!(
            "middle finger, tension raised evenly: up to {FREE_TENSION} N, where the tip meets the palm, all joints rise together \
             (monotone) and stay within {STATIC_TOLERANCE} deg of static equilibrium with cable friction (found \
             {difference:.1}); at {MAX_TENSION} N all are past {CLOSED_FLEXION} deg"
        ),
        Verdict::from_good(monotone && difference < STATIC_TOLERANCE && last.iter().all(|angle| *angle > CLOSED_FLEXION)),
    )
    .with_details(json!({ "tension_n": free.tension, "mcp_pip_dip_deg": free.angles }))
}

/// Tests a fixed block under a phalanx: the joints beyond it must continue.
fn blocked_row(free: &FlexionPath, path: &FlexionPath, phalanx: usize, name: &str) -> CheckRow {
    let end = path.angles[path.angles.len() - 1];
    // The block is touched when the blocked joint leaves its free path.
    let met = (0..path.angles.len())
        .find(|n| (path.angles[*n][phalanx] - free.angles[*n][phalanx]).abs() > 3.0)
        .unwrap_or(path.angles.len() - 1);
    let at = path.angles[met];
    let stood = phalanx > 0 || (end[phalanx] - at[phalanx]).abs() < BLOCKED_TOLERANCE;
    let went_on = (phalanx + 1..3).all(|joint| end[joint] - at[joint] > CONTINUED_FLEXION);
    let ours = format!("{:.0}/{:.0}/{:.0} to {:.0}/{:.0}/{:.0} deg", at[0], at[1], at[2], end[0], end[1], end[2]);
    CheckRow::new(
        &format!("{name} phalanx blocked"),
        ours,
        "semi-independent",
        &format!(
            "a fixed block under the {name} phalanx: MCP/PIP/DIP at the first contact and at {MAX_TENSION} N; the joints beyond it continue by \
             more than {CONTINUED_FLEXION} deg"
        ),
        Verdict::from_good(stood && went_on && met + 1 < path.angles.len()),
    )
    .with_details(json!({ "tension_n": path.tension, "mcp_pip_dip_deg": path.angles }))
}

/// Draws angles against tension, and the finger at the end, for free closing and for each block.
fn draw(
    hand: &Hand,
    free: &FlexionPath,
    stand: &HandTestStand,
    blocked: &[(&str, FlexionPath, HandTestStand)],
    file: &Path,
) -> Result<()> {
    let follow = |joint: usize| free.angles.iter().map(|a| [a[0], a[joint]]).collect();
    let mut plots = vec![
        Plot {
            title: "free flexion: PIP and DIP over MCP".into(),
            x: "MCP [deg]".into(),
            y: "[deg]".into(),
            lines: vec![("PIP".into(), follow(1)), ("DIP".into(), follow(2))],
        }
        .draw(),
    ];
    let side = View { width: 0.18, center: nalgebra::Point3::new(0.015, 0.02, 0.0), ..View::thumb_side() };
    let mut picture = Picture::new(420, View { eye: Vector3::x(), ..side });
    picture.hand(hand, &stand.angles());
    let mut pictures = vec![picture.finish("free, 18 N: the tip is at the palm")];
    for (name, path, stand) in blocked {
        let mut all = lines(free, " free");
        all.extend(lines(path, " blocked"));
        let title = format!("{name} phalanx blocked");
        plots.push(Plot { title: title.clone(), x: "tension [N]".into(), y: "[deg]".into(), lines: all }.draw());
        let mut picture = Picture::new(420, View { eye: Vector3::x(), ..side });
        picture.stand(stand);
        pictures.push(picture.finish(&title));
    }
    plots.extend(pictures);
    save(&tile(&plots, 3), file)
}
