//! Palpation: free digits touch the second object before it is grasped, to find out where it is.
//!
//! Vision and arm err by as much as a finger is wide, and both err alike in the touch and in the grasp that follows it at the same
//! place. Index and middle finger, stretched out, come down on the object's rim from above, slowly, until a pad feels it. The
//! pads then show where the object is in the hand, as they do with a held one.

use grasping::{Grasp, Role};
use hand_model::{Digit, Hand};
use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use scenarios::geometry::Shape;
use touch::posture::digit_of;
use touch::{InHand, KnownShape, PoseEstimate, PosePrior, TouchError};

use crate::look::Look;
use crate::motion::approach::duration;
use crate::percept::Percept;
use crate::perception::KnownObject;
use crate::sensing::Senses;
use crate::trajectory::{PathError, PathLimits, PosePath};

/// Pads that touch: those in the outer half of the stretched fingers.
const PADS: [&str; 4] = ["index_middle", "index_distal", "middle_middle", "middle_distal"];
/// Cables' tensions while they touch, N: a slack cable tells nothing of its digit's posture.
pub const TENSION: [f64; 5] = [0.0, 1.0, 1.0, 0.0, 0.0];
/// Angle of each joint of the touching fingers under that tension, rad.
const CURL: f64 = 0.11;
/// Turn of the hand while it touches, rad, fingers down: what is held stays clear of the table.
const PITCH: f64 = 0.5;
/// The guarded motion begins so far before the object as it is seen and ends so far beyond, m.
const AROUND: (f64, f64) = (0.012, 0.018);
/// Mean speed of the guarded motion, m/s.
const SPEED: f64 = 0.015;
/// The hand comes from so far above, m.
pub const ABOVE: f64 = 0.06;

/// The palm's way onto an object.
#[derive(Debug, Clone)]
pub struct Touching {
    /// To where the guarded motion begins.
    pub way: PosePath,
    /// The guarded motion.
    pub onto: PosePath,
}

/// How the hand at `here` (`world_from_palm`) touches an object of this `shape` that is seen at `percept` and is to be grasped
/// with `grasp`: from above, turned about the vertical as it grasps.
pub fn touching(
    hand: &Hand,
    limits: &PathLimits,
    here: &Isometry3<f64>,
    grasp: &Grasp,
    (shape, percept): (&Shape, &Percept),
) -> Result<Touching, PathError> {
    let rotation = Grasp { pitch: PITCH, roll: 0.0, ..grasp.clone() }.palm_rotation(percept.yaw);
    let (middle, facing) = plate(hand);
    let (facing, pose) = (rotation * facing, percept.pose());
    let rim = pose * shape.support(&pose.inverse_transform_vector(&-facing));
    let at = |along: f64| {
        let place = rim.coords - rotation * middle.coords + facing * along;
        Isometry3::from_parts(Translation3::from(place), rotation)
    };
    let (before, beyond) = (at(-AROUND.0), at(AROUND.1));
    let above = Isometry3::from_parts(Translation3::from(before.translation.vector + Vector3::z() * ABOVE), rotation);
    let way = PosePath::new(vec![
        (0.0, *here),
        (duration(limits, here, &above), above),
        (duration(limits, &above, &before), before),
    ])?;
    let onto = PosePath::new(vec![(0.0, before), ((AROUND.0 + AROUND.1) / SPEED, beyond)])?;
    Ok(Touching { way, onto })
}

/// Whether a pad is one of those that touch.
pub fn touches(hand: &Hand, pad: usize) -> bool {
    PADS.contains(&hand.pads[pad].name.as_str())
}

/// The middle of the pads that touch and the way that they face, both in the palm frame, with the fingers stretched.
fn plate(hand: &Hand) -> (Point3<f64>, Vector3<f64>) {
    let links = hand.tree.forward(&[CURL; hand_model::HAND_JOINTS]);
    let places = hand.pads.iter().filter(|pad| PADS.contains(&pad.name.as_str()));
    let places: Vec<_> =
        places.map(|pad| pad.link.map_or(Isometry3::identity(), |link| links[link]) * pad.link_from_pad).collect();
    let middle = places.iter().map(|place| place.translation.vector).sum::<Vector3<f64>>() / places.len() as f64;
    let facing = places.iter().map(|place| place * Vector3::z()).sum::<Vector3<f64>>();
    (middle.into(), facing.normalize())
}

/// Where an object is in the hand that touches it with free digits; `None` if they feel nothing of it. `first` is what is held.
pub fn located(
    senses: &Senses,
    look: &Look,
    object: &KnownObject,
    prior: &PosePrior,
    first: InHand,
) -> Result<Option<PoseEstimate>, TouchError> {
    let (pipeline, shape) = (senses.pipeline(), object as &dyn KnownShape);
    let mut touches = senses.perceive(look)?.touches;
    pipeline.mark_own(&mut touches, look.servos, &[first, InHand { shape, prior: *prior }])?;
    let free = |pad: usize| digit_of(pipeline.hand().pads[pad].link).is_some_and(is_free);
    touches.retain(|touch| free(touch.pad));
    if touches.iter().all(|touch| touch.of_objects().next().is_none()) {
        return Ok(None);
    }
    pipeline.estimate_pose(&touches, look.servos, prior, shape).map(Some)
}

/// Whether a digit has no part in holding the first object.
fn is_free(digit: Digit) -> bool {
    Role::Second.digits().contains(&digit)
}
