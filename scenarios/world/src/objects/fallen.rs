//! Other stable resting poses of an object on a table. They are the directions, in the object's frame, in which the
//! support height under its centre of mass has a local minimum. Each pose is treated as a separate object for
//! grasping.

use nalgebra::{UnitQuaternion, Vector3};

use super::model::ObjectModel;
use super::set::ObjectSet;
use super::symmetry::Symmetry;

/// Number of evenly distributed directions in the coarse search.
const DIRECTION_COUNT: usize = 1500;
/// Half angle of the neighbourhood in which a resting pose must be the lowest, rad.
const POSE_NEIGHBOURHOOD: f64 = 0.15;
/// Number of directions before and after one among which its whole neighbourhood is: their z components are
/// 2 / [`DIRECTION_COUNT`] apart, and those of neighbours differ by the angle at most.
const NEIGHBOURS: usize = (0.5 * POSE_NEIGHBOURHOOD * DIRECTION_COUNT as f64) as usize + 1;
/// Number of resting poses kept, the lowest ones.
const MAX_POSES: usize = 3;
/// Step sizes of the refinement, rad.
const REFINEMENT_STEPS: [f64; 4] = [0.02, 0.004, 0.0008, 0.0002];

impl ObjectModel {
    /// Returns the object in each of its other stable resting poses, named `<name>_fallen`, `<name>_fallen_2`, ..., the
    /// lowest first. Balls have no other resting pose.
    pub fn fallen(&self) -> Vec<Self> {
        if self.symmetry == Symmetry::Full {
            return Vec::new();
        }
        let height = |down: &Vector3<f64>| self.shape.support(down).coords.dot(down);
        let spread: Vec<(Vector3<f64>, f64)> =
            fibonacci_sphere(DIRECTION_COUNT).map(|down| (down, height(&down))).collect();
        let beside = POSE_NEIGHBOURHOOD.cos();
        let mut lowest: Vec<(Vector3<f64>, f64)> = spread
            .iter()
            .enumerate()
            .filter(|(n, (down, at))| {
                let near = &spread[n.saturating_sub(NEIGHBOURS)..(n + NEIGHBOURS + 1).min(DIRECTION_COUNT)];
                near.iter().all(|(other, there)| there >= at || other.dot(down) <= beside)
            })
            .map(|(_, (down, _))| refine(*down, &height))
            .collect();
        lowest.sort_by(|a, b| a.1.total_cmp(&b.1));
        let mut found: Vec<Self> = Vec::new();
        for (down, _) in lowest {
            let rest = UnitQuaternion::rotation_between(&down, &-Vector3::z())
                .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
            let known = std::iter::once(self).chain(&found).any(|pose| pose.resting_yaw(&rest).is_some());
            if !known && found.len() < MAX_POSES {
                let number = if found.is_empty() { String::new() } else { format!("_{}", found.len() + 1) };
                found.push(Self { name: format!("{}_fallen{number}", self.name), rest, ..self.clone() });
            }
        }
        found
    }
}

impl ObjectSet {
    /// Returns this set together with every other resting pose of its objects.
    #[must_use]
    pub fn with_fallen(mut self) -> Self {
        let fallen: Vec<ObjectModel> = self.iter().flat_map(|object| object.fallen()).collect();
        for object in fallen {
            self.insert(object);
        }
        self
    }

    /// Returns the resting poses of `object` other than its default one that this set contains.
    pub fn fallen_of<'a>(&'a self, object: &'a ObjectModel) -> impl Iterator<Item = &'a ObjectModel> {
        let prefix = format!("{}_fallen", object.name);
        self.iter().filter(move |other| other.name.starts_with(&prefix)).map(|other| &**other)
    }
}

/// Returns `count` evenly distributed unit vectors (Fibonacci sphere).
fn fibonacci_sphere(count: usize) -> impl Iterator<Item = Vector3<f64>> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..count).map(move |n| {
        let z = 1.0 - (2.0 * n as f64 + 1.0) / count as f64;
        let (sin, cos) = (golden * n as f64).sin_cos();
        let radius = (1.0 - z * z).sqrt();
        Vector3::new(radius * cos, radius * sin, z)
    })
}

/// Refines `down` by pattern search with decreasing rotation steps, to a local minimum of `height`.
fn refine(down: Vector3<f64>, height: &impl Fn(&Vector3<f64>) -> f64) -> (Vector3<f64>, f64) {
    let mut best = (down, height(&down));
    for step in REFINEMENT_STEPS {
        loop {
            let (at, before) = best;
            for axis in [Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis()] {
                for angle in [step, -step] {
                    let turned = UnitQuaternion::from_axis_angle(&axis, angle) * at;
                    let there = height(&turned);
                    if there < best.1 - 1e-9 {
                        best = (turned, there);
                    }
                }
            }
            if best.1 >= before {
                break;
            }
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ways_to_lie() {
        let set = ObjectSet::standard().with_fallen();
        let fallen = |name: &str| set.fallen_of(set.get(name).unwrap()).map(|o| o.rest_height()).collect::<Vec<_>>();
        // A can may lie on its side. A ball and a cube have no other resting pose. A box may lie on its longer sides.
        assert!(matches!(fallen("can_50")[..], [height] if (height - 0.025).abs() < 1e-4));
        assert!(fallen("golf_ball").is_empty() && fallen("cube_45").is_empty());
        assert!(matches!(fallen("box_60")[..], [height] if (height - 0.0225).abs() < 1e-4));
        assert!(!fallen("pear").is_empty() && !fallen("pawn").is_empty() && !fallen("polyhedron").is_empty());
        for object in set.iter().filter(|object| object.name.contains("_fallen")) {
            let tipped = |axis, angle| UnitQuaternion::from_axis_angle(&axis, angle) * object.rest;
            for axis in [Vector3::x_axis(), Vector3::y_axis()] {
                for angle in [0.03, -0.03] {
                    let rise = -object.shape.lowest_height(&tipped(axis, angle)) - object.rest_height();
                    assert!(rise > -5e-5, "{} does not lie still: {rise}", object.name);
                }
            }
        }
    }
}
