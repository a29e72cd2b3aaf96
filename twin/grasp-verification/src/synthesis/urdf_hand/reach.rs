//! Reachability: the path of the open hand to the pose where it closes, checked backwards.
//!
//! The hand starts in its open posture at the object and draws back along a straight line until it is clear, first as
//! it is, then fully opened. A path is free if no point of the hand's surface enters the object or goes below the
//! table.

use dexterous_grasping::synthesis::energy::TablePlane;
use dexterous_grasping::synthesis::frames::{HandState, LinkFrames};
use nalgebra::{Isometry3, Rotation3, Unit, Vector3};

use crate::synthesis::grasping_hand::GraspingHand;
use crate::synthesis::subject::PreparedObject;

/// Tolerated penetration of the hand's points on the path, m, because the distance field is that coarse.
const PENETRATION_TOLERANCE: f64 = 1e-3;
/// Step of the path, m, and its length beyond the object's own size.
const PATH_STEP: f64 = 4e-3;
const PATH_MARGIN: f64 = 0.05;
/// Number of steps in which the hand opens before it draws back.
const OPENING_STEPS: usize = 10;
/// Angles (rad) between the retreat and the palm's own direction, and the number of directions at each.
const RETREAT_TILTS: [(f64, usize); 3] = [(0.0, 1), (std::f64::consts::FRAC_PI_4, 8), (std::f64::consts::FRAC_PI_2, 8)];

/// True if a free path leads to the object at `start` (`root_from_object`) with the joints at `open` (rad or m).
pub fn reachable(
    hand: &GraspingHand,
    subject: &PreparedObject,
    start: &Isometry3<f64>,
    open: &[f64],
    table: Option<&TablePlane>,
) -> bool {
    let object_from_palm = (hand.palm_from_root * start).inverse();
    let mut frames = LinkFrames::new(&hand.sampled.tree);
    let mut place = |joints: Vec<f64>| {
        frames.set_state(&HandState { object_from_palm, joints });
        let links = hand.sampled.surface.links.iter().enumerate();
        links
            .flat_map(|(link, own)| own.points.iter().map(|point| frames.point(link, point)).collect::<Vec<_>>())
            .collect()
    };
    let (low, high) = subject.field.extent();
    let far = (high - low).norm() + PATH_MARGIN;
    // The object comes along the palm's -z, so the hand draws back along its z.
    let back = object_from_palm.rotation * Vector3::z();
    let free =
        |points: &[Vector3<f64>]| retreat_directions(&back).any(|way| is_free(subject, points, &way, far, table));
    let as_it_is: Vec<Vector3<f64>> = place(open.to_vec());
    if free(&as_it_is) {
        return true;
    }
    let wide = hand.mechanism().rest_coordinates();
    for step in 1..=OPENING_STEPS {
        let share = step as f64 / OPENING_STEPS as f64;
        let joints = open.iter().zip(&wide).map(|(from, to)| from + share * (to - from)).collect();
        let points = place(joints);
        if !is_clear(subject, &points, &Vector3::zeros(), table) {
            return false;
        }
        if step == OPENING_STEPS {
            return free(&points);
        }
    }
    false
}

/// Returns the directions around `back`, the straight one first.
fn retreat_directions(back: &Vector3<f64>) -> impl Iterator<Item = Vector3<f64>> {
    let axis = Unit::new_normalize(*back);
    let helper = if axis.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() };
    let side = Unit::new_normalize(axis.cross(&helper));
    RETREAT_TILTS.iter().flat_map(move |(tilt, count)| {
        let tilted = Rotation3::from_axis_angle(&side, *tilt) * axis.into_inner();
        (0..*count)
            .map(move |n| Rotation3::from_axis_angle(&axis, std::f64::consts::TAU * n as f64 / *count as f64) * tilted)
    })
}

fn is_free(
    subject: &PreparedObject,
    points: &[Vector3<f64>],
    way: &Vector3<f64>,
    far: f64,
    table: Option<&TablePlane>,
) -> bool {
    let steps = (far / PATH_STEP).ceil() as usize;
    (0..=steps).all(|step| is_clear(subject, points, &(way * (PATH_STEP * step as f64)), table))
}

fn is_clear(
    subject: &PreparedObject,
    points: &[Vector3<f64>],
    shift: &Vector3<f64>,
    table: Option<&TablePlane>,
) -> bool {
    points.iter().all(|point| {
        let at = point + shift;
        subject.field.distance(&at) > -PENETRATION_TOLERANCE
            && table.is_none_or(|plane| at.dot(&plane.normal) > plane.offset - PENETRATION_TOLERANCE)
    })
}

#[cfg(test)]
mod tests;
