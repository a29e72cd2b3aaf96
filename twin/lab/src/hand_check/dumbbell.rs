//! Payload test: a dumbbell of 2.5 kg held for ten seconds.
//!
//! It is taken from a rack. The fingers close on the bar, and while the rack still carries the weight, the hand grips
//! hard a few times. Each time bar and phalanges come closer to the rest position that cables, joint stops and friction
//! allow. Otherwise they would get there under load, and the settling of the bar into the hand would be measured as
//! slip.

use std::path::Path;
use std::sync::Arc;

use anyhow::Result;
use hand_model::{DigitVector, Hand};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use rayon::prelude::*;
use report::picture::{Picture, View, save, tile};
use serde_json::json;
use sim::engine::EngineSettings;
use sim::test_stand::{HandTestStand, Prop, tension_goals};

use super::row::{CheckRow, Verdict};

/// Mass of the dumbbell, kg.
const DUMBBELL_MASS: f64 = 2.5;
/// Size, m: radius and length of the handle, radius and length of each weight.
const DUMBBELL_SIZE: [f64; 4] = [0.016, 0.120, 0.045, 0.045];
/// Tolerance on slip of a hold, m.
const SLIP_TOLERANCE: f64 = 0.002;
/// Time of the hold, s.
const HOLD_TIME: f64 = 10.0;
/// Time for the grip to take up the load before slip is measured, s.
const SETTLING_TIME: f64 = 1.0;
/// Tension of the four fingers' cables, N; the thumb stays open, clear of the weights.
const GRIP_TENSION: f64 = 60.0;
/// Pulses of a hard grip: tension, N (0.83 A of the 0.91 A that a servo may draw), number, and length, s. The pause
/// after each is as long.
const HARD_GRIP_TENSION: f64 = 100.0;
const HARD_GRIP_COUNT: usize = 6;
const HARD_GRIP_TIME: f64 = 0.5;
/// Times, s: first closing around the held bar, and rest once the rack carries only the weight.
const CLOSING_TIME: f64 = 1.5;
const REST_TIME: f64 = 1.0;
/// Position (x, y) of the bar under the knuckles, palm frame, m.
const BAR_POSITION: [f64; 2] = [0.0026, 0.013];

/// Returns the pose of the handle on the open hand.
pub fn handle_pose(hand: &Hand) -> Isometry3<f64> {
    let skin = hand.palm_cover.link_from_cover.translation.z - hand.palm_cover.half.z;
    let across = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::FRAC_PI_2);
    Isometry3::from_parts(
        Vector3::new(BAR_POSITION[0], BAR_POSITION[1], skin - DUMBBELL_SIZE[0] - 0.0005).into(),
        across,
    )
}

pub fn dumbbell_prop() -> Prop {
    Prop::dumbbell(DUMBBELL_SIZE[0], DUMBBELL_SIZE[1], DUMBBELL_SIZE[2], DUMBBELL_SIZE[3], DUMBBELL_MASS)
}

/// Returns the tensions of the grip, N.
pub fn tensions() -> DigitVector {
    fingers(GRIP_TENSION)
}

fn fingers(tension: f64) -> DigitVector {
    [0.0, tension, tension, tension, tension].into()
}

/// Returns the sequence of tensions (N), each with its time (s), from the release of the bar until the weight acts.
pub fn grip_sequence() -> Vec<(DigitVector, f64)> {
    let beats = std::iter::repeat_n(
        [(fingers(HARD_GRIP_TENSION), HARD_GRIP_TIME), (tensions(), HARD_GRIP_TIME)],
        HARD_GRIP_COUNT,
    )
    .flatten();
    std::iter::once((tensions(), REST_TIME)).chain(beats).collect()
}

/// Closes on the held dumbbell, releases it, grips hard, and applies its weight along `down` (palm frame). Returns the
/// stand and the slip (m) over ten seconds after settling.
fn hold(hand: &Arc<Hand>, down: &Vector3<f64>) -> (HandTestStand, f64) {
    let mut stand = HandTestStand::new(hand.clone(), EngineSettings::default());
    let bell = stand.add_prop(dumbbell_prop(), &handle_pose(hand));
    let goals = tension_goals(hand, &tensions(), 0.0);
    stand.run(&goals, CLOSING_TIME);
    stand.release_prop(bell);
    for (tensions, seconds) in grip_sequence() {
        stand.run(&tension_goals(hand, &tensions, 0.0), seconds);
    }
    stand.set_gravity(&(down * 9.81));
    stand.run(&goals, SETTLING_TIME);
    let before = stand.prop_pose(bell);
    let mut slip = 0.0f64;
    for _ in 0..(HOLD_TIME / 0.05) as usize {
        stand.run(&goals, 0.05);
        slip = slip.max((stand.prop_pose(bell).translation.vector - before.translation.vector).norm());
    }
    (stand, slip)
}

pub fn row(hand: &Arc<Hand>, out: Option<&Path>) -> Result<CheckRow> {
    let ways = [
        ("fingers down", Vector3::y()),
        ("palm down", -Vector3::z()),
        ("palm up", Vector3::z()),
        ("fingers up", -Vector3::y()),
        ("thumb down", Vector3::x()),
        ("thumb up", -Vector3::x()),
    ];
    let held: Vec<(HandTestStand, f64)> = ways.par_iter().map(|(_, down)| hold(hand, down)).collect();
    let text = |slip: f64| if slip < 0.05 { format!("{:.2} mm", slip * 1e3) } else { "dropped".to_string() };
    // The row is for the hanging arm, as in carrying a dumbbell; the other directions are reported too.
    let main = held[0].1;
    let all: serde_json::Map<String, serde_json::Value> =
        ways.iter().zip(&held).map(|((name, _), (_, slip))| (name.to_string(), json!(slip * 1e3))).collect();
    let count = held.iter().filter(|(_, slip)| *slip < SLIP_TOLERANCE).count();
    let amperes = hand.parameters.cable.spool_radius / hand.parameters.servo.torque_constant;
    let mut row = CheckRow::new(
        "2.5 kg dumbbell held 10 s",
        format!("slip {}", text(main)),
        "holds a 2.5 kg dumbbell",
        &format!(
            "on a rack, four fingers closed with {GRIP_TENSION} N in each cable, gripped {HARD_GRIP_COUNT} times with {HARD_GRIP_TENSION} N, then the weight, \
             fingers down; slip after 1 s of settling; below 2 mm. Of six directions of gravity {count} hold within this limit: {}",
            ways.iter().zip(&held).map(|((name, _), (_, slip))| format!("{name} {}", text(*slip))).collect::<Vec<_>>().join(", ")
        ),
        Verdict::from_good(main < SLIP_TOLERANCE),
    )
    .with_details(json!({ "slip_mm": all, "current_a": GRIP_TENSION * amperes, "hard_current_a": HARD_GRIP_TENSION * amperes }));
    if let Some(folder) = out {
        let pictures: Vec<_> = ways
            .iter()
            .zip(&held)
            .map(|((name, down), (stand, slip))| {
                let view = if down.z != 0.0 { View::thumb_side() } else { View::palm() };
                let mut picture = Picture::new(320, view.recentered(Point3::new(0.0, -0.02, -0.01), 0.27));
                picture.stand(stand);
                picture.finish(&format!("{name}: slip {}", text(*slip)))
            })
            .collect();
        save(&tile(&pictures, 3), &folder.join("dumbbell.png"))?;
        row.picture = Some("dumbbell.png".into());
    }
    Ok(row)
}
