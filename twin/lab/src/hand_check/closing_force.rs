//! Closing force of the digits on a rigid rod: force of each phalanx at rated current, and their sum against the
//! current.

use std::path::Path;
use std::sync::Arc;

use anyhow::Result;
use hand_model::{Digit, Hand};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use report::picture::{Picture, View, save, tile};
use report::plot::Plot;
use serde_json::json;
use sim::engine::EngineSettings;
use sim::test_stand::{HandTestStand, Prop, tension_goals};
use world::ObjectShape;

use super::row::{CheckRow, Verdict};

/// Total force in the paper, N.
const PAPER_FORCE: f64 = 10.3;
/// Rated torque over stall torque: recommendation of makers of small geared servos for continuous load.
const RATED_SHARE: f64 = 0.2;
/// Size of the rod: radius and half length, m.
const ROD_SIZE: (f64, f64) = (0.025, 0.06);
/// Opposition angle of the thumb, rad.
const OPPOSITION_ANGLE: f64 = 1.0;
/// Time to close, s.
const CLOSING_TIME: f64 = 3.0;

/// Closes all digits at a cable tension (N). Returns the stand and the normal force of each link on the rod, palm last,
/// N.
fn close(hand: &Arc<Hand>, tension: f64) -> (HandTestStand, [f64; 16]) {
    let mut stand = HandTestStand::new(hand.clone(), EngineSettings::default());
    let rod = Prop::new("rod", ObjectShape::Cylinder { radius: ROD_SIZE.0, half_height: ROD_SIZE.1 }, 0.3, 0.8);
    let across = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::FRAC_PI_2);
    // Just clear of the palm, over the finger bases.
    let skin = hand.palm_cover.link_from_cover.translation.z - hand.palm_cover.half.z;
    let place = Isometry3::from_parts(Vector3::new(0.0, -0.008, skin - ROD_SIZE.0 - 0.0005).into(), across);
    stand.add_prop(rod, &place);
    stand.run(&tension_goals(hand, &[0.0; 5], OPPOSITION_ANGLE), 0.5);
    stand.run(&tension_goals(hand, &[tension; 5], OPPOSITION_ANGLE), CLOSING_TIME);
    let mut forces = [0.0; 16];
    for contact in stand.contacts() {
        forces[contact.link.unwrap_or(15)] += contact.force.norm();
    }
    (stand, forces)
}

pub fn rows(hand: &Arc<Hand>, out: Option<&Path>) -> Result<Vec<CheckRow>> {
    let servo = hand.parameters.servo;
    let rated = RATED_SHARE * servo.stall_torque;
    let tension = |torque: f64| torque / hand.parameters.cable.spool_radius;
    let (stand, forces) = close(hand, tension(rated));
    let total: f64 = forces[..15].iter().sum();
    let touching = forces[..15].iter().filter(|force| **force > 0.05).count();
    let shares = [0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 2.5];
    let curve: Vec<[f64; 2]> = shares
        .iter()
        .map(|share| {
            let torque = share * rated;
            [torque / servo.torque_constant, close(hand, tension(torque)).1[..15].iter().sum()]
        })
        .collect();
    let needed = curve.windows(2).find(|pair| pair[0][1] < PAPER_FORCE && pair[1][1] >= PAPER_FORCE).map(|pair| {
        let part = (PAPER_FORCE - pair[0][1]) / (pair[1][1] - pair[0][1]);
        pair[0][0] + part * (pair[1][0] - pair[0][0])
    });
    let mut by_phalanx = serde_json::Map::new();
    for (joint, force) in hand.tree.joints.iter().zip(&forces) {
        by_phalanx.insert(joint.name.clone(), json!(force));
    }
    by_phalanx.insert("palm".into(), json!(forces[15]));
    let current = rated / servo.torque_constant;
    let mut row = CheckRow::new(
        "closing force, sum of phalanges",
        format!("{total:.1} N at {:.0} mA", current * 1e3),
        "10.3 N",
        &format!(
            "normal forces of all phalanges on a fixed rod of 50 mm, all five cables at rated torque (a fifth of stall, {:.1} N of \
             tension); at least 10.3 N{}",
            tension(rated),
            needed.map_or(String::new(), |amps| format!("; ours reaches 10.3 N at {:.0} mA", amps * 1e3))
        ),
        Verdict::from_good(total >= PAPER_FORCE),
    )
    .with_details(json!({ "forces_n": by_phalanx, "sum_over_current_a_n": curve, "phalanges_touching": touching }));
    if let Some(folder) = out {
        let caption = |digit: Digit| {
            let [a, b, c] = digit.ftac_joints().map(|joint| forces[joint]);
            format!("{:7} {a:5.1} {b:5.1} {c:5.1} N", digit.name())
        };
        let lines: Vec<String> = Digit::ALL.into_iter().map(caption).collect();
        let mut first = Picture::new(480, View::thumb_side());
        first.stand(&stand);
        let mut second = Picture::new(480, View::palm().recentered(Point3::new(0.01, -0.02, 0.0), 0.20));
        second.stand(&stand);
        for contact in stand.contacts() {
            second.dot(&contact.point, 0.001, [200.0, 30.0, 30.0]);
        }
        let pictures = [
            first.finish(&format!("rated current, proximal to distal:\n{}", lines.join("\n"))),
            second.finish(&format!("sum {total:.1} N; red: contacts")),
        ];
        save(&tile(&pictures, 2), &folder.join("closing_force.png"))?;
        let plot = Plot {
            title: "sum of the phalanges' forces on a 50 mm rod".into(),
            x: "servo current [A], all five".into(),
            y: "[N]".into(),
            lines: vec![
                ("ours".into(), curve.clone()),
                ("paper".into(), curve.iter().map(|p| [p[0], PAPER_FORCE]).collect()),
            ],
        };
        save(&plot.draw(), &folder.join("closing_force_curve.png"))?;
        row.picture = Some("closing_force.png".into());
    }
    Ok(vec![row])
}
