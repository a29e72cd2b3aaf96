//! Perception of holds: estimates from tactile images which objects are in the hand, and their poses in it.

use std::sync::Arc;

use dexterous_grasping::Grasp;
use hand_model::parameters::HoldLimits;
use hand_model::robot::ServoState;
use hand_model::{Digit, Hand};
use nalgebra::{Isometry3, Point3, Vector3};
use tactile_perception::pose::loaded_posture;
use tactile_perception::posture::{self, cable_excursion, cable_tension};
use tactile_perception::{
    CameraFault, ContactPatch, ExpectedObject, KnownShape, PadPerception, PadTouch, PoseEstimate, PosePrior,
    TouchError, TouchPipeline,
};
use world::geometry::{DistanceGrid, ObjectShape};
use world::layout::MAX_OBJECTS;
use world::objects::ObjectModel;

use crate::closure::{has_pads_throughout, stops_early};
use crate::detection::DetectedObject;
use crate::sensing::{TouchPerception, is_pad_on_digits};
use crate::tactile_snapshot::TactileSnapshot;

/// Standard deviations of the planned pose of an object in the hand, m and rad.
const PRIOR_SIGMA: (f64, f64) = (0.012, 0.35);
/// Lower bounds of these standard deviations for a grasp with a known distribution of holds, m and rad.
const MIN_PRIOR_SIGMA: (f64, f64) = (0.003, 0.08);

/// Cell size of the distance grids of meshes, and their margin around the shape, m.
const GRID_CELL_AND_MARGIN: (f64, f64) = (0.001, 0.012);

/// An object whose shape can be registered quickly: a mesh has a distance grid, which is computed where a distance is
/// asked for.
#[derive(Debug, Clone)]
pub struct KnownObject {
    pub model: Arc<ObjectModel>,
    grid: Option<DistanceGrid>,
}

impl KnownObject {
    pub fn new(model: Arc<ObjectModel>) -> Self {
        let is_mesh = matches!(model.shape, ObjectShape::Mesh(_));
        let grid = is_mesh.then(|| DistanceGrid::new(&model.shape, GRID_CELL_AND_MARGIN.0, GRID_CELL_AND_MARGIN.1));
        Self { model, grid }
    }

    /// Computes the whole distance grid, so that no decision has to wait for a part of it: 0.1 to 2 s for the
    /// benchmark's meshes.
    pub fn prepare(&self) {
        if let Some(grid) = &self.grid {
            grid.prepare();
        }
    }
}

impl KnownShape for KnownObject {
    fn signed_distance(&self, point: &Point3<f64>) -> (f64, Vector3<f64>) {
        match &self.grid {
            Some(grid) => grid.signed_distance(point),
            None => self.model.shape.signed_distance(point),
        }
    }

    fn distance(&self, point: &Point3<f64>) -> f64 {
        match &self.grid {
            Some(grid) => grid.distance(point),
            None => self.model.shape.signed_distance(point).0,
        }
    }
}

/// Pose estimate of an object.
#[derive(Debug, Clone)]
pub struct ObjectEstimate {
    /// Number of the object in the trial.
    pub object: usize,
    /// One entry a pad.
    pub touches: Vec<PadTouch>,
    /// Cameras that were left out, with the reasons.
    pub faults: Vec<CameraFault>,
    /// Estimate of the held object's pose.
    pub estimate: PoseEstimate,
    /// Planned `palm_from_object`.
    pub prior: Isometry3<f64>,
    /// Objects felt to be in the hand.
    pub hold_state: HoldState,
}

/// Set of the objects that are felt to be in the hand, in the order in which they are taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct HoldState([bool; MAX_OBJECTS]);

impl FromIterator<bool> for HoldState {
    fn from_iter<I: IntoIterator<Item = bool>>(held: I) -> Self {
        let mut grip = Self::default();
        grip.0.iter_mut().zip(held).for_each(|(place, held)| *place = held);
        grip
    }
}

/// Expected hold of an object.
#[derive(Debug, Clone, Copy)]
pub struct ExpectedHold<'a> {
    /// Digits that hold the object.
    pub digits: &'a [Digit],
    /// Joint angles of the verified hold, rad, if known.
    pub joints: Option<&'a [f64]>,
}

impl<'a> ExpectedHold<'a> {
    pub fn from_grasp(grasp: &'a Grasp) -> Self {
        Self { digits: &grasp.digits, joints: grasp.held_joints.as_deref() }
    }
}

/// Evidence on which objects are in the hand.
#[derive(Clone, Copy)]
pub struct HoldEvidence<'a> {
    pub limits: &'a HoldLimits,
    /// One entry a pad.
    pub touches: &'a [PadTouch],
    pub servos: &'a [ServoState],
    /// Joint angles, rad.
    pub q: &'a [f64],
    /// Expected holds, in the order in which the objects are taken.
    pub objects: &'a [ExpectedHold<'a>],
    /// Pads that rest on the first object.
    pub on_first: &'a [usize],
    /// Standard deviation of a cable excursion, m.
    pub sigma: f64,
}

impl HoldState {
    /// True if an object is in the hand.
    pub fn holds(&self, object: usize) -> bool {
        self.0.get(object).is_some_and(|held| *held)
    }

    /// Returns the first object up to the `last` that is not in the hand.
    pub fn first_missing(&self, last: usize) -> Option<usize> {
        (0..=last).find(|object| !self.holds(*object))
    }

    /// Decides which objects are held. An object counts as held if at least two of the parts that hold it feel
    /// something, or the only part that has pads. The parts are the digits and the palm for the first object, and the
    /// digits for a later one. Digits often hold with their sides, which bear no pads. An object therefore also counts
    /// as held if a cable shows that a finger did not close.
    ///
    /// A finger that takes no part in the verified hold of a later grasp, or that stops much later than in that hold,
    /// has met the thumb and not the object. The same holds for a finger that feels another part of the hand, or of
    /// which a pad rests on the first object: such contacts are no evidence of a later object. A finger with links that
    /// bear no pad is compared with its grasp's hold and with an empty closing ([`stops_early`]). Jaws can meet nothing
    /// else: a jaw that did not close holds the first object.
    pub fn from_evidence(hand: &Hand, signs: &HoldEvidence) -> Self {
        let HoldEvidence { limits, touches, servos, q, objects, on_first, sigma } = *signs;
        let of = |digit: Option<Digit>| {
            touches.iter().filter(move |touch| hand.digit_of(hand.pads[touch.pad].link) == digit)
        };
        let feels = |digit: Option<Digit>| of(digit).any(PadTouch::is_touched);
        let feels_later =
            |digit: Digit| of(Some(digit)).any(|touch| touch.is_touched() && !on_first.contains(&touch.pad));
        let rests = |digit: Digit| on_first.iter().any(|pad| hand.digit_of(hand.pads[*pad].link) == Some(digit));
        let expected = |object: &ExpectedHold, digit: Digit| {
            let path = &hand.transmission.cables[digit.index()];
            object.joints.map(|joints| path.excursion(joints) / full_excursion(hand, digit))
        };
        let feels_itself =
            |digit: Digit| of(Some(digit)).any(|touch| touch.patches.iter().any(|patch| patch.self_contact));
        let bare = |digit: Digit| !has_pads_throughout(hand, digit);
        let blocked = |digit: Digit| is_blocked(hand, limits, servos, digit) && !feels_itself(digit) && !rests(digit);
        let early = |object: &ExpectedHold, digit: Digit| {
            let servo = &servos[digit.index()];
            let pulled = cable_tension(hand, digit.index(), servo) > limits.pulled;
            pulled
                && !feels_itself(digit)
                && !rests(digit)
                && stops_early(hand, (digit, servo), q, object.joints, sigma)
        };
        let takes_part = |object: &ExpectedHold, digit: Digit| {
            digit == Digit::Thumb || bare(digit) || expected(object, digit).is_none_or(|share| share < limits.idle)
        };
        let stopped = |object: &ExpectedHold, digit: Digit| {
            if bare(digit) {
                return early(object, digit);
            }
            blocked(digit)
                && takes_part(object, digit)
                && expected(object, digit).is_none_or(|share| closure(hand, servos, digit) < share + limits.late)
        };
        // A closed thumb lies where the fingers of the first object close. Then only the pads count, or a digit with a
        // blind pad.
        let thumb = cable_tension(hand, Digit::Thumb.index(), &servos[Digit::Thumb.index()]) > limits.pulled;
        let blind = |digit: Digit| of(Some(digit)).any(|touch| touch.blind);
        let holds = |digit: &&Digit| feels(Some(**digit)) || blind(**digit) && !bare(**digit) && blocked(**digit);
        let has_pads = |digit: Option<Digit>| hand.pads.iter().any(|pad| hand.digit_of(pad.link) == digit);
        let first = |object: &ExpectedHold| {
            let digits = object.digits;
            let alone = !thumb || digits.contains(&Digit::Thumb);
            let keeps = |digit: Digit| if bare(digit) { early(object, digit) } else { alone && blocked(digit) };
            let feeling = digits.iter().filter(|digit| has_pads(Some(**digit))).count() + usize::from(has_pads(None));
            let holding = digits.iter().filter(holds).count() + usize::from(feels(None));
            holding >= feeling.clamp(1, 2) || digits.iter().any(|digit| keeps(*digit))
        };
        let later = |object: &ExpectedHold| {
            let taking = object.digits.iter().filter(|digit| takes_part(object, **digit) && feels_later(**digit));
            taking.count() >= 2 || object.digits.iter().any(|digit| *digit != Digit::Thumb && stopped(object, *digit))
        };
        objects.iter().enumerate().map(|(n, object)| if n == 0 { first(object) } else { later(object) }).collect()
    }
}

/// True if something blocks a closing digit: its cable is taken up by less than a full closing. A digit that is not
/// pulled gives no evidence.
pub fn is_blocked(hand: &Hand, limits: &HoldLimits, servos: &[ServoState], digit: Digit) -> bool {
    let pulled = cable_tension(hand, digit.index(), &servos[digit.index()]) > limits.pulled;
    pulled && closure(hand, servos, digit) < limits.blocked
}

/// Closure of a digit, as a share of full closing.
fn closure(hand: &Hand, servos: &[ServoState], digit: Digit) -> f64 {
    cable_excursion(hand, digit.index(), &servos[digit.index()]) / full_excursion(hand, digit)
}

fn full_excursion(hand: &Hand, digit: Digit) -> f64 {
    hand.transmission.cables[digit.index()].full_excursion()
}

/// Expected holds of a trial's planned grasps, as far as perception needs them.
#[derive(Debug, Clone)]
pub struct ExpectedHolds<'a> {
    /// Planned `palm_from_object` of the first object.
    pub palm_from_object: Isometry3<f64>,
    /// Standard deviations of that position, m, and rotation, rad.
    sigma: (f64, f64),
    /// Expected hold of each object, in the order in which they are taken.
    pub objects: Vec<ExpectedHold<'a>>,
}

impl<'a> ExpectedHolds<'a> {
    /// Expectations from the `first` grasp and the ones after it; `detected` is the detected pose of the first object.
    pub fn from_grasps(
        first: &'a Grasp,
        detected: &DetectedObject,
        later: impl IntoIterator<Item = &'a Grasp>,
    ) -> Self {
        let objects = std::iter::once(first).chain(later).map(ExpectedHold::from_grasp).collect();
        let sigma = first.held_sigmas.map_or(PRIOR_SIGMA, |[place, turn]| {
            (place.clamp(MIN_PRIOR_SIGMA.0, PRIOR_SIGMA.0), turn.clamp(MIN_PRIOR_SIGMA.1, PRIOR_SIGMA.1))
        });
        Self { palm_from_object: pose_in_hand(first, detected), sigma, objects }
    }

    /// Prior of the first object's pose in the hand.
    pub fn prior(&self) -> PosePrior {
        let (sigma_translation, sigma_rotation) = self.sigma;
        PosePrior { palm_from_object: self.palm_from_object, sigma_translation, sigma_rotation }
    }
}

/// Planned `palm_from_object` of an object at `detected` after `grasp`.
pub fn pose_in_hand(grasp: &Grasp, detected: &DetectedObject) -> Isometry3<f64> {
    grasp.held.unwrap_or_else(|| grasp.palm_pose(&detected.position, detected.yaw).inverse() * detected.pose())
}

/// Interprets a tactile snapshot of the hand with `object` as the first object.
pub fn estimate_hold(
    senses: &TouchPerception,
    snapshot: &TactileSnapshot,
    object: &KnownObject,
    expected: &ExpectedHolds,
) -> Result<ObjectEstimate, TouchError> {
    let pipeline = senses.pipeline();
    let PadPerception { mut touches, faults } = senses.perceive(snapshot)?;
    let prior = expected.prior();
    pipeline.mark_self_contacts(&mut touches, snapshot.readings, &[ExpectedObject { shape: object, prior }])?;
    let estimate = pipeline.estimate_pose(&touches, snapshot.readings, &prior, object)?;
    let (servos, q, sigma) = (snapshot.readings.servos, &estimate.q[..], excursion_sigma(pipeline));
    let (limits, objects) = (senses.hold_limits(), &expected.objects[..]);
    let signs = HoldEvidence { limits, touches: &touches, servos, q, objects, on_first: &[], sigma };
    let grip = HoldState::from_evidence(pipeline.hand(), &signs);
    Ok(ObjectEstimate { object: 0, touches, faults, estimate, prior: prior.palm_from_object, hold_state: grip })
}

/// Interprets a tactile snapshot, already perceived, of a hand that holds each object with its own digits, and
/// estimates the pose of each. Every object is given by its number, its shape, its digits and its expected
/// `palm_from_object`.
pub fn estimate_each_hold(
    senses: &TouchPerception,
    snapshot: &TactileSnapshot,
    (PadPerception { mut touches, faults }, grip): (PadPerception, HoldState),
    objects: &[(usize, &KnownObject, &[Digit], Isometry3<f64>)],
) -> Result<Vec<ObjectEstimate>, TouchError> {
    let (pipeline, hand) = (senses.pipeline(), senses.pipeline().hand());
    let in_hand: Vec<ExpectedObject> = objects
        .iter()
        .map(|(_, shape, _, place)| ExpectedObject { shape: *shape as &dyn KnownShape, prior: default_prior(*place) })
        .collect();
    pipeline.mark_self_contacts(&mut touches, snapshot.readings, &in_hand)?;
    let pads = hand.pad_poses(&hand.tree.forward(&loaded_posture(hand, &touches, snapshot.readings, &pipeline.pose)?));
    // Each patch belongs to the nearest object. A digit keeps its patches for the object it holds, unless they lie on
    // another one.
    let owner = |pad: usize, patch: &ContactPatch| {
        let nearest = nearest_object(&in_hand, &pads[pad], patch)?;
        let holds = objects.iter().position(|(_, _, digits, _)| is_pad_on_digits(hand, pad, digits));
        Some(holds.filter(|_| nearest.1 > senses.hold_limits().near).unwrap_or(nearest.0))
    };
    let mut felt = Vec::with_capacity(objects.len());
    for (n, (object, shape, digits, place)) in objects.iter().enumerate() {
        let mut own: Vec<PadTouch> = touches.clone();
        own.iter_mut().for_each(|touch| touch.patches.retain(|patch| owner(touch.pad, patch) == Some(n)));
        let on_palm = |pad: usize| hand.pads[pad].link.is_none();
        own.retain(|touch| {
            on_palm(touch.pad) || is_pad_on_digits(hand, touch.pad, digits) || !touch.patches.is_empty()
        });
        let estimate = pipeline.estimate_pose(&own, snapshot.readings, &in_hand[n].prior, *shape)?;
        let faults = if n == 0 { faults.clone() } else { Vec::new() };
        felt.push(ObjectEstimate { object: *object, touches: own, faults, estimate, prior: *place, hold_state: grip });
    }
    Ok(felt)
}

/// Returns the object whose surface is nearest to a patch on a pad, and the mean distance (m) of the patch from it.
fn nearest_object(
    objects: &[ExpectedObject],
    palm_from_pad: &Isometry3<f64>,
    patch: &ContactPatch,
) -> Option<(usize, f64)> {
    let distance = |object: &ExpectedObject| {
        let object_from_pad = object.prior.palm_from_object.inverse() * palm_from_pad;
        let apart =
            patch.points.iter().map(|felt| object.shape.signed_distance(&(object_from_pad * felt.point)).0.abs());
        apart.sum::<f64>() / patch.points.len().max(1) as f64
    };
    objects.iter().map(distance).enumerate().min_by(|a, b| a.1.total_cmp(&b.1))
}

/// Prior for a planned pose of an object in the hand, with the default standard deviations.
pub fn default_prior(palm_from_object: Isometry3<f64>) -> PosePrior {
    PosePrior { palm_from_object, sigma_translation: PRIOR_SIGMA.0, sigma_rotation: PRIOR_SIGMA.1 }
}

/// Determines from a tactile snapshot which objects are in the hand; `objects` are the expected ones, the first one
/// first.
pub fn detect_hold_state(
    senses: &TouchPerception,
    snapshot: &TactileSnapshot,
    expected: &ExpectedHolds,
    objects: &[ExpectedObject],
) -> Result<HoldState, TouchError> {
    let PadPerception { mut touches, .. } = senses.perceive(snapshot)?;
    senses.pipeline().mark_self_contacts(&mut touches, snapshot.readings, objects)?;
    let (pipeline, hand) = (senses.pipeline(), senses.pipeline().hand());
    let q = loaded_posture(hand, &touches, snapshot.readings, &pipeline.pose)?;
    let free: Vec<Digit> = expected.objects.iter().skip(1).flat_map(|object| object.digits.iter().copied()).collect();
    let on_first =
        objects.first().map_or(Vec::new(), |first| pads_on_object(hand, &q, first, &free, senses.hold_limits().near));
    let (servos, sigma) = (snapshot.readings.servos, excursion_sigma(pipeline));
    let (limits, objects) = (senses.hold_limits(), &expected.objects[..]);
    let signs = HoldEvidence { limits, touches: &touches, servos, q: &q, objects, on_first: &on_first, sigma };
    Ok(HoldState::from_evidence(hand, &signs))
}

/// Standard deviation of a measured cable excursion, m.
fn excursion_sigma(pipeline: &TouchPipeline) -> f64 {
    posture::excursion_sigma(pipeline.hand(), pipeline.pose.sigma_excursion, &pipeline.pose.cables)
}

/// Pads of `free` digits that are on the first object, or nearer than `near` (m), with the joints at `q` (rad).
fn pads_on_object(hand: &Hand, q: &[f64], first: &ExpectedObject, free: &[Digit], near: f64) -> Vec<usize> {
    let object_from_palm = first.prior.palm_from_object.inverse();
    let pads = hand.pad_poses(&hand.tree.forward(q));
    let on_it = |pad: &usize| {
        let middle = object_from_palm * pads[*pad] * Point3::origin();
        is_pad_on_digits(hand, *pad, free) && first.shape.signed_distance(&middle).0 < near
    };
    (0..pads.len()).filter(on_it).collect()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use hand_model::ActuatorVector;

    /// Servo readings of a hand whose cables are pulled with `tension` (N) and taken up by `share` of a full closing,
    /// thumb first.
    fn pulled(hand: &Hand, share: [f64; 5], tension: f64) -> ActuatorVector<ServoState> {
        let cable = &hand.parameters.cable;
        hand.each_actuator(|n| {
            let full = hand.transmission.cables.get(n).map_or(0.0, |cable| cable.full_excursion());
            let wound = share.get(n).unwrap_or(&0.0) * full + tension / cable.stiffness;
            let current = tension * cable.spool_radius / hand.parameters.servo.torque_constant;
            ServoState { position: wound / cable.spool_radius, velocity: 0.0, current, temperature: 25.0 }
        })
    }

    pub(crate) fn servos(hand: &Hand, share: [f64; 5]) -> ActuatorVector<ServoState> {
        pulled(hand, share, 10.0)
    }

    /// Hold state from the servos alone, with the verified hold of the second grasp.
    fn hold_state_from_servos(hand: &Hand, servos: &[ServoState], second: Option<&[f64]>) -> HoldState {
        let (q, sets) = (hand.open_angles(), dexterous_grasping::digit_sets(hand, 2));
        let objects =
            [ExpectedHold { digits: &sets[0], joints: None }, ExpectedHold { digits: &sets[1], joints: second }];
        let (limits, objects) = (&hand.parameters.hold().expect("signs of a hold"), &objects);
        HoldState::from_evidence(
            hand,
            &HoldEvidence { limits, touches: &[], servos, q: &q, objects, on_first: &[], sigma: 1.5e-4 },
        )
    }

    /// A digit without power stays open, which does not count as an object.
    #[test]
    fn a_slack_finger_holds_nothing() {
        let hand = Hand::ftac();
        let slack = hold_state_from_servos(&hand, &pulled(&hand, [0.0; 5], 0.0), None);
        assert_eq!(slack, HoldState::default());
    }

    /// Fingers that close completely hold nothing; an index finger that stops halfway does.
    #[test]
    fn a_blocked_finger_holds_something() {
        let hand = Hand::ftac();
        let closed = hold_state_from_servos(&hand, &servos(&hand, [1.0; 5]), None);
        assert_eq!(closed, HoldState::default());
        let blocked = hold_state_from_servos(&hand, &servos(&hand, [1.0, 0.5, 1.0, 1.0, 1.0]), None);
        assert_eq!(blocked, HoldState::from_iter([false, true]));
    }

    /// A middle finger that stops later than at its verified hold has met the thumb, and so has one that takes no part
    /// in the grasp.
    #[test]
    fn a_finger_that_met_the_thumb_holds_nothing() {
        let hand = Hand::ftac();
        let held = |middle: f64| {
            let mut joints = hand.open_angles();
            for joint in Digit::Index.ftac_joints() {
                joints[joint] = 0.6;
            }
            for joint in Digit::Middle.ftac_joints() {
                joints[joint] = middle;
            }
            joints
        };
        let stopped = servos(&hand, [0.7, 1.0, 0.7, 1.0, 1.0]);
        let second = |middle: f64| hold_state_from_servos(&hand, &stopped, Some(&held(middle)[..])).holds(1);
        assert!(second(1.0));
        assert!(!second(0.4) && !second(1.55));
    }
}
