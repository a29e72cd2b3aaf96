//! Policies: everything that decides, retries, aims and gives up.
//!
//! A policy sees what a robot measures and what its [`Eyes`] report. It is asked at the decisions of a trial, acts on the
//! [`Executor`], and answers how far to play. [`blind`] carries out the plan, [`touch`] adapts to what is felt, [`in_turn`] does so with more than two objects, [`chosen`] asks
//! somebody else, [`order`] says which object is taken first, [`pick_sequence`] decides what a transport takes next; [`reach`] finds the grasps that the arm can carry out. No type here can name the scene's truth:
//! the true-pose ablation is an [`Injected`] estimate that comes from outside.

pub mod blind;
pub mod chosen;
pub mod in_turn;
pub mod order;
pub mod pick_sequence;
pub mod reach;
pub mod touch;
mod tracked;

use std::sync::Arc;

use ::touch::TouchError;
use grasping::Repertoire;
use nalgebra::Isometry3;
use world::attempt::Attempt;
use world::layout::MOST_OBJECTS;
use world::objects::{ObjectModel, ObjectSet};

use crate::executor::Executor;
use crate::foresight::Foresees;
use crate::motion::MotionError;
use crate::percept::{Eyes, EyesError};
use crate::perception::{Felt, Grip, KnownObject};
use crate::strategy::{Assessment, Course, Decision, StrategyError, Weighed};
use crate::uncertainty::Uncertainty;
use crate::workcell::Workcell;
use crate::worth::{Candidate, Sequence};

/// What a policy knows before a trial begins.
#[derive(Clone)]
pub struct Knowledge<'a> {
    /// Hand and arm.
    pub cell: &'a Workcell,
    /// All objects, in every way in which they can lie.
    pub library: &'a ObjectSet,
    /// Proven grasps.
    pub repertoire: &'a Repertoire,
    /// The objects of the trial, in the order in which they are taken.
    pub objects: Vec<Arc<ObjectModel>>,
    /// The same, ready to be registered.
    pub known: Vec<&'a KnownObject>,
    /// Grasps of the second object, the planned one first; none in a trial of one.
    pub second: Vec<Candidate>,
    /// Grasps of the third object, the planned one first; none in a trial of fewer.
    pub third: Vec<Candidate>,
    /// Rehearsed grasps of the second object in the ways in which it can fall over: each names its way as its object.
    pub fallen: Vec<Candidate>,
    /// Other first grasps, with the second grasps rehearsed after each.
    pub others: Vec<Sequence>,
    /// Errors that the controller expects of its robot.
    pub uncertainty: Uncertainty,
    /// What the first look at each object states of its own error, m ([`crate::percept::Sighted::sigma`]).
    pub sighted: [Option<f64>; MOST_OBJECTS],
    /// Time after which a trial counts as failed, s.
    pub time_limit: f64,
    /// How it may try again.
    pub recovery: Recovery,
    /// Whether it touches objects to find out where they are, before it grasps them.
    pub explores: bool,
    /// How it plays second grasps in a twin of the scene before it chooses one, if it does.
    pub foresees: Option<Foresees<'a>>,
    /// Why the objects are taken in another order than planned, if they are.
    pub reordered: Option<Reordered>,
}

/// The other order must promise this many times as much. Where no sequence of the plan is sure, the plans of both orders were searched for
/// the best of many odds, and the best of many is partly the luckiest. Set by hand on seed 1.
const GAIN: f64 = 1.1;

/// What two orders promise, where the other one promises more than the planned one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reordered {
    /// Of the planned order.
    pub planned: f64,
    /// Of the other one.
    pub other: f64,
}

impl Reordered {
    /// `Some` if the other order should be taken.
    pub fn of(planned: f64, other: f64) -> Option<Self> {
        (other > GAIN * planned).then_some(Self { planned, other })
    }
}

/// How a policy may try again: everything, but in an ablation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Recovery {
    /// Tries again what failed.
    pub retry: bool,
    /// Looks at the objects anew before it does.
    pub new_look: bool,
}

impl Recovery {
    /// Everything.
    pub const FULL: Self = Self { retry: true, new_look: true };
}

/// What is in the hand, from a source other than touch: an ablation's upper bound.
#[derive(Debug, Clone, Copy)]
pub struct Injected {
    /// Pose of the first object in the hand.
    pub palm_from_object: Isometry3<f64>,
    /// Which objects are in the hand.
    pub grip: Grip,
}

/// How a trial goes on after a decision.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// Play until the next decision.
    Play,
    /// The trial is over.
    Finish,
    /// The trial is given up: no grasp is in reach.
    GiveUp,
    /// The trial is given up: a contact is likelier than a hold, whatever is tried.
    Decline,
    /// The trial is given up: an object that is needed is nowhere to be seen.
    NotSeen,
    /// The trial is given up: who decides has failed.
    Failed,
}

/// A decision for whoever watches: what was weighed, and what came of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Choice {
    /// The candidates.
    pub weighed: Vec<Weighed>,
    /// Place of the chosen one among them; `None` if none was taken.
    pub chosen: Option<usize>,
    /// How the plan would have gone, if something else was chosen.
    pub rejected: Option<Course>,
    /// How the chosen one goes.
    pub course: Option<Course>,
}

impl Choice {
    /// `decision` as it was made; `declined`: nothing is taken.
    fn of(decision: &Decision, declined: bool) -> Self {
        let Decision { weighed, choice, rejected, course, .. } = decision;
        Self {
            weighed: weighed.clone(),
            chosen: (!declined).then_some(*choice),
            rejected: if declined { Some(course.clone()) } else { rejected.clone() },
            course: (!declined).then(|| course.clone()),
        }
    }
}

/// The planned second grasp and the chosen one, as the first decision assessed them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FirstDecision {
    /// Of the plan, aimed at what is seen.
    pub plan: Assessment,
    /// Of the chosen grasp; `None` where the policy declined.
    pub chosen: Option<Assessment>,
}

/// What a policy did in a trial, for its record.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Story {
    /// How often a grasp was tried again.
    pub retries: u32,
    /// Whether a second grasp other than the planned one was chosen.
    pub switched: bool,
    /// Whether the second grasp was aimed elsewhere than at what was seen first.
    pub aimed: bool,
    /// Decisions how to take the second object.
    pub decisions: u32,
    /// The first decision how to take the second object.
    pub first_decision: Option<FirstDecision>,
    /// What was attempted after the first grasp, in order.
    pub attempts: Vec<Attempt>,
    /// Reasons in words, in order.
    pub reasons: Vec<String>,
    /// What is about to be done and why, for whoever watches.
    announcements: Vec<String>,
    /// The latest decision, until somebody takes it.
    choice: Option<Choice>,
}

impl Story {
    /// Whether everything so far is what the plan says.
    pub fn is_as_planned(&self) -> bool {
        self.retries == 0 && !self.switched && !self.aimed
    }

    /// What was announced since the last call.
    pub fn take_announcements(&mut self) -> Vec<String> {
        std::mem::take(&mut self.announcements)
    }

    /// The decision that was made since the last call.
    pub fn take_choice(&mut self) -> Option<Choice> {
        self.choice.take()
    }

    /// A reason that is recorded and announced.
    fn tell(&mut self, reason: String) {
        self.announcements.push(reason.clone());
        self.reasons.push(reason);
    }
}

/// Why a policy cannot go on.
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
    Eyes(#[from] EyesError),
    /// The plan names no second grasp.
    #[error("the plan for {0} has no second grasp")]
    NoPlan(String),
}

/// A policy of a trial. It is asked whenever the executor waits: first it perceives, then it decides.
pub trait Policy {
    /// Takes in what the last look measured.
    fn perceive(&mut self, executor: &Executor, injected: Option<Injected>) -> Result<(), PolicyError>;
    /// Decides at `time` (s, the robot's clock) and acts on the executor.
    fn decide(&mut self, executor: &mut Executor, eyes: &mut dyn Eyes, time: f64) -> Result<Step, PolicyError>;
    /// What it did so far.
    fn story(&mut self) -> &mut Story;
    /// Pose estimate of each object in the hand at the last look.
    fn felt(&self) -> &[Felt];
    /// Whether its decisions are made from measurements, and so take time.
    fn deliberates(&self) -> bool;
}
