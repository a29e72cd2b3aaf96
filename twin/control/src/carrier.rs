//! The carrier: takes one object after the other, as many as the digits hold, and brings them all to one place.
//!
//! Where [`crate::executive`] runs the benchmark's two-object trial phase by phase, this repeats a single cycle as long as there is
//! something to take: approach, close, lift, look, and then a policy decides what comes next. Digits that hold something keep
//! their tension while others close. A clone, together with a clone of a simulated body, branches a transport.

use std::ops::Deref;
use std::sync::Arc;

use grasping::Grasp;
use hand_model::robot::{Command, Observation};
use hand_model::{Digit, DigitVector, Hand};
use nalgebra::{Isometry3, Translation3};

use crate::inverse_kinematics::ArmServo;
use crate::motion::tension::{against_friction, closing_tension};
use crate::motion::{LOOK_TIME, Motion, MotionError, Protocol};
use crate::percept::Percept;

/// How far the palm goes down to release objects, as a share of the lift.
const LOWERING: f64 = 0.6;

/// What the carrier is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CarryPhase {
    /// Waiting for the decision what to take next, or to carry away what is held.
    Decide,
    /// To an object.
    Approach,
    Close,
    /// Raising it.
    Lift,
    /// Still, taking tactile images.
    Look,
    /// Carrying what is held to the goal.
    Carry,
    /// Holding it still there.
    Hold,
    /// Putting it down and opening the hand.
    Release,
}

impl CarryPhase {
    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Decide => "decide",
            Self::Approach => "approach",
            Self::Close => "close",
            Self::Lift => "lift",
            Self::Look => "look",
            Self::Carry => "carry",
            Self::Hold => "hold",
            Self::Release => "release",
        }
    }
}

/// Runs one transport; see the module's page.
#[derive(Clone)]
pub struct Carrier {
    motion: Motion,
    protocol: Protocol,
    phase: CarryPhase,
    grasp: Option<Grasp>,
    /// Tension with which each digit holds what it has, N.
    kept: DigitVector,
    opposition: f64,
}

/// What moves: posture, palm, images and servo readings.
impl Deref for Carrier {
    type Target = Motion;

    fn deref(&self) -> &Motion {
        &self.motion
    }
}

impl Carrier {
    /// A carrier with an empty hand and its arm at rest in `servo`'s posture; `tick` s is the length of a tick.
    pub fn new(hand: Arc<Hand>, servo: ArmServo, protocol: Protocol, tick: f64) -> Result<Self, MotionError> {
        let kept = hand.slack();
        Ok(Self {
            motion: Motion::new(hand, servo, tick)?,
            protocol,
            phase: CarryPhase::Decide,
            grasp: None,
            kept,
            opposition: 0.0,
        })
    }

    /// What is being done.
    pub fn phase(&self) -> CarryPhase {
        self.phase
    }

    /// Digits that keep holding what they have.
    pub fn holding(&self) -> Vec<Digit> {
        let kept = Digit::ALL.into_iter().zip(&self.kept).filter(|(_, tension)| **tension > 0.0);
        kept.map(|(digit, _)| digit).collect()
    }

    /// Leaves [`CarryPhase::Decide`] to take what is seen at `percept` with `grasp`, beside what is held.
    pub fn take(&mut self, grasp: Grasp, percept: &Percept) -> Result<(), MotionError> {
        let path = self.motion.approach(&self.protocol.limits, &grasp, percept)?;
        self.motion.begin(path);
        self.grasp = Some(grasp);
        self.phase = CarryPhase::Approach;
        Ok(())
    }

    /// Digits other than `holding` open again: they have nothing.
    pub fn keep_only(&mut self, holding: &[Digit]) {
        for digit in self.motion.hand().digits() {
            if !holding.contains(&digit) {
                self.kept[digit.index()] = 0.0;
            }
        }
    }

    /// Leaves [`CarryPhase::Decide`] to bring the palm over (x, y), m, hold for the protocol's time, and release everything there.
    pub fn deliver(&mut self, [x, y]: [f64; 2]) -> Result<(), MotionError> {
        let here = self.motion.end();
        let target = Isometry3::from_parts(Translation3::new(x, y, here.translation.z), here.rotation);
        let path = self.motion.straight(&self.protocol.limits, target)?;
        self.motion.begin(path);
        self.phase = CarryPhase::Carry;
        Ok(())
    }

    /// Begins the next phase when the present one is over.
    fn advance(&mut self) -> Result<(), MotionError> {
        if !self.motion.is_over() {
            return Ok(());
        }
        let (motion, limits) = (&self.motion, &self.protocol.limits);
        let (phase, path) = match self.phase {
            CarryPhase::Decide => return Ok(()),
            CarryPhase::Approach => {
                let raise = self.grasp.as_ref().map_or(0.0, |grasp| grasp.raise);
                (CarryPhase::Close, motion.close(raise)?)
            }
            CarryPhase::Close => {
                if let Some(grasp) = &self.grasp {
                    for (kept, close) in self.kept.iter_mut().zip(grasp.close_tension) {
                        *kept = kept.max(close);
                    }
                }
                (CarryPhase::Lift, motion.lift(limits, self.protocol.lift)?)
            }
            CarryPhase::Lift => {
                let path = motion.rest(LOOK_TIME)?;
                self.motion.begin_look();
                (CarryPhase::Look, path)
            }
            CarryPhase::Look if !motion.has_looked() => return Ok(()),
            CarryPhase::Look | CarryPhase::Release => (CarryPhase::Decide, motion.wait()?),
            CarryPhase::Carry => (CarryPhase::Hold, motion.rest(self.protocol.hold)?),
            CarryPhase::Hold => {
                let (path, _) = motion.put_down(limits, LOWERING * self.protocol.lift)?;
                self.kept = self.motion.hand().slack();
                (CarryPhase::Release, path)
            }
        };
        self.motion.begin(path);
        self.phase = phase;
        Ok(())
    }

    /// One tick: takes what was measured, gives the command.
    pub fn tick(&mut self, observation: &Observation) -> Result<Command, MotionError> {
        let looking = self.phase == CarryPhase::Look;
        self.motion.measure(observation, if looking { &observation.tactile } else { &[] });
        self.advance()?;
        let arm = self.motion.follow()?;
        let wanted = self.wanted_tension();
        let wanted = against_friction(self.motion.hand(), &self.protocol.friction, &observation.servos, &wanted);
        // A thumb that holds something stays opposed as it is.
        if let Some(grasp) = self.grasp.as_ref().filter(|_| self.kept[Digit::Thumb.index()] == 0.0) {
            self.opposition = grasp.opposition;
        }
        let capture = self.phase == CarryPhase::Look && self.motion.captures_look();
        Ok(self.motion.command(arm, &wanted, self.opposition, capture))
    }

    fn wanted_tension(&self) -> DigitVector {
        let Some(grasp) = &self.grasp else { return self.kept };
        self.motion.hand().each_digit(|digit| match self.phase {
            CarryPhase::Approach => self.kept[digit].max(grasp.pre_tension[digit]),
            CarryPhase::Close => self.kept[digit].max(closing_tension(grasp, digit, self.motion.clock())),
            _ => self.kept[digit],
        })
    }
}
