//! Surface of any set of triangles, closed or not, with a nearest-point query.

use nalgebra::Point3;
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::TriMesh;

use super::mesh::{from_parry, to_parry};

/// Triangles with a nearest-point query.
pub struct TriangleSurface(TriMesh);

impl TriangleSurface {
    /// Creates the surface of `triangles` between `vertices`; none if there are no triangles with vertices.
    pub fn new(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> Option<Self> {
        TriMesh::new(vertices.iter().map(to_parry).collect(), triangles.to_vec()).ok().map(Self)
    }

    /// Returns the point of the surface nearest to `point`.
    pub fn nearest(&self, point: &Point3<f64>) -> Point3<f64> {
        from_parry(self.0.project_local_point(to_parry(point), false).point)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One triangle: the nearest point is straight below from above its middle, and on its edge from beside.
    #[test]
    fn the_nearest_point_lies_on_the_triangles() {
        let vertices = [Point3::origin(), Point3::new(1.0, 0.0, 0.0), Point3::new(0.0, 1.0, 0.0)];
        let surface = TriangleSurface::new(&vertices, &[[0, 1, 2]]).expect("one");
        assert!((surface.nearest(&Point3::new(0.2, 0.3, 0.5)) - Point3::new(0.2, 0.3, 0.0)).norm() < 1e-12);
        assert!((surface.nearest(&Point3::new(0.4, -2.0, 0.0)) - Point3::new(0.4, 0.0, 0.0)).norm() < 1e-12);
        assert!(TriangleSurface::new(&[], &[]).is_none());
    }
}
