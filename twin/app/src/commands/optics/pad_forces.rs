//! Normal forces of pads as the images tell them, beside the physics engine's: a ball, rods and a box gripped on the test stand.

use std::sync::Arc;

use anyhow::Result;
use hand_model::Hand;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use scenarios::Shape;
use serde::Serialize;
use sim::engine::EngineSettings;
use sim::stand::{HandStand, Prop, tension_goals};
use sim::tactile::TactileBoard;
use touch::TouchPipeline;

/// Cable tensions of the grips, N.
const TENSIONS: [f64; 4] = [6.0, 12.0, 25.0, 50.0];
/// How far the thumb opposes, rad, and the time to close, s.
const OPPOSITION: f64 = 1.0;
const CLOSE: f64 = 2.0;
/// Hand unit, as in trials.
const UNIT: u64 = 7;
/// Forces below this are left out, N: the simulated board leaves such pads idle.
const LEAST: f64 = 0.02;

/// One pad in one grip.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// What is gripped.
    pub object: &'static str,
    /// Cable tension, N.
    pub tension: f64,
    /// The pad.
    pub pad: String,
    /// Normal force by the physics engine, N.
    pub engine: f64,
    /// Normal force by the image, N.
    pub image: f64,
}

/// All rows in one line.
#[derive(Debug, Clone, Serialize)]
pub struct Agreement {
    /// Loaded pads.
    pub pads: usize,
    /// Loaded pads that feel nothing.
    pub unfelt: usize,
    /// Median of image over engine, of those that feel something.
    pub median_ratio: f64,
    /// Median of the difference's size over the engine's force.
    pub median_relative_error: f64,
    /// Correlation of both forces.
    pub correlation: f64,
}

/// Grips everything and measures.
pub fn rows() -> Result<Vec<Row>> {
    let hand = Arc::new(Hand::ftac());
    let board = TactileBoard::unit(&hand, UNIT);
    let calibration = bench::builtin::builtin_calibration()?;
    let touch = TouchPipeline::new(&hand, calibration, board.backgrounds())?;
    let objects = [
        ("ball 50 mm", Shape::Sphere { radius: 0.025 }, 0.025),
        ("rod 30 mm", Shape::Cylinder { radius: 0.015, half_height: 0.06 }, 0.015),
        ("rod 50 mm", Shape::Cylinder { radius: 0.025, half_height: 0.06 }, 0.025),
        ("box 40 mm", Shape::Cuboid { half: Vector3::new(0.02, 0.02, 0.05), radius: 0.002 }, 0.02),
    ];
    let mut rows = Vec::new();
    for (object, shape, half) in objects {
        for tension in TENSIONS {
            rows.extend(grip(&hand, &board, &touch, object, &shape, half, tension)?);
        }
    }
    Ok(rows)
}

fn grip(
    hand: &Arc<Hand>,
    board: &TactileBoard,
    touch: &TouchPipeline,
    object: &'static str,
    shape: &Shape,
    half: f64,
    tension: f64,
) -> Result<Vec<Row>> {
    let mut stand = HandStand::new(hand.clone(), EngineSettings::default());
    let across = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::FRAC_PI_2);
    // Just clear of the palm, over the finger bases.
    let skin = hand.palm_cover.link_from_cover.translation.z - hand.palm_cover.half.z;
    let place = Isometry3::from_parts(Vector3::new(0.0, -0.008, skin - half - 0.0005).into(), across);
    let prop = stand.put(Prop::new(object, shape.clone(), 0.3, 0.8), &place);
    stand.run(&tension_goals(hand, &[0.0; 5], OPPOSITION), 0.5);
    stand.run(&tension_goals(hand, &[tension; 5], OPPOSITION), CLOSE);
    let links = stand.links();
    let pads: Vec<Isometry3<f64>> = hand
        .pads
        .iter()
        .map(|pad| pad.link.map_or(Isometry3::identity(), |link| links[link]) * pad.link_from_pad)
        .collect();
    let mut forces = vec![0.0; pads.len()];
    for contact in stand.contacts() {
        // As the simulated robot has it: on the pad's surface, and from outside.
        let outward = contact.force.normalize();
        let on = hand.pads.iter().zip(&pads).position(|(pad, palm_from_pad)| {
            let local = palm_from_pad.inverse_transform_point(&contact.point);
            let inside = local.x.abs() < 0.5 * pad.w && local.y.abs() < 0.5 * pad.h;
            pad.link == contact.link && inside && palm_from_pad.inverse_transform_vector(&outward).z > 0.4
        });
        if let Some(pad) = on {
            forces[pad] += contact.force.norm();
        }
    }
    let frames = board.clone().capture(hand, stand.time(), &pads, &forces, &[(shape, stand.pose(prop))]);
    let images: Vec<_> = frames.into_iter().map(|frame| frame.image).collect();
    let felt = touch.perceive(&images)?;
    let loaded = felt.iter().filter(|felt| forces[felt.pad] >= LEAST);
    Ok(loaded
        .map(|felt| Row {
            object,
            tension,
            pad: hand.pads[felt.pad].name.clone(),
            engine: forces[felt.pad],
            image: felt.force,
        })
        .collect())
}

/// How well both agree; `None` without rows.
pub fn agreement(rows: &[Row]) -> Option<Agreement> {
    let median = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied()
    };
    let felt: Vec<&Row> = rows.iter().filter(|row| row.image > 0.0).collect();
    let n = rows.len() as f64;
    let (mx, my) =
        (rows.iter().map(|row| row.engine).sum::<f64>() / n, rows.iter().map(|row| row.image).sum::<f64>() / n);
    let (xx, xy, yy) = rows
        .iter()
        .map(|row| (row.engine - mx, row.image - my))
        .fold((0.0, 0.0, 0.0), |sum, (x, y)| (sum.0 + x * x, sum.1 + x * y, sum.2 + y * y));
    Some(Agreement {
        pads: rows.len(),
        unfelt: rows.len() - felt.len(),
        median_ratio: median(felt.iter().map(|row| row.image / row.engine).collect())?,
        median_relative_error: median(rows.iter().map(|row| (row.image / row.engine - 1.0).abs()).collect())?,
        correlation: xy / (xx * yy).sqrt(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agreement_of_a_known_table() {
        let row = |engine: f64, image: f64| Row { object: "", tension: 0.0, pad: String::new(), engine, image };
        let found = agreement(&[row(1.0, 1.1), row(2.0, 2.2), row(3.0, 3.3), row(1.0, 0.0)]).unwrap();
        assert_eq!((found.pads, found.unfelt), (4, 1));
        assert!((found.median_ratio - 1.1).abs() < 1e-12 && (found.median_relative_error - 0.1).abs() < 1e-9);
        assert!(found.correlation > 0.9 && agreement(&[]).is_none());
    }
}
