//! Clearance between the hand, with the object it holds, and its surroundings along a planned motion.
//!
//! The hand is represented by its covers (rounded boxes) at given joint angles. All moving solids are rigid in the palm
//! frame while the palm follows a [`PosePath`]. Distances are signed; a negative one is a penetration depth. Meshes are
//! surfaces, not solids: a solid wholly inside a closed mesh is at a positive distance from it. Meshes of solids
//! must therefore be given as convex parts (`SharedShape::compound` of hulls).

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use hand_model::{Digit, Hand, hand::CoverShape};
use nalgebra::{Isometry3, Vector3};
use parry3d_f64::math::{Pose, Vector};
use parry3d_f64::query;
use parry3d_f64::shape::{Shape, SharedShape};
use thiserror::Error;

use crate::trajectory::PosePath;

/// Tolerance (m): excess of the reported clearance over the true minimum, if the number of steps allows it.
pub const CLEARANCE_TOLERANCE: f64 = 2e-4;

/// Error in a clearance computation.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum CollisionError {
    /// The geometry library has no distance between these two shapes.
    #[error("no distance is defined between the shapes of {moving} and {fixed}")]
    Unsupported {
        /// Name of the moving solid.
        moving: String,
        /// Name of the fixed solid.
        fixed: String,
    },
    /// A moving solid is unbounded.
    #[error("{0} is unbounded and cannot move")]
    Unbounded(String),
}

/// A body for collision checks: a core shape, grown by a margin, at a pose.
#[derive(Clone)]
pub struct Solid {
    /// Name for reports.
    pub name: String,
    /// Core shape.
    pub shape: SharedShape,
    /// Growth of the core on all sides, m: a rounding radius, plus a safety distance if one is wanted.
    pub margin: f64,
    /// `palm_from_solid` of a moving solid, `world_from_solid` of a fixed one.
    pub pose: Isometry3<f64>,
}

impl Solid {
    /// A solid with no margin.
    pub fn new(name: impl Into<String>, shape: SharedShape, pose: Isometry3<f64>) -> Self {
        Self { name: name.into(), shape, margin: 0.0, pose }
    }

    /// The same solid, grown by `margin` (m) on all sides.
    pub fn grown(mut self, margin: f64) -> Self {
        self.margin += margin;
        self
    }

    /// A box with rounded edges; `half` extents (m) include the rounding `radius` (m).
    pub fn rounded_box(name: impl Into<String>, half: Vector3<f64>, radius: f64, pose: Isometry3<f64>) -> Self {
        let radius = radius.min(half.min() * 0.999);
        let core = half.add_scalar(-radius);
        Self::new(name, SharedShape::cuboid(core.x, core.y, core.z), pose).grown(radius)
    }

    /// A sphere of this `radius` (m).
    pub fn ball(name: impl Into<String>, radius: f64, pose: Isometry3<f64>) -> Self {
        Self::new(name, SharedShape::ball(radius), pose)
    }

    /// A capsule of this `radius` (m) from the origin of its frame to `end` (m).
    pub fn capsule(name: impl Into<String>, end: &Vector3<f64>, radius: f64, pose: Isometry3<f64>) -> Self {
        Self::new(name, SharedShape::segment(Vector::ZERO, Vector::new(end.x, end.y, end.z)), pose).grown(radius)
    }

    /// The table: everything below z = `height` (m) of the world.
    pub fn table(height: f64) -> Self {
        Self::new("table", SharedShape::halfspace(Vector::Z), Isometry3::translation(0.0, 0.0, height))
    }

    fn cover(name: impl Into<String>, cover: &CoverShape, palm_from_link: &Isometry3<f64>) -> Self {
        Self::rounded_box(name, cover.half, cover.radius, palm_from_link * cover.link_from_cover)
    }
}

/// Covers of `digits` at `joint_angles` (rad), in the palm frame, and the cover of the palm if `palm`. The solids bear
/// the names of the links (`index_2`) and `palm`.
///
/// # Panics
/// If `joint_angles` has another length than the hand has joints.
pub fn hand_solids(hand: &Hand, joint_angles: &[f64], digits: &[Digit], palm: bool) -> Vec<Solid> {
    let links = hand.tree.forward(joint_angles);
    let of_digits = |link: usize| hand.digit_of(Some(link)).is_some_and(|digit| digits.contains(&digit));
    let fingers = hand.tree.joints.iter().enumerate().filter(|(link, _)| of_digits(*link));
    palm.then(|| Solid::cover("palm", &hand.palm_cover, &Isometry3::identity()))
        .into_iter()
        .chain(fingers.map(|(i, joint)| Solid::cover(joint.name.clone(), &hand.covers[i], &links[i])))
        .collect()
}

/// The closest approach.
#[derive(Debug, Clone, PartialEq)]
pub struct Clearance {
    /// Smallest distance, m; negative is penetration depth.
    pub min_distance: f64,
    /// Path time at which it occurs, s.
    pub time: f64,
    /// Name of the moving solid.
    pub moving: String,
    /// Name of the fixed solid.
    pub fixed: String,
    /// Number of distance queries.
    pub queries: usize,
}

/// Computes the smallest distance between the `moving` solids (palm frame) and the `fixed` ones (world frame) while the
/// palm follows `path`. `None` if there is no pair.
///
/// Branch and bound over time. No point of a solid moves faster than the path's speed bound and the solid's reach
/// allow, so the distances at both ends of an interval bound the distances in between from below. Intervals are halved,
/// the most promising first, until none can contain a distance lower than the best one less [`CLEARANCE_TOLERANCE`], or
/// until they are shorter than duration / `steps`.
pub fn clearance_along(
    path: &PosePath,
    moving: &[Solid],
    fixed: &[Solid],
    steps: usize,
) -> Result<Option<Clearance>, CollisionError> {
    let mut search = Search { path, queries: 0, best: None };
    let end = path.duration();
    let shortest = end / steps.max(1) as f64;
    let mut stretches = BinaryHeap::new();
    for a in moving {
        let sphere = a.shape.compute_local_bounding_sphere();
        // Farthest point of the solid from the palm's origin: a rotation moves no point faster than rate x reach.
        let center = a.pose.translation.vector.norm() + sphere.center.length();
        let reach = center + sphere.radius + a.margin;
        if !(reach.is_finite() && reach < 1e3) {
            return Err(CollisionError::Unbounded(a.name.clone()));
        }
        for b in fixed {
            let from = (0.0, search.distance(a, b, 0.0)?);
            if end > 0.0 {
                let to = (end, search.distance(a, b, end)?);
                stretches.push(PathInterval::new(path, Pair { a, b, reach }, from, to));
            }
        }
    }
    while let (Some(stretch), Some(best)) = (stretches.pop(), search.best.as_ref()) {
        if stretch.bound >= best.0 - CLEARANCE_TOLERANCE {
            break;
        }
        let (from, to) = (stretch.from, stretch.to);
        if to.0 - from.0 <= shortest {
            continue;
        }
        let time = 0.5 * (from.0 + to.0);
        let middle = (time, search.distance(stretch.pair.a, stretch.pair.b, time)?);
        stretches.push(PathInterval::new(path, stretch.pair, from, middle));
        stretches.push(PathInterval::new(path, stretch.pair, middle, to));
    }
    Ok(search.best.map(|(min_distance, time, a, b)| Clearance {
        min_distance,
        time,
        moving: a.name.clone(),
        fixed: b.name.clone(),
        queries: search.queries,
    }))
}

/// Branch-and-bound search with the best pair so far: distance (m), time (s), moving and fixed solid.
struct Search<'a> {
    path: &'a PosePath,
    queries: usize,
    best: Option<(f64, f64, &'a Solid, &'a Solid)>,
}

impl<'a> Search<'a> {
    fn distance(&mut self, a: &'a Solid, b: &'a Solid, time: f64) -> Result<f64, CollisionError> {
        let distance = signed_distance(a, &(self.path.sample(time).0 * a.pose), b)?;
        self.queries += 1;
        if self.best.is_none_or(|best| distance < best.0) {
            self.best = Some((distance, time, a, b));
        }
        Ok(distance)
    }
}

#[derive(Clone, Copy)]
struct Pair<'a> {
    a: &'a Solid,
    b: &'a Solid,
    /// Largest distance of the moving solid's points from the palm's origin, m.
    reach: f64,
}

/// Time interval of a pair: (time s, distance m) at both ends, and the lower bound (m) of the distance within.
struct PathInterval<'a> {
    pair: Pair<'a>,
    from: (f64, f64),
    to: (f64, f64),
    bound: f64,
}

impl<'a> PathInterval<'a> {
    fn new(path: &PosePath, pair: Pair<'a>, from: (f64, f64), to: (f64, f64)) -> Self {
        let mut moved = 0.0;
        let mut time = from.0;
        while time < to.0 {
            let bound = path.speed_bound(time);
            let until = bound.until.min(to.0);
            moved += (bound.linear + bound.angular * pair.reach) * (until - time);
            time = until;
        }
        Self { pair, from, to, bound: (0.5 * (from.1 + to.1 - moved)).min(from.1).min(to.1) }
    }
}

/// Orders intervals so that the lowest bound comes first out of a max-heap; ties by time, so that the search is
/// deterministic.
impl Ord for PathInterval<'_> {
    fn cmp(&self, other: &Self) -> Ordering {
        other.bound.total_cmp(&self.bound).then(other.from.0.total_cmp(&self.from.0))
    }
}

impl PartialOrd for PathInterval<'_> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for PathInterval<'_> {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for PathInterval<'_> {}

/// Computes the smallest distance while the palm rests at `world_from_palm`.
pub fn clearance_at(
    world_from_palm: &Isometry3<f64>,
    moving: &[Solid],
    fixed: &[Solid],
) -> Result<Option<Clearance>, CollisionError> {
    match PosePath::new(vec![(0.0, *world_from_palm)]) {
        Ok(path) => clearance_along(&path, moving, fixed, 1),
        Err(_) => Err(CollisionError::Unbounded("the palm".into())),
    }
}

/// Signed distance (m) between two solids, the first at `world_from_a`.
pub fn signed_distance(a: &Solid, world_from_a: &Isometry3<f64>, b: &Solid) -> Result<f64, CollisionError> {
    let (pose_a, pose_b) = (parry_pose(world_from_a), parry_pose(&b.pose));
    let core = if let Some(plane) = b.shape.as_halfspace() {
        over_plane(a.shape.as_ref(), &pose_b.inv_mul(&pose_a), plane.normal)
    } else if let Some(plane) = a.shape.as_halfspace() {
        over_plane(b.shape.as_ref(), &pose_a.inv_mul(&pose_b), plane.normal)
    } else {
        between(&pose_a, a.shape.as_ref(), &pose_b, b.shape.as_ref())
    };
    core.map(|distance| distance - a.margin - b.margin)
        .ok_or_else(|| CollisionError::Unsupported { moving: a.name.clone(), fixed: b.name.clone() })
}

fn between(pose_a: &Pose, a: &dyn Shape, pose_b: &Pose, b: &dyn Shape) -> Option<f64> {
    let distance = query::distance(pose_a, a, pose_b, b).ok()?.distance;
    if distance > 0.0 {
        return Some(distance);
    }
    let contact = query::contact(pose_a, a, pose_b, b, 0.0).ok()?;
    Some(contact.map_or(0.0, |contact| contact.dist.min(0.0)))
}

/// Signed height of the lowest point of a shape above the plane through the origin with this normal; exact.
fn over_plane(shape: &dyn Shape, plane_from_shape: &Pose, normal: Vector) -> Option<f64> {
    if let Some(support) = shape.as_support_map() {
        return Some(support.support_point(plane_from_shape, -normal).dot(normal));
    }
    if let Some(mesh) = shape.as_trimesh() {
        return mesh.vertices().iter().map(|v| plane_from_shape.transform_point(*v).dot(normal)).reduce(f64::min);
    }
    let mut lowest: Option<f64> = None;
    for (pose, part) in shape.as_compound()?.shapes() {
        let height = over_plane(part.as_ref(), &(*plane_from_shape * *pose), normal)?;
        lowest = Some(lowest.map_or(height, |h| h.min(height)));
    }
    lowest
}

/// Converts a pose to the type of the geometry library.
pub fn parry_pose(pose: &Isometry3<f64>) -> Pose {
    Pose::from_parts(pose.translation.into(), pose.rotation.into())
}

#[cfg(test)]
mod tests;
