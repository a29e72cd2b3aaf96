//! Extent of a held object: its reach along the palm's axes, for the outcome model of a grasp beside it.
//!
//! Unlike a pose, the extent is invariant under the object's own symmetries. It is also what another object collides
//! with.

use nalgebra::{Isometry3, Vector3};
use world::geometry::ObjectShape;

/// Directions in the palm frame.
const DIRECTIONS: [[f64; 3]; 6] =
    [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]];
/// Kernel width, m: at this difference of extents, knowledge of one hold counts for the other by a factor of exp(-1/2).
const KERNEL_WIDTH: f64 = 0.006;

/// Farthest reach of an object from the palm's origin along x, -x, y, -y, z and -z of the palm, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeldExtent(pub [f64; 6]);

impl HeldExtent {
    /// Extent of an object of this shape that is held at `palm_from_object`.
    pub fn from_shape(shape: &ObjectShape, palm_from_object: &Isometry3<f64>) -> Self {
        Self(DIRECTIONS.map(|direction| {
            let direction = Vector3::from(direction);
            let local = palm_from_object.inverse_transform_vector(&direction);
            (palm_from_object * shape.support(&local)).coords.dot(&direction)
        }))
    }

    /// Weight (0 to 1) of the knowledge of one hold for the other; 1 if they are the same.
    pub fn similarity(&self, other: &Self) -> f64 {
        let squares = self.0.iter().zip(other.0).map(|(one, other)| ((one - other) / KERNEL_WIDTH).powi(2));
        (-0.5 * squares.sum::<f64>()).exp()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{UnitQuaternion, Vector3};

    use super::*;

    /// A ball has the same extent in any orientation; a box does not.
    #[test]
    fn turns_count_only_where_they_show() {
        let turned = Isometry3::from_parts(
            Vector3::new(0.01, -0.02, -0.04).into(),
            UnitQuaternion::from_euler_angles(0.3, -0.2, 0.5),
        );
        let straight = Isometry3::translation(0.01, -0.02, -0.04);
        let ball = ObjectShape::Sphere { radius: 0.02 };
        let (one, other) = (HeldExtent::from_shape(&ball, &straight), HeldExtent::from_shape(&ball, &turned));
        let expected = [0.03, 0.01, 0.0, 0.04, -0.02, 0.06];
        assert!(one.0.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-9), "{one:?}");
        assert!(one.similarity(&other) > 0.999_999);
        let cuboid = ObjectShape::Cuboid { half: Vector3::new(0.02, 0.03, 0.04), radius: 0.002 };
        let likeness = HeldExtent::from_shape(&cuboid, &straight).similarity(&HeldExtent::from_shape(&cuboid, &turned));
        assert!(likeness < 0.5, "{likeness}");
    }
}
