//! The executive: runs a two-object trial tick by tick on whatever body it is given.
//!
//! It sees what a robot measures and nothing else. Every phase is one palm path of the shared [`Motion`]. After each lift tactile
//! images are taken, and the executive waits for a policy: in [`Phase::Decide`] for how to take the second object
//! ([`Executive::decide`]), in [`Phase::Confirm`] for the order to carry both away ([`Executive::confirm`]), and in both for another try
//! of a grasp that failed. A last look ends the hold: what is lost by then can be tried again from [`Phase::Done`]. Cloning it,
//! together with a clone of a simulated body, branches a trial.

use std::ops::Deref;
use std::sync::Arc;

use grasping::Grasp;
use hand_model::robot::{Command, Observation, TactileFrame};
use hand_model::{DigitVector, Hand};
use nalgebra::{Isometry3, Translation3, Vector3};

use world::geometry::Shape;
pub use world::phase::Phase;

use crate::guarded::{self, Guarded};
use crate::inverse_kinematics::ArmServo;
use crate::motion::approach::in_parts;
use crate::motion::tension::{against_friction, closing_tension};
use crate::motion::{LOOK_TIME, Motion, MotionError, Protocol};
use crate::palpation::{self, Touching};
use crate::percept::Percept;
use crate::slip::{self, SlipWatch};
use crate::trajectory::PosePath;
use crate::watch::Watch;

/// Share of the way to a touch after which pads are looked at untouched: digits have opened by then.
const UNTOUCHED: f64 = 0.4;
/// Share of the rise from a touch, and of the whole approach at most, in which the digits that touched keep still: closing for the
/// grasp at once they would drag the object along.
const LEAVING: (f64, f64) = (0.9, 0.5);
/// How far the palm may rise before it goes to the second object, so that what it holds passes above, m.
const RISES: [f64; 3] = [0.0, 0.05, 0.1];

/// Runs one trial; see the module's page.
#[derive(Clone)]
pub struct Executive {
    motion: Motion,
    protocol: Protocol,
    first: (Grasp, Percept),
    second: (Grasp, Percept),
    phase: Phase,
    /// Time on the path of [`Phase::PutDown`] at which the digits open, s.
    open_from: f64,
    /// When images were last asked for between looks, s.
    last_images: f64,
    /// Images that nothing is decided by.
    watch: Watch,
    slip: Option<SlipWatch>,
    /// How an object is touched at present.
    guarded: Option<Guarded>,
    /// Height from which the hand is still rising that has just touched an object, m.
    left_from: Option<f64>,
}

/// What moves: posture, palm, images and servo readings.
impl Deref for Executive {
    type Target = Motion;

    fn deref(&self) -> &Motion {
        &self.motion
    }
}

impl Executive {
    /// An executive about to approach the first object with an arm at rest in `servo`'s posture.
    pub fn new(
        hand: Arc<Hand>,
        servo: ArmServo,
        protocol: Protocol,
        first: (Grasp, Percept),
        second: (Grasp, Percept),
        tick: f64,
    ) -> Result<Self, MotionError> {
        let mut executive = Self {
            motion: Motion::new(hand, servo, tick)?,
            protocol,
            first,
            second,
            phase: Phase::ApproachFirst,
            open_from: f64::INFINITY,
            last_images: f64::NEG_INFINITY,
            watch: Watch::default(),
            slip: None,
            guarded: None,
            left_from: None,
        };
        executive.enter(Phase::ApproachFirst)?;
        Ok(executive)
    }

    /// Before anything has moved: waits in [`Phase::Begin`] for a policy that does not begin with the approach.
    pub fn wait_to_begin(&mut self) -> Result<(), MotionError> {
        self.phase = Phase::Begin;
        self.motion.begin(self.motion.stop(0.0)?);
        Ok(())
    }

    /// The present phase.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// The first grasp and its percept.
    pub fn first(&self) -> &(Grasp, Percept) {
        &self.first
    }

    /// The second grasp as planned at present, with the percept it aims at.
    pub fn second(&self) -> &(Grasp, Percept) {
        &self.second
    }

    /// Asks for images every `period` (s) throughout, for a recording, or as often as the link brings them where that is less often; nothing is
    /// decided by them.
    pub fn watch_images(&mut self, period: f64) {
        self.watch.begin(period);
    }

    /// The stops of the ways from the present palm pose to another, before the approach pose: the shortest way, then higher ones.
    pub fn ways(&self) -> impl Iterator<Item = Vec<Isometry3<f64>>> {
        RISES.iter().map(|rise| self.motion.stops(self.rise() + rise))
    }

    /// The path by way of `stops` that takes an object with `grasp` where it is seen at `percept`: to the approach pose, and from
    /// there to where the digits close.
    pub fn path_to(
        &self,
        stops: &[Isometry3<f64>],
        grasp: &Grasp,
        percept: &Percept,
    ) -> Result<[PosePath; 2], MotionError> {
        Ok(in_parts(&self.protocol.limits, stops, grasp, percept)?)
    }

    /// A path by way of `stops` that the arm can follow to where `grasp` closes on what is seen at `percept`; see
    /// [`Motion::rehearsed_approach`].
    pub fn rehearsed_approach(&self, stops: &[Isometry3<f64>], grasp: &Grasp, percept: &Percept) -> Option<PosePath> {
        self.motion.rehearsed_approach(&self.protocol.limits, grasp, percept, stops)
    }

    /// How far the palm rises before it goes anywhere else, m: fingers that touch an object leave it upwards.
    fn rise(&self) -> f64 {
        if matches!(self.phase, Phase::LocateFirst | Phase::LocateSecond) { palpation::RISE } else { 0.0 }
    }

    /// The ways in which the arm can touch the first or second `object` of this `shape` where it is seen, the usual one first.
    pub fn rehearsed_touches(&self, object: usize, shape: &Shape) -> impl Iterator<Item = Touching> {
        let (motion, limits, (grasp, seen)) =
            (&self.motion, &self.protocol.limits, [&self.first, &self.second][object]);
        let onto = palpation::touches(motion.hand(), grasp.yaw + seen.yaw, (shape, seen)).into_iter();
        onto.filter_map(move |onto| {
            let there = onto.start();
            let way = motion.rehearsed(limits, |limits| [palpation::way(limits, &motion.end(), &there)])?;
            Some(Touching { way, onto })
        })
    }

    /// Leaves [`Phase::Decide`] with `second` as the grasp to use, or [`Phase::Confirm`] or [`Phase::Done`] to try the second object
    /// again with it; the first one is held.
    pub fn decide(&mut self, second: Grasp) -> Result<(), MotionError> {
        self.second.0 = second;
        self.enter(Phase::ApproachSecond)
    }

    /// The same by `path`, with the second object taken to be at `percept`.
    pub fn take_second(&mut self, grasp: Grasp, percept: Percept, path: PosePath) -> Result<(), MotionError> {
        self.see_second(percept);
        self.decide(grasp)?;
        self.redirect(path);
        Ok(())
    }

    /// Takes `path` instead of the straight approach that has just begun.
    pub fn redirect(&mut self, path: PosePath) {
        self.motion.redirect(path);
    }

    /// Leaves [`Phase::Confirm`]: both objects are taken to be in the hand and carried away.
    pub fn confirm(&mut self) -> Result<(), MotionError> {
        self.enter(Phase::Carry)
    }

    /// Tries the first object again with `grasp`, seen anew at `percept`; the hand is empty.
    pub fn retry_first(&mut self, grasp: Grasp, percept: Percept) -> Result<(), MotionError> {
        self.first = (grasp, percept);
        self.enter(Phase::ApproachFirst)
    }

    /// The first object is now seen at `percept`.
    pub fn see_first(&mut self, percept: Percept) {
        self.first.1 = percept;
    }

    /// The second object is now seen at `percept`.
    pub fn see_second(&mut self, percept: Percept) {
        self.second.1 = percept;
    }

    /// Puts down what is held, opens the hand and rises again; [`Phase::Decide`] follows.
    pub fn put_down(&mut self) -> Result<(), MotionError> {
        self.enter(Phase::PutDown)
    }

    /// From now on slip while carrying is answered with tension; images are taken for that.
    pub fn react_to_slip(&mut self) {
        self.slip = Some(SlipWatch::default());
    }

    /// Leaves a decision to touch the first or second `object` before it is grasped: along `way`, then on as `guarded` says;
    /// [`Phase::LocateFirst`] or [`Phase::LocateSecond`] follows.
    pub fn touch(&mut self, object: usize, way: PosePath, guarded: Guarded) {
        self.guarded = Some(guarded);
        self.phase = [Phase::ReachFirst, Phase::ReachSecond][object];
        self.motion.begin(way);
    }

    /// How often either object was felt to slip so far.
    pub fn slips(&self) -> [u32; 2] {
        self.slip.as_ref().map_or([0; 2], SlipWatch::steps)
    }

    /// Moves the hand with what it holds out of the eyes' way; [`Phase::Decide`] follows.
    pub fn step_aside(&mut self) -> Result<(), MotionError> {
        self.enter(Phase::StepAside)
    }

    fn enter(&mut self, phase: Phase) -> Result<(), MotionError> {
        let touched = matches!(self.phase, Phase::LocateFirst | Phase::LocateSecond);
        self.left_from = touched.then(|| self.motion.end().translation.z);
        let (motion, limits) = (&self.motion, &self.protocol.limits);
        let path = match phase {
            Phase::ApproachFirst => motion.approach(limits, &self.first.0, &self.first.1)?,
            Phase::ApproachSecond => motion.approach(limits, &self.second.0, &self.second.1)?,
            Phase::GraspFirst => motion.close(self.first.0.raise)?,
            Phase::GraspSecond => motion.close(self.second.0.raise)?,
            Phase::LiftFirst | Phase::LiftSecond => motion.lift(limits, self.protocol.lift)?,
            Phase::ReachFirst | Phase::ReachSecond => motion.wait()?,
            Phase::TouchFirst | Phase::TouchSecond => match &self.guarded {
                Some(guarded) => guarded.path().clone(),
                None => motion.wait()?,
            },
            Phase::FeelFirst | Phase::FeelSecond => motion.stop(palpation::SETTLING)?,
            Phase::Look | Phase::Check | Phase::Verify => motion.rest(LOOK_TIME)?,
            Phase::PutDown => {
                let (path, open_from) = motion.put_down(limits, self.protocol.lift)?;
                self.open_from = open_from;
                path
            }
            Phase::StepAside => motion.home(limits)?,
            Phase::Carry => {
                let here = motion.end();
                let aside = here.translation.vector + Vector3::y() * self.protocol.carry;
                motion.straight(limits, Isometry3::from_parts(Translation3::from(aside), here.rotation))?
            }
            Phase::Hold => motion.rest(self.protocol.hold)?,
            Phase::Begin | Phase::Decide | Phase::LocateFirst | Phase::LocateSecond | Phase::Confirm | Phase::Done => {
                motion.wait()?
            }
        };
        self.phase = phase;
        if self.is_looking() {
            self.motion.begin_look();
        }
        self.motion.begin(path);
        Ok(())
    }

    fn next_phase(&self) -> Option<Phase> {
        let touched = |guarded: &Guarded| self.is_touching() && guarded.is_over(self.motion.clock());
        if !self.motion.is_over() && !self.guarded.as_ref().is_some_and(touched) {
            return None;
        }
        let after_look = |phase: Phase| self.motion.has_looked().then_some(phase);
        match self.phase {
            Phase::ApproachFirst => Some(Phase::GraspFirst),
            Phase::GraspFirst => Some(Phase::LiftFirst),
            Phase::LiftFirst => Some(Phase::Look),
            Phase::Look => after_look(Phase::Decide),
            Phase::Check => after_look(Phase::Confirm),
            Phase::PutDown | Phase::StepAside => Some(Phase::Decide),
            Phase::ReachFirst => Some(Phase::TouchFirst),
            Phase::TouchFirst => Some(Phase::FeelFirst),
            Phase::FeelFirst => after_look(Phase::LocateFirst),
            Phase::ReachSecond => Some(Phase::TouchSecond),
            Phase::TouchSecond => Some(Phase::FeelSecond),
            Phase::FeelSecond => after_look(Phase::LocateSecond),
            Phase::ApproachSecond => Some(Phase::GraspSecond),
            Phase::GraspSecond => Some(Phase::LiftSecond),
            Phase::LiftSecond => Some(Phase::Check),
            Phase::Carry => Some(Phase::Hold),
            Phase::Hold => Some(Phase::Verify),
            Phase::Verify => after_look(Phase::Done),
            Phase::Begin | Phase::Decide | Phase::LocateFirst | Phase::LocateSecond | Phase::Confirm | Phase::Done => {
                None
            }
        }
    }

    fn is_looking(&self) -> bool {
        matches!(self.phase, Phase::Look | Phase::FeelFirst | Phase::FeelSecond | Phase::Check | Phase::Verify)
    }

    fn is_reaching(&self) -> bool {
        matches!(self.phase, Phase::ReachFirst | Phase::ReachSecond)
    }

    fn is_touching(&self) -> bool {
        matches!(self.phase, Phase::TouchFirst | Phase::TouchSecond)
    }

    /// Notes when the hand has risen from an object that it touched.
    fn leave(&mut self) {
        let height = self.motion.palm().translation.z - LEAVING.0 * palpation::RISE;
        if self.left_from.is_some_and(|from| height > from) || self.motion.progress() > LEAVING.1 {
            self.left_from = None;
        }
    }

    fn is_carrying(&self) -> bool {
        matches!(self.phase, Phase::Carry | Phase::Hold | Phase::Verify)
    }

    /// Takes what was measured in a tick in which somebody else commands.
    pub fn attend(&mut self, observation: &Observation) {
        self.motion.measure(observation, &[]);
    }

    /// One tick: takes what was measured, gives the command.
    pub fn tick(&mut self, observation: &Observation) -> Result<Command, MotionError> {
        let images = self.watch.others(&observation.tactile, self.motion.tick_length());
        self.motion.measure(observation, if self.is_looking() { &images } else { &[] });
        let (reaching, touching) = (self.is_reaching(), self.is_touching());
        if let Some(guarded) = self.guarded.as_mut().filter(|_| reaching || touching) {
            guarded.see(&images, touching.then_some(self.motion.clock()));
        }
        if let Some(next) = self.next_phase() {
            self.enter(next)?;
        }
        self.leave();
        let arm = self.motion.follow()?;
        let wanted = self.held_tension(observation, &images);
        let wanted = against_friction(self.motion.hand(), &self.protocol.friction, &observation.servos, &wanted);
        let opposition = match self.phase {
            Phase::PutDown => self.second.0.opposition,
            phase if phase < Phase::ApproachSecond => self.first.0.opposition,
            _ => self.second.0.opposition,
        };
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
        Ok(self.motion.command(arm, &wanted, opposition, capture))
    }

    /// Tensions wanted at present, with what the reaction to slip adds, N.
    fn held_tension(&mut self, observation: &Observation, images: &[TactileFrame]) -> DigitVector {
        let (plan, carrying) = (self.wanted_tensions(), self.is_carrying());
        let (hand, tick) = (self.motion.hand(), self.motion.tick_length());
        let Some(watch) = &mut self.slip else { return plan };
        if !carrying {
            if self.phase < Phase::Carry {
                watch.begin();
            }
            return plan;
        }
        let most = slip::most_tension(hand);
        watch.tick(hand, &observation.servos, images, &plan, most, tick)
    }

    /// Tensions that the grasps want in the present phase, N.
    pub fn wanted_tensions(&self) -> DigitVector {
        let (first, second) = (&self.first.0, &self.second.0);
        let closing = |grasp: &Grasp, digit: usize| closing_tension(grasp, digit, self.motion.clock());
        let leaving = self.left_from.is_some();
        self.motion.hand().each_digit(|digit| match self.phase {
            Phase::ApproachFirst | Phase::ApproachSecond if leaving => {
                first.close_tension[digit].max(palpation::TENSION[digit])
            }
            Phase::ApproachFirst => first.pre_tension[digit],
            Phase::GraspFirst => closing(first, digit),
            Phase::Begin => 0.0,
            Phase::StepAside | Phase::LiftFirst | Phase::Look | Phase::Decide => first.close_tension[digit],
            // Of an empty hand, ring and little finger close out of the way.
            Phase::ReachFirst
            | Phase::TouchFirst
            | Phase::FeelFirst
            | Phase::LocateFirst
            | Phase::ReachSecond
            | Phase::TouchSecond
            | Phase::FeelSecond
            | Phase::LocateSecond => first.close_tension[digit].max(palpation::TENSION[digit]),
            Phase::ApproachSecond => first.close_tension[digit].max(second.pre_tension[digit]),
            Phase::GraspSecond => first.close_tension[digit].max(closing(second, digit)),
            Phase::PutDown if self.motion.clock() >= self.open_from => 0.0,
            Phase::PutDown
            | Phase::LiftSecond
            | Phase::Check
            | Phase::Confirm
            | Phase::Carry
            | Phase::Hold
            | Phase::Verify
            | Phase::Done => first.close_tension[digit].max(second.close_tension[digit]),
        })
    }
}
