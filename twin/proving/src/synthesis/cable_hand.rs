//! Synthesis for the hand of cables: contacts on its pads, a tension for each digit.

use std::sync::Arc;

use anyhow::Result;
use grasping::synthesis::frames::{Frames, HandState};
use grasping::synthesis::held::{ClosedPose, DigitUse, HeldGrasp, Proof, pose_to_array};
use grasping::synthesis::mechanism::Mechanism;
use grasping::synthesis::posture::{self, FreePosture};
use grasping::synthesis::surface::HandSurface;
use hand_model::{Digit, Hand};
use nalgebra::{Isometry3, Point3, Vector3};
use sim::hand_scene::HandScene;

use super::checks;
use super::closing::{Closed, contact};
use super::grasping_hand::{GraspingHand, SampledHand};
use super::hands::BestGrasp;
use super::search::Report;
use super::size::Opening;
use super::subject::Subject;
use super::synthesizer::Checked;

/// Points on the hand's surface.
const SURFACE_POINTS: usize = 2000;

/// The hand with its surface.
pub struct CableHand {
    pub hand: Arc<Hand>,
    sampled: SampledHand,
}

impl CableHand {
    pub fn new(hand: Arc<Hand>) -> Self {
        let (tree, mechanism) = (hand.tree.clone(), Mechanism::of(&hand));
        Self { sampled: SampledHand { tree, mechanism, surface: HandSurface::new(&hand, SURFACE_POINTS) }, hand }
    }

    /// Digits in contact, and the others.
    fn digits(&self, closed: &Closed) -> (Vec<Digit>, Vec<Digit>) {
        let touching = |digit: &Digit| {
            closed.touches.iter().any(|touch| touch.link.is_some_and(|link| self.hand.links(*digit).contains(&link)))
        };
        self.hand.digits().iter().copied().partition(touching)
    }

    /// Least distance of the free digits' surfaces from the object, m.
    fn room(&self, subject: &Subject, closed: &Closed, free: &[Digit]) -> Option<f64> {
        let object_from_palm = closed.scene.object().inverse();
        let links = self.hand.tree.forward(closed.scene.angles());
        let distances = free.iter().flat_map(|digit| self.hand.links(*digit)).flat_map(|&link| {
            let object_from_link = object_from_palm * links[link];
            let field = &subject.field;
            let points = &self.sampled.surface.links[link + 1].points;
            points.iter().map(move |p| field.distance(&(object_from_link * Point3::from(*p)).coords))
        });
        distances.reduce(f64::min)
    }
}

impl GraspingHand for CableHand {
    const TENSIONS: (f64, f64) = (6.0, 40.0);

    fn sampled(&self) -> &SampledHand {
        &self.sampled
    }

    fn opening(&self) -> Opening {
        Opening::ours()
    }

    fn closing(&self, contacts: &[usize]) -> Vec<bool> {
        let on = |joint: &usize| contacts.iter().any(|c| joint + 1 == self.sampled.surface.candidates[*c].link);
        self.hand.digits().iter().map(|digit| self.hand.links(*digit).iter().any(on)).collect()
    }

    fn open_clear(
        &self,
        subject: &Subject,
        frames: &mut Frames,
        sample: &HandState,
    ) -> Option<(Isometry3<f64>, FreePosture)> {
        let opened = posture::open_clear(&self.hand, &self.sampled.surface, &subject.field, frames, sample)?;
        Some((opened.state.object_from_palm.inverse(), opened.open))
    }

    fn scene(&self, subject: &Subject, start: &Isometry3<f64>, joints: &[f64]) -> HandScene {
        HandScene::new(&self.hand, &subject.model, start, joints)
    }

    fn margin(&self, subject: &Subject, closed: &Closed) -> Result<f64> {
        checks::margin(subject, closed)
    }

    fn penetration(&self, subject: &Subject, closed: &Closed) -> f64 {
        checks::penetration(&self.hand, &self.sampled.surface, subject, closed)
    }

    fn report(&self) -> Report {
        Report { hand: "F-TAC".into(), ..Report::default() }
    }

    fn count(&self, checked: &Checked, report: &mut Report) {
        for digit in self.digits(&checked.closed).0 {
            *report.digits.entry(digit.name()).or_default() += 1;
        }
    }

    fn record(&self, subject: &Subject, chain: u64, checked: &Checked) -> HeldGrasp {
        let closed = &checked.closed;
        let palm_from_object = closed.scene.object();
        let (digits, free) = self.digits(closed);
        let facing = palm_from_object.inverse_transform_vector(&-Vector3::z());
        HeldGrasp {
            object: subject.model.name.clone(),
            chain,
            closed: ClosedPose::PalmFromObject(pose_to_array(&palm_from_object)),
            joints: closed.scene.angles().iter().copied().collect(),
            start: pose_to_array(&closed.start),
            open_joints: closed.open.joints.iter().copied().collect(),
            open_tensions: None,
            tensions: closed.pull.tensions.iter().copied().collect(),
            opposition: Some(closed.pull.opposition),
            contacts: closed.touches.iter().map(|touch| contact(touch, &touch.point)).collect(),
            digit_use: Some(DigitUse {
                palm: closed.touches.iter().any(|touch| touch.link.is_none()),
                room: self.room(subject, closed, &free),
                digits,
                approach: facing.into(),
            }),
            margin: checked.margin,
            penetration: checked.penetration,
            held_without_tension: None,
            moved: Some(closed.moved.into()),
            energy: Some(checked.sample.terms.total),
            proof: None,
        }
        .rounded()
    }

    fn prove(&self, _: &Checked, proof: Proof, grasp: &mut HeldGrasp) {
        grasp.proof = Some(proof);
        *grasp = grasp.clone().rounded();
    }

    fn reopened(&self, grasp: &HeldGrasp) -> (FreePosture, Vec<f64>) {
        (posture::project(&self.hand, &grasp.open_joints), grasp.tensions.to_vec())
    }

    fn in_palm_frame(&self, grasp: &HeldGrasp) -> BestGrasp {
        BestGrasp {
            palm_from_object: *grasp.closed,
            joints: grasp.joints.to_vec(),
            contacts: grasp.contacts.iter().map(|contact| contact.point).collect(),
            margin: grasp.margin,
        }
    }
}
