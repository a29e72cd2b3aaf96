//! The executive: runs a two-object trial tick by tick on whatever body it is given.
//!
//! It sees what a robot measures and nothing else. Every tick it looks at the clock of the present phase, samples the palm's
//! path, asks the arm servo for joint set-points and the digits for tensions. After each lift it takes tactile images and
//! waits: in [`Phase::Decide`] for how to take the second object ([`Executive::decide`]), in [`Phase::Confirm`] for the word to
//! carry both away ([`Executive::confirm`]), and in both for a new try of a grasp that failed. A last look ends the hold: what is
//! lost by then can be tried again from [`Phase::Done`]. Cloning it, together with a clone
//! of a simulated body, branches a trial.

pub(crate) mod holding;
pub(crate) mod way;

use std::sync::Arc;

use grasping::Grasp;
use hand_model::robot::{Command, Observation, TactileFrame};
use hand_model::{ACTUATORS, CAMERAS, Hand};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
pub use scenarios::phase::Phase;

use self::holding::{approach_tension, servo_goals};
use crate::inverse_kinematics::{ArmServo, IkError, Joints};
use crate::slip::{self, SlipWatch};
use crate::trajectory::{PathError, PathLimits, PosePath};

/// Time the digits are given to close, s.
pub(crate) const CLOSING_TIME: f64 = 1.1;
/// Distance from which the hand approaches a grasp, m.
pub const APPROACH_DISTANCE: f64 = 0.09;
/// Rest before the picture is taken and after it, s.
pub(crate) const LOOK_TIME: f64 = 0.3;
/// Time the digits are given to open when things are laid down, s.
pub(crate) const OPENING_TIME: f64 = 0.7;

/// An object as prior perception (a camera over the table, say) reports it, error included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Percept {
    /// Centre, m, world.
    pub position: Point3<f64>,
    /// Orientation `world_from_object`.
    pub rotation: UnitQuaternion<f64>,
    /// Yaw of that orientation about the vertical, rad.
    pub yaw: f64,
}

impl Percept {
    /// `world_from_object`.
    pub fn pose(&self) -> Isometry3<f64> {
        Isometry3::from_parts(Translation3::from(self.position.coords), self.rotation)
    }
}

/// Distances and times of a trial.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Protocol {
    /// How far objects are lifted, m.
    pub lift: f64,
    /// How far they are carried sideways, m.
    pub carry: f64,
    /// How long they are held at the end, s.
    pub hold: f64,
    /// Cartesian limits of free motion.
    pub limits: PathLimits,
}

/// Why a trial cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum ExecutiveError {
    /// A path could not be made.
    #[error(transparent)]
    Path(#[from] PathError),
    /// The arm servo failed.
    #[error(transparent)]
    Ik(#[from] IkError),
}

/// The executive; see the module's page.
#[derive(Clone)]
pub struct Executive {
    hand: Arc<Hand>,
    protocol: Protocol,
    servo: ArmServo,
    home: Isometry3<f64>,
    first: (Grasp, Percept),
    second: (Grasp, Percept),
    phase: Phase,
    clock: f64,
    open_from: f64,
    path: PosePath,
    tension: [f64; 5],
    opposition: f64,
    images: Vec<TactileFrame>,
    newest: Vec<TactileFrame>,
    before: [Option<u64>; CAMERAS],
    watch_period: Option<f64>,
    last_watch: f64,
    slip: Option<SlipWatch>,
    servos: [hand_model::robot::ServoState; ACTUATORS],
    tick: f64,
    worst_tracking: f64,
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
    ) -> Result<Self, ExecutiveError> {
        let palm = servo.palm_pose();
        let mut executive = Self {
            servo,
            home: palm,
            hand,
            protocol,
            first,
            second,
            phase: Phase::ApproachFirst,
            clock: 0.0,
            open_from: f64::INFINITY,
            path: PosePath::new(vec![(0.0, palm)])?,
            tension: [0.0; 5],
            opposition: 0.0,
            images: Vec::new(),
            newest: Vec::new(),
            before: [None; CAMERAS],
            watch_period: None,
            last_watch: f64::NEG_INFINITY,
            slip: None,
            servos: Default::default(),
            tick,
            worst_tracking: 0.0,
        };
        executive.enter(Phase::ApproachFirst)?;
        Ok(executive)
    }

    /// The present phase.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Tactile images taken during the last [`Phase::Look`], [`Phase::Check`] or [`Phase::Verify`].
    pub fn images(&self) -> &[TactileFrame] {
        &self.images
    }

    /// Sequence number that each camera had sent before the images of [`Self::images`] were asked for.
    pub fn sequences_before(&self) -> &[Option<u64>; CAMERAS] {
        &self.before
    }

    /// Newest images of all cameras that arrived, in any phase.
    pub fn newest_images(&self) -> &[TactileFrame] {
        &self.newest
    }

    /// Asks for images every `period` (s) throughout, for whoever watches; decisions use those of [`Phase::Look`] alone.
    pub fn watch_images(&mut self, period: f64) {
        self.watch_period = Some(period);
    }

    /// Part of the present phase that is over, 0 to 1.
    pub fn progress(&self) -> f64 {
        let whole = self.path.duration();
        if whole > 0.0 { (self.clock / whole).min(1.0) } else { 1.0 }
    }

    /// Newest servo readings.
    pub fn servos(&self) -> &[hand_model::robot::ServoState; ACTUATORS] {
        &self.servos
    }

    /// The second grasp as planned at present, with the percept it aims at.
    pub fn second(&self) -> &(Grasp, Percept) {
        &self.second
    }

    /// The first grasp and its percept.
    pub fn first(&self) -> &(Grasp, Percept) {
        &self.first
    }

    /// Largest distance between wanted and reached palm reference, m.
    pub fn worst_tracking(&self) -> f64 {
        self.worst_tracking
    }

    /// The arm's reference posture, rad.
    pub fn posture(&self) -> &Joints {
        self.servo.q()
    }

    /// `world_from_palm` that the executive wants at present.
    pub fn palm(&self) -> Isometry3<f64> {
        self.path.sample(self.clock).0
    }

    /// The path that would take the second object with `grasp`: from the present palm pose to where the digits close.
    pub fn path_to_second(&self, grasp: &Grasp) -> Result<PosePath, ExecutiveError> {
        self.approach(&[self.path.end()], grasp, &self.second.1, 1.0)
    }

    /// Leaves [`Phase::Decide`] with `second` as the grasp to use, or [`Phase::Confirm`] or [`Phase::Done`] to try the second object
    /// again with it; the first one is held.
    pub fn decide(&mut self, second: Grasp) -> Result<(), ExecutiveError> {
        self.second.0 = second;
        self.enter(Phase::ApproachSecond)
    }

    /// Leaves [`Phase::Confirm`]: both objects are taken to be in the hand and carried away.
    pub fn confirm(&mut self) -> Result<(), ExecutiveError> {
        self.enter(Phase::Carry)
    }

    /// Tries the first object again with `grasp`, seen anew at `percept`; the hand is empty.
    pub fn retry_first(&mut self, grasp: Grasp, percept: Percept) -> Result<(), ExecutiveError> {
        self.first = (grasp, percept);
        self.enter(Phase::ApproachFirst)
    }

    /// Takes note of where the second object is seen to be now.
    pub fn see_second(&mut self, percept: Percept) {
        self.second.1 = percept;
    }

    /// Lays down what is held, opens the hand and rises again; [`Phase::Decide`] follows.
    pub fn put_down(&mut self) -> Result<(), ExecutiveError> {
        self.enter(Phase::PutDown)
    }

    fn enter(&mut self, phase: Phase) -> Result<(), ExecutiveError> {
        let here = self.path.end();
        let up = |height: f64| {
            Isometry3::from_parts(Translation3::from(here.translation.vector + Vector3::z() * height), here.rotation)
        };
        let limits = self.protocol.limits;
        let rest = |time: f64| PosePath::new(vec![(0.0, here), (time, here)]);
        self.path = match phase {
            Phase::ApproachFirst => self.approach(&[here], &self.first.0, &self.first.1, 1.0)?,
            Phase::ApproachSecond => self.approach(&[here], &self.second.0, &self.second.1, 1.0)?,
            Phase::GraspFirst => PosePath::new(vec![(0.0, here), (CLOSING_TIME, up(self.first.0.raise))])?,
            Phase::GraspSecond => PosePath::new(vec![(0.0, here), (CLOSING_TIME, up(self.second.0.raise))])?,
            Phase::LiftFirst | Phase::LiftSecond => {
                let target = up(self.protocol.lift);
                PosePath::new(vec![(0.0, here), (duration(&limits.scaled(0.7), &here, &target), target)])?
            }
            Phase::Look | Phase::Check | Phase::Verify => rest(LOOK_TIME)?,
            Phase::PutDown => {
                let down = up(-self.protocol.lift);
                let time = duration(&limits.scaled(0.7), &here, &down);
                self.open_from = time;
                let opened = time + OPENING_TIME;
                PosePath::new(vec![(0.0, here), (time, down), (opened, down), (opened + time, here)])?
            }
            Phase::Carry => {
                let target = Isometry3::from_parts(
                    Translation3::from(here.translation.vector + Vector3::y() * self.protocol.carry),
                    here.rotation,
                );
                PosePath::new(vec![(0.0, here), (duration(&limits, &here, &target), target)])?
            }
            Phase::Hold => rest(self.protocol.hold)?,
            Phase::Decide | Phase::Confirm | Phase::Done => PosePath::new(vec![(0.0, here)])?,
        };
        if matches!(phase, Phase::Look | Phase::Check | Phase::Verify) {
            self.images.clear();
            for frame in self.newest.iter().filter(|frame| frame.camera < CAMERAS) {
                self.before[frame.camera] = Some(frame.sequence);
            }
        }
        self.phase = phase;
        self.clock = 0.0;
        Ok(())
    }

    fn next_phase(&self) -> Option<Phase> {
        if self.clock + 1e-9 < self.path.duration() {
            return None;
        }
        match self.phase {
            Phase::ApproachFirst => Some(Phase::GraspFirst),
            Phase::GraspFirst => Some(Phase::LiftFirst),
            Phase::LiftFirst => Some(Phase::Look),
            Phase::Look => self.looked().then_some(Phase::Decide),
            Phase::Check => self.looked().then_some(Phase::Confirm),
            Phase::PutDown => Some(Phase::Decide),
            Phase::ApproachSecond => Some(Phase::GraspSecond),
            Phase::GraspSecond => Some(Phase::LiftSecond),
            Phase::LiftSecond => Some(Phase::Check),
            Phase::Carry => Some(Phase::Hold),
            Phase::Hold => Some(Phase::Verify),
            Phase::Verify => self.looked().then_some(Phase::Done),
            Phase::Decide | Phase::Confirm | Phase::Done => None,
        }
    }

    fn looking(&self) -> bool {
        matches!(self.phase, Phase::Look | Phase::Check | Phase::Verify)
    }

    /// Whether the images of a look have come, or will not come any more.
    fn looked(&self) -> bool {
        self.images.len() >= self.hand.cameras.len() || self.clock > 2.0 * LOOK_TIME
    }

    /// One tick: takes what was measured, gives the command.
    pub fn tick(&mut self, observation: &Observation) -> Result<Command, ExecutiveError> {
        self.servos = observation.servos;
        keep_newest(&mut self.newest, &observation.tactile);
        // The picture asked for at the end of the look, when everything rests.
        if self.looking() && self.clock > LOOK_TIME - 1.5 * self.tick {
            keep_newest(&mut self.images, &observation.tactile);
        }
        if let Some(next) = self.next_phase() {
            self.enter(next)?;
        }
        self.clock += self.tick;
        let (palm, twist) = self.path.sample(self.clock);
        let step = self.servo.step(&palm, &twist, self.tick)?;
        self.worst_tracking = self.worst_tracking.max(step.position_error);
        let wanted = self.held_tension(observation);
        approach_tension(&mut self.tension, &wanted, self.tick);
        self.opposition = match self.phase {
            Phase::ApproachFirst | Phase::GraspFirst | Phase::LiftFirst | Phase::Look | Phase::Decide => {
                self.first.0.opposition
            }
            _ => self.second.0.opposition,
        };
        let mut capture = self.looking() && (self.clock - LOOK_TIME + self.tick).abs() < 0.6 * self.tick;
        let period = if self.slip.is_some() && self.carrying() { Some(slip::LOOK_PERIOD) } else { self.watch_period };
        if period.is_some_and(|period| observation.time >= self.last_watch + period) {
            self.last_watch = observation.time;
            capture = true;
        }
        Ok(Command { arm: step.q, servos: servo_goals(&self.hand, &self.tension, self.opposition), capture })
    }
}

/// Puts each camera's frame in the place of its older one: a real board's images come one after the other.
pub(crate) fn keep_newest(kept: &mut Vec<TactileFrame>, arrived: &[TactileFrame]) {
    for frame in arrived {
        match kept.iter_mut().find(|known| known.camera == frame.camera) {
            Some(known) => *known = frame.clone(),
            None => kept.push(frame.clone()),
        }
    }
}

/// Time for a motion between two poses within limits, s.
pub(crate) fn duration(limits: &PathLimits, from: &Isometry3<f64>, to: &Isometry3<f64>) -> f64 {
    let length = (to.translation.vector - from.translation.vector).norm();
    let angle = from.rotation.angle_to(&to.rotation);
    limits.duration(length, angle).max(0.05)
}
