//! Stable resting pose of an object. Candidates are the faces of its convex hull that its centre of mass projects onto;
//! the pose that is hardest to tip over wins.

use nalgebra::{Point3, Unit, UnitQuaternion, Vector3};

use super::model::ObjectModel;
use crate::geometry::{ObjectShape, hull_triangles};

/// Angle below which a resting pose is merged with a lower one, rad: bumps of a scan are not separate poses.
const POSE_NEIGHBOURHOOD: f64 = 0.15;
/// Tolerance for the projection of the centre of mass beside a face, relative to the object's size.
const PROJECTION_TOLERANCE: f64 = 1e-3;
/// Number of directions in which the object is tipped; below, the step of the tilt (rad) and the number of steps.
const TIP_DIRECTION_COUNT: u32 = 16;
const TILT_STEPS: (f64, u32) = (0.05, 16);

impl ObjectModel {
    /// Returns the object as its shape is given, if that is stable, otherwise in the pose that is hardest to tip over.
    /// None if there is no stable pose.
    pub fn in_stable_pose(self) -> Option<Self> {
        let upright = Self { rest: UnitQuaternion::identity(), ..self };
        if upright.rests_stably() {
            return Some(upright);
        }
        let poses = upright.resting_poses().into_iter().map(|rest| Self { rest, ..upright.clone() });
        let stable = poses.filter(Self::rests_stably).map(|pose| (pose.tipping_height(), pose));
        // Among poses that are equally hard to tip over, the lowest wins; it comes first.
        stable.reduce(|best, other| if other.0 > best.0 { other } else { best }).map(|(_, pose)| pose)
    }

    /// Returns the resting poses on faces of the convex hull under the centre of mass, the lowest first.
    fn resting_poses(&self) -> Vec<UnitQuaternion<f64>> {
        let points = match &self.shape {
            ObjectShape::Mesh(mesh) => mesh.vertices().to_vec(),
            shape => shape.triangles().0,
        };
        let Ok((corners, faces)) = hull_triangles(&points) else { return Vec::new() };
        let beside = PROJECTION_TOLERANCE * self.shape.bounding_radius();
        let downwards = |face: &[u32; 3]| {
            let [a, b, c] = face.map(|index| corners[index as usize]);
            let down = (b - a).cross(&(c - a)).try_normalize(1e-14)?;
            let height = a.coords.dot(&down);
            let foot = Point3::from(down * height);
            let inside = [(a, b), (b, c), (c, a)].into_iter().all(|(from, to): (Point3<f64>, Point3<f64>)| {
                let edge = to - from;
                edge.cross(&(foot - from)).dot(&down) >= -beside * edge.norm()
            });
            inside.then_some((height, down))
        };
        let mut found: Vec<(f64, Vector3<f64>)> = faces.iter().filter_map(downwards).collect();
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut poses: Vec<Vector3<f64>> = Vec::new();
        for (_, down) in found {
            if poses.iter().all(|other| other.dot(&down) < POSE_NEIGHBOURHOOD.cos()) {
                poses.push(down);
            }
        }
        let turned = |down: Vector3<f64>| {
            UnitQuaternion::rotation_between(&down, &-Vector3::z())
                .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI))
        };
        poses.into_iter().map(turned).collect()
    }

    /// Returns the height by which the centre of mass must rise to tip the object over its weakest side, m.
    fn tipping_height(&self) -> f64 {
        let height = self.rest_height();
        let over = |side: u32| {
            let angle = std::f64::consts::TAU * f64::from(side) / f64::from(TIP_DIRECTION_COUNT);
            let axis = Unit::new_normalize(Vector3::new(angle.cos(), angle.sin(), 0.0));
            let rises = (1..=TILT_STEPS.1).map(|step| {
                let tipped = UnitQuaternion::from_axis_angle(&axis, TILT_STEPS.0 * f64::from(step)) * self.rest;
                -self.shape.lowest_height(&tipped) - height
            });
            // Once the centre drops, the object has tipped over.
            let mut highest = 0.0_f64;
            for rise in rises {
                if rise < highest {
                    break;
                }
                highest = rise;
            }
            highest
        };
        (0..TIP_DIRECTION_COUNT).map(over).fold(f64::INFINITY, f64::min)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::geometry::{Mesh, ObjectShape};
    use crate::objects::{ObjectSet, Symmetry};

    fn object(shape: ObjectShape) -> ObjectModel {
        ObjectModel {
            name: "thing".into(),
            shape,
            mass: 0.1,
            friction: 0.6,
            color: [0; 3],
            rest: UnitQuaternion::identity(),
            symmetry: Symmetry::None,
        }
    }

    /// Returns a bumpy solid, made from a sphere's tessellation stretched by `half`, m.
    fn lumpy(half: Vector3<f64>) -> ObjectShape {
        let (points, triangles, _) = ObjectShape::Sphere { radius: 1.0 }.triangles();
        let lump = |at: &Point3<f64>| {
            let height = 1.0 + 0.03 * (9.0 * at.x).sin() * (7.0 * at.y).cos() + 0.02 * (11.0 * at.z + at.x).sin();
            Point3::from(at.coords.component_mul(&half) * height)
        };
        let points: Vec<Point3<f64>> = points.iter().map(lump).collect();
        ObjectShape::Mesh(Arc::new(Mesh::repaired(&points, &triangles).expect("closed").0.centered().expect("a mesh")))
    }

    /// A bumpy stone that stands on end in its file is laid on its broad side, where it is stable.
    #[test]
    fn a_lumpy_solid_finds_its_rest() {
        let stone = object(lumpy(Vector3::new(0.03, 0.016, 0.045)));
        assert!(!stone.rests_stably(), "on its end");
        let lying = stone.clone().in_stable_pose().expect("a pose");
        assert!(lying.rests_stably() && lying.rest_height() < 0.019, "{}", lying.rest_height());
        let down = lying.rest.inverse() * -Vector3::z();
        assert!(down.y.abs() > 0.95, "on its broad side: {down}");
    }

    /// A pencil is laid down. An object that stands as given stays so, to the bit.
    #[test]
    fn only_what_would_fall_over_is_turned() {
        let pencil =
            object(ObjectShape::Cylinder { radius: 0.003, half_height: 0.08 }).in_stable_pose().expect("a pose");
        assert!((pencil.rest_height() - 0.003).abs() < 1e-4, "{}", pencil.rest_height());
        for object in ObjectSet::standard().iter().filter(|object| object.rest == UnitQuaternion::identity()) {
            let same = (**object).clone().in_stable_pose().expect("a pose");
            assert_eq!(same.rest, object.rest, "{}", object.name);
        }
    }
}
