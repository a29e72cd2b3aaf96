//! The carrier: takes one object after the other, as many as the digits hold, and brings them all to one place.
//!
//! Where [`crate::executive`] runs the benchmark's two-object trial phase by phase, this knows a single cycle, gone through as
//! often as there is something to take: approach, close, lift, look, and then the decision what to do next. Digits that hold
//! something keep their tension while others close. A clone, together with a clone of a simulated body, branches a transport.

use std::sync::Arc;

use grasping::Grasp;
use hand_model::robot::{Command, Observation, ServoState, TactileFrame};
use hand_model::{ACTUATORS, CAMERAS, Digit, Hand};
use nalgebra::{Isometry3, Translation3, Vector3};

use crate::executive::holding::{approach_tension, closing_tension, servo_goals};
use crate::executive::way::approach;
use crate::executive::{
    CLOSING_TIME, ExecutiveError, LOOK_TIME, OPENING_TIME, Percept, Protocol, duration, keep_newest,
};
use crate::inverse_kinematics::{ArmServo, Joints};
use crate::trajectory::PosePath;

/// Height of the palm's way down over the place of delivery, as part of the lift.
const LOWERING: f64 = 0.6;

/// What the carrier is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Waiting for the word what to take next, or to bring away what is held.
    Decide,
    /// To an object.
    Approach,
    /// Closing on it.
    Close,
    /// Raising it.
    Lift,
    /// Still, taking tactile images.
    Look,
    /// Bringing what is held to its place.
    Carry,
    /// Holding it still there.
    Hold,
    /// Laying it down and opening the hand.
    Release,
}

impl Stage {
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

/// The carrier; see the module's page.
#[derive(Clone)]
pub struct Carrier {
    hand: Arc<Hand>,
    servo: ArmServo,
    protocol: Protocol,
    stage: Stage,
    clock: f64,
    path: PosePath,
    open_from: f64,
    grasp: Option<Grasp>,
    /// Tension with which each digit holds what it has, N.
    kept: [f64; 5],
    tension: [f64; 5],
    opposition: f64,
    images: Vec<TactileFrame>,
    newest: Vec<TactileFrame>,
    before: [Option<u64>; CAMERAS],
    servos: [ServoState; ACTUATORS],
    tick: f64,
}

impl Carrier {
    /// A carrier with an empty hand and its arm at rest in `servo`'s posture; `tick` s is the length of a tick.
    pub fn new(hand: Arc<Hand>, servo: ArmServo, protocol: Protocol, tick: f64) -> Result<Self, ExecutiveError> {
        let palm = servo.palm_pose();
        Ok(Self {
            hand,
            servo,
            protocol,
            stage: Stage::Decide,
            clock: 0.0,
            path: PosePath::new(vec![(0.0, palm)])?,
            open_from: f64::INFINITY,
            grasp: None,
            kept: [0.0; 5],
            tension: [0.0; 5],
            opposition: 0.0,
            images: Vec::new(),
            newest: Vec::new(),
            before: [None; CAMERAS],
            servos: Default::default(),
            tick,
        })
    }

    /// What is being done.
    pub fn stage(&self) -> Stage {
        self.stage
    }

    /// Part of it that is over, 0 to 1.
    pub fn progress(&self) -> f64 {
        let whole = self.path.duration();
        if whole > 0.0 { (self.clock / whole).min(1.0) } else { 1.0 }
    }

    /// Tactile images of the last [`Stage::Look`].
    pub fn images(&self) -> &[TactileFrame] {
        &self.images
    }

    /// Newest image of every camera.
    pub fn newest_images(&self) -> &[TactileFrame] {
        &self.newest
    }

    /// Sequence number that each camera had sent before those were asked for.
    pub fn sequences_before(&self) -> &[Option<u64>; CAMERAS] {
        &self.before
    }

    /// Newest servo readings.
    pub fn servos(&self) -> &[ServoState; ACTUATORS] {
        &self.servos
    }

    /// The arm's reference posture, rad.
    pub fn posture(&self) -> &Joints {
        self.servo.q()
    }

    /// Digits that keep holding what they have.
    pub fn holding(&self) -> Vec<Digit> {
        Digit::ALL.into_iter().filter(|digit| self.kept[digit.index()] > 0.0).collect()
    }

    /// Leaves [`Stage::Decide`] to take what is seen at `percept` with `grasp`, beside what is held.
    pub fn take(&mut self, grasp: Grasp, percept: &Percept) -> Result<(), ExecutiveError> {
        self.path = approach(&self.protocol.limits, &[self.path.end()], &grasp, percept)?;
        self.grasp = Some(grasp);
        self.begin(Stage::Approach);
        Ok(())
    }

    /// Digits other than `holding` open again: they have nothing.
    pub fn keep_only(&mut self, holding: &[Digit]) {
        for digit in Digit::ALL {
            if !holding.contains(&digit) {
                self.kept[digit.index()] = 0.0;
            }
        }
    }

    /// Leaves [`Stage::Decide`] to bring the palm over (x, y), m, hold for the protocol's time, and let go of everything there.
    pub fn deliver(&mut self, [x, y]: [f64; 2]) -> Result<(), ExecutiveError> {
        let here = self.path.end();
        let target = Isometry3::from_parts(Translation3::new(x, y, here.translation.z), here.rotation);
        self.path = PosePath::new(vec![(0.0, here), (duration(&self.protocol.limits, &here, &target), target)])?;
        self.begin(Stage::Carry);
        Ok(())
    }

    fn begin(&mut self, stage: Stage) {
        self.stage = stage;
        self.clock = 0.0;
    }

    /// Goes on to what follows when the present stage is over.
    fn advance(&mut self) -> Result<(), ExecutiveError> {
        if self.clock + 1e-9 < self.path.duration() {
            return Ok(());
        }
        let here = self.path.end();
        let up = |height: f64| {
            Isometry3::from_parts(Translation3::from(here.translation.vector + Vector3::z() * height), here.rotation)
        };
        let slow = self.protocol.limits.scaled(0.7);
        let (stage, waypoints) = match self.stage {
            Stage::Decide => return Ok(()),
            Stage::Approach => {
                let raise = self.grasp.as_ref().map_or(0.0, |grasp| grasp.raise);
                (Stage::Close, vec![(0.0, here), (CLOSING_TIME, up(raise))])
            }
            Stage::Close => {
                if let Some(grasp) = &self.grasp {
                    for (kept, close) in self.kept.iter_mut().zip(grasp.close_tension) {
                        *kept = kept.max(close);
                    }
                }
                let target = up(self.protocol.lift);
                (Stage::Lift, vec![(0.0, here), (duration(&slow, &here, &target), target)])
            }
            Stage::Lift => {
                self.images.clear();
                for frame in self.newest.iter().filter(|frame| frame.camera < CAMERAS) {
                    self.before[frame.camera] = Some(frame.sequence);
                }
                (Stage::Look, vec![(0.0, here), (LOOK_TIME, here)])
            }
            Stage::Look if self.images.len() < self.hand.cameras.len() && self.clock < 2.0 * LOOK_TIME => return Ok(()),
            Stage::Look | Stage::Release => (Stage::Decide, vec![(0.0, here)]),
            Stage::Carry => (Stage::Hold, vec![(0.0, here), (self.protocol.hold, here)]),
            Stage::Hold => {
                let down = up(-LOWERING * self.protocol.lift);
                let time = duration(&slow, &here, &down);
                self.open_from = time;
                self.kept = [0.0; 5];
                let opened = time + OPENING_TIME;
                (Stage::Release, vec![(0.0, here), (time, down), (opened, down), (opened + time, here)])
            }
        };
        self.path = PosePath::new(waypoints)?;
        self.begin(stage);
        Ok(())
    }

    /// One tick: takes what was measured, gives the command.
    pub fn tick(&mut self, observation: &Observation) -> Result<Command, ExecutiveError> {
        self.servos = observation.servos;
        keep_newest(&mut self.newest, &observation.tactile);
        let looking = self.stage == Stage::Look;
        if looking && self.clock > LOOK_TIME - 1.5 * self.tick {
            keep_newest(&mut self.images, &observation.tactile);
        }
        self.advance()?;
        self.clock += self.tick;
        let (palm, twist) = self.path.sample(self.clock);
        let step = self.servo.step(&palm, &twist, self.tick)?;
        let wanted = self.wanted_tension();
        approach_tension(&mut self.tension, &wanted, self.tick);
        // A thumb that holds something stays opposed as it is.
        if let Some(grasp) = self.grasp.as_ref().filter(|_| self.kept[Digit::Thumb.index()] == 0.0) {
            self.opposition = grasp.opposition;
        }
        let looking = self.stage == Stage::Look;
        Ok(Command {
            arm: step.q,
            servos: servo_goals(&self.hand, &self.tension, self.opposition),
            capture: looking && (self.clock - LOOK_TIME + self.tick).abs() < 0.6 * self.tick,
        })
    }

    fn wanted_tension(&self) -> [f64; 5] {
        let Some(grasp) = &self.grasp else { return self.kept };
        std::array::from_fn(|digit| match self.stage {
            Stage::Approach => self.kept[digit].max(grasp.pre_tension[digit]),
            Stage::Close => self.kept[digit].max(closing_tension(grasp, digit, self.clock)),
            _ => self.kept[digit],
        })
    }
}
