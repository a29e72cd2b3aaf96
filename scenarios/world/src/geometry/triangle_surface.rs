//! The surface of any set of triangles, closed or not: the point on it that is nearest.

use nalgebra::Point3;
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::TriMesh;

use super::mesh::{from_parry, to_parry};

/// Triangles that can be asked for their nearest point.
pub struct TriangleSurface(TriMesh);

impl TriangleSurface {
    /// Of `triangles` between `vertices`; none where there are no triangles with vertices.
    pub fn new(vertices: &[Point3<f64>], triangles: &[[u32; 3]]) -> Option<Self> {
        TriMesh::new(vertices.iter().map(to_parry).collect(), triangles.to_vec()).ok().map(Self)
    }

    /// The nearest point of the surface to `point`.
    pub fn nearest(&self, point: &Point3<f64>) -> Point3<f64> {
        from_parry(self.0.project_local_point(to_parry(point), false).point)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One triangle: from above its middle down to it, from beside to its edge.
    #[test]
    fn the_nearest_point_lies_on_the_triangles() {
        let vertices = [Point3::origin(), Point3::new(1.0, 0.0, 0.0), Point3::new(0.0, 1.0, 0.0)];
        let surface = TriangleSurface::new(&vertices, &[[0, 1, 2]]).expect("one");
        assert!((surface.nearest(&Point3::new(0.2, 0.3, 0.5)) - Point3::new(0.2, 0.3, 0.0)).norm() < 1e-12);
        assert!((surface.nearest(&Point3::new(0.4, -2.0, 0.0)) - Point3::new(0.4, 0.0, 0.0)).norm() < 1e-12);
        assert!(TriangleSurface::new(&[], &[]).is_none());
    }
}
