//! Moves a robot by a [`Script`]: any body, simulated, emulated or real; limits are the body's own.

use hand_model::robot::{Command, Robot, ServoGoal};
use hand_model::{ACTUATORS, ARM_JOINTS, Hand};
use serde::{Deserialize, Serialize};

use crate::script::{Script, Step, actuator};

/// How close to a posture the arm's set-points are there, rad.
const THERE: f64 = 1e-4;

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
}

/// Plays the script's steps from `first` on, from wherever the robot stands; `ready` is the posture that they turn from. `heard` is told of
/// each step; `goes_on` is asked at each tick. Returns whether all was played. The hand is open at the end.
pub fn play<R: Robot, E>(
    robot: &mut R,
    hand: &Hand,
    script: &Script,
    (ready, first): (&[f64; ARM_JOINTS], usize),
    mut heard: impl FnMut(Progress) -> Result<(), E>,
    mut goes_on: impl FnMut(&mut R) -> bool,
) -> Result<bool, E> {
    let observation = robot.observe();
    let mut player = Player { robot, time: observation.time, arm: observation.arm.position, script };
    for (n, step) in script.steps().iter().enumerate().skip(first) {
        heard(Progress::Begins(n))?;
        if !player.step(hand, step, ready, &mut goes_on) {
            return Ok(false);
        }
        heard(Progress::Done(n))?;
    }
    Ok(player.open(script.open_time, &mut goes_on))
}

struct Player<'a, R> {
    robot: &'a mut R,
    /// Of the newest observation, s.
    time: f64,
    /// Set-points, rad.
    arm: [f64; ARM_JOINTS],
    script: &'a Script,
}

impl<R: Robot> Player<'_, R> {
    /// Goals of servos that hold the hand open.
    fn opening(&self) -> [ServoGoal; ACTUATORS] {
        [ServoGoal::Position { angle: 0.0, current_limit: self.script.open_current }; ACTUATORS]
    }

    fn tick(&mut self, servos: [ServoGoal; ACTUATORS], goes_on: &mut impl FnMut(&mut R) -> bool) -> bool {
        if !goes_on(self.robot) {
            return false;
        }
        self.robot.send(&Command { arm: self.arm, servos, capture: false });
        self.robot.wait_for_tick();
        self.time = self.robot.observe().time;
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

    fn step(
        &mut self,
        hand: &Hand,
        step: &Step,
        ready: &[f64; ARM_JOINTS],
        goes_on: &mut impl FnMut(&mut R) -> bool,
    ) -> bool {
        let target: [f64; ARM_JOINTS] = std::array::from_fn(|joint| ready[joint] + step.posture.turn[joint]);
        if !self.go(&target, goes_on) || !self.open(self.script.open_time, goes_on) {
            return false;
        }
        let moved: Vec<usize> = step.motion.actuators.iter().filter_map(|name| actuator(hand, name)).collect();
        let begun = self.time;
        // A quarter of a tick: times are sums of ticks.
        let early = 0.25 * self.robot.tick_length();
        loop {
            let elapsed = self.time - begun + early;
            let Some(current) = self.script.current(step.motion, elapsed) else { return true };
            let mut servos = self.opening();
            moved.iter().for_each(|n| servos[*n] = ServoGoal::Current(current));
            if !self.tick(servos, goes_on) {
                return false;
            }
        }
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
pub fn described(script: &Script) -> Vec<String> {
    let line = |(n, step): (usize, Step)| {
        format!(
            "{:3}  {:26} {:32} up to {:3.0} mA in {:.1} s, {:4.1} s in all",
            n + 1,
            step.posture.name,
            step.motion.actuators.join(", "),
            1e3 * step.motion.current,
            step.motion.time,
            script.length(step.motion)
        )
    };
    script.steps().into_iter().enumerate().map(line).collect()
}
