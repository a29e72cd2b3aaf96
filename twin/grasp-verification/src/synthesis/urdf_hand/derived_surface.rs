//! Surface and palm of a hand, derived from its files.

use nalgebra::Point3;

use super::solids::{LinkPart, link_number};
use super::true_surface::TrueSurfaces;

/// Surface and palm of a hand as given by its files.
pub struct DerivedSurface {
    /// The root's collision shapes, root frame.
    pub(super) root: Vec<LinkPart>,
    pub(super) true_surfaces: TrueSurfaces,
}

impl DerivedSurface {
    /// True if the part of the root nearest to `point` (root frame) belongs to the palm.
    pub fn on_palm(&self, point: &Point3<f64>) -> bool {
        let distance = |part: &LinkPart| part.shape.signed_distance(&part.pose.inverse_transform_point(point)).0;
        self.root.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).is_some_and(|part| part.bears)
    }

    /// Returns the point of a link's own surface (`None` is the root) nearest to `point`, both in the link's frame.
    pub fn on_surface(&self, link: Option<usize>, point: &Point3<f64>) -> Point3<f64> {
        self.true_surfaces.nearest(link_number(link), point)
    }
}
