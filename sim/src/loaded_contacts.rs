//! Loaded contact points, read from the manifolds of a contact pair.

use nalgebra::Vector3;
use rapier3d_f64::prelude::*;

use crate::convert;

/// A loaded contact point.
pub(crate) struct LoadedPoint<'a> {
    /// Contact point, world, m.
    pub point: Vector3<f64>,
    /// Unit normal out of the pair's first collider, world.
    pub normal: Vector3<f64>,
    /// The solver's result; impulses in N s.
    pub data: &'a ContactData,
}

/// Iterates over the loaded contact points of a pair.
pub(crate) fn loaded_points<'a>(
    pair: &'a ContactPair,
    bodies: &'a RigidBodySet,
) -> impl Iterator<Item = LoadedPoint<'a>> {
    pair.solver_manifolds().iter().flat_map(move |manifold| {
        let normal = convert::to_vector(manifold.data.normal);
        manifold.data.solver_contacts.iter().filter_map(move |contact| {
            let point = manifold.points.get(contact.contact_indices()[0] as usize)?;
            let (a, b) = manifold.data.solver_contact_world_points(contact, bodies);
            let middle = (convert::to_vector(a) + convert::to_vector(b)) * 0.5;
            (point.data.impulse > 0.0).then_some(LoadedPoint { point: middle, normal, data: &point.data })
        })
    })
}
