//! Policies: they choose grasps and aims, retry, and give up.
//!
//! A policy receives the measurements of the robot and the reports of its [`ObjectDetector`]. It is called at the
//! decisions of a trial, acts on the [`Executor`], and answers how to go on. [`blind`] carries out the planned grasps,
//! and [`touch`] adapts to tactile perception. [`sequential`] does so with more than two objects. [`chooser`] delegates
//! the choice to an external chooser. [`order`] determines which object is taken first, [`pick_sequence`] decides the
//! picks of a transport, and [`reach`] finds the grasps that the arm can carry out. No type here has access to ground
//! truth: the true-pose ablation is an [`InjectedHold`] estimate from the caller.

pub mod blind;
pub mod chooser;
pub mod order;
pub mod pick_sequence;
pub mod reach;
pub mod sequential;
pub mod touch;
mod tracked;

use std::sync::Arc;

use dexterous_grasping::Repertoire;
use nalgebra::Isometry3;
use tactile_perception::TouchError;
use world::attempt::Attempt;
use world::layout::MAX_OBJECTS;
use world::objects::{ObjectModel, ObjectSet};

use crate::detection::{DetectionError, ObjectDetector};
use crate::executor::Executor;
use crate::look_ahead::LookAheadSettings;
use crate::motion::MotionError;
use crate::perception::{HoldState, KnownObject, ObjectEstimate};
use crate::score::{GraspCandidate, GraspSequence};
use crate::strategy::{Assessment, Decision, HeldObjectPath, ScoredCandidate, StrategyError};
use crate::uncertainty::Uncertainty;
use crate::workcell::Workcell;

/// Knowledge of a policy before a trial begins.
#[derive(Clone)]
pub struct Knowledge<'a> {
    /// Hand and arm.
    pub cell: &'a Workcell,
    /// All objects, in every pose in which they can lie.
    pub library: &'a ObjectSet,
    /// Grasps verified in simulation.
    pub repertoire: &'a Repertoire,
    /// The objects of the trial, in the order in which they are taken.
    pub objects: Vec<Arc<ObjectModel>>,
    /// The same objects, prepared for registration.
    pub known_objects: Vec<&'a KnownObject>,
    /// Grasps of the second object, the planned one first; empty in a trial of one object.
    pub second_candidates: Vec<GraspCandidate>,
    /// Grasps of the third object, the planned one first; empty in a trial of fewer objects.
    pub third_candidates: Vec<GraspCandidate>,
    /// Grasps of the second object with rollouts, for the poses into which it can fall over; the object of each names
    /// that pose.
    pub fallen_candidates: Vec<GraspCandidate>,
    /// Alternative first grasps, each with the second grasps that have rollouts after it.
    pub alternative_firsts: Vec<GraspSequence>,
    /// Standard deviations of the errors that the controller expects of its robot.
    pub uncertainty: Uncertainty,
    /// Standard deviation that the detector reports for its first detection of each object, m
    /// ([`crate::detection::PoseDetection::sigma`]).
    pub first_detection_sigmas: [Option<f64>; MAX_OBJECTS],
    /// Time limit of a trial, s.
    pub time_limit: f64,
    /// Permitted retries.
    pub recovery: Recovery,
    /// True if the policy palpates objects to locate them before it grasps them.
    pub palpates: bool,
    /// Settings for rollouts of second grasps before one is chosen, if that is enabled.
    pub look_ahead: Option<LookAheadSettings<'a>>,
    /// Expected results of both orders, if the objects are taken in another order than planned.
    pub reordered: Option<OrderComparison>,
}

/// Factor by which the other order must score higher than the planned one. Without a sure sequence in the plan, the
/// best of many outcome models was searched in both orders, and the best of many is partly the luckiest. Set by hand on
/// seed 1.
const REORDER_GAIN: f64 = 1.1;

/// Expected results of two orders, if the other order scores higher than the planned one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrderComparison {
    /// Score of the planned order.
    pub planned: f64,
    /// Score of the other order.
    pub other: f64,
}

impl OrderComparison {
    /// Returns `Some` if the other order should be taken.
    pub fn if_better(planned: f64, other: f64) -> Option<Self> {
        (other > REORDER_GAIN * planned).then_some(Self { planned, other })
    }
}

/// Permitted retries; restricted only in an ablation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Recovery {
    /// True if failed grasps are tried again.
    pub retry: bool,
    /// True if the objects are detected again before a retry.
    pub new_detection: bool,
}

impl Recovery {
    /// All retries permitted.
    pub const FULL: Self = Self { retry: true, new_detection: true };
}

/// Contents of the hand from a source other than touch: the upper bound of an ablation.
#[derive(Debug, Clone, Copy)]
pub struct InjectedHold {
    /// Pose of the first object in the hand.
    pub palm_from_object: Isometry3<f64>,
    /// Objects in the hand.
    pub hold_state: HoldState,
}

/// Continuation of a trial after a decision.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PolicyStep {
    /// Run until the next decision.
    Continue,
    /// The trial is over.
    Finish,
    /// The trial is given up: no grasp is within reach.
    GiveUp,
    /// The trial is given up: a contact is likelier than a hold for every grasp.
    Decline,
    /// The trial is given up: a required object is not visible.
    NotDetected,
    /// The trial is given up: the external chooser has failed.
    Failed,
}

/// A decision for an observer: the options that were scored, and the result.
#[derive(Debug, Clone, PartialEq)]
pub struct DecisionRecord {
    /// The candidates.
    pub candidates: Vec<ScoredCandidate>,
    /// Index of the chosen candidate; `None` if none was taken.
    pub chosen: Option<usize>,
    /// Predicted course of the planned grasp, if another option was chosen.
    pub rejected: Option<HeldObjectPath>,
    /// Predicted course of the chosen option.
    pub course: Option<HeldObjectPath>,
}

impl DecisionRecord {
    /// Record of `decision`; with `declined`, nothing is taken.
    fn from_decision(decision: &Decision, declined: bool) -> Self {
        let Decision { candidates: scored, choice, rejected, course, .. } = decision;
        Self {
            candidates: scored.clone(),
            chosen: (!declined).then_some(*choice),
            rejected: if declined { Some(course.clone()) } else { rejected.clone() },
            course: (!declined).then(|| course.clone()),
        }
    }
}

/// The planned and the chosen second grasp, as assessed by the first decision.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FirstDecision {
    /// Assessment of the planned grasp, aimed at the detected position.
    pub planned: Assessment,
    /// Assessment of the chosen grasp; `None` if the policy declined.
    pub chosen: Option<Assessment>,
}

/// Record of a policy's actions in a trial.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct DecisionTrace {
    /// Number of retries.
    pub retries: u32,
    /// True if a second grasp other than the planned one was chosen.
    pub switched: bool,
    /// True if the second grasp was aimed away from the first detected position.
    pub aimed: bool,
    /// Number of decisions on how to take the second object.
    pub decisions: u32,
    /// The first decision on how to take the second object.
    pub first_decision: Option<FirstDecision>,
    /// Attempts after the first grasp, in order.
    pub attempts: Vec<Attempt>,
    /// Reasons in words, in order.
    pub reasons: Vec<String>,
    /// Announcements of upcoming actions with their reasons, for an observer.
    announcements: Vec<String>,
    /// The latest decision, until an observer takes it.
    choice: Option<DecisionRecord>,
}

impl DecisionTrace {
    /// True if everything so far follows the plan.
    pub fn is_as_planned(&self) -> bool {
        self.retries == 0 && !self.switched && !self.aimed
    }

    /// Takes the announcements since the last call.
    pub fn take_announcements(&mut self) -> Vec<String> {
        std::mem::take(&mut self.announcements)
    }

    /// Takes the decision since the last call, if there was one.
    pub fn take_choice(&mut self) -> Option<DecisionRecord> {
        self.choice.take()
    }

    /// Records and announces a reason.
    fn record(&mut self, reason: String) {
        self.announcements.push(reason.clone());
        self.reasons.push(reason);
    }
}

/// Error that stops a policy.
#[derive(Debug, thiserror::Error)]
pub enum PolicyError {
    /// Perception failed.
    #[error(transparent)]
    Touch(#[from] TouchError),
    /// The decision failed.
    #[error(transparent)]
    Strategy(#[from] StrategyError),
    /// A motion could not be planned.
    #[error(transparent)]
    Motion(#[from] MotionError),
    /// Prior perception failed.
    #[error(transparent)]
    Detection(#[from] DetectionError),
    /// The plan has no second grasp.
    #[error("the plan for {0} has no second grasp")]
    NoSecondGrasp(String),
}

/// Policy of a trial. It is called whenever the executor waits: first it perceives, then it decides.
pub trait TrialPolicy {
    /// Perceives the measurements of the last tactile snapshot.
    fn perceive(&mut self, executor: &Executor, injected: Option<InjectedHold>) -> Result<(), PolicyError>;
    /// Decides at `time` (s, the robot's clock) and acts on the executor.
    fn decide(
        &mut self,
        executor: &mut Executor,
        detector: &mut dyn ObjectDetector,
        time: f64,
    ) -> Result<PolicyStep, PolicyError>;
    /// Returns the record of its actions so far.
    fn trace(&mut self) -> &mut DecisionTrace;
    /// Pose estimate of each object in the hand at the last tactile snapshot.
    fn felt(&self) -> &[ObjectEstimate];
    /// True if its decisions depend on measurements, and therefore take time.
    fn deliberates(&self) -> bool;
}
