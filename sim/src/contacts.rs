//! Contact pairs with contact points and forces, read from the solver's manifolds.

use nalgebra::{Point3, Vector3};
use rapier3d_f64::prelude::*;

use crate::engine::Engine;
use crate::loaded_contacts::loaded_points;

/// One contact point of a collider.
#[derive(Debug, Clone, Copy)]
pub struct ContactPoint {
    /// The collider on the other side.
    pub other: ColliderHandle,
    /// Contact point, world, m.
    pub point: Point3<f64>,
    /// Unit normal from this collider to the other.
    pub normal: Vector3<f64>,
    /// Normal force, N.
    pub force: f64,
}

/// Returns all loaded contact points of `collider`.
pub fn contacts_of(engine: &Engine, collider: ColliderHandle) -> Vec<ContactPoint> {
    let dt = engine.settings.dt;
    let mut found = Vec::new();
    for pair in engine.narrow_phase.contact_pairs_with(collider) {
        let first = pair.collider1 == collider;
        let other = if first { pair.collider2 } else { pair.collider1 };
        found.extend(loaded_points(pair, &engine.bodies).map(|at| ContactPoint {
            other,
            point: at.point.into(),
            normal: at.normal * if first { 1.0 } else { -1.0 },
            force: at.data.impulse / dt,
        }));
    }
    found
}

/// Sums the normal forces between two colliders, N.
pub fn normal_force(engine: &Engine, one: ColliderHandle, other: ColliderHandle) -> f64 {
    let Some(pair) = engine.narrow_phase.contact_pair(one, other) else { return 0.0 };
    let impulses = pair.solver_manifolds().iter().flat_map(|manifold| &manifold.points).map(|point| point.data.impulse);
    impulses.sum::<f64>() / engine.settings.dt
}
