//! The side door by which objects are put elsewhere, fastened or replaced while the robot goes on: what a person does at the table.
//!
//! Like the truth it is on the concrete type alone: no controller that holds a [`hand_model::robot::RobotBackend`] can reach it.

use std::sync::Arc;

use nalgebra::Isometry3;
use rapier3d_f64::prelude::*;
use world::objects::ObjectModel;

use super::{ObjectPlacement, SimulatedRobot};
use crate::convert;
use crate::scene::insert_object;

impl SimulatedRobot {
    /// Object `index` stays where it is from now on, whatever pushes it: a ring or a drop of glue keeps it there.
    pub fn fasten(&mut self, index: usize) {
        self.engine.bodies[self.objects[index].1].set_body_type(RigidBodyType::Fixed, true);
    }

    /// Object `index` moves freely again.
    pub fn release(&mut self, index: usize) {
        self.engine.bodies[self.objects[index].1].set_body_type(RigidBodyType::Dynamic, true);
    }

    /// Object `index` is put at `world_from_object`, at rest.
    pub fn put(&mut self, index: usize, world_from_object: &Isometry3<f64>) {
        let body = &mut self.engine.bodies[self.objects[index].1];
        body.set_position(convert::pose(world_from_object), true);
        body.set_linvel(Vector::ZERO, true);
        body.set_angvel(Vector::ZERO, true);
    }

    /// All objects are taken away, and these are put on the table.
    pub fn replace_objects(&mut self, placements: &[ObjectPlacement]) {
        for (_, body, _) in std::mem::take(&mut self.objects) {
            self.engine.remove(body);
        }
        self.objects = placements.iter().map(|placement| insert_object(&mut self.engine, placement)).collect();
        if let Some(covers) = &mut self.engine.soft_covers {
            let pressers: Vec<(ColliderHandle, Arc<ObjectModel>)> =
                self.objects.iter().map(|(model, _, collider)| (*collider, model.clone())).collect();
            covers.replace_objects(pressers.into_iter());
        }
        self.touched_by = vec![0; self.objects.len()];
        self.on_table = vec![false; self.objects.len()];
        self.object_pairs.clear();
    }
}
