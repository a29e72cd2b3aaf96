//! Moves a robot by a [`Script`]: any body, simulated, emulated or real; limits are the body's own.

use hand_model::robot::{ArmState, Command, Robot, ServoGoal};
use hand_model::{ACTUATORS, ARM_JOINTS, Arm, Hand};
use serde::{Deserialize, Serialize};
use touch::PhotometricCalibration;

use crate::ball::{Approach, Press};
use crate::pressing::Aim;
use crate::script::{Motion, Posture, Script, Step, actuator};
use crate::touches::{PAUSE, PressImages};

/// How close to a posture the arm's set-points are there, rad.
const THERE: f64 = 1e-4;

/// Images that have not come after this time are not waited for, s.
const LATEST: f64 = 0.3;

/// Images of a look, and ticks from one to the next: an odd number, so that what goes to and fro from tick to tick averages out.
const IMAGES: usize = 2;
const BETWEEN: usize = 5;

/// A press ends where the arm bears more than this, N, whatever the images show: four times what the deepest press
/// takes. A joint near its stop may look like 9 N.
const MOST_FORCE: f64 = 12.0;

/// What a session of an excitation says it is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Task {
    /// `excitation`.
    pub task: String,
    /// Name of the hand's drawing.
    pub hand: String,
    /// What it was moved by.
    pub script: Script,
    /// Index of the first step of this session.
    pub first: usize,
}

impl Task {
    /// Of the steps from `first` on.
    pub fn new(hand: &Hand, script: &Script, first: usize) -> Self {
        Self { task: NAME.to_owned(), hand: hand.parameters.name.clone(), script: script.clone(), first }
    }
}

/// [`Task::task`] of an excitation.
pub const NAME: &str = "excitation";

/// Where an excitation is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Progress {
    /// A step begins.
    Begins(usize),
    /// A step is done.
    Done(usize),
    /// The arm does not get there with everything clear: the step is left out.
    OutOfReach(usize),
}

/// What an excitation goes by.
#[derive(Debug, Clone, Copy)]
pub struct Means<'a> {
    pub hand: &'a Hand,
    pub arm: &'a Arm,
    /// With which the pads are read while they are pressed: that of the drawing's, as long as there is no other.
    pub pads: &'a PhotometricCalibration,
    pub script: &'a Script,
    /// Posture that the script's turn from, rad.
    pub ready: [f64; ARM_JOINTS],
}

/// Plays the script's steps from `first` on, from wherever the robot stands. `heard` is told of
/// each step; `goes_on` is asked at each tick. Returns whether all was played. The hand is open at the end.
pub fn play<R: Robot, E>(
    robot: &mut R,
    means: &Means,
    first: usize,
    mut heard: impl FnMut(Progress) -> Result<(), E>,
    mut goes_on: impl FnMut(&mut R) -> bool,
) -> Result<bool, E> {
    let observation = robot.observe();
    let (time, arm, images) = (observation.time, observation.arm.position, PressImages::default());
    let mut player = Player { robot, time, arm, felt: observation.arm, script: means.script, images };
    let mut aim = means.script.ball.as_ref().map(|ball| Aim::new(means, ball));
    for (n, step) in means.script.steps(means.hand).iter().enumerate().skip(first) {
        heard(Progress::Begins(n))?;
        let went_on = match (step, &mut aim) {
            (Step::Press(_, press), Some(aim)) => match aim.at(press) {
                Some(approach) => player.press(press, &approach, aim, &mut goes_on),
                None => {
                    heard(Progress::OutOfReach(n))?;
                    continue;
                }
            },
            (Step::Motion(posture, motion), _) => {
                player.motion((means.hand, &means.ready), posture, motion, &mut goes_on)
            }
            (Step::Press(..), None) => true,
        };
        if !went_on {
            return Ok(false);
        }
        heard(Progress::Done(n))?;
    }
    Ok(player.open(means.script.open_time, &mut goes_on))
}

struct Player<'a, R> {
    robot: &'a mut R,
    /// Of the newest observation, s.
    time: f64,
    /// Set-points, rad.
    arm: [f64; ARM_JOINTS],
    /// What the arm last reported.
    felt: ArmState,
    script: &'a Script,
    images: PressImages,
}

impl<R: Robot> Player<'_, R> {
    /// Goals of servos that hold the hand open.
    fn opening(&self) -> [ServoGoal; ACTUATORS] {
        [ServoGoal::Position { angle: 0.0, current_limit: self.script.open_current }; ACTUATORS]
    }

    fn tick(&mut self, servos: [ServoGoal; ACTUATORS], goes_on: &mut impl FnMut(&mut R) -> bool) -> bool {
        self.tick_and(servos, false, goes_on)
    }

    fn tick_and(
        &mut self,
        servos: [ServoGoal; ACTUATORS],
        capture: bool,
        goes_on: &mut impl FnMut(&mut R) -> bool,
    ) -> bool {
        if !goes_on(self.robot) {
            return false;
        }
        self.robot.send(&Command { arm: self.arm, servos, capture });
        self.robot.wait_for_tick();
        let observation = self.robot.observe();
        (self.time, self.felt) = (observation.time, observation.arm);
        self.images.see(&observation);
        true
    }

    /// Holds the hand open for a while.
    fn open(&mut self, time: f64, goes_on: &mut impl FnMut(&mut R) -> bool) -> bool {
        let end = self.time + time;
        while self.time < end {
            if !self.tick(self.opening(), goes_on) {
                return false;
            }
        }
        true
    }

    fn motion(
        &mut self,
        (hand, ready): (&Hand, &[f64; ARM_JOINTS]),
        posture: &Posture,
        motion: &Motion,
        goes_on: &mut impl FnMut(&mut R) -> bool,
    ) -> bool {
        let target: [f64; ARM_JOINTS] = std::array::from_fn(|joint| ready[joint] + posture.turn[joint]);
        if !self.go(&target, goes_on) || !self.open(self.script.open_time, goes_on) {
            return false;
        }
        let moved: Vec<usize> = motion.actuators.iter().filter_map(|name| actuator(hand, name)).collect();
        let begun = self.time;
        // A quarter of a tick: times are sums of ticks.
        let early = 0.25 * self.robot.tick_length();
        loop {
            let elapsed = self.time - begun + early;
            let Some(current) = self.script.current(motion, elapsed) else { return true };
            let mut servos = self.opening();
            moved.iter().for_each(|n| servos[*n] = ServoGoal::Current(current));
            if !self.tick(servos, goes_on) {
                return false;
            }
        }
    }

    /// Presses a pad on the ball, deeper from look to look until it is deep enough, slides over it, and leaves it again.
    fn press(
        &mut self,
        press: &Press,
        approach: &Approach,
        aim: &mut Aim,
        goes_on: &mut impl FnMut(&mut R) -> bool,
    ) -> bool {
        // The first look after a pause is at untouched pads.
        if !self.go(&approach.hover, goes_on) || !self.open(PAUSE + LATEST, goes_on) || !self.look(goes_on) {
            return false;
        }
        let clear = self.felt;
        for posture in &approach.way {
            if !self.go(posture, goes_on) || !self.open(aim.ball().settle, goes_on) || !self.look(goes_on) {
                return false;
            }
            if aim.is_deep(press.camera, &self.images) || aim.force(&clear, &self.felt) > MOST_FORCE {
                break;
            }
        }
        aim.learn(&self.images);
        let at = self.arm;
        for posture in aim.sideways(press, &at).unwrap_or_default() {
            if !self.go(&posture, goes_on) || !self.open(aim.ball().settle, goes_on) {
                return false;
            }
        }
        approach.way.first().is_none_or(|back| self.go(back, goes_on)) && self.go(&approach.hover, goes_on)
    }

    /// Asks for images a few times and waits for them, but not for ever.
    fn look(&mut self, goes_on: &mut impl FnMut(&mut R) -> bool) -> bool {
        for _ in 0..IMAGES {
            let asked = self.time;
            if !self.tick_and(self.opening(), true, goes_on) {
                return false;
            }
            let mut ticks = 1;
            while ticks < BETWEEN || (self.images.newest_time() <= asked && self.time < asked + LATEST) {
                if !self.tick(self.opening(), goes_on) {
                    return false;
                }
                ticks += 1;
            }
        }
        true
    }

    /// Moves the arm's set-points in a straight line, all joints at once.
    fn go(&mut self, target: &[f64; ARM_JOINTS], goes_on: &mut impl FnMut(&mut R) -> bool) -> bool {
        loop {
            let way: [f64; ARM_JOINTS] = std::array::from_fn(|joint| target[joint] - self.arm[joint]);
            let longest = way.iter().fold(0.0_f64, |longest, way| longest.max(way.abs()));
            if longest < THERE {
                return true;
            }
            let share = (self.script.arm_speed * self.robot.tick_length() / longest).min(1.0);
            for (at, way) in self.arm.iter_mut().zip(way) {
                *at += share * way;
            }
            if !self.tick(self.opening(), goes_on) {
                return false;
            }
        }
    }
}

/// What an operator reads before anything moves: a line a step.
pub fn described(script: &Script, hand: &Hand) -> Vec<String> {
    let line = |(n, step): (usize, Step)| {
        let (what, how) = match &step {
            Step::Motion(posture, motion) => (
                format!("{:26} {:32}", posture.name, motion.actuators.join(", ")),
                format!("up to {:3.0} mA in {:.1} s", 1e3 * motion.current, motion.time),
            ),
            Step::Press(ball, press) => (
                format!("{:26} {:32}", "ball", hand.cameras[press.camera].name),
                format!("at {:+.2} {:+.2}, {:.1} mm deep", press.spot[0], press.spot[1], 1e3 * ball.depth),
            ),
        };
        format!("{:3}  {what} {how}, {:4.1} s in all", n + 1, script.length(&step, hand))
    };
    script.steps(hand).into_iter().enumerate().map(line).collect()
}
