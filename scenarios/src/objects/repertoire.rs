//! The 23 objects of the synthesized repertoire: as many as the paper's, a set of our own. Seventeen are the benchmark's; the
//! others are larger or flatter things, among them the ones that the paper's multi-object landscape names (vase, multimeter,
//! board eraser, coffee bottle, Coke can; its pawn is the benchmark's).

use nalgebra::{UnitQuaternion, Vector3};

use super::{ObjectModel, ObjectSet, SEGMENTS, Symmetry, centered, outlines};
use crate::geometry::{GeometryError, Shape, revolve};

/// Of the benchmark's three small balls the middle one is left out: two are enough.
const LEFT_OUT: &str = "ball_45";

impl ObjectSet {
    /// The 23 objects of the synthesized repertoire.
    ///
    /// # Panics
    /// Never in a tested build: the shapes are compiled in and a test builds them.
    pub fn repertoire() -> Self {
        let mut set = Self::standard();
        set.objects.retain(|object| object.name != LEFT_OUT);
        for object in additions().expect("the built-in objects are valid") {
            set.insert(object);
        }
        set
    }
}

fn additions() -> Result<Vec<ObjectModel>, GeometryError> {
    let model = |name: &str, shape: Shape, grams: f64, friction: f64, color: [u8; 3], symmetry: Symmetry| ObjectModel {
        name: name.into(),
        shape,
        mass: grams * 1e-3,
        friction,
        color,
        rest: UnitQuaternion::identity(),
        symmetry,
    };
    let cuboid = |x: f64, y: f64, z: f64, radius: f64| Shape::Cuboid {
        half: Vector3::new(x, y, z) * 0.5e-3,
        radius: radius * 1e-3,
    };
    let box_like = Symmetry::Fold { n: 2, flip: true };
    let axis = Symmetry::Axis { flip: false };
    Ok(vec![
        model("ball", Shape::Sphere { radius: 0.03 }, 100.0, 0.8, [220, 90, 60], Symmetry::Full),
        model(
            "coke_can",
            Shape::Cylinder { radius: 0.033, half_height: 0.0575 },
            385.0,
            0.7,
            [200, 16, 30],
            Symmetry::Axis { flip: true },
        ),
        model("board_eraser", cuboid(110.0, 55.0, 35.0, 4.0), 60.0, 0.9, [60, 90, 140], box_like),
        model("multimeter", cuboid(75.0, 145.0, 35.0, 6.0), 300.0, 0.7, [230, 190, 30], Symmetry::None),
        model("vase", centered(revolve(&outlines::vase(), SEGMENTS)?)?, 180.0, 0.6, [120, 170, 200], axis),
        model("coffee_bottle", centered(revolve(&outlines::bottle(), SEGMENTS)?)?, 290.0, 0.7, [90, 60, 40], axis),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn twenty_three_objects_that_a_hand_can_hold() {
        let set = ObjectSet::repertoire();
        assert_eq!(set.iter().len(), 23);
        for object in set.iter() {
            let (low, high) = object.shape.aabb();
            let size = high - low;
            assert!(size.min() > 0.03 && size.min() < 0.08 && size.max() < 0.16, "{}: {size:?}", object.name);
            let density = object.mass / object.shape.volume();
            assert!((200.0..2000.0).contains(&density), "{}: {density} kg/m3", object.name);
            assert!(object.shape.inertia(object.mass).0.coords.norm() < 1e-9, "{}", object.name);
        }
    }
}
