//! Records of verified grasps, and their counts in a search's report.

use dexterous_grasping::synthesis::held::{ClosedPose, DigitUse, HeldGrasp, NamedValues, VerifiedLoad, pose_to_array};
use hand_model::{Digit, Hand};
use nalgebra::{Point3, Vector3};
use sim::hand_scene::SceneContact;

use super::checks;
use super::closing::{ClosedGrasp, held_contact};
use super::grasping_hand::GraspingHand;
use super::report::{DerivedHandCounts, SynthesisReport};
use super::subject::PreparedObject;
use super::synthesizer::CheckedGrasp;
use super::urdf_hand::refusal;

/// Creates an empty report of a search.
pub fn report(hand: &GraspingHand) -> SynthesisReport {
    let judgement = hand.derived_surface.as_ref().map(|_| DerivedHandCounts::default());
    SynthesisReport { hand: hand.name().into(), notes: hand.notes.clone(), judgement, ..SynthesisReport::default() }
}

/// Counts a verified grasp in the report.
pub fn count(hand: &GraspingHand, checked: &CheckedGrasp, report: &mut SynthesisReport) {
    let ClosedGrasp { scene, touches, .. } = &checked.closed;
    if let Some(named) = &hand.named_hand {
        for digit in digits(named, touches).0 {
            *report.digits.entry(digit.name()).or_default() += 1;
        }
    }
    if let (Some(found), Some(judgement)) = (&hand.derived_surface, &mut report.judgement) {
        let links = scene.links();
        let gaps = touches.iter().map(|touch| refusal::surface_gap(found, &links, touch));
        judgement.surface_gap = gaps.fold(judgement.surface_gap, f64::max);
        judgement.opposed += u64::from(refusal::has_opposed_digits(hand, touches));
    }
}

/// Returns the record of a verified grasp without its verified load.
pub fn to_held_grasp(hand: &GraspingHand, subject: &PreparedObject, chain: u64, checked: &CheckedGrasp) -> HeldGrasp {
    let (closed, mechanism, named) = (&checked.closed, hand.mechanism(), hand.named_hand.is_some());
    let (pose, links) = (pose_to_array(&closed.scene.object()), closed.scene.links());
    let values = |names: Vec<String>, values: &[f64]| NamedValues {
        names: if named { Vec::new() } else { names },
        values: values.to_vec(),
    };
    let by_joint = |angles| values(mechanism.tree.joints.iter().map(|joint| joint.name.clone()).collect(), angles);
    let by_pull = |tensions| values(mechanism.actuators.iter().map(|pull| pull.name.clone()).collect(), tensions);
    let on_surface = |touch: &SceneContact| match &hand.derived_surface {
        Some(found) => refusal::on_surface(found, &links, touch),
        None => touch.point,
    };
    HeldGrasp {
        object: subject.model.name.clone(),
        chain,
        closed: if named { ClosedPose::PalmFromObject(pose) } else { ClosedPose::RootFromObject(pose) },
        joints: by_joint(closed.scene.angles()),
        start: pose_to_array(&closed.start),
        open_joints: by_joint(&closed.open.joints),
        open_tensions: (!named).then(|| by_pull(&closed.open.tensions)),
        tensions: by_pull(&closed.pull.tensions),
        opposition: named.then_some(closed.pull.opposition),
        contacts: closed.touches.iter().map(|touch| held_contact(touch, &on_surface(touch))).collect(),
        digit_use: hand.named_hand.as_ref().map(|named| digit_use(hand, named, subject, closed)),
        margin: checked.margin,
        penetration: checked.penetration,
        held_without_tension: None,
        moved: named.then(|| closed.moved.into()),
        energy: named.then_some(checked.sample.terms.total),
        verified_load: None,
    }
    .at_file_precision()
}

fn digit_use(hand: &GraspingHand, named: &Hand, subject: &PreparedObject, closed: &ClosedGrasp) -> DigitUse {
    let (digits, free) = digits(named, &closed.touches);
    let object_from_palm = closed.scene.object().inverse();
    let links = named.tree.forward(closed.scene.angles());
    let distances = free.iter().flat_map(|digit| named.links(*digit)).flat_map(|&link| {
        let object_from_link = object_from_palm * links[link];
        let points = &hand.sampled.surface.links[link + 1].points;
        points.iter().map(move |p| subject.field.distance(&(object_from_link * Point3::from(*p)).coords))
    });
    DigitUse {
        room: distances.reduce(f64::min),
        palm: closed.touches.iter().any(|touch| touch.link.is_none()),
        approach: closed.scene.object().inverse_transform_vector(&-Vector3::z()).into(),
        digits,
    }
}

/// Completes a record with its verified load.
pub fn add_verification(
    hand: &GraspingHand,
    checked: &CheckedGrasp,
    verification: VerifiedLoad,
    grasp: &mut HeldGrasp,
) {
    let slack = || checks::run_hold_test(&checked.closed.slack(), checked.mass).held;
    grasp.held_without_tension = hand.derived_surface.as_ref().map(|_| slack());
    grasp.verified_load = Some(verification);
    *grasp = grasp.clone().at_file_precision();
}

/// Returns the digits in contact, and the others.
fn digits(hand: &Hand, touches: &[SceneContact]) -> (Vec<Digit>, Vec<Digit>) {
    let touching =
        |digit: &Digit| touches.iter().any(|touch| touch.link.is_some_and(|link| hand.links(*digit).contains(&link)));
    hand.digits().iter().copied().partition(touching)
}
