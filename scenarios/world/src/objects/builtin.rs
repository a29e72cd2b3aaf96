//! The built-in objects.

use std::path::Path;
use std::sync::OnceLock;

use ftac_platform::file_access::FileAccess;

use super::file::ObjectFile;
use super::set::ObjectSet;

/// Lists files of `data/objects` with their names.
macro_rules! files {
    ($($name:literal),* $(,)?) => {
        &[$((concat!($name, ".toml"), include_str!(concat!("../../data/objects/", $name, ".toml")))),*]
    };
}

/// Eighteen compact objects.
const COMPACT_OBJECTS: &[(&str, &str)] = files![
    "golf_ball",
    "ball_45",
    "ball_50",
    "billiard_ball",
    "tennis_ball",
    "cube_45",
    "box_50",
    "box_60",
    "cylinder_45",
    "can_50",
    "can_66",
    "egg",
    "lemon",
    "peanut",
    "pear",
    "pawn",
    "polyhedron",
    "gem",
];

/// Larger or flatter objects. They include those of the paper's multi-object landscape (vase, multimeter, board
/// eraser, coffee bottle, Coke can), except its pawn, which is among the compact ones.
const LARGE_OBJECTS: &[(&str, &str)] =
    files!["ball", "coke_can", "board_eraser", "multimeter", "vase", "coffee_bottle"];

/// Long or irregular objects: held across the palm, they reach into the workspace of the digits that are still free.
const LONG_OBJECTS: &[(&str, &str)] =
    files!["pillar", "bar", "slab", "bottle", "shampoo", "glue_stick", "salt_mill", "l_block", "caddy",];

/// Object left out of the synthesized repertoire: the middle one of the three small balls, because two are enough.
const OMITTED_OBJECT: &str = "ball_45";

impl ObjectSet {
    /// Returns all built-in objects.
    ///
    /// # Panics
    /// Never in a tested build: the files are compiled in and a test reads them.
    pub fn standard() -> Self {
        // Each is made once; sets share them.
        static STANDARD: OnceLock<ObjectSet> = OnceLock::new();
        STANDARD.get_or_init(|| Self::builtin(&[COMPACT_OBJECTS, LARGE_OBJECTS, LONG_OBJECTS])).clone()
    }

    /// Returns the 23 objects of the synthesized repertoire: as many as in the paper, but a different set.
    ///
    /// # Panics
    /// Never in a tested build: the files are compiled in and a test reads them.
    pub fn repertoire() -> Self {
        let mut set = Self::builtin(&[COMPACT_OBJECTS, LARGE_OBJECTS]);
        set.remove(OMITTED_OBJECT);
        set
    }

    fn builtin(groups: &[&[(&str, &str)]]) -> Self {
        let mut set = Self::default();
        for (name, text) in groups.iter().copied().flatten() {
            let path = Path::new(name);
            let object = ObjectFile::parse(text, path, FileAccess::Nothing).and_then(|file| file.model(path));
            set.insert(object.expect("the built-in objects are valid"));
        }
        set
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, PI, TAU};

    use nalgebra::{Unit, UnitQuaternion, Vector3};

    use super::*;
    use crate::geometry::{ObjectShape, hull_mesh};
    use crate::objects::Symmetry;

    #[test]
    fn the_set_has_what_it_promises() {
        let compact = ObjectSet::builtin(&[COMPACT_OBJECTS]);
        assert_eq!(compact.iter().len(), 18);
        assert!(compact.iter().filter(|object| matches!(object.shape, ObjectShape::Mesh(_))).count() >= 5);
        for object in compact.iter() {
            let (low, high) = object.shape.aabb();
            let size = high - low;
            assert!(size.min() > 0.04 && size.min() <= 0.066, "{}: {size:?}", object.name);
        }
        let set = ObjectSet::standard();
        assert_eq!(set.iter().len(), 33);
        assert!(set.iter().filter(|object| matches!(object.shape, ObjectShape::Mesh(_))).count() >= 11);
        for object in set.iter() {
            let (low, high) = object.shape.aabb();
            let size = high - low;
            assert!(size.min() > 0.03 && size.min() < 0.08 && size.max() < 0.18, "{}: {size:?}", object.name);
            let density = object.mass / object.shape.volume();
            assert!((250.0..2000.0).contains(&density), "{}: {density} kg/m3", object.name);
            let (com, inertia) = object.shape.inertia(object.mass);
            assert!(com.coords.norm() < 1e-9, "{}: {com}", object.name);
            assert!(inertia.symmetric_eigenvalues().min() > 0.0);
        }
    }

    #[test]
    fn every_object_rests_stably() {
        for object in ObjectSet::standard().iter() {
            let height = object.rest_height();
            for k in 0..16 {
                let angle = TAU * f64::from(k) / 16.0;
                let axis = Unit::new_normalize(Vector3::new(angle.cos(), angle.sin(), 0.0));
                let tipped = UnitQuaternion::from_axis_angle(&axis, 0.05) * object.rest;
                let change = -object.shape.lowest_height(&tipped) - height;
                assert!(change > -2e-5, "{} falls over: {change}", object.name);
            }
        }
    }

    #[test]
    fn convex_parts_fill_the_mesh() {
        for object in ObjectSet::standard().iter() {
            let ObjectShape::Mesh(mesh) = &object.shape else { continue };
            let parts = object.shape.convex_parts();
            println!("{}: {} triangles, {} parts", object.name, mesh.triangles().len(), parts.len());
            let volume: f64 = parts.iter().map(|part| hull_mesh(part).unwrap().volume()).sum();
            assert!((volume / mesh.volume() - 1.0).abs() < 0.03, "{}: {volume} of {}", object.name, mesh.volume());
            for point in parts.iter().flatten() {
                assert!(object.shape.signed_distance(point).0 < 3e-4);
            }
            assert!(parts.len() <= 10 && parts.iter().map(Vec::len).max().unwrap() <= 500, "{}", object.name);
        }
    }

    /// Orientations that look the same have the same yaw. A fallen object does not stand.
    #[test]
    fn standing_and_lying() {
        let set = ObjectSet::standard();
        let yaw = |name: &str, turn: UnitQuaternion<f64>| {
            let object = set.get(name).unwrap();
            object.resting_yaw(&(turn * object.rest))
        };
        let about = |axis: Unit<Vector3<f64>>, angle: f64| UnitQuaternion::from_axis_angle(&axis, angle);
        let (x, y, z) = (Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis());
        for object in set.iter() {
            let turned = yaw(&object.name, about(z, 0.3)).unwrap();
            let wanted = if object.round_about_vertical(&object.rest) { 0.0 } else { 0.3 };
            assert!((turned - wanted).abs() < 1e-6, "{}: {turned}", object.name);
        }
        let near = |found: Option<f64>, wanted: f64| (found.unwrap() - wanted).abs() < 1e-6;
        assert!(near(yaw("golf_ball", about(x, 1.9)), 0.0));
        assert!(near(yaw("cube_45", about(z, 0.2) * about(y, FRAC_PI_2)), 0.2));
        assert!(near(yaw("cube_45", about(z, 1.4)), 1.4 - FRAC_PI_2));
        assert!(near(yaw("can_50", about(x, PI)), 0.0));
        for (name, turn) in [("can_50", about(x, FRAC_PI_2)), ("pear", about(y, 2.0)), ("box_60", about(x, FRAC_PI_2))]
        {
            assert_eq!(yaw(name, turn), None, "{name}");
        }
    }

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

    /// The symmetry in an object's file agrees with its shape.
    #[test]
    fn symmetric_turns_map_the_surface_onto_itself() {
        for object in ObjectSet::repertoire().iter() {
            let mut turns = object.symmetry.rotations();
            let about = |axis: Unit<Vector3<f64>>, angle: f64| UnitQuaternion::from_axis_angle(&axis, angle);
            match object.symmetry {
                Symmetry::Full => turns.extend([about(Vector3::x_axis(), 1.0), about(Vector3::z_axis(), 2.0)]),
                Symmetry::Axis { flip } => {
                    turns.push(about(Vector3::z_axis(), 1.0));
                    turns.extend(flip.then(|| about(Vector3::x_axis(), PI)));
                }
                _ => {}
            }
            for point in object.shape.surface_samples(200) {
                for turn in &turns {
                    let away = object.shape.signed_distance(&(turn * point)).0.abs();
                    assert!(away < 2e-4, "{}: {away} m off its surface after a turn", object.name);
                }
            }
        }
    }
}
