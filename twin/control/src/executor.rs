//! The executor: carries out a queue of skills, each on one object of a list, tick by tick on any robot.
//!
//! It receives only the measurements of the robot. Every skill consists of one or a few palm paths of its
//! [`MotionExecutor`]. Taking an object is an approach, a grasp, a lift and a tactile snapshot, sometimes after a
//! palpation. Held objects are carried, held still and verified, or laid down. When the queue is empty, the executor
//! waits ([`Phase::waits_for_decision`]) until a policy begins the next skill: [`Executor::take`],
//! [`Executor::palpate`], [`Executor::carry_aside`], [`Executor::deliver`], [`Executor::put_down_path`],
//! [`Executor::step_aside`]. The policy's list determines the number of objects and their order. A clone, together with
//! a clone of a simulated robot, branches a trial.

mod grip;
mod paths;

use std::collections::VecDeque;
use std::sync::Arc;

use dexterous_grasping::Grasp;
use hand_model::Hand;
use hand_model::robot::{Observation, RobotCommand};
use nalgebra::{Isometry3, Translation3, Vector3};

pub use world::phase::{Phase, Skill, SkillStage};

use crate::detection::DetectedObject;
use crate::guarded::{self, GuardedMotion};
use crate::image_requests::PeriodicImageRequests;
use crate::inverse_kinematics::ArmServo;
use crate::motion::tension::friction_compensated;
use crate::motion::{MotionError, MotionExecutor, MotionProtocol, SNAPSHOT_REST_TIME};
use crate::palpation;
use crate::slip::{self, SlipController};
use crate::trajectory::PosePath;

/// Fraction of the motion towards a palpation after which the pads are imaged untouched: the digits have opened by
/// then.
const REFERENCE_IMAGE_PROGRESS: f64 = 0.4;
/// Digits that touched keep still for this fraction of the rise after a palpation, and for at most this fraction of the
/// whole approach. If they closed for the grasp at once, they would drag the object along.
const RETREAT_STILL_FRACTIONS: (f64, f64) = (0.9, 0.5);
/// Distance by which the palm is lowered while it releases a delivered object, as a share of the lift.
const RELEASE_LOWERING_SHARE: f64 = 0.6;

/// An object to take: its grasp and its detected pose.
#[derive(Debug, Clone, PartialEq)]
pub struct GraspTarget {
    /// The grasp; its closing tensions hold the object once it is taken.
    pub grasp: Grasp,
    /// The pose at which the grasp is aimed.
    pub detected: DetectedObject,
}

/// Runs one task; see the module documentation.
#[derive(Clone)]
pub struct Executor {
    motion: MotionExecutor,
    protocol: MotionProtocol,
    /// The objects, in the order in which they are taken.
    targets: Vec<GraspTarget>,
    /// Skills that follow the present one without a decision.
    queue: VecDeque<Phase>,
    phase: Phase,
    /// Number of targets, from the first, whose digits keep their tension.
    held_count: usize,
    /// Set-point of the opposition joint of the thumb, rad.
    opposition: f64,
    /// Path time of a put-down at which the digits open, s.
    open_from: f64,
    /// Time of the last image request between tactile snapshots, s.
    last_images: f64,
    /// Image requests for a recording; no decision depends on them.
    image_requests: PeriodicImageRequests,
    slip: Option<SlipController>,
    /// The guarded motion of a palpation.
    guarded_motion: Option<GuardedMotion>,
    /// Palm height at which the retreat after a palpation began, m; `None` once the hand has left the object.
    retreat_start_height: Option<f64>,
}

impl Executor {
    /// An executor that waits to begin, with its arm at rest in the posture of `servo`. A tick lasts `tick` s.
    pub fn new(
        hand: Arc<Hand>,
        servo: ArmServo,
        protocol: MotionProtocol,
        targets: Vec<GraspTarget>,
        tick: f64,
    ) -> Result<Self, MotionError> {
        Ok(Self {
            motion: MotionExecutor::new(hand, servo, tick)?,
            protocol,
            targets,
            queue: VecDeque::new(),
            phase: Phase::decide(Skill::Begin, 0),
            held_count: 0,
            opposition: 0.0,
            open_from: f64::INFINITY,
            last_images: f64::NEG_INFINITY,
            image_requests: PeriodicImageRequests::default(),
            slip: None,
            guarded_motion: None,
            retreat_start_height: None,
        })
    }

    /// Returns the present phase.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Motion state: posture, palm, images and servo readings.
    pub fn motion(&self) -> &MotionExecutor {
        &self.motion
    }

    /// Height by which objects are lifted, m.
    pub fn lift(&self) -> f64 {
        self.protocol.lift
    }

    /// Planned targets, in the order in which they are taken.
    pub fn targets(&self) -> &[GraspTarget] {
        &self.targets
    }

    /// Target number `object` of the list.
    ///
    /// # Panics
    /// If the list has no such object.
    pub fn target(&self, object: usize) -> &GraspTarget {
        &self.targets[object]
    }

    /// Requests images every `period` (s) throughout the task, for a recording, or as often as the link delivers them
    /// if that is less often. No decision depends on them.
    pub fn request_images_every(&mut self, period: f64) {
        self.image_requests.begin(period);
    }

    /// Updates the detected pose of `object`.
    pub fn update_detection(&mut self, object: usize, percept: DetectedObject) {
        self.targets[object].detected = percept;
    }

    /// Takes `object` of the list as planned. The objects before it stay in the hand.
    pub fn take_planned(&mut self, object: usize) -> Result<(), MotionError> {
        let GraspTarget { grasp, detected: percept } = self.target(object);
        let path = self.motion.approach_path(&self.protocol.limits, grasp, percept)?;
        self.held_count = object;
        self.start(Phase::run(Skill::Approach, object), path);
        self.queue.extend([Skill::Grasp, Skill::Lift, Skill::Snapshot].map(|skill| Phase::run(skill, object)));
        Ok(())
    }

    /// Takes `object` of the list with `grasp` instead of the planned one.
    pub fn take_with(&mut self, object: usize, grasp: Grasp) -> Result<(), MotionError> {
        self.targets[object].grasp = grasp;
        self.take_planned(object)
    }

    /// At a decision, continues as planned: takes the next object of the list, or carries everything aside. Does
    /// nothing elsewhere.
    pub fn continue_as_planned(&mut self) -> Result<(), MotionError> {
        let Phase { skill, object, .. } = self.phase;
        match skill {
            _ if !self.phase.waits_for_decision() => Ok(()),
            Skill::Begin => self.take_planned(0),
            Skill::Snapshot if object + 1 < self.targets.len() => self.take_planned(object + 1),
            Skill::Snapshot => self.carry_aside(),
            _ => Ok(()),
        }
    }

    /// Takes `target` as number `object` of the list, which grows by one at most.
    pub fn take(&mut self, object: usize, target: GraspTarget) -> Result<(), MotionError> {
        if object == self.targets.len() {
            self.targets.push(target);
        } else {
            self.targets[object] = target;
        }
        self.take_planned(object)
    }

    /// Replaces the straight approach that has just begun with `path`.
    pub fn redirect(&mut self, path: PosePath) {
        self.motion.redirect(path);
    }

    /// Palpates `object` before it is grasped: follows `way`, then performs the guarded motion `guarded`.
    pub fn palpate(&mut self, object: usize, way: PosePath, guarded: GuardedMotion) {
        self.guarded_motion = Some(guarded);
        // With an empty hand, the digits of the first grasp close to be out of the way.
        self.held_count = object.max(1);
        self.start(Phase::palpate(object, SkillStage::Reach), way);
    }

    /// Carries everything that is held to the side by the protocol's distance, holds it for the protocol's time and
    /// verifies it.
    pub fn carry_aside(&mut self) -> Result<(), MotionError> {
        let aside = self.motion.end().translation.vector + Vector3::y() * self.protocol.carry_distance;
        self.start_carry(aside, &[Skill::Hold, Skill::Verify])
    }

    /// Brings the palm over (x, y), m, holds everything there for the protocol's time, and releases it.
    pub fn deliver(&mut self, [x, y]: [f64; 2]) -> Result<(), MotionError> {
        let there = Vector3::new(x, y, self.motion.end().translation.z);
        self.start_carry(there, &[Skill::Hold, Skill::PutDown])
    }

    fn start_carry(&mut self, there: Vector3<f64>, then: &[Skill]) -> Result<(), MotionError> {
        let there = Isometry3::from_parts(Translation3::from(there), self.motion.end().rotation);
        let path = self.motion.straight_path(&self.protocol.limits, there)?;
        self.start(Phase::run(Skill::Carry, 0), path);
        self.queue.extend(then.iter().map(|skill| Phase::run(*skill, 0)));
        Ok(())
    }

    /// Lays everything down where it was lifted, opens the hand and rises again.
    pub fn put_down(&mut self) -> Result<(), MotionError> {
        let (path, open_from) = self.motion.put_down_path(&self.protocol.limits, self.protocol.lift)?;
        self.open_from = open_from;
        self.held_count = self.targets.len();
        self.start(Phase::run(Skill::PutDown, 0), path);
        Ok(())
    }

    /// Moves the hand with everything it holds out of the detector's view, so that `object` can be detected.
    pub fn step_aside(&mut self, object: usize) -> Result<(), MotionError> {
        let path = self.motion.home_path(&self.protocol.limits)?;
        self.held_count = object.max(1);
        self.start(Phase::run(Skill::StepAside, 0), path);
        Ok(())
    }

    /// Begins a skill at a decision and clears the queue.
    fn start(&mut self, phase: Phase, path: PosePath) {
        self.queue.clear();
        self.enter(phase, path);
    }

    fn enter(&mut self, phase: Phase, path: PosePath) {
        self.retreat_start_height = self.has_touched().then(|| self.motion.end().translation.z);
        self.phase = phase;
        if self.is_taking_snapshot() {
            self.motion.begin_snapshot();
        }
        self.motion.begin(path);
    }

    /// Enters the next phase when the present one is over, unless a decision is needed.
    fn advance(&mut self) -> Result<(), MotionError> {
        let touched = |guarded: &GuardedMotion| self.is_touching() && guarded.is_over(self.motion.clock());
        let over = self.motion.is_over() || self.guarded_motion.as_ref().is_some_and(touched);
        if !over || self.phase.waits_for_decision() || self.is_taking_snapshot() && !self.motion.snapshot_is_complete()
        {
            return Ok(());
        }
        let Phase { skill, object, stage } = self.phase;
        let next = match (skill, stage) {
            (Skill::Palpate, SkillStage::Reach) => Phase::palpate(object, SkillStage::Touch),
            (Skill::Palpate, SkillStage::Touch) => Phase::palpate(object, SkillStage::Feel),
            _ => self.queue.pop_front().unwrap_or(Phase::decide(skill, object)),
        };
        let path = self.path_of(next)?;
        match next.skill {
            Skill::Lift => self.held_count = object + 1,
            // Delivered objects are released on the way down.
            Skill::PutDown if !next.waits_for_decision() => {
                (self.opposition, self.held_count, self.open_from) =
                    (self.target(self.held_count - 1).grasp.opposition, 0, 0.0);
            }
            Skill::PutDown => self.held_count = self.held_count.min(1),
            _ => {}
        }
        self.enter(next, path);
        Ok(())
    }

    /// Palm path of a phase that follows another one without a decision, or that waits for a decision.
    fn path_of(&self, phase: Phase) -> Result<PosePath, MotionError> {
        let (motion, MotionProtocol { limits, lift, hold_time: hold, .. }) = (&self.motion, &self.protocol);
        Ok(match (phase.skill, phase.stage) {
            (Skill::Palpate, SkillStage::Touch) => match &self.guarded_motion {
                Some(guarded) => guarded.path().clone(),
                None => motion.wait_path()?,
            },
            (Skill::Palpate, SkillStage::Feel) => motion.stop_path(palpation::SETTLING_TIME)?,
            (Skill::Grasp, SkillStage::Run) => motion.closing_path(self.target(phase.object).grasp.raise)?,
            (Skill::Lift, SkillStage::Run) => motion.lift_path(limits, *lift)?,
            (Skill::Snapshot | Skill::Verify, SkillStage::Run) => motion.rest_path(SNAPSHOT_REST_TIME)?,
            (Skill::Hold, SkillStage::Run) => motion.rest_path(*hold)?,
            (Skill::PutDown, SkillStage::Run) => motion.put_down_path(limits, RELEASE_LOWERING_SHARE * lift)?.0,
            _ => motion.wait_path()?,
        })
    }

    fn is_taking_snapshot(&self) -> bool {
        match self.phase.stage {
            SkillStage::Run => matches!(self.phase.skill, Skill::Snapshot | Skill::Verify),
            stage => stage == SkillStage::Feel,
        }
    }

    fn is_reaching(&self) -> bool {
        self.phase.stage == SkillStage::Reach
    }

    fn is_touching(&self) -> bool {
        self.phase.stage == SkillStage::Touch
    }

    /// True at the decision after a palpation.
    fn has_touched(&self) -> bool {
        self.phase.skill == Skill::Palpate && self.phase.waits_for_decision()
    }

    /// Ends the retreat once the hand has risen far enough from the object that it touched.
    fn finish_retreat(&mut self) {
        let height = self.motion.palm().translation.z - RETREAT_STILL_FRACTIONS.0 * palpation::RETREAT_HEIGHT;
        if self.retreat_start_height.is_some_and(|from| height > from)
            || self.motion.progress() > RETREAT_STILL_FRACTIONS.1
        {
            self.retreat_start_height = None;
        }
    }

    fn is_carrying(&self) -> bool {
        self.phase.has_begun_carry() && !self.phase.waits_for_decision()
    }

    /// Records the measurements of a tick in which another controller commands the robot.
    pub fn record_measurements(&mut self, observation: &Observation) {
        self.motion.measure(observation, &[]);
    }

    /// Runs one tick: takes the measurements and returns the command.
    pub fn tick(&mut self, observation: &Observation) -> Result<RobotCommand, MotionError> {
        let images = self.image_requests.images_for_others(&observation.tactile, self.motion.tick_length());
        self.motion.measure(observation, if self.is_taking_snapshot() { &images } else { &[] });
        let (reaching, touching) = (self.is_reaching(), self.is_touching());
        if let Some(guarded) = self.guarded_motion.as_mut().filter(|_| reaching || touching) {
            guarded.add_images(&images, touching.then_some(self.motion.clock()));
        }
        self.advance()?;
        self.finish_retreat();
        let arm = self.motion.follow()?;
        let wanted = self.held_tension(observation, &images);
        let wanted = friction_compensated(self.motion.hand(), &self.protocol.friction, &observation.servos, &wanted);
        self.set_opposition();
        let mut capture = self.is_taking_snapshot() && self.motion.captures_snapshot();
        let unknown = |guarded: &GuardedMotion| {
            self.motion.progress() > REFERENCE_IMAGE_PROGRESS && !guarded.has_reference_images()
        };
        let period = match self.phase {
            _ if self.is_reaching() && self.guarded_motion.as_ref().is_some_and(unknown) => Some(guarded::IMAGE_PERIOD),
            _ if self.is_touching() => Some(guarded::IMAGE_PERIOD),
            _ if self.slip.is_some() && self.is_carrying() => Some(slip::IMAGE_PERIOD),
            _ => None,
        };
        if period.is_some_and(|period| observation.time >= self.last_images + period) {
            self.last_images = observation.time;
            capture = true;
        }
        capture = self.image_requests.should_capture(observation, capture, period.is_none());
        Ok(self.motion.command(arm, &wanted, self.opposition, capture))
    }
}
