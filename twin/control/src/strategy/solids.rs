//! Solids of a decision for distance queries: an object, the held object with the digits that hold it, and the rest of
//! the hand.

use hand_model::{Digit, Hand};
use nalgebra::{Isometry3, Point3, Vector3};
use parry3d_f64::shape::SharedShape;
use world::geometry::{ObjectShape, hull_mesh};
use world::objects::ObjectModel;

use crate::collision::{Solid, hand_solids};

/// Number of points kept of a convex part for distance queries, whose cost grows with it.
const HULL_POINTS: usize = 96;
/// Threshold below which a mesh counts as convex: the volume of its hull relative to its own.
const CONVEX_VOLUME_RATIO: f64 = 1.03;

/// The held object, as estimated.
#[derive(Clone)]
pub struct HeldObject<'a> {
    pub name: &'a str,
    /// Solids in the object's frame: [`object_solids`].
    pub solids: &'a [Solid],
    /// `palm_from_object`.
    pub pose: Isometry3<f64>,
    /// Finger joint angles, rad.
    pub joints: Vec<f64>,
    /// Digits that hold it.
    pub digits: Vec<Digit>,
    /// Standard deviation of its surface's position, m.
    pub sigma: f64,
}

/// The solids of an object in its own frame.
pub fn object_solids(object: &ObjectModel) -> Vec<Solid> {
    let pose = Isometry3::identity();
    match &object.shape {
        ObjectShape::Sphere { radius } => vec![Solid::ball(object.name.clone(), *radius, pose)],
        ObjectShape::Cuboid { half, radius } => vec![Solid::rounded_box(object.name.clone(), *half, *radius, pose)],
        ObjectShape::Cylinder { radius, half_height } => {
            let upright = nalgebra::UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
            vec![Solid::new(object.name.clone(), SharedShape::cylinder(*half_height, *radius), pose * upright)]
        }
        ObjectShape::Mesh(mesh) => {
            let hull_of = |points: &[Point3<f64>]| {
                Some(Solid::new(object.name.clone(), SharedShape::convex_hull(&extreme_points(points))?, pose))
            };
            // Distances to one hull cost a fraction of those to many, so the slices of a nearly convex mesh are
            // combined.
            let whole =
                hull_mesh(mesh.vertices()).ok().filter(|hull| hull.volume() < CONVEX_VOLUME_RATIO * mesh.volume());
            match whole.and_then(|hull| hull_of(hull.vertices())) {
                Some(hull) => vec![hull],
                None => mesh.convex_parts().iter().filter_map(|points| hull_of(points)).collect(),
            }
        }
    }
}

/// Extreme points of a convex part in evenly distributed directions: within half a millimetre of the part at these
/// sizes.
fn extreme_points(points: &[Point3<f64>]) -> Vec<parry3d_f64::math::Vector> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let mut kept: Vec<usize> = (0..HULL_POINTS)
        .filter_map(|n| {
            let z = 1.0 - (2.0 * n as f64 + 1.0) / HULL_POINTS as f64;
            let (sin, cos) = (golden * n as f64).sin_cos();
            let direction = Vector3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z);
            let along = |point: &Point3<f64>| point.coords.dot(&direction);
            (0..points.len()).max_by(|a, b| along(&points[*a]).total_cmp(&along(&points[*b])))
        })
        .collect();
    kept.sort_unstable();
    kept.dedup();
    kept.iter().map(|n| parry3d_f64::math::Vector::new(points[*n].x, points[*n].y, points[*n].z)).collect()
}

/// Moves the `solids` of an object to `pose`.
pub fn transformed(solids: &[Solid], pose: &Isometry3<f64>) -> Vec<Solid> {
    solids.iter().map(|solid| Solid { pose: pose * solid.pose, ..solid.clone() }).collect()
}

/// Solids that move with the palm (palm frame): the held object at a pose in it, with its digits at these angles.
pub(super) fn held_solids(hand: &Hand, held: &HeldObject, (pose, joints): (&Isometry3<f64>, &[f64])) -> Vec<Solid> {
    let mut moving = transformed(held.solids, pose);
    moving.extend(hand_solids(hand, joints, &held.digits, false));
    moving
}

/// Solids of the rest of the hand: its palm and the digits that hold nothing, in the palm frame.
pub(super) fn free_solids(hand: &Hand, held: &HeldObject) -> Vec<Solid> {
    let free: Vec<Digit> = hand.digits().iter().copied().filter(|digit| !held.digits.contains(digit)).collect();
    hand_solids(hand, &held.joints, &free, true)
}
