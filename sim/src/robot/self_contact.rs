//! Self-contact: loads of the hand and of the table on the hand's own pads, from the engine's contacts between covers,
//! and between covers and table.
//!
//! The engine lets any two covers touch that no joint connects: fingers each other, the thumb fingers and palm, and a
//! finger's middle and distal links the palm; not a first link and the palm, nor neighbours along a digit.

use hand_model::hand::CoverShape;
use nalgebra::{Isometry3, Vector3};
use world::geometry::ObjectShape;
use world::physics::{Physics, TablePhysics};

use super::SimulatedRobot;
use crate::contacts::{contacts_of, normal_force};
use crate::tactile::SelfLoad;

/// Returns the rounded box of a cover.
fn cover_shape(cover: &CoverShape) -> ObjectShape {
    ObjectShape::Cuboid { half: cover.half, radius: cover.radius }
}

/// Returns the table and `world_from_table`.
fn table_shape() -> (ObjectShape, Isometry3<f64>) {
    let TablePhysics { center, half, .. } = Physics::standard().table;
    (
        ObjectShape::Cuboid { half: Vector3::from(half), radius: 0.0 },
        Isometry3::translation(center[0], center[1], center[2]),
    )
}

impl SimulatedRobot {
    /// Returns the present force of hand and wrist on the table, N: ground truth.
    pub fn force_on_table(&self) -> f64 {
        let parts = self.body.covers.iter().chain(&self.body.wrist);
        parts.map(|part| normal_force(&self.engine, *part, self.table)).sum()
    }

    /// Returns the present loads of the hand and the table on the pads: ground truth. Empty if the scene's pads feel
    /// objects only.
    pub fn self_loads(&self) -> Vec<SelfLoad> {
        let mut loads: Vec<(usize, Option<usize>, f64)> = Vec::new();
        if !self.self_contact {
            return Vec::new();
        }
        let links = self.body.link_poses(&self.engine);
        let palm = self.palm(&links);
        let covers = &self.body.covers;
        for (cover, collider) in covers.iter().enumerate() {
            for contact in contacts_of(&self.engine, *collider) {
                let other = covers.iter().position(|other| *other == contact.other);
                if other.is_none() && contact.other != self.table {
                    continue;
                }
                // As for an object, the normal points away from what presses into the pad.
                let inward = -contact.normal;
                let Some(pad) = self.pad_at(cover.checked_sub(1), &contact.point, &inward, &links, &palm) else {
                    continue;
                };
                match loads.iter_mut().find(|load| (load.0, load.1) == (pad, other)) {
                    Some(load) => load.2 += contact.force,
                    None => loads.push((pad, other, contact.force)),
                }
            }
        }
        let load = |(pad, other, force): (usize, Option<usize>, f64)| {
            let (shape, pose) = match other {
                None => table_shape(),
                Some(0) => (cover_shape(&self.hand.palm_cover), palm * self.hand.palm_cover.link_from_cover),
                Some(cover) => {
                    let shape = &self.hand.covers[cover - 1];
                    (cover_shape(shape), links[self.arm.joints() + cover - 1] * shape.link_from_cover)
                }
            };
            SelfLoad { pad, force, shape, pose }
        };
        loads.into_iter().map(load).collect()
    }
}
