//! Normal forces of pads estimated from their images, compared with the physics engine's: a ball, rods and a box
//! gripped on the test stand.

use std::sync::Arc;

use anyhow::Result;
use hand_model::Hand;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use schemars::JsonSchema;
use serde::Serialize;
use sim::engine::EngineSettings;
use sim::tactile::TactileBoard;
use sim::test_stand::{HandTestStand, Prop, tension_goals};
use tactile_perception::{PhotometricCalibration, TouchPipeline};
use world::ObjectShape;

/// Cable tensions of the grips, N.
const TENSIONS: [f64; 4] = [6.0, 12.0, 25.0, 50.0];
/// Opposition angle of the thumb, rad, and time to close, s.
const OPPOSITION_ANGLE: f64 = 1.0;
const CLOSING_TIME: f64 = 2.0;
/// Serial number of the hand unit, as in trials.
const HAND_UNIT: u64 = 7;
/// Minimum force, N. Smaller ones are left out, because the simulated board leaves such pads idle.
const MIN_FORCE: f64 = 0.02;

/// Force on one pad in one grip.
#[derive(Debug, Clone, Serialize, JsonSchema)]
pub struct PadForce {
    /// Name of the gripped object.
    pub object: &'static str,
    /// Cable tension, N.
    pub tension: f64,
    pub pad: String,
    /// Normal force from the physics engine, N.
    pub engine: f64,
    /// Normal force estimated from the image, N.
    pub image: f64,
}

/// Agreement of both forces over all grips.
#[derive(Debug, Clone, Serialize, JsonSchema)]
pub struct Agreement {
    pub pads: usize,
    /// Loaded pads without a touch in their image.
    pub unfelt: usize,
    /// Median ratio of image force to engine force, over the pads with a touch.
    pub median_ratio: f64,
    /// Median relative error: absolute difference over the engine's force.
    pub median_relative_error: f64,
    /// Correlation of both forces.
    pub correlation: f64,
}

struct GrippedObject {
    name: &'static str,
    shape: ObjectShape,
    /// Half of the object's height above the palm, m.
    half: f64,
}

/// Setup: the hand on the test stand, its simulated cameras, and the pipeline that reads them.
struct GripSetup {
    hand: Arc<Hand>,
    board: TactileBoard,
    touch: TouchPipeline,
}

/// Grips every object at every tension, and estimates forces with `calibration`.
pub fn grip_all(hand: &Arc<Hand>, calibration: PhotometricCalibration) -> Result<Vec<PadForce>> {
    let hand = hand.clone();
    let board = TactileBoard::unit(&hand, HAND_UNIT);
    let touch = TouchPipeline::new(&hand, calibration, board.backgrounds())?;
    let grips = GripSetup { hand, board, touch };
    let block = ObjectShape::Cuboid { half: Vector3::new(0.02, 0.02, 0.05), radius: 0.002 };
    let objects = [
        GrippedObject { name: "ball 50 mm", shape: ObjectShape::Sphere { radius: 0.025 }, half: 0.025 },
        GrippedObject {
            name: "rod 30 mm",
            shape: ObjectShape::Cylinder { radius: 0.015, half_height: 0.06 },
            half: 0.015,
        },
        GrippedObject {
            name: "rod 50 mm",
            shape: ObjectShape::Cylinder { radius: 0.025, half_height: 0.06 },
            half: 0.025,
        },
        GrippedObject { name: "box 40 mm", shape: block, half: 0.02 },
    ];
    let mut rows = Vec::new();
    for object in &objects {
        for tension in TENSIONS {
            rows.extend(grips.grip(object, tension)?);
        }
    }
    Ok(rows)
}

impl GripSetup {
    fn grip(&self, object: &GrippedObject, tension: f64) -> Result<Vec<PadForce>> {
        let hand = &self.hand;
        let mut stand = HandTestStand::new(hand.clone(), EngineSettings::default());
        let across = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::FRAC_PI_2);
        // Just clear of the palm, over the finger bases.
        let skin = hand.palm_cover.link_from_cover.translation.z - hand.palm_cover.half.z;
        let place = Isometry3::from_parts(Vector3::new(0.0, -0.008, skin - object.half - 0.0005).into(), across);
        let prop = stand.add_prop(Prop::new(object.name, object.shape.clone(), 0.3, 0.8), &place);
        stand.run(&tension_goals(hand, &[0.0; 5], OPPOSITION_ANGLE), 0.5);
        stand.run(&tension_goals(hand, &[tension; 5], OPPOSITION_ANGLE), CLOSING_TIME);
        let links = stand.links();
        let pads: Vec<Isometry3<f64>> = hand
            .pads
            .iter()
            .map(|pad| pad.link.map_or(Isometry3::identity(), |link| links[link]) * pad.link_from_pad)
            .collect();
        let forces = pad_loads(hand, &stand, &pads);
        let frames =
            self.board.clone().capture(hand, stand.time(), &pads, &forces, &[(&object.shape, stand.prop_pose(prop))]);
        let images: Vec<_> = frames.into_iter().map(|frame| frame.image).collect();
        let felt = self.touch.perceive(&images)?;
        let loaded = felt.iter().filter(|felt| forces[felt.pad] >= MIN_FORCE);
        Ok(loaded
            .map(|felt| PadForce {
                object: object.name,
                tension,
                pad: hand.pads[felt.pad].name.clone(),
                engine: forces[felt.pad],
                image: felt.force,
            })
            .collect())
    }
}

/// Sums the engine's contact forces over each pad, N; `pads` are the pads' poses in the palm frame.
fn pad_loads(hand: &Hand, stand: &HandTestStand, pads: &[Isometry3<f64>]) -> Vec<f64> {
    let mut forces = vec![0.0; pads.len()];
    for contact in stand.contacts() {
        // As in the simulated robot: a contact counts if it is on the pad's surface and pushes from outside.
        let outward = contact.force.normalize();
        let on = hand.pads.iter().zip(pads).position(|(pad, palm_from_pad)| {
            let local = palm_from_pad.inverse_transform_point(&contact.point);
            let inside = local.x.abs() < 0.5 * pad.w && local.y.abs() < 0.5 * pad.h;
            pad.link == contact.link && inside && palm_from_pad.inverse_transform_vector(&outward).z > 0.4
        });
        if let Some(pad) = on {
            forces[pad] += contact.force.norm();
        }
    }
    forces
}

/// Formats every pad of every grip, one line each, and the agreement.
pub fn table(rows: &[PadForce], all: &Agreement) -> String {
    let mut text = format!("{:12} {:>9} {:20} {:>9} {:>9}\n", "object", "tension N", "pad", "engine N", "image N");
    for row in rows {
        text += &format!("{:12} {:9.0} {:20} {:9.2} {:9.2}\n", row.object, row.tension, row.pad, row.engine, row.image);
    }
    text += &format!(
        "{} loaded pads, {} without a detected touch; image over engine {:.2} (median), error {:.0} % (median), correlation {:.3}\n",
        all.pads,
        all.unfelt,
        all.median_ratio,
        100.0 * all.median_relative_error,
        all.correlation
    );
    text
}

/// Computes the agreement of both forces; `None` without rows.
pub fn agreement(rows: &[PadForce]) -> Option<Agreement> {
    let median = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied()
    };
    let felt: Vec<&PadForce> = rows.iter().filter(|row| row.image > 0.0).collect();
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
        let row = |engine: f64, image: f64| PadForce { object: "", tension: 0.0, pad: String::new(), engine, image };
        let found = agreement(&[row(1.0, 1.1), row(2.0, 2.2), row(3.0, 3.3), row(1.0, 0.0)]).unwrap();
        assert_eq!((found.pads, found.unfelt), (4, 1));
        assert!((found.median_ratio - 1.1).abs() < 1e-12 && (found.median_relative_error - 0.1).abs() < 1e-9);
        assert!(found.correlation > 0.9 && agreement(&[]).is_none());
    }
}
