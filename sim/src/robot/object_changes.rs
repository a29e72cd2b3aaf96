//! Interface by which objects are moved, fixed or replaced while the robot runs, as a person at the table would do.
//!
//! Like the ground truth, it is available on the concrete type alone: no controller that holds a
//! [`hand_model::robot::RobotBackend`] can reach it.

use std::sync::Arc;

use nalgebra::Isometry3;
use rapier3d_f64::prelude::*;
use world::objects::ObjectModel;

use super::{ObjectPlacement, SimulatedRobot};
use crate::convert;
use crate::scene::insert_object;

impl SimulatedRobot {
    /// Fixes object `index` in place from now on, like a ring or a drop of glue would.
    pub fn fix_object(&mut self, index: usize) {
        self.engine.bodies[self.objects[index].1].set_body_type(RigidBodyType::Fixed, true);
    }

    /// Releases object `index` to move freely again.
    pub fn release_object(&mut self, index: usize) {
        self.engine.bodies[self.objects[index].1].set_body_type(RigidBodyType::Dynamic, true);
    }

    /// Puts object `index` at `world_from_object`, at rest.
    pub fn set_object_pose(&mut self, index: usize, world_from_object: &Isometry3<f64>) {
        let body = &mut self.engine.bodies[self.objects[index].1];
        body.set_position(convert::pose(world_from_object), true);
        body.set_linvel(Vector::ZERO, true);
        body.set_angvel(Vector::ZERO, true);
    }

    /// Removes all objects and puts these on the table.
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
