//! Surface of a hand's links as given by its files, in addition to the convex parts that represent it in collisions.

use hand_model::hand_mechanism::HandMechanism;
use nalgebra::{Isometry3, Point3};
use world::geometry::{ObjectShape, TriangleSurface};

use super::solids::{LinkShapes, link_number};

/// Surfaces by link (0 is the root).
pub struct TrueSurfaces(Vec<LinkSurface>);

#[derive(Default)]
struct LinkSurface {
    /// Meshes with `link_from_mesh`.
    meshes: Vec<(Isometry3<f64>, TriangleSurface)>,
    /// Boxes, spheres and cylinders, which are their own surface, with `link_from_shape`.
    simple: Vec<(Isometry3<f64>, ObjectShape)>,
}

impl TrueSurfaces {
    /// Collects the surfaces of a hand whose collision shapes are `shapes`.
    pub fn new(hand: &HandMechanism, shapes: &LinkShapes) -> Self {
        let mut found: Vec<LinkSurface> = Vec::new();
        found.resize_with(hand.tree.len() + 1, LinkSurface::default);
        for own in &hand.surfaces {
            let surface = TriangleSurface::new(&own.triangles.0, &own.triangles.1);
            found[link_number(own.link)].meshes.extend(surface.map(|surface| (own.link_from_mesh, surface)));
        }
        for (link, parts) in shapes.iter().enumerate() {
            let simple = parts.iter().filter(|part| !part.of_mesh);
            found[link].simple = simple.map(|part| (part.pose, part.shape.clone())).collect();
        }
        Self(found)
    }

    /// Returns the point of a link's surface nearest to `point`, both in the link's frame. For a link without a mesh,
    /// the collision shape counts and `point` is returned.
    pub fn nearest(&self, link: usize, point: &Point3<f64>) -> Point3<f64> {
        let own = &self.0[link];
        if own.meshes.is_empty() {
            return *point;
        }
        let on_mesh =
            own.meshes.iter().map(|(pose, surface)| pose * surface.nearest(&pose.inverse_transform_point(point)));
        let on_simple = own.simple.iter().map(|(pose, shape)| {
            let local = pose.inverse_transform_point(point);
            let (distance, outward) = shape.signed_distance(&local);
            pose * (local - outward * distance)
        });
        let far = |at: &Point3<f64>| (at - point).norm();
        on_mesh.chain(on_simple).min_by(|a, b| far(a).total_cmp(&far(b))).unwrap_or(*point)
    }
}
