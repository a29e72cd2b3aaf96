//! Synthesis for a hand that is known from its URDF and what pulls on its joints.
//!
//! [`describe`] finds surface, contact candidates and palm frame, and [`refusal`] says which of the grasps that pass the checks are
//! none of the hand as it is. [`kinds`] sorts what was found.

pub mod describe;
pub mod kinds;
mod open_posture;
mod reach;
pub mod refusal;

use anyhow::Result;
use grasping::force_closure::{Contact, soft_wrench_margin};
use grasping::synthesis::energy::Plane;
use grasping::synthesis::frames::{Frames, HandState};
use grasping::synthesis::held::{ClosedPose, HeldGrasp, Proof, Values, pose_from_array, pose_to_array};
use grasping::synthesis::posture::FreePosture;
use nalgebra::{Isometry3, Point3};
use sim::hand_scene::{HandScene, Touch};
use sim::stand::Prop;

use self::describe::Described;
use self::refusal::Refusal;
use super::checks::{self, TOTAL_FORCE};
use super::closing::{Closed, contact};
use super::grasping_hand::{GraspingHand, SampledHand};
use super::hands::BestGrasp;
use super::search::{Judgement, Report};
use super::size::Opening;
use super::subject::Subject;
use super::synthesizer::Checked;

/// Arm of the friction that a fingertip bears about its normal, m: 3 pi / 16 of the radius of its contact (Hertz), which is 5 mm for soft tips.
const TORSION_ARM: f64 = 3.0 * std::f64::consts::PI / 16.0 * 5e-3;
/// Torques count as forces at this arm, m: as far beside its middle as an object's weight may act.
const TORQUE_ARM: f64 = 0.01;

impl GraspingHand for Described {
    const TENSIONS: (f64, f64) = (8.0, 60.0);

    fn sampled(&self) -> &SampledHand {
        &self.sampled
    }

    fn opening(&self) -> Opening {
        Opening { width: self.opening, hand: self.hand.name.clone() }
    }

    fn closing(&self, _: &[usize]) -> Vec<bool> {
        vec![true; self.hand.pulls.len()]
    }

    fn open_clear(
        &self,
        subject: &Subject,
        frames: &mut Frames,
        sample: &HandState,
    ) -> Option<(Isometry3<f64>, FreePosture)> {
        let (state, amounts) = open_posture::open_clear(self, &subject.field, frames, sample)?;
        let start = self.palm_from_root.inverse() * state.object_from_palm.inverse();
        let amounts = amounts.iter().enumerate();
        let tensions = amounts.map(|(line, amount)| open_posture::holding(self, line, *amount)).collect();
        Some((start, FreePosture { tensions, opposition: 0.0, joints: state.joints }))
    }

    fn bearable(&self, tensions: Vec<f64>) -> Vec<f64> {
        self.hand.within_efforts(&tensions).0
    }

    fn scene(&self, subject: &Subject, start: &Isometry3<f64>, joints: &[f64]) -> HandScene {
        let mut scene = HandScene::of_urdf(&self.body, joints);
        let model = &subject.model;
        scene.put(&Prop::new(&model.name, model.shape.clone(), model.mass, model.friction), start);
        scene.release();
        scene
    }

    /// Of soft contacts, torques over [`TORQUE_ARM`].
    fn margin(&self, subject: &Subject, closed: &Closed) -> Result<f64> {
        let contact =
            |touch: &Touch| Contact { point: touch.point, normal: touch.normal, friction: subject.model.friction };
        let contacts: Vec<Contact> = closed.touches.iter().map(contact).collect();
        let center = closed.scene.object() * subject.field.center;
        Ok(soft_wrench_margin(&contacts, TORSION_ARM, &center, TORQUE_ARM, TOTAL_FORCE)?)
    }

    fn penetration(&self, _: &Subject, closed: &Closed) -> f64 {
        closed.scene.penetration()
    }

    fn refusal(&self, subject: &Subject, closed: &Closed, table: Option<&Plane>) -> Option<Refusal> {
        refusal::of(self, subject, closed, table)
    }

    fn report(&self) -> Report {
        let (hand, notes) = (self.hand.name.clone(), self.notes.clone());
        Report { hand, notes, judgement: Some(Judgement::default()), ..Report::default() }
    }

    fn count(&self, checked: &Checked, report: &mut Report) {
        let Some(judgement) = &mut report.judgement else { return };
        let Closed { scene, touches, .. } = &checked.closed;
        let links = scene.links();
        let gaps = touches.iter().map(|touch| refusal::gap(self, &links, touch));
        judgement.surface_gap = gaps.fold(judgement.surface_gap, f64::max);
        judgement.opposed += u64::from(refusal::opposes(self, touches));
    }

    fn record(&self, subject: &Subject, chain: u64, checked: &Checked) -> HeldGrasp {
        let closed = &checked.closed;
        let joints: Vec<String> = self.hand.tree.joints.iter().map(|joint| joint.name.clone()).collect();
        let pulls: Vec<String> = self.hand.pulls.iter().map(|pull| pull.name.clone()).collect();
        let by_joint = |angles: &[f64]| Values { names: joints.clone(), values: angles.to_vec() };
        let by_pull = |tensions: &[f64]| Values { names: pulls.clone(), values: tensions.to_vec() };
        let links = closed.scene.links();
        let contacts = closed.touches.iter().map(|touch| contact(touch, &refusal::on_surface(self, &links, touch)));
        let model = &subject.model;
        HeldGrasp {
            object: model.name.clone(),
            chain,
            closed: ClosedPose::RootFromObject(pose_to_array(&closed.scene.object())),
            joints: by_joint(closed.scene.angles()),
            start: pose_to_array(&closed.start),
            open_joints: by_joint(&closed.open.joints),
            open_tensions: Some(by_pull(&closed.open.tensions)),
            tensions: by_pull(&closed.pull.tensions),
            opposition: None,
            contacts: contacts.collect(),
            digit_use: None,
            margin: checked.margin,
            penetration: checked.penetration,
            held_without_tension: None,
            moved: None,
            energy: None,
            proof: None,
        }
    }

    fn prove(&self, checked: &Checked, proof: Proof, grasp: &mut HeldGrasp) {
        grasp.held_without_tension = Some(checks::hold(&checked.closed.slack(), checked.mass).held);
        grasp.proof = Some(proof);
    }

    fn reopened(&self, grasp: &HeldGrasp) -> (FreePosture, Vec<f64>) {
        let tensions = grasp.open_tensions.as_deref().unwrap_or_default().to_vec();
        (FreePosture { tensions, opposition: 0.0, joints: grasp.open_joints.to_vec() }, grasp.tensions.to_vec())
    }

    fn in_palm_frame(&self, grasp: &HeldGrasp) -> BestGrasp {
        let point = |point: &[f64; 3]| (self.palm_from_root * Point3::from(*point)).coords.into();
        BestGrasp {
            palm_from_object: pose_to_array(&(self.palm_from_root * pose_from_array(&grasp.closed))),
            joints: grasp.joints.to_vec(),
            contacts: grasp.contacts.iter().map(|contact| point(&contact.point)).collect(),
            margin: grasp.margin,
        }
    }
}
