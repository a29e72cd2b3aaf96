//! Pose of a hand's palm, and the opening of its fingers.

use anyhow::{Context, Result};
use dexterous_grasping::synthesis::frames::PIVOT;
use dexterous_grasping::synthesis::mechanism::Mechanism;
use dexterous_grasping::synthesis::surface::ContactCandidate;
use hand_model::hand_mechanism::HandMechanism;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::super::solids::LinkShapes;
use super::{CLOSING_STEPS, MIN_MOTION, pose};

/// Cosine between a contact candidate's normal and the direction to another candidate above which the two face each
/// other.
const MIN_FACING_COSINE: f64 = 0.8;

/// Returns the palm frame. Its pivot is on `place`, and its -z is the direction of the pulls file, or else away from
/// the palm's nearest surface.
pub fn palm_frame(
    hand: &HandMechanism,
    shapes: &LinkShapes,
    place: &Point3<f64>,
    notes: &mut Vec<String>,
) -> Result<Isometry3<f64>> {
    let named = shapes[0].iter().any(|part| part.bears);
    let nearest = shapes[0]
        .iter()
        .filter(|part| part.bears || !named)
        .map(|part| {
            let (distance, outward) = part.shape.signed_distance(&part.pose.inverse_transform_point(place));
            (distance, part.pose * outward)
        })
        .min_by(|a, b| a.0.total_cmp(&b.0));
    let (distance, facing) = match (nearest, hand.palm.facing) {
        (nearest, Some(facing)) => (nearest.map_or(0.0, |(distance, _)| distance), facing),
        (Some((distance, facing)), None) if distance > 0.0 => (distance, facing),
        _ => {
            let facing =
                place.coords.try_normalize(1e-6).context("root: found no shape and no direction to the fingers")?;
            notes.push(
                "WARNING root: no collision shape behind the fingers, they are taken to face away from its origin; \
                 `facing` in the pulls file's [palm] says it"
                    .into(),
            );
            (place.coords.norm(), facing)
        }
    };
    notes.push(format!(
        "the fingers close on [{:.3}, {:.3}, {:.3}] m, {:.0} mm before the root, facing [{:.2}, {:.2}, {:.2}]",
        place.x,
        place.y,
        place.z,
        1e3 * distance,
        facing.x,
        facing.y,
        facing.z
    ));
    let turn = UnitQuaternion::rotation_between(&facing, &-Vector3::z())
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
    Ok(Isometry3::from_parts(Translation3::from(PIVOT - turn * place.coords), turn))
}

/// Returns a warning if closing moves the last links away from the palm. The palm's facing was then found from another
/// part of the root, or the arms' signs open the hand.
pub fn facing_warning(
    hand: &HandMechanism,
    mechanism: &Mechanism,
    closing_motion: &[Vec<f64>],
    palm_from_root: &Isometry3<f64>,
) -> Option<String> {
    let moved = mechanism.lines.iter().flat_map(|line| line.joints.iter().copied());
    let tips: Vec<usize> =
        moved.filter(|joint| !hand.tree.joints.iter().any(|other| other.parent == Some(*joint))).collect();
    let (before, after) = (&closing_motion[CLOSING_STEPS / 2], &closing_motion[CLOSING_STEPS]);
    let way: Vector3<f64> = tips
        .iter()
        .map(|tip| {
            let ball = Point3::from(hand.masses[*tip].com);
            pose(hand, after, tip + 1) * ball - pose(hand, before, tip + 1) * ball
        })
        .sum();
    let away = -(palm_from_root * way).z / tips.len() as f64;
    (away > MIN_MOTION).then(|| {
        format!(
            "WARNING palm: the closing fingertips go {:.0} mm the way it faces; is an arm's sign wrong, or its facing, which `facing` in the \
             pulls file's [palm] says?",
            1e3 * away
        )
    })
}

/// Returns the opening, m: the largest distance of two candidates that face each other, on different digits or on a
/// digit and the palm, which is the width of the widest object between them. Without such a pair, it is the largest
/// distance of candidates on different digits.
pub fn opening(hand: &HandMechanism, closing_motion: &[Vec<f64>], candidates: &[ContactCandidate]) -> f64 {
    let digit = |link: usize| link.checked_sub(1).map(|joint| hand.tree.chain(joint)[0]);
    let (mut facing, mut any) = (0.0f64, 0.0f64);
    for joints in closing_motion {
        let placed: Vec<(Option<usize>, Point3<f64>, Vector3<f64>)> = candidates
            .iter()
            .map(|at| {
                let pose = pose(hand, joints, at.link);
                (digit(at.link), pose * Point3::from(at.point), pose * at.normal)
            })
            .collect();
        for (n, (digit, point, normal)) in placed.iter().enumerate() {
            for (other, there, back) in placed[n + 1..].iter().filter(|(other, ..)| other != digit) {
                let way = there - point;
                let distance = way.norm();
                if digit.is_some() && other.is_some() {
                    any = any.max(distance);
                }
                let (out, home) = (normal.dot(&way), -back.dot(&way));
                if out.min(home) > MIN_FACING_COSINE * distance {
                    // Across the object, not along a diagonal.
                    facing = facing.max(out.min(home));
                }
            }
        }
    }
    if facing > 0.0 { facing } else { any }
}
