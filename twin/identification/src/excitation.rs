//! Excitation: moves a robot by a [`Script`], whether simulated, emulated or real. Limits are enforced by the robot
//! itself.

mod lifting;

use control::outage::Outage;
use hand_model::robot::{ArmState, Command, Readings, RobotBackend, RobotError, ServoGoal, ServoState};
use hand_model::{ActuatorVector, ArmVector, Hand};

use crate::ball::{Approach, Press};
use crate::means::Means;
use crate::pressing::Aim;
use crate::script::{Motion, Script, Step, actuator};
use crate::touches::{PAUSE, PressImages};
use crate::weight::{Part, Posture};
use lifting::Ended;

/// Tolerance of the set-points for having reached a posture, rad.
const THERE: f64 = 1e-4;

/// Greatest time to wait for images, s.
const LATEST: f64 = 0.3;

/// Number of images of a look; below, the ticks between them: an odd number, so that an oscillation from tick to tick
/// averages out.
const IMAGES: usize = 2;
const BETWEEN: usize = 5;

/// Force on the arm at which a press ends, N, whatever the images show: four times the force of the deepest press. A
/// joint near its stop may look like 9 N.
const MOST_FORCE: f64 = 12.0;
/// Speed of the fastest joint towards the ball, rad/s: about 2 cm/s of the hand, so that early contact is noticed in
/// time.
const GUARDED_SPEED: f64 = 0.04;
/// Number of ticks for which the force must persist to count as a contact and not as a jolt.
const MET_TICKS: u32 = 3;

/// Difference between requested and sent set-point beyond which the robot holds its arm back, rad.
const HELD: f64 = 0.02;
/// Time for which that difference must persist, s.
const HELD_TIME: f64 = 1.0;

/// The robot holds the arm back: continuing would show other postures than the script's.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "joint {joint} of the arm is held by the robot: asked for {asked:.3} rad, sent {sent:.3} rad, since {since:.1} s of the session; its limits let no arm go there, or not so fast"
)]
pub struct ArmHeld {
    /// Number of the joint, from 1.
    pub joint: usize,
    /// Requested set-point, rad.
    pub asked: f64,
    /// Set-point that the robot sent instead, rad.
    pub sent: f64,
    /// Time at which that began, s.
    pub since: f64,
}

/// Reasons for an excitation to end early.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ExcitationError {
    #[error(transparent)]
    Held(#[from] ArmHeld),
    /// The robot failed to observe or send for too long.
    #[error(transparent)]
    Robot(#[from] RobotError),
}

/// Progress of an excitation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Progress {
    /// A step begins.
    Begins(usize),
    /// A step is done.
    Done(usize),
    /// The arm cannot reach the posture with everything clear; the step is skipped.
    OutOfReach(usize),
    /// No weight is felt in the hand; the step is skipped.
    NotLifted(usize),
    /// The robot held the arm back, and the arm has returned; the rest of the step is skipped.
    Blocked(usize, ArmHeld),
}

impl Progress {
    /// Returns the step that is finished with this event, whether played or skipped.
    pub fn over(self) -> Option<usize> {
        match self {
            Self::Begins(_) => None,
            Self::Done(step) | Self::OutOfReach(step) | Self::NotLifted(step) | Self::Blocked(step, _) => Some(step),
        }
    }
}

/// Plays the script's steps from `first` on, from wherever the robot stands. Calls `heard` with the progress of each step, and
/// `goes_on` at each tick to ask whether to continue. Returns true if all steps were played. The hand is open at the end.
///
/// # Errors
/// Errors of `heard`, and [`ExcitationError`].
pub fn play<R: RobotBackend, E: From<ExcitationError>>(
    robot: &mut R,
    means: &Means,
    first: usize,
    mut heard: impl FnMut(Progress) -> Result<(), E>,
    mut goes_on: impl FnMut(&mut R) -> bool,
) -> Result<bool, E> {
    let seen = robot.observe().and_then(Readings::complete);
    let observation = seen.map_err(ExcitationError::Robot)?;
    let (time, arm, images) = (observation.time, observation.arm.position, PressImages::default());
    let (felt, servos, script) = (observation.arm, observation.servos, means.script);
    let (outage, failed) = (Outage::default(), None);
    let (grip, lag, held) = (None, None, None);
    let mut player = Player { robot, time, arm, felt, servos, script, images, grip, lag, held, outage, failed };
    let mut aim = means.script.ball.as_ref().map(|ball| Aim::new(means, ball));
    for (n, step) in means.script.steps(&means.robot.hand).iter().enumerate().skip(first) {
        heard(Progress::Begins(n))?;
        let (went_on, back) = match (step, &mut aim) {
            (Step::Press(_, press), Some(aim)) => match aim.at(press, &player.arm) {
                Some(approach) => (player.press(press, &approach, aim, &mut goes_on), Some(approach.hover)),
                None => {
                    heard(Progress::OutOfReach(n))?;
                    continue;
                }
            },
            (Step::Motion(posture, motion), _) => {
                (player.motion((&means.robot.hand, &means.ready), posture, motion, &mut goes_on), None)
            }
            (Step::Press(..), None) => (true, None),
            (Step::Weigh(weight, part), aim) => {
                let own = aim.as_ref().map_or(means.robot, |aim| aim.own());
                let back = Some(weight.stand(0, &means.ready));
                match player.weigh(means, own, (weight, *part), &mut goes_on) {
                    Ended::Done => (true, back),
                    Ended::Stopped => (false, back),
                    Ended::OutOfReach => {
                        heard(Progress::OutOfReach(n))?;
                        continue;
                    }
                    Ended::NotLifted => {
                        heard(Progress::NotLifted(n))?;
                        continue;
                    }
                }
            }
        };
        if let Some(error) = player.failed.take() {
            return Err(ExcitationError::Robot(error).into());
        }
        if !went_on {
            let Some(held) = player.held else { return Ok(false) };
            match back {
                Some(back) if player.goes_back(&back, &mut goes_on) => heard(Progress::Blocked(n, held))?,
                _ => return player.held.map_or(Ok(false), |held| Err(ExcitationError::Held(held).into())),
            }
            continue;
        }
        heard(Progress::Done(n))?;
    }
    let opened = player.open(means.script.open_time, &mut goes_on);
    if let Some(error) = player.failed {
        return Err(ExcitationError::Robot(error).into());
    }
    player.held.map_or(Ok(opened), |held| Err(ExcitationError::Held(held).into()))
}

struct Player<'a, R> {
    robot: &'a mut R,
    /// Time of the newest observation, s.
    time: f64,
    /// Set-points of the arm, rad.
    arm: ArmVector,
    /// State that the arm last reported.
    felt: ArmState,
    /// State that the servos last reported.
    servos: ActuatorVector<ServoState>,
    script: &'a Script,
    images: PressImages,
    /// Goals of servos that hold something; none if the hand is open.
    grip: Option<ActuatorVector<ServoGoal>>,
    /// Deviation of the sent set-points from the requested ones, as long as it lasts.
    lag: Option<ArmHeld>,
    /// The same deviation once it has lasted too long.
    held: Option<ArmHeld>,
    outage: Outage,
    /// Error for which the robot can no longer observe or send.
    failed: Option<RobotError>,
}

impl<R: RobotBackend> Player<'_, R> {
    /// Returns the goals of servos that hold the hand open, or hold the object in it.
    fn holding(&self) -> ActuatorVector<ServoGoal> {
        let open = ServoGoal::Position { angle: 0.0, current_limit: self.script.open_current };
        self.grip.unwrap_or_else(|| self.servos.iter().map(|_| open).collect())
    }

    /// Lets a tick pass in which the hand stays as it is.
    fn tick(&mut self, goes_on: &mut impl FnMut(&mut R) -> bool) -> bool {
        self.tick_and(self.holding(), false, goes_on)
    }

    fn tick_and(
        &mut self,
        servos: ActuatorVector<ServoGoal>,
        capture: bool,
        goes_on: &mut impl FnMut(&mut R) -> bool,
    ) -> bool {
        if !goes_on(self.robot) {
            return false;
        }
        self.exchange(&Command { arm: self.arm, servos, capture }).unwrap_or_else(|error| {
            self.failed = Some(error);
            false
        })
    }

    /// Sends a command, lets a tick pass and observes. Returns false if the arm is held back.
    fn exchange(&mut self, command: &Command) -> Result<bool, RobotError> {
        if let Some(sent) = self.outage.sent(self.robot.send(command))? {
            self.held = self.held.or_else(|| self.lags(&sent.arm));
            if self.held.is_some() {
                return Ok(false);
            }
        }
        self.robot.wait_for_tick();
        if let Some(observation) = self.outage.observed(self.robot.observe())? {
            (self.time, self.felt, self.servos) = (observation.time, observation.arm, observation.servos);
            self.images.see(&observation);
        }
        Ok(true)
    }

    /// Moves an arm that the robot held back to where the way was free, starting from where the robot has it.
    fn goes_back(&mut self, to: &[f64], goes_on: &mut impl FnMut(&mut R) -> bool) -> bool {
        (self.held, self.lag, self.grip) = (None, None, None);
        self.arm = self.felt.position;
        self.go(to, goes_on)
    }

    /// Notes the set-points `sent` by the robot (rad). Returns the joint with the greatest deviation once it has lasted
    /// too long.
    fn lags(&mut self, sent: &[f64]) -> Option<ArmHeld> {
        let off = |joint: &usize| (self.arm[*joint] - sent[*joint]).abs();
        let worst = (0..sent.len()).max_by(|a, b| off(a).total_cmp(&off(b))).filter(|joint| off(joint) > HELD);
        let since = self.lag.map_or(self.time, |lag| lag.since);
        self.lag = worst.map(|joint| ArmHeld { joint: joint + 1, asked: self.arm[joint], sent: sent[joint], since });
        self.lag.filter(|_| self.time - since > HELD_TIME)
    }

    /// Holds the hand as it is for `time` (s).
    fn open(&mut self, time: f64, goes_on: &mut impl FnMut(&mut R) -> bool) -> bool {
        let end = self.time + time;
        while self.time < end {
            if !self.tick(goes_on) {
                return false;
            }
        }
        true
    }

    fn motion(
        &mut self,
        (hand, ready): (&Hand, &[f64]),
        posture: &Posture,
        motion: &Motion,
        goes_on: &mut impl FnMut(&mut R) -> bool,
    ) -> bool {
        let target: ArmVector = ready.iter().zip(posture.turn).map(|(ready, turn)| ready + turn).collect();
        if !self.go(&target, goes_on) || !self.open(self.script.open_time, goes_on) {
            return false;
        }
        let moved: Vec<usize> = motion.actuators.iter().filter_map(|name| actuator(hand, name)).collect();
        let begun = self.time;
        // A quarter of a tick, because times are sums of ticks.
        let early = 0.25 * self.robot.tick_length();
        loop {
            let elapsed = self.time - begun + early;
            let Some(current) = self.script.current(motion, elapsed) else { return true };
            let mut servos = self.holding();
            moved.iter().for_each(|n| servos[*n] = ServoGoal::Current(current));
            if !self.tick_and(servos, false, goes_on) {
                return false;
            }
        }
    }

    /// Presses a pad on the ball, deeper from look to look until it is deep enough, slides over the ball, and retreats.
    fn press(
        &mut self,
        press: &Press,
        approach: &Approach,
        aim: &mut Aim,
        goes_on: &mut impl FnMut(&mut R) -> bool,
    ) -> bool {
        // The first look after a pause is at untouched pads.
        let hovers = approach.round.iter().chain([&approach.hover]).all(|at| self.go(at, goes_on));
        if !hovers || !self.open(PAUSE + LATEST, goes_on) || !self.look(goes_on) {
            return false;
        }
        let clear = self.felt;
        for posture in &approach.way {
            let Some(met) = self.go_until(posture, |felt| aim.force(&clear, felt) > MOST_FORCE, goes_on) else {
                return false;
            };
            if !self.open(aim.ball().settle, goes_on) || !self.look(goes_on) {
                return false;
            }
            if met || aim.is_deep(press.camera, &self.images) || aim.force(&clear, &self.felt) > MOST_FORCE {
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

    /// Requests images a few times and waits for them up to a time limit.
    fn look(&mut self, goes_on: &mut impl FnMut(&mut R) -> bool) -> bool {
        for _ in 0..IMAGES {
            let asked = self.time;
            if !self.tick_and(self.holding(), true, goes_on) {
                return false;
            }
            let mut ticks = 1;
            while ticks < BETWEEN || (self.images.newest_time() <= asked && self.time < asked + LATEST) {
                if !self.tick(goes_on) {
                    return false;
                }
                ticks += 1;
            }
        }
        true
    }

    /// Moves the arm's set-points in a straight line in joint space at the script's speed.
    fn go(&mut self, target: &[f64], goes_on: &mut impl FnMut(&mut R) -> bool) -> bool {
        self.go_at(target, self.script.arm_speed, goes_on)
    }

    /// Moves slowly, and stops if `met` holds for the state of the arm for a few ticks. Returns true if it stopped for
    /// that, and none if it was told to stop.
    fn go_until(
        &mut self,
        target: &[f64],
        met: impl Fn(&ArmState) -> bool,
        goes_on: &mut impl FnMut(&mut R) -> bool,
    ) -> Option<bool> {
        let mut ticks = 0;
        while self.step(target, GUARDED_SPEED) {
            if !self.tick(goes_on) {
                return None;
            }
            ticks = if met(&self.felt) { ticks + 1 } else { 0 };
            if ticks >= MET_TICKS {
                return Some(true);
            }
        }
        Some(false)
    }

    /// Like [`Self::go`], with the fastest joint at `speed` (rad/s).
    fn go_at(&mut self, target: &[f64], speed: f64, goes_on: &mut impl FnMut(&mut R) -> bool) -> bool {
        while self.step(target, speed) {
            if !self.tick(goes_on) {
                return false;
            }
        }
        true
    }

    /// Moves the set-points by one tick, with the fastest joint at `speed` (rad/s). Returns false if they are at the
    /// target.
    fn step(&mut self, target: &[f64], speed: f64) -> bool {
        let way: ArmVector = target.iter().zip(self.arm).map(|(target, at)| target - at).collect();
        let longest = way.iter().fold(0.0_f64, |longest, way| longest.max(way.abs()));
        if longest < THERE {
            return false;
        }
        let share = (speed * self.robot.tick_length() / longest).min(1.0);
        for (at, way) in self.arm.iter_mut().zip(way) {
            *at += share * way;
        }
        true
    }
}

/// Describes the script for the operator before anything moves, one line per step.
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
            Step::Weigh(weight, Part::Empty(posture)) => (
                format!("{:26} {:32}", weight.posture[*posture].name, "weighing, hand empty"),
                format!("stands for {:.1} s", weight.hold),
            ),
            Step::Weigh(weight, Part::Lifted) => (
                format!("{:26} {:32}", weight.object, "picked up, held, put down"),
                format!("{:.0} g, in {} postures", 1e3 * weight.mass, weight.posture.len()),
            ),
        };
        format!("{:3}  {what} {how}, {:4.1} s in all", n + 1, script.length(&step, hand))
    };
    script.steps(hand).into_iter().enumerate().map(line).collect()
}

#[cfg(test)]
mod tests;
