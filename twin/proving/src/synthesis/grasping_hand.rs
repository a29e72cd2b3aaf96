//! The hand as the synthesis of grasps needs it: how it may touch, open, pull and hold.
//!
//! [`GraspingHand::of`] makes it of a hand whose digits and pads are known, [`super::urdf_hand::describe`] of any URDF.

use std::sync::Arc;

use anyhow::Result;
use grasping::force_closure::{Contact, soft_wrench_margin, wrench_margin};
use grasping::synthesis::energy::Plane;
use grasping::synthesis::frames::{Frames, HandState};
use grasping::synthesis::held::{ClosedPose, DigitUse, HeldGrasp, Proof, Values, pose_from_array, pose_to_array};
use grasping::synthesis::mechanism::Mechanism;
use grasping::synthesis::posture::{self, FreePosture};
use grasping::synthesis::surface::HandSurface;
use hand_model::hand_mechanism::HandMechanism;
use hand_model::kinematics::Tree;
use hand_model::{Digit, Hand};
use nalgebra::{Isometry3, Point3, Vector3};
use sim::collision_model::CollisionModel;
use sim::hand_scene::{HandScene, Touch};

use super::checks::{self, TOTAL_FORCE};
use super::closing::{Closed, contact};
use super::hands::BestGrasp;
use super::search::{Judgement, Report};
use super::size::Opening;
use super::subject::Subject;
use super::synthesizer::Checked;
use super::urdf_hand::describe::FoundSurface;
use super::urdf_hand::open_posture;
use super::urdf_hand::refusal::{self, Refusal};

/// Name of our own hand.
const OURS: &str = "F-TAC";
/// Points on the surface of a hand with pads.
const SURFACE_POINTS: usize = 2000;

/// A hand as it is sampled, in the palm frame: the object comes along -z.
pub struct SampledHand {
    pub tree: Tree,
    /// Joint limits and actuator lines.
    pub mechanism: Mechanism,
    /// Points, contact candidates, pairs of links that may collide.
    pub surface: HandSurface,
}

/// Forces that a contact bears.
#[derive(Debug, Clone, Copy)]
pub enum ContactModel {
    /// Friction along the surface; torques count over the object's size.
    Hard,
    /// Friction about the normal as well.
    Soft {
        /// Arm of that friction, m.
        torsion_arm: f64,
        /// Torques count as forces at this arm, m.
        torque_arm: f64,
    },
}

/// A hand for which grasps are synthesized.
pub struct GraspingHand {
    /// With its collision shapes.
    pub body: CollisionModel,
    /// `palm_from_root`.
    pub palm_from_root: Isometry3<f64>,
    pub sampled: SampledHand,
    /// The widest that it takes.
    pub opening: Opening,
    /// Range from which an actuator's tension is drawn, N.
    pub tensions: (f64, f64),
    pub contacts: ContactModel,
    /// The hand whose digits have names, each closed by a cable of its own; none of one from a URDF.
    pub named: Option<Arc<Hand>>,
    /// Surface and palm where they are found, not given; grasps are refused by them.
    pub found: Option<FoundSurface>,
    /// What was found, in words; warnings begin with `WARNING`.
    pub notes: Vec<String>,
}

impl GraspingHand {
    /// Of a hand that touches with its pads.
    pub fn of(hand: Arc<Hand>) -> Self {
        let (tree, mechanism) = (hand.tree.clone(), Mechanism::of(&hand));
        Self {
            body: CollisionModel::new(Arc::new(HandMechanism::of(&hand, OURS))),
            palm_from_root: Isometry3::identity(),
            sampled: SampledHand { tree, mechanism, surface: HandSurface::new(&hand, SURFACE_POINTS) },
            opening: Opening::ours(),
            tensions: (6.0, 40.0),
            contacts: ContactModel::Hard,
            named: Some(hand),
            found: None,
            notes: Vec::new(),
        }
    }

    /// Joints, links and actuators.
    pub fn mechanism(&self) -> &Arc<HandMechanism> {
        self.body.hand()
    }

    pub fn name(&self) -> &str {
        &self.mechanism().name
    }

    /// For each actuator, true if it closes a sample with these contact candidates: where digits have cables of their own, those in
    /// contact.
    pub fn closing(&self, contacts: &[usize]) -> Vec<bool> {
        let on = |joint: &usize| contacts.iter().any(|c| joint + 1 == self.sampled.surface.candidates[*c].link);
        match &self.named {
            Some(hand) => hand.digits().iter().map(|digit| hand.links(*digit).iter().any(on)).collect(),
            None => vec![true; self.mechanism().pulls.len()],
        }
    }

    /// The nearest posture that the actuators hold clear of the object, and `root_from_object` there; none if the hand is not cleared.
    pub fn open_clear(
        &self,
        subject: &Subject,
        frames: &mut Frames,
        sample: &HandState,
    ) -> Option<(Isometry3<f64>, FreePosture)> {
        if let Some(hand) = &self.named {
            let opened = posture::open_clear(hand, &self.sampled.surface, &subject.field, frames, sample)?;
            return Some((opened.state.object_from_palm.inverse(), opened.open));
        }
        let (state, amounts) = open_posture::open_clear(self, &subject.field, frames, sample)?;
        let start = self.palm_from_root.inverse() * state.object_from_palm.inverse();
        let amounts = amounts.iter().enumerate();
        let tensions = amounts.map(|(line, amount)| open_posture::holding(self, line, *amount)).collect();
        Some((start, FreePosture { tensions, opposition: 0.0, joints: state.joints }))
    }

    /// `tensions` (N) as far as the joints bear them.
    pub fn bearable(&self, tensions: &[f64]) -> Vec<f64> {
        self.mechanism().within_efforts(tensions).0
    }

    /// The hand with its joints at `joints` (rad or m) and the floating object at `start` (`root_from_object`).
    pub fn scene(&self, subject: &Subject, start: &Isometry3<f64>, joints: &[f64]) -> HandScene {
        let mut scene = HandScene::new(&self.body, joints);
        scene.place(&subject.model, start);
        scene
    }

    /// Wrench margin of a closed grasp, N.
    pub fn margin(&self, subject: &Subject, closed: &Closed) -> Result<f64> {
        let contact =
            |touch: &Touch| Contact { point: touch.point, normal: touch.normal, friction: subject.model.friction };
        let contacts: Vec<Contact> = closed.touches.iter().map(contact).collect();
        let center = closed.scene.object() * subject.field.center;
        Ok(match self.contacts {
            ContactModel::Hard => wrench_margin(&contacts, &center, subject.field.length, TOTAL_FORCE)?,
            ContactModel::Soft { torsion_arm, torque_arm } => {
                soft_wrench_margin(&contacts, torsion_arm, &center, torque_arm, TOTAL_FORCE)?
            }
        })
    }

    /// Deepest penetration in a closed grasp, m.
    pub fn penetration(&self, subject: &Subject, closed: &Closed) -> f64 {
        match &self.named {
            Some(hand) => checks::penetration(hand, &self.sampled.surface, subject, closed),
            None => closed.scene.penetration(),
        }
    }

    /// Reason to refuse a closed grasp that passed all checks.
    pub fn refusal(&self, subject: &Subject, closed: &Closed, table: Option<&Plane>) -> Option<Refusal> {
        refusal::of(self, self.found.as_ref()?, subject, closed, table)
    }

    /// An empty report of a search.
    pub fn report(&self) -> Report {
        let judgement = self.found.as_ref().map(|_| Judgement::default());
        Report { hand: self.name().into(), notes: self.notes.clone(), judgement, ..Report::default() }
    }

    /// Counts a verified grasp in the report.
    pub fn count(&self, checked: &Checked, report: &mut Report) {
        let Closed { scene, touches, .. } = &checked.closed;
        if let Some(hand) = &self.named {
            for digit in digits(hand, touches).0 {
                *report.digits.entry(digit.name()).or_default() += 1;
            }
        }
        if let (Some(found), Some(judgement)) = (&self.found, &mut report.judgement) {
            let links = scene.links();
            let gaps = touches.iter().map(|touch| refusal::gap(found, &links, touch));
            judgement.surface_gap = gaps.fold(judgement.surface_gap, f64::max);
            judgement.opposed += u64::from(refusal::opposes(self, touches));
        }
    }

    /// The record of a verified grasp but for its proof.
    pub fn record(&self, subject: &Subject, chain: u64, checked: &Checked) -> HeldGrasp {
        let (closed, hand, named) = (&checked.closed, self.mechanism(), self.named.is_some());
        let (pose, links) = (pose_to_array(&closed.scene.object()), closed.scene.links());
        let values = |names: Vec<String>, values: &[f64]| Values {
            names: if named { Vec::new() } else { names },
            values: values.to_vec(),
        };
        let by_joint = |angles| values(hand.tree.joints.iter().map(|joint| joint.name.clone()).collect(), angles);
        let by_pull = |tensions| values(hand.pulls.iter().map(|pull| pull.name.clone()).collect(), tensions);
        let on_surface = |touch: &Touch| match &self.found {
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
            contacts: closed.touches.iter().map(|touch| contact(touch, &on_surface(touch))).collect(),
            digit_use: self.named.as_ref().map(|hand| self.digit_use(hand, subject, closed)),
            margin: checked.margin,
            penetration: checked.penetration,
            held_without_tension: None,
            moved: named.then(|| closed.moved.into()),
            energy: named.then_some(checked.sample.terms.total),
            proof: None,
        }
        .rounded()
    }

    fn digit_use(&self, hand: &Hand, subject: &Subject, closed: &Closed) -> DigitUse {
        let (digits, free) = digits(hand, &closed.touches);
        let object_from_palm = closed.scene.object().inverse();
        let links = hand.tree.forward(closed.scene.angles());
        let distances = free.iter().flat_map(|digit| hand.links(*digit)).flat_map(|&link| {
            let object_from_link = object_from_palm * links[link];
            let points = &self.sampled.surface.links[link + 1].points;
            points.iter().map(move |p| subject.field.distance(&(object_from_link * Point3::from(*p)).coords))
        });
        DigitUse {
            room: distances.reduce(f64::min),
            palm: closed.touches.iter().any(|touch| touch.link.is_none()),
            approach: closed.scene.object().inverse_transform_vector(&-Vector3::z()).into(),
            digits,
        }
    }

    /// Completes a record.
    pub fn prove(&self, checked: &Checked, proof: Proof, grasp: &mut HeldGrasp) {
        let slack = || checks::hold(&checked.closed.slack(), checked.mass).held;
        grasp.held_without_tension = self.found.as_ref().map(|_| slack());
        grasp.proof = Some(proof);
        *grasp = grasp.clone().rounded();
    }

    /// The open posture of a record.
    pub fn reopened(&self, grasp: &HeldGrasp) -> FreePosture {
        match (&self.named, &grasp.open_tensions) {
            (Some(hand), _) => posture::project(hand, &grasp.open_joints),
            (None, tensions) => FreePosture {
                tensions: tensions.as_deref().unwrap_or_default().to_vec(),
                opposition: 0.0,
                joints: grasp.open_joints.to_vec(),
            },
        }
    }

    /// A record in the palm frame.
    pub fn in_palm_frame(&self, grasp: &HeldGrasp) -> BestGrasp {
        let point = |point: &[f64; 3]| (self.palm_from_root * Point3::from(*point)).coords.into();
        BestGrasp {
            palm_from_object: pose_to_array(&(self.palm_from_root * pose_from_array(&grasp.closed))),
            joints: grasp.joints.to_vec(),
            contacts: grasp.contacts.iter().map(|contact| point(&contact.point)).collect(),
            margin: grasp.margin,
        }
    }
}

/// Digits in contact, and the others.
fn digits(hand: &Hand, touches: &[Touch]) -> (Vec<Digit>, Vec<Digit>) {
    let touching =
        |digit: &Digit| touches.iter().any(|touch| touch.link.is_some_and(|link| hand.links(*digit).contains(&link)));
    hand.digits().iter().copied().partition(touching)
}
