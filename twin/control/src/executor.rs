//! The executor: carries out a queue of skills, each on one object of a list, tick by tick on any robot.
//!
//! It receives only the measurements of the robot. Every skill consists of one or a few palm paths of its [`Motion`].
//! Taking an object is an approach, a grasp, a lift and a look, sometimes after a palpation. Held objects are carried,
//! held still and verified, or laid down. When the queue is empty, the executor waits ([`Phase::waits`]) until a policy
//! begins the next skill: [`Executor::take`], [`Executor::palpate`], [`Executor::carry_aside`], [`Executor::deliver`],
//! [`Executor::put_down`], [`Executor::step_aside`]. The policy's list determines the number of objects and their
//! order. A clone, together with a clone of a simulated robot, branches a trial.

mod grip;
mod paths;

use std::collections::VecDeque;
use std::sync::Arc;

use dexterous_grasping::Grasp;
use hand_model::Hand;
use hand_model::robot::{Command, Observation};
use nalgebra::{Isometry3, Translation3, Vector3};

pub use world::phase::{Phase, Skill, Stage};

use crate::guarded::{self, Guarded};
use crate::inverse_kinematics::ArmServo;
use crate::motion::tension::against_friction;
use crate::motion::{LOOK_TIME, Motion, MotionError, Protocol};
use crate::palpation;
use crate::percept::Percept;
use crate::slip::{self, SlipWatch};
use crate::trajectory::PosePath;
use crate::watch::Watch;

/// Fraction of the motion towards a palpation after which the pads are imaged untouched: the digits have opened by
/// then.
const UNTOUCHED: f64 = 0.4;
/// Digits that touched keep still for this fraction of the rise after a palpation, and for at most this fraction of the
/// whole approach. If they closed for the grasp at once, they would drag the object along.
const LEAVING: (f64, f64) = (0.9, 0.5);
/// Distance by which the palm is lowered while it releases a delivered object, as a share of the lift.
const LOWERING: f64 = 0.6;

/// An object to take: its grasp and its percept.
#[derive(Debug, Clone, PartialEq)]
pub struct Target {
    /// The grasp; its closing tensions hold the object once it is taken.
    pub grasp: Grasp,
    /// The pose at which the grasp is aimed.
    pub percept: Percept,
}

/// Runs one task; see the module documentation.
#[derive(Clone)]
pub struct Executor {
    motion: Motion,
    protocol: Protocol,
    /// The objects, in the order in which they are taken.
    targets: Vec<Target>,
    /// Skills that follow the present one without a decision.
    queue: VecDeque<Phase>,
    phase: Phase,
    /// Number of targets, from the first, whose digits keep their tension.
    held: usize,
    /// Set-point of the opposition joint of the thumb, rad.
    opposition: f64,
    /// Path time of a put-down at which the digits open, s.
    open_from: f64,
    /// Time of the last image request between looks, s.
    last_images: f64,
    /// Image requests for a recording; no decision depends on them.
    watch: Watch,
    slip: Option<SlipWatch>,
    /// The guarded motion of a palpation.
    guarded: Option<Guarded>,
    /// Palm height at which the retreat after a palpation began, m; `None` once the hand has left the object.
    left_from: Option<f64>,
}

impl Executor {
    /// An executor that waits to begin, with its arm at rest in the posture of `servo`. A tick lasts `tick` s.
    pub fn new(
        hand: Arc<Hand>,
        servo: ArmServo,
        protocol: Protocol,
        targets: Vec<Target>,
        tick: f64,
    ) -> Result<Self, MotionError> {
        Ok(Self {
            motion: Motion::new(hand, servo, tick)?,
            protocol,
            targets,
            queue: VecDeque::new(),
            phase: Phase::decide(Skill::Begin, 0),
            held: 0,
            opposition: 0.0,
            open_from: f64::INFINITY,
            last_images: f64::NEG_INFINITY,
            watch: Watch::default(),
            slip: None,
            guarded: None,
            left_from: None,
        })
    }

    /// Returns the present phase.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Motion state: posture, palm, images and servo readings.
    pub fn motion(&self) -> &Motion {
        &self.motion
    }

    /// Height by which objects are lifted, m.
    pub fn lift(&self) -> f64 {
        self.protocol.lift
    }

    /// Planned targets, in the order in which they are taken.
    pub fn targets(&self) -> &[Target] {
        &self.targets
    }

    /// Target number `object` of the list.
    ///
    /// # Panics
    /// If the list has no such object.
    pub fn target(&self, object: usize) -> &Target {
        &self.targets[object]
    }

    /// Requests images every `period` (s) throughout the task, for a recording, or as often as the link delivers them
    /// if that is less often. No decision depends on them.
    pub fn watch_images(&mut self, period: f64) {
        self.watch.begin(period);
    }

    /// Updates the percept of `object`.
    pub fn see(&mut self, object: usize, percept: Percept) {
        self.targets[object].percept = percept;
    }

    /// Takes `object` of the list as planned. The objects before it stay in the hand.
    pub fn take_planned(&mut self, object: usize) -> Result<(), MotionError> {
        let Target { grasp, percept } = self.target(object);
        let path = self.motion.approach(&self.protocol.limits, grasp, percept)?;
        self.held = object;
        self.start(Phase::run(Skill::Approach, object), path);
        self.queue.extend([Skill::Grasp, Skill::Lift, Skill::Look].map(|skill| Phase::run(skill, object)));
        Ok(())
    }

    /// Takes `object` of the list with `grasp` instead of the planned one.
    pub fn take_with(&mut self, object: usize, grasp: Grasp) -> Result<(), MotionError> {
        self.targets[object].grasp = grasp;
        self.take_planned(object)
    }

    /// At a decision, continues as planned: takes the next object of the list, or carries everything aside. Does
    /// nothing elsewhere.
    pub fn go_on(&mut self) -> Result<(), MotionError> {
        let Phase { skill, object, .. } = self.phase;
        match skill {
            _ if !self.phase.waits() => Ok(()),
            Skill::Begin => self.take_planned(0),
            Skill::Look if object + 1 < self.targets.len() => self.take_planned(object + 1),
            Skill::Look => self.carry_aside(),
            _ => Ok(()),
        }
    }

    /// Takes `target` as number `object` of the list, which grows by one at most.
    pub fn take(&mut self, object: usize, target: Target) -> Result<(), MotionError> {
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

    /// Palpates `object` before it is grasped: follows `way`, then the guarded motion `guarded`.
    pub fn palpate(&mut self, object: usize, way: PosePath, guarded: Guarded) {
        self.guarded = Some(guarded);
        // With an empty hand, the digits of the first grasp close to be out of the way.
        self.held = object.max(1);
        self.start(Phase::palpate(object, Stage::Reach), way);
    }

    /// Carries everything that is held to the side by the protocol's distance, holds it for the protocol's time and
    /// verifies it.
    pub fn carry_aside(&mut self) -> Result<(), MotionError> {
        let aside = self.motion.end().translation.vector + Vector3::y() * self.protocol.carry;
        self.carry(aside, &[Skill::Hold, Skill::Verify])
    }

    /// Brings the palm over (x, y), m, holds everything there for the protocol's time, and releases it.
    pub fn deliver(&mut self, [x, y]: [f64; 2]) -> Result<(), MotionError> {
        let there = Vector3::new(x, y, self.motion.end().translation.z);
        self.carry(there, &[Skill::Hold, Skill::PutDown])
    }

    fn carry(&mut self, there: Vector3<f64>, then: &[Skill]) -> Result<(), MotionError> {
        let there = Isometry3::from_parts(Translation3::from(there), self.motion.end().rotation);
        let path = self.motion.straight(&self.protocol.limits, there)?;
        self.start(Phase::run(Skill::Carry, 0), path);
        self.queue.extend(then.iter().map(|skill| Phase::run(*skill, 0)));
        Ok(())
    }

    /// Lays everything down where it was lifted, opens the hand and rises again.
    pub fn put_down(&mut self) -> Result<(), MotionError> {
        let (path, open_from) = self.motion.put_down(&self.protocol.limits, self.protocol.lift)?;
        self.open_from = open_from;
        self.held = self.targets.len();
        self.start(Phase::run(Skill::PutDown, 0), path);
        Ok(())
    }

    /// Moves the hand with everything it holds out of the detector's view, in order to look for `object`.
    pub fn step_aside(&mut self, object: usize) -> Result<(), MotionError> {
        let path = self.motion.home(&self.protocol.limits)?;
        self.held = object.max(1);
        self.start(Phase::run(Skill::StepAside, 0), path);
        Ok(())
    }

    /// Begins a skill at a decision and clears the queue.
    fn start(&mut self, phase: Phase, path: PosePath) {
        self.queue.clear();
        self.enter(phase, path);
    }

    fn enter(&mut self, phase: Phase, path: PosePath) {
        self.left_from = self.has_touched().then(|| self.motion.end().translation.z);
        self.phase = phase;
        if self.is_looking() {
            self.motion.begin_look();
        }
        self.motion.begin(path);
    }

    /// Enters the next phase when the present one is over, unless a decision is needed.
    fn advance(&mut self) -> Result<(), MotionError> {
        let touched = |guarded: &Guarded| self.is_touching() && guarded.is_over(self.motion.clock());
        let over = self.motion.is_over() || self.guarded.as_ref().is_some_and(touched);
        if !over || self.phase.waits() || self.is_looking() && !self.motion.has_looked() {
            return Ok(());
        }
        let Phase { skill, object, stage } = self.phase;
        let next = match (skill, stage) {
            (Skill::Palpate, Stage::Reach) => Phase::palpate(object, Stage::Touch),
            (Skill::Palpate, Stage::Touch) => Phase::palpate(object, Stage::Feel),
            _ => self.queue.pop_front().unwrap_or(Phase::decide(skill, object)),
        };
        let path = self.path_of(next)?;
        match next.skill {
            Skill::Lift => self.held = object + 1,
            // Delivered objects are released on the way down.
            Skill::PutDown if !next.waits() => {
                (self.opposition, self.held, self.open_from) = (self.target(self.held - 1).grasp.opposition, 0, 0.0);
            }
            Skill::PutDown => self.held = self.held.min(1),
            _ => {}
        }
        self.enter(next, path);
        Ok(())
    }

    /// Palm path of a phase that follows another one without a decision, or that waits for a decision.
    fn path_of(&self, phase: Phase) -> Result<PosePath, MotionError> {
        let (motion, Protocol { limits, lift, hold, .. }) = (&self.motion, &self.protocol);
        Ok(match (phase.skill, phase.stage) {
            (Skill::Palpate, Stage::Touch) => match &self.guarded {
                Some(guarded) => guarded.path().clone(),
                None => motion.wait()?,
            },
            (Skill::Palpate, Stage::Feel) => motion.stop(palpation::SETTLING)?,
            (Skill::Grasp, Stage::Run) => motion.close(self.target(phase.object).grasp.raise)?,
            (Skill::Lift, Stage::Run) => motion.lift(limits, *lift)?,
            (Skill::Look | Skill::Verify, Stage::Run) => motion.rest(LOOK_TIME)?,
            (Skill::Hold, Stage::Run) => motion.rest(*hold)?,
            (Skill::PutDown, Stage::Run) => motion.put_down(limits, LOWERING * lift)?.0,
            _ => motion.wait()?,
        })
    }

    fn is_looking(&self) -> bool {
        match self.phase.stage {
            Stage::Run => matches!(self.phase.skill, Skill::Look | Skill::Verify),
            stage => stage == Stage::Feel,
        }
    }

    fn is_reaching(&self) -> bool {
        self.phase.stage == Stage::Reach
    }

    fn is_touching(&self) -> bool {
        self.phase.stage == Stage::Touch
    }

    /// True at the decision after a palpation.
    fn has_touched(&self) -> bool {
        self.phase.skill == Skill::Palpate && self.phase.waits()
    }

    /// Ends the retreat once the hand has risen far enough from the object that it touched.
    fn leave(&mut self) {
        let height = self.motion.palm().translation.z - LEAVING.0 * palpation::RISE;
        if self.left_from.is_some_and(|from| height > from) || self.motion.progress() > LEAVING.1 {
            self.left_from = None;
        }
    }

    fn is_carrying(&self) -> bool {
        self.phase.carries() && !self.phase.waits()
    }

    /// Records the measurements of a tick in which another controller commands the robot.
    pub fn attend(&mut self, observation: &Observation) {
        self.motion.measure(observation, &[]);
    }

    /// Runs one tick: takes the measurements and returns the command.
    pub fn tick(&mut self, observation: &Observation) -> Result<Command, MotionError> {
        let images = self.watch.others(&observation.tactile, self.motion.tick_length());
        self.motion.measure(observation, if self.is_looking() { &images } else { &[] });
        let (reaching, touching) = (self.is_reaching(), self.is_touching());
        if let Some(guarded) = self.guarded.as_mut().filter(|_| reaching || touching) {
            guarded.see(&images, touching.then_some(self.motion.clock()));
        }
        self.advance()?;
        self.leave();
        let arm = self.motion.follow()?;
        let wanted = self.held_tension(observation, &images);
        let wanted = against_friction(self.motion.hand(), &self.protocol.friction, &observation.servos, &wanted);
        self.oppose();
        let mut capture = self.is_looking() && self.motion.captures_look();
        let unknown = |guarded: &Guarded| self.motion.progress() > UNTOUCHED && !guarded.knows_untouched();
        let period = match self.phase {
            _ if self.is_reaching() && self.guarded.as_ref().is_some_and(unknown) => Some(guarded::LOOK_PERIOD),
            _ if self.is_touching() => Some(guarded::LOOK_PERIOD),
            _ if self.slip.is_some() && self.is_carrying() => Some(slip::LOOK_PERIOD),
            _ => None,
        };
        if period.is_some_and(|period| observation.time >= self.last_images + period) {
            self.last_images = observation.time;
            capture = true;
        }
        capture = self.watch.captures(observation, capture, period.is_none());
        Ok(self.motion.command(arm, &wanted, self.opposition, capture))
    }
}
