//! The object set: everyday things of true size, built by code.
//!
//! Every frame sits in the object's centre of volume, which is its centre of mass. Sizes suit the hand: what is to be held by
//! ring and little finger measures 43 to 60 mm across, what is grasped second 43 to 66 mm.

mod fallen;
mod outlines;
mod repertoire;

use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::sync::Arc;

use nalgebra::{Unit, UnitQuaternion, Vector3};

use crate::geometry::{GeometryError, Mesh, Shape, hull_mesh, revolve};

/// Turns that leave an object looking the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Symmetry {
    /// Every turn: a ball.
    Full,
    /// Every turn about z.
    Axis {
        /// End over end as well, as for a cylinder.
        flip: bool,
    },
    /// Turns about z by a whole circle over `n`.
    Fold {
        /// At least 1.
        n: u32,
        /// Half turns about x as well, as for a box.
        flip: bool,
    },
    /// The 24 turns of a cube.
    Cube,
    /// None.
    None,
}

impl Symmetry {
    /// The smallest angle by which orientations `a` and `b` (`world_from_object`) can differ, given the symmetry, rad.
    pub fn angle(&self, a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>) -> f64 {
        match self {
            Self::Full => 0.0,
            Self::Axis { flip } => {
                let angle = (a * Vector3::z()).angle(&(b * Vector3::z()));
                if *flip { angle.min(PI - angle) } else { angle }
            }
            Self::Fold { .. } | Self::Cube | Self::None => {
                self.turns().iter().map(|turn| a.angle_to(&(b * turn))).fold(f64::INFINITY, f64::min)
            }
        }
    }

    /// The turns of a discrete symmetry, the identity first; only the identity for a continuous one.
    pub fn turns(&self) -> Vec<UnitQuaternion<f64>> {
        let about = |axis: &Unit<Vector3<f64>>, angle: f64| UnitQuaternion::from_axis_angle(axis, angle);
        let (x, y, z) = (Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis());
        let folds = |n: u32| (0..n.max(1)).map(move |k| about(&z, TAU * f64::from(k) / f64::from(n.max(1))));
        match *self {
            Self::Full | Self::Axis { .. } | Self::None => vec![UnitQuaternion::identity()],
            Self::Fold { n, flip: false } => folds(n).collect(),
            Self::Fold { n, flip: true } => folds(n).flat_map(|turn| [turn, turn * about(&x, PI)]).collect(),
            Self::Cube => {
                let tops = [
                    UnitQuaternion::identity(),
                    about(&x, PI),
                    about(&x, FRAC_PI_2),
                    about(&x, -FRAC_PI_2),
                    about(&y, FRAC_PI_2),
                    about(&y, -FRAC_PI_2),
                ];
                tops.into_iter().flat_map(|top| folds(4).map(move |turn| top * turn)).collect()
            }
        }
    }
}

/// Tilt from which an object no longer stands as at rest, rad.
const LEANING: f64 = 0.15;
/// Height of a unit axis's end from which the axis counts as vertical.
const UPRIGHT: f64 = 0.99;

/// One object.
#[derive(Debug, Clone)]
pub struct ObjectModel {
    /// Unique, such as `golf_ball`.
    pub name: String,
    /// In the frame `object/<name>`, origin at the centre of mass.
    pub shape: Shape,
    /// kg.
    pub mass: f64,
    /// Coulomb friction coefficient against the hand's elastomer.
    pub friction: f64,
    /// RGB.
    pub color: [u8; 3],
    /// `table_from_object`: how it stands or lies on the table at yaw 0.
    pub rest: UnitQuaternion<f64>,
    /// Turns that leave it looking the same.
    pub symmetry: Symmetry,
}

impl ObjectModel {
    /// The same thing of the same stuff, `factor` times as large.
    pub fn scaled(&self, factor: f64) -> Result<Self, GeometryError> {
        Ok(Self { shape: self.shape.scaled(factor)?, mass: self.mass * factor.powi(3), ..self.clone() })
    }

    /// Whether the object, oriented as `world_from_object`, looks the same from all sides: a ball, or what stands on its axis.
    pub fn round_about_vertical(&self, rotation: &UnitQuaternion<f64>) -> bool {
        match self.symmetry {
            Symmetry::Full => true,
            Symmetry::Axis { .. } => (rotation * Vector3::z()).z.abs() > UPRIGHT,
            Symmetry::Fold { .. } | Symmetry::Cube | Symmetry::None => false,
        }
    }

    /// The turn about the vertical by which the object, oriented as `world_from_object`, differs from its rest pose, rad; of
    /// turns that leave it looking the same the smallest. `None` if it lies otherwise than at rest.
    pub fn standing_yaw(&self, rotation: &UnitQuaternion<f64>) -> Option<f64> {
        self.standing_yaws(rotation).into_iter().min_by(|a, b| a.abs().total_cmp(&b.abs()))
    }

    /// All those turns; none if it lies otherwise than at rest.
    pub fn standing_yaws(&self, rotation: &UnitQuaternion<f64>) -> Vec<f64> {
        let candidate = |turn: &UnitQuaternion<f64>| match self.symmetry {
            Symmetry::Full => (0.0, 0.0),
            Symmetry::Axis { .. } => {
                let (now, rest) = (rotation * turn * Vector3::z(), self.rest * Vector3::z());
                let azimuth = |axis: &Vector3<f64>| if axis.z.abs() > UPRIGHT { 0.0 } else { axis.y.atan2(axis.x) };
                let yaw = azimuth(&now) - azimuth(&rest);
                ((now.z.acos() - rest.z.acos()).abs(), yaw - TAU * (yaw / TAU).round())
            }
            Symmetry::Fold { .. } | Symmetry::Cube | Symmetry::None => {
                let moved = rotation * turn * self.rest.inverse();
                let ahead = moved * Vector3::x();
                ((moved * Vector3::z()).angle(&Vector3::z()), ahead.y.atan2(ahead.x))
            }
        };
        let mut turns = self.symmetry.turns();
        if self.symmetry == (Symmetry::Axis { flip: true }) {
            turns.push(UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI));
        }
        let standing = turns.iter().map(candidate).filter(|(tilt, _)| *tilt < LEANING);
        standing.map(|(_, yaw)| yaw).collect()
    }

    /// Height of the frame's origin over the table when at rest, m.
    pub fn rest_height(&self) -> f64 {
        -self.shape.lowest(&self.rest)
    }
}

/// A set of objects with unique names, in a fixed order.
#[derive(Debug, Clone, Default)]
pub struct ObjectSet {
    objects: Vec<Arc<ObjectModel>>,
}

impl ObjectSet {
    /// The eighteen objects of the benchmark.
    ///
    /// # Panics
    /// Never in a tested build: the shapes are compiled in and a test builds them.
    pub fn standard() -> Self {
        Self::build().expect("the built-in objects are valid")
    }

    /// Adds an object; one of the same name is replaced and given back.
    pub fn insert(&mut self, object: ObjectModel) -> Option<Arc<ObjectModel>> {
        let object = Arc::new(object);
        match self.objects.iter_mut().find(|other| other.name == object.name) {
            Some(place) => Some(std::mem::replace(place, object)),
            None => {
                self.objects.push(object);
                None
            }
        }
    }

    /// The object called `name`.
    pub fn get(&self, name: &str) -> Option<&Arc<ObjectModel>> {
        self.objects.iter().find(|object| object.name == name)
    }

    /// All objects in order.
    pub fn iter(&self) -> std::slice::Iter<'_, Arc<ObjectModel>> {
        self.objects.iter()
    }

    /// All names in order.
    pub fn names(&self) -> Vec<&str> {
        self.objects.iter().map(|object| object.name.as_str()).collect()
    }

    fn build() -> Result<Self, GeometryError> {
        let mut set = Self::default();
        let mut add = |name: &str, shape: Shape, grams: f64, friction: f64, color: [u8; 3], rest, symmetry| {
            let mass = grams * 1e-3;
            set.insert(ObjectModel { name: name.into(), shape, mass, friction, color, rest, symmetry });
        };
        let upright = UnitQuaternion::identity();
        let sphere = |mm: f64| Shape::Sphere { radius: 0.5e-3 * mm };
        let cylinder = |mm: f64, high: f64| Shape::Cylinder { radius: 0.5e-3 * mm, half_height: 0.5e-3 * high };
        let cuboid = |x: f64, y: f64, z: f64| Shape::Cuboid { half: Vector3::new(x, y, z) * 0.5e-3, radius: 3e-3 };
        let ends_alike = Symmetry::Axis { flip: true };
        let axis = Symmetry::Axis { flip: false };

        add("golf_ball", sphere(42.7), 46.0, 0.8, [238, 238, 232], upright, Symmetry::Full);
        add("ball_45", sphere(45.0), 40.0, 0.8, [196, 78, 82], upright, Symmetry::Full);
        add("ball_50", sphere(50.0), 60.0, 0.8, [76, 114, 176], upright, Symmetry::Full);
        add("billiard_ball", sphere(57.15), 165.0, 0.7, [176, 32, 40], upright, Symmetry::Full);
        add("tennis_ball", sphere(65.0), 58.0, 0.9, [204, 222, 64], upright, Symmetry::Full);
        add("cube_45", cuboid(45.0, 45.0, 45.0), 60.0, 0.8, [221, 132, 82], upright, Symmetry::Cube);
        add("box_50", cuboid(50.0, 50.0, 50.0), 80.0, 0.8, [129, 114, 179], upright, Symmetry::Cube);
        add(
            "box_60",
            cuboid(45.0, 45.0, 60.0),
            78.0,
            0.8,
            [147, 120, 96],
            upright,
            Symmetry::Fold { n: 4, flip: true },
        );
        add("cylinder_45", cylinder(45.0, 55.0), 60.0, 0.8, [100, 181, 205], upright, ends_alike);
        add("can_50", cylinder(50.0, 60.0), 90.0, 0.8, [140, 160, 170], upright, ends_alike);
        add("can_66", cylinder(66.0, 75.0), 150.0, 0.8, [85, 168, 104], upright, ends_alike);

        let (egg, lying) = lying(&outlines::egg())?;
        add("egg", egg, 57.0, 0.8, [236, 214, 184], lying, axis);
        let (lemon, lying) = self::lying(&outlines::lemon())?;
        add("lemon", lemon, 58.0, 0.8, [250, 220, 60], lying, ends_alike);
        let (peanut, lying) = self::lying(&outlines::peanut())?;
        add("peanut", peanut, 45.0, 0.8, [206, 168, 104], lying, ends_alike);
        add("pear", centered(revolve(&outlines::pear(), SEGMENTS)?)?, 70.0, 0.8, [170, 196, 72], upright, axis);
        add("pawn", centered(revolve(&outlines::pawn(), SEGMENTS)?)?, 42.0, 0.8, [60, 60, 66], upright, axis);
        let polyhedron = centered(hull_mesh(&outlines::polyhedron())?)?;
        add("polyhedron", polyhedron, 62.0, 0.8, [190, 90, 160], upright, Symmetry::None);
        let gem = centered(hull_mesh(&outlines::gem())?)?;
        add("gem", gem, 70.0, 0.7, [64, 190, 190], upright, Symmetry::Fold { n: 8, flip: false });
        Ok(set)
    }
}

/// Steps around a surface of revolution.
const SEGMENTS: usize = 48;

fn centered(mesh: Mesh) -> Result<Shape, GeometryError> {
    Ok(Shape::Mesh(Arc::new(mesh.centered()?)))
}

/// A surface of revolution lying on its side: the tilt at which its centre is lowest, a facet down.
fn lying(profile: &crate::geometry::Profile) -> Result<(Shape, UnitQuaternion<f64>), GeometryError> {
    let shape = centered(revolve(profile, SEGMENTS)?)?;
    let facet_down = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), PI / SEGMENTS as f64);
    let tilted = |tilt: f64| UnitQuaternion::from_axis_angle(&Vector3::y_axis(), tilt) * facet_down;
    let height = |tilt: f64| -shape.lowest(&tilted(tilt));
    // Whole steps first, because two lobes have two valleys with a ridge between; then ever finer around the best.
    let (mut best, mut step) = (FRAC_PI_2, PI / 180.0);
    for _ in 0..4 {
        let around = best;
        for k in -30..=30 {
            let tilt = around + step * f64::from(k);
            if height(tilt) < height(best) - 1e-12 {
                best = tilt;
            }
        }
        step *= 0.1;
    }
    Ok((shape, tilted(best)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_set_has_what_it_promises() {
        let set = ObjectSet::standard();
        assert_eq!(set.iter().len(), 18);
        assert!(set.iter().filter(|object| matches!(object.shape, Shape::Mesh(_))).count() >= 5);
        for object in set.iter() {
            let (low, high) = object.shape.aabb();
            let size = high - low;
            assert!(size.min() > 0.04 && size.min() <= 0.066, "{}: {size:?}", object.name);
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
                let change = -object.shape.lowest(&tipped) - height;
                assert!(change > -2e-5, "{} falls over: {change}", object.name);
            }
        }
    }

    #[test]
    fn convex_parts_fill_the_mesh() {
        for object in ObjectSet::standard().iter() {
            let Shape::Mesh(mesh) = &object.shape else { continue };
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

    /// What looks the same stands the same; what fell over does not stand.
    #[test]
    fn standing_and_lying() {
        let set = ObjectSet::standard();
        let yaw = |name: &str, turn: UnitQuaternion<f64>| {
            let object = set.get(name).unwrap();
            object.standing_yaw(&(turn * object.rest))
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
    fn symmetric_turns_cost_nothing() {
        let turn = UnitQuaternion::from_euler_angles(0.3, -1.1, 2.0);
        let about = |axis: Unit<Vector3<f64>>, angle: f64| turn * UnitQuaternion::from_axis_angle(&axis, angle);
        let quarter = about(Vector3::y_axis(), FRAC_PI_2);
        assert!(Symmetry::Cube.angle(&turn, &quarter) < 1e-7);
        assert_eq!(Symmetry::Cube.turns().len(), 24);
        assert!((Symmetry::Fold { n: 4, flip: true }.angle(&turn, &quarter) - FRAC_PI_2).abs() < 1e-7);
        assert!(Symmetry::Axis { flip: true }.angle(&turn, &about(Vector3::x_axis(), PI)) < 1e-7);
        assert!((Symmetry::Axis { flip: false }.angle(&turn, &about(Vector3::x_axis(), PI)) - PI).abs() < 1e-7);
        assert!(Symmetry::Fold { n: 8, flip: false }.angle(&turn, &about(Vector3::z_axis(), TAU / 8.0)) < 1e-7);
        assert!((Symmetry::None.angle(&turn, &about(Vector3::z_axis(), 0.4)) - 0.4).abs() < 1e-9);
    }
}
