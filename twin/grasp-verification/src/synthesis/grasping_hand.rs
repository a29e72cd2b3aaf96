//! Hand model of the grasp synthesis: how a hand may touch, open, pull and hold.
//!
//! [`GraspingHand::from_hand`] builds it from a hand whose digits and pads are known, and
//! [`super::urdf_hand::describe`] from any URDF.

use std::sync::Arc;

use dexterous_grasping::synthesis::hand_use::HandUse;
use dexterous_grasping::synthesis::held::HeldGrasp;
use dexterous_grasping::synthesis::mechanism::Mechanism;
use dexterous_grasping::synthesis::posture::{self, FreePosture};
use dexterous_grasping::synthesis::surface::HandSurface;
use hand_model::Hand;
use hand_model::hand_mechanism::HandMechanism;
use hand_model::kinematics::Tree;
use nalgebra::Isometry3;
use sim::collision_model::CollisionModel;
use sim::hand_scene::HandScene;

use super::size::HandOpening;
use super::subject::PreparedObject;
use super::urdf_hand::derived_surface::DerivedSurface;

/// Name of our own hand.
const BUILTIN_HAND_NAME: &str = "F-TAC";
/// Number of points on the surface of a hand with pads.
const SURFACE_POINTS: usize = 2000;

/// A hand as it is sampled, in the palm frame. The object comes along -z.
pub struct SampledHand {
    pub tree: Tree,
    /// Joint limits and actuator lines.
    pub mechanism: Mechanism,
    /// Surface points, contact candidates, and pairs of links that may collide.
    pub surface: HandSurface,
}

/// Contact model: the forces that a contact bears.
#[derive(Debug, Clone, Copy)]
pub enum ContactModel {
    /// Friction along the surface. Torques are scaled by the object's size.
    Hard,
    /// Torsional friction about the normal as well.
    Soft {
        /// Arm of the torsional friction, m.
        torsion_arm: f64,
        /// Arm at which torques count as forces, m.
        torque_arm: f64,
    },
}

/// A hand for which grasps are synthesized.
pub struct GraspingHand {
    /// The hand with its collision shapes.
    pub body: CollisionModel,
    /// `palm_from_root`.
    pub palm_from_root: Isometry3<f64>,
    pub sampled: SampledHand,
    /// True for each actuator that may close.
    pub may_close: Vec<bool>,
    /// Opening: width of the widest object that it takes.
    pub opening: HandOpening,
    /// Range from which an actuator's tension is drawn, N.
    pub tensions: (f64, f64),
    pub contacts: ContactModel,
    /// The hand with named digits, each closed by its own cable. `None` for a hand from a URDF.
    pub named_hand: Option<Arc<Hand>>,
    /// Surface and palm derived from the hand's files, by which grasps are refused. `None` if they are given.
    pub derived_surface: Option<DerivedSurface>,
    /// Findings as text. Warnings begin with `WARNING`.
    pub notes: Vec<String>,
}

impl GraspingHand {
    /// Builds it from a hand that touches with its pads.
    pub fn from_hand(hand: Arc<Hand>) -> Self {
        let (tree, mechanism) = (hand.tree.clone(), Mechanism::from_hand(&hand));
        let may_close = vec![true; hand.cables.len()];
        Self {
            body: CollisionModel::new(Arc::new(HandMechanism::from_hand(&hand, BUILTIN_HAND_NAME))),
            palm_from_root: Isometry3::identity(),
            sampled: SampledHand { tree, mechanism, surface: HandSurface::new(&hand, SURFACE_POINTS) },
            may_close,
            opening: HandOpening::builtin_hand(),
            tensions: (6.0, 40.0),
            contacts: ContactModel::Hard,
            named_hand: Some(hand),
            derived_surface: None,
            notes: Vec::new(),
        }
    }

    /// Returns the hand limited to the parts that may touch an object. The other digits stay open. A hand whose digits
    /// have no names is returned unchanged.
    #[must_use]
    pub fn limited_to(mut self, to: &HandUse) -> Self {
        let Some(named) = &self.named_hand else { return self };
        let SampledHand { surface, mechanism, .. } = &mut self.sampled;
        to.limit(named, &named.open_angles(), surface, mechanism);
        self.may_close = named.digits().iter().map(|digit| to.digits.contains(digit)).collect();
        if let Some([low, high]) = to.tension {
            self.tensions = (low, high);
        }
        self
    }

    /// Returns the mechanism: joints, links and actuators.
    pub fn mechanism(&self) -> &Arc<HandMechanism> {
        self.body.hand()
    }

    pub fn name(&self) -> &str {
        &self.mechanism().name
    }

    /// Returns, for each actuator, true if it closes a sample with these contact candidates. If digits have their own
    /// cables, only the digits in contact close.
    pub fn closing(&self, contacts: &[usize]) -> Vec<bool> {
        let on = |joint: &usize| contacts.iter().any(|c| joint + 1 == self.sampled.surface.candidates[*c].link);
        match &self.named_hand {
            Some(hand) => hand.digits().iter().map(|digit| hand.links(*digit).iter().any(on)).collect(),
            None => vec![true; self.mechanism().actuators.len()],
        }
    }

    /// Returns `tensions` (N) limited to the efforts that the joints bear.
    pub fn limited_to_efforts(&self, tensions: &[f64]) -> Vec<f64> {
        self.mechanism().limit_tensions(tensions).0
    }

    /// Builds the scene of the hand with its joints at `joints` (rad or m) and the floating object at `start`
    /// (`root_from_object`).
    pub fn scene(&self, subject: &PreparedObject, start: &Isometry3<f64>, joints: &[f64]) -> HandScene {
        let mut scene = HandScene::new(&self.body, joints);
        scene.add_object(&subject.model, start);
        scene
    }

    /// Returns the open posture of a record.
    pub fn open_posture(&self, grasp: &HeldGrasp) -> FreePosture {
        match (&self.named_hand, &grasp.open_tensions) {
            (Some(hand), _) => posture::project(hand, &grasp.open_joints),
            (None, tensions) => FreePosture {
                tensions: tensions.as_deref().unwrap_or_default().to_vec(),
                opposition: 0.0,
                joints: grasp.open_joints.to_vec(),
            },
        }
    }
}
