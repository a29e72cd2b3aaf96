//! Graspable places: points at which an object is thin enough for a hand, such as its handle, its rim, its edge, or all
//! of it.

use anyhow::{Result, bail};
use nalgebra::{Point3, Vector3};
use world::geometry::ObjectShape;
use world::objects::ObjectModel;

/// Number of surface points that are examined.
const SAMPLE_COUNT: usize = 600;
/// Least share of them at which the object has to be thin, because a fingertip needs some room.
const MIN_THIN_SHARE: f64 = 0.02;
/// Cosine between the normals on both sides of a place below which they oppose each other.
const OPPOSED_COSINE: f64 = -0.7;
/// Least step into the object, m, and maximum number of steps.
const MIN_STEP: f64 = 5e-4;
const MAX_STEPS: usize = 2000;
/// Maximum number of places at which a search begins.
const MAX_PIVOTS: usize = 64;

/// Opening of a hand.
#[derive(Debug, Clone, PartialEq)]
pub struct HandOpening {
    /// Width of the widest object that fits between its fingers, m.
    pub width: f64,
    /// Name of the hand.
    pub hand: String,
}

impl HandOpening {
    /// Returns the opening of the F-TAC Hand.
    pub fn builtin_hand() -> Self {
        Self { width: 0.11, hand: "the F-TAC Hand".into() }
    }
}

/// A place where an object is thin.
#[derive(Debug, Clone, Copy)]
struct ThinPlace {
    middle: Point3<f64>,
    /// Thickness, m.
    thickness: f64,
}

/// Finds the places where the hand can take an object, as points in the object frame from which a search begins. An
/// object that fits into the hand as a whole has none. An object that the hand can take nowhere is an error.
pub fn graspable_places(object: &ObjectModel, opening: &HandOpening) -> Result<Vec<Vector3<f64>>> {
    let shape = &object.shape;
    let (low, high) = shape.aabb();
    if (high - low).min() <= opening.width {
        return Ok(Vec::new());
    }
    let samples = shape.surface_samples(SAMPLE_COUNT);
    let places: Vec<ThinPlace> = samples.iter().filter_map(|point| measure_thickness(shape, point)).collect();
    let thin: Vec<&ThinPlace> = places.iter().filter(|place| place.thickness <= opening.width).collect();
    if (thin.len() as f64) < MIN_THIN_SHARE * samples.len() as f64 {
        let found = match places.iter().map(|place| place.thickness).min_by(f64::total_cmp) {
            Some(least) => format!("places {:.0} mm thick at least", 1e3 * least),
            None => "no place between two opposite sides".into(),
        };
        bail!(
            "{}: found {found}, expected a handle, a rim or an edge of at most {:.0} mm: {} does not open wider",
            object.name,
            1e3 * opening.width,
            opening.hand
        );
    }
    let every = thin.len().div_ceil(MAX_PIVOTS);
    Ok(thin.into_iter().step_by(every).map(|place| place.middle.coords).collect())
}

/// Measures the thickness of the object from a point of its surface to the opposite side.
fn measure_thickness(shape: &ObjectShape, point: &Point3<f64>) -> Option<ThinPlace> {
    let (_, outward) = shape.signed_distance(point);
    let mut depth = MIN_STEP;
    for _ in 0..MAX_STEPS {
        let at = point - outward * depth;
        let (distance, normal) = shape.signed_distance(&at);
        if distance >= 0.0 {
            let opposed = normal.dot(&outward) < OPPOSED_COSINE;
            return opposed.then(|| ThinPlace { middle: point - outward * (0.5 * depth), thickness: depth });
        }
        depth += MIN_STEP.max(-distance);
    }
    None
}

#[cfg(test)]
mod tests {
    use world::objects::ObjectSet;

    use super::*;

    fn places(shape: &ObjectShape) -> Vec<ThinPlace> {
        shape.surface_samples(SAMPLE_COUNT).iter().filter_map(|point| measure_thickness(shape, point)).collect()
    }

    /// A plate has its thickness everywhere but on its narrow sides. A ball has it everywhere.
    #[test]
    fn thickness_is_measured_across() {
        let plate = ObjectShape::Cuboid { half: Vector3::new(0.15, 0.15, 0.002), radius: 0.0 };
        let found = places(&plate);
        let thin = found.iter().filter(|place| (place.thickness - 0.004).abs() < 1e-3).count();
        assert!(thin > SAMPLE_COUNT * 9 / 10, "{thin}");
        let ball = places(&ObjectShape::Sphere { radius: 0.1 });
        assert!(ball.iter().all(|place| place.thickness > 0.15), "{ball:?}");
    }

    /// The set's objects fit as a whole. A hand with a smaller opening takes them where they are thin, or not at all.
    #[test]
    fn an_object_is_judged_by_its_thin_places() {
        let open = |width| HandOpening { width, hand: "the clamp".into() };
        let known = |name: &str| ObjectSet::repertoire().get(name).expect("known").clone();
        assert!(
            graspable_places(&known("vase"), &HandOpening::builtin_hand()).expect("it can").is_empty(),
            "as a whole"
        );
        let error = graspable_places(&known("tennis_ball"), &open(0.03)).expect_err("nowhere thin").to_string();
        assert!(
            error.starts_with("tennis_ball: found places") && error.ends_with("30 mm: the clamp does not open wider"),
            "{error}"
        );
    }
}
