//! Excitation: moves a simulated, emulated or real robot by an [`ExcitationScript`]. Limits are enforced by the robot
//! itself.

mod lifting;

use control::outage::Outage;
use hand_model::robot::{ArmState, Readings, RobotBackend, RobotCommand, RobotError, ServoGoal, ServoState};
use hand_model::{ActuatorVector, ArmVector, Hand};

use crate::ball::{PadPress, PressApproach};
use crate::excitation_setup::ExcitationSetup;
use crate::payload::{PayloadStep, ScriptPosture};
use crate::pressing::PressAim;
use crate::script::{ExcitationScript, ExcitationStep, WindingMotion, actuator};
use crate::touches::{PRESS_PAUSE, PressImages};
use lifting::LiftOutcome;

/// Tolerance of the set-points at a requested posture, rad.
const REACH_TOLERANCE: f64 = 1e-4;

/// Maximum time to wait for images, s.
const IMAGE_TIMEOUT: f64 = 0.3;

/// Number of images of a snapshot; below, the ticks between them: an odd number, so that an oscillation from tick to
/// tick averages out.
const IMAGES_PER_SNAPSHOT: usize = 2;
const TICKS_BETWEEN_IMAGES: usize = 5;

/// Force on the arm at which a press ends, N, whatever the images show: four times the force of the deepest press. A
/// joint near its stop may snapshot like 9 N.
const MAX_PRESS_FORCE: f64 = 12.0;
/// Speed of the fastest joint towards the ball, rad/s: about 2 cm/s of the hand, so that early contact is noticed in
/// time.
const GUARDED_SPEED: f64 = 0.04;
/// Number of ticks for which the force must persist to count as a contact and not as a jolt.
const CONTACT_TICKS: u32 = 3;

/// Difference between requested and sent set-point beyond which the robot holds its arm back, rad.
const HOLD_BACK_TOLERANCE: f64 = 0.02;
/// Time for which that difference must persist, s.
const HOLD_BACK_TIME: f64 = 1.0;

/// The robot holds the arm back: continuing would reach other postures than the script's.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error(
    "joint {joint} of the arm is held by the robot: asked for {requested:.3} rad, sent {sent:.3} rad, since {since:.1} s of the session; position or velocity limit reached"
)]
pub struct ArmHeldBack {
    /// Number of the joint, from 1.
    pub joint: usize,
    /// Requested set-point, rad.
    pub requested: f64,
    /// Set-point that the robot sent instead, rad.
    pub sent: f64,
    /// Start time of the deviation, s.
    pub since: f64,
}

/// Reasons for an excitation to end early.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ExcitationError {
    #[error(transparent)]
    Held(#[from] ArmHeldBack),
    /// The robot failed to observe or send for too long.
    #[error(transparent)]
    Robot(#[from] RobotError),
}

/// Progress of an excitation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ExcitationProgress {
    /// A step begins.
    Begins(usize),
    /// A step is done.
    Done(usize),
    /// The arm cannot reach the posture with everything clear; the step is skipped.
    OutOfReach(usize),
    /// The arm bears no weight in the hand; the step is skipped.
    NotLifted(usize),
    /// The robot held the arm back, and the arm has returned; the rest of the step is skipped.
    Blocked(usize, ArmHeldBack),
}

impl ExcitationProgress {
    /// Returns the step that is finished with this event, whether run or skipped.
    pub fn finished_step(self) -> Option<usize> {
        match self {
            Self::Begins(_) => None,
            Self::Done(step) | Self::OutOfReach(step) | Self::NotLifted(step) | Self::Blocked(step, _) => Some(step),
        }
    }
}

/// Runs the script's steps from `first` on, from any posture of the robot. Calls `heard` with the progress of each
/// step, and `goes_on` at each tick to ask whether to continue. Returns true if all steps were run. The hand is open at
/// the end.
///
/// # Errors
/// Errors of `heard`, and [`ExcitationError`].
pub fn run_script<R: RobotBackend, E: From<ExcitationError>>(
    robot: &mut R,
    means: &ExcitationSetup,
    first: usize,
    mut heard: impl FnMut(ExcitationProgress) -> Result<(), E>,
    mut goes_on: impl FnMut(&mut R) -> bool,
) -> Result<bool, E> {
    let seen = robot.observe().and_then(Readings::into_observation);
    let observation = seen.map_err(ExcitationError::Robot)?;
    let (time, arm, images) = (observation.time, observation.arm.position, PressImages::default());
    let (felt, servos, script) = (observation.arm, observation.servos, means.script);
    let (outage, failed) = (Outage::default(), None);
    let (grip, lag, held) = (None, None, None);
    let mut player = ScriptPlayer {
        robot,
        time,
        arm,
        arm_state: felt,
        servos,
        script,
        images,
        grip,
        deviation: lag,
        held_back: held,
        outage,
        failure: failed,
    };
    let mut aim = means.script.ball.as_ref().map(|ball| PressAim::new(means, ball));
    for (n, step) in means.script.steps(&means.robot.hand).iter().enumerate().skip(first) {
        heard(ExcitationProgress::Begins(n))?;
        let (went_on, back) = match (step, &mut aim) {
            (ExcitationStep::Press(_, press), Some(aim)) => match aim.plan_press(press, &player.arm) {
                Some(approach) => (player.run_press(press, &approach, aim, &mut goes_on), Some(approach.hover)),
                None => {
                    heard(ExcitationProgress::OutOfReach(n))?;
                    continue;
                }
            },
            (ExcitationStep::Motion(posture, motion), _) => {
                (player.run_motion((&means.robot.hand, &means.ready), posture, motion, &mut goes_on), None)
            }
            (ExcitationStep::Press(..), None) => (true, None),
            (ExcitationStep::CalibratePayload(weight, part), aim) => {
                let back = Some(weight.posture_joints(0, &means.ready));
                match player.calibrate_payload(means, aim.as_ref(), (weight, *part), &mut goes_on) {
                    LiftOutcome::Done => (true, back),
                    LiftOutcome::Stopped => (false, back),
                    LiftOutcome::OutOfReach => {
                        heard(ExcitationProgress::OutOfReach(n))?;
                        continue;
                    }
                    LiftOutcome::NotLifted => {
                        heard(ExcitationProgress::NotLifted(n))?;
                        continue;
                    }
                }
            }
        };
        if let Some(error) = player.failure.take() {
            return Err(ExcitationError::Robot(error).into());
        }
        if !went_on {
            let Some(held) = player.held_back else { return Ok(false) };
            match back {
                Some(back) if player.return_to(&back, &mut goes_on) => heard(ExcitationProgress::Blocked(n, held))?,
                _ => return player.held_back.map_or(Ok(false), |held| Err(ExcitationError::Held(held).into())),
            }
            continue;
        }
        heard(ExcitationProgress::Done(n))?;
    }
    let opened = player.hold_hand(means.script.open_time, &mut goes_on);
    if let Some(error) = player.failure {
        return Err(ExcitationError::Robot(error).into());
    }
    player.held_back.map_or(Ok(opened), |held| Err(ExcitationError::Held(held).into()))
}

struct ScriptPlayer<'a, R> {
    robot: &'a mut R,
    /// Time of the newest observation, s.
    time: f64,
    /// Set-points of the arm, rad.
    arm: ArmVector,
    /// State that the arm last reported.
    arm_state: ArmState,
    /// State that the servos last reported.
    servos: ActuatorVector<ServoState>,
    script: &'a ExcitationScript,
    images: PressImages,
    /// Goals of servos that hold something; none if the hand is open.
    grip: Option<ActuatorVector<ServoGoal>>,
    /// Deviation of the sent set-points from the requested ones, while it lasts.
    deviation: Option<ArmHeldBack>,
    /// The same deviation once it has lasted too long.
    held_back: Option<ArmHeldBack>,
    outage: Outage,
    /// Error that prevents further observations or commands.
    failure: Option<RobotError>,
}

impl<R: RobotBackend> ScriptPlayer<'_, R> {
    /// Returns the goals of servos that hold the hand open, or hold the object in it.
    fn holding_goals(&self) -> ActuatorVector<ServoGoal> {
        let open = ServoGoal::Position { angle: 0.0, current_limit: self.script.open_current };
        self.grip.unwrap_or_else(|| self.servos.iter().map(|_| open).collect())
    }

    /// Lets a tick pass in which the hand stays as it is.
    fn tick(&mut self, goes_on: &mut impl FnMut(&mut R) -> bool) -> bool {
        self.tick_with(self.holding_goals(), false, goes_on)
    }

    fn tick_with(
        &mut self,
        servos: ActuatorVector<ServoGoal>,
        capture: bool,
        goes_on: &mut impl FnMut(&mut R) -> bool,
    ) -> bool {
        if !goes_on(self.robot) {
            return false;
        }
        self.exchange(&RobotCommand { arm: self.arm, servos, capture }).unwrap_or_else(|error| {
            self.failure = Some(error);
            false
        })
    }

    /// Sends a command, lets a tick pass and observes. Returns false if the arm is held back.
    fn exchange(&mut self, command: &RobotCommand) -> Result<bool, RobotError> {
        if let Some(sent) = self.outage.record_send(self.robot.send(command))? {
            self.held_back = self.held_back.or_else(|| self.check_deviation(&sent.arm));
            if self.held_back.is_some() {
                return Ok(false);
            }
        }
        self.robot.wait_for_tick();
        if let Some(observation) = self.outage.record_observation(self.robot.observe())? {
            (self.time, self.arm_state, self.servos) = (observation.time, observation.arm, observation.servos);
            self.images.add_observation(&observation);
        }
        Ok(true)
    }

    /// Moves an arm that the robot held back to the last free posture, starting from its present one.
    fn return_to(&mut self, to: &[f64], goes_on: &mut impl FnMut(&mut R) -> bool) -> bool {
        (self.held_back, self.deviation, self.grip) = (None, None, None);
        self.arm = self.arm_state.position;
        self.move_to(to, goes_on)
    }

    /// Notes the set-points `sent` by the robot (rad). Returns the joint with the greatest deviation once it has lasted
    /// too long.
    fn check_deviation(&mut self, sent: &[f64]) -> Option<ArmHeldBack> {
        let off = |joint: &usize| (self.arm[*joint] - sent[*joint]).abs();
        let worst =
            (0..sent.len()).max_by(|a, b| off(a).total_cmp(&off(b))).filter(|joint| off(joint) > HOLD_BACK_TOLERANCE);
        let since = self.deviation.map_or(self.time, |lag| lag.since);
        self.deviation =
            worst.map(|joint| ArmHeldBack { joint: joint + 1, requested: self.arm[joint], sent: sent[joint], since });
        self.deviation.filter(|_| self.time - since > HOLD_BACK_TIME)
    }

    /// Holds the hand as it is for `time` (s).
    fn hold_hand(&mut self, time: f64, goes_on: &mut impl FnMut(&mut R) -> bool) -> bool {
        let end = self.time + time;
        while self.time < end {
            if !self.tick(goes_on) {
                return false;
            }
        }
        true
    }

    fn run_motion(
        &mut self,
        (hand, ready): (&Hand, &[f64]),
        posture: &ScriptPosture,
        motion: &WindingMotion,
        goes_on: &mut impl FnMut(&mut R) -> bool,
    ) -> bool {
        let target: ArmVector = ready.iter().zip(posture.turn).map(|(ready, turn)| ready + turn).collect();
        if !self.move_to(&target, goes_on) || !self.hold_hand(self.script.open_time, goes_on) {
            return false;
        }
        let moved: Vec<usize> = motion.actuators.iter().filter_map(|name| actuator(hand, name)).collect();
        let begun = self.time;
        // A quarter of a tick, because times are sums of ticks.
        let early = 0.25 * self.robot.tick_length();
        loop {
            let elapsed = self.time - begun + early;
            let Some(current) = self.script.current(motion, elapsed) else { return true };
            let mut servos = self.holding_goals();
            moved.iter().for_each(|n| servos[*n] = ServoGoal::Current(current));
            if !self.tick_with(servos, false, goes_on) {
                return false;
            }
        }
    }

    /// Presses a pad on the ball, deeper from snapshot to snapshot until it is deep enough, slides over the ball, and
    /// retreats.
    fn run_press(
        &mut self,
        press: &PadPress,
        approach: &PressApproach,
        aim: &mut PressAim,
        goes_on: &mut impl FnMut(&mut R) -> bool,
    ) -> bool {
        // The first snapshot after a pause shows untouched pads.
        let hovers = approach.waypoints.iter().chain([&approach.hover]).all(|at| self.move_to(at, goes_on));
        if !hovers || !self.hold_hand(PRESS_PAUSE + IMAGE_TIMEOUT, goes_on) || !self.take_snapshot(goes_on) {
            return false;
        }
        let clear = self.arm_state;
        for posture in &approach.press_postures {
            let Some(met) = self.move_until(posture, |felt| aim.force(&clear, felt) > MAX_PRESS_FORCE, goes_on) else {
                return false;
            };
            if !self.hold_hand(aim.ball().settle, goes_on) || !self.take_snapshot(goes_on) {
                return false;
            }
            if met || aim.is_deep(press.camera, &self.images) || aim.force(&clear, &self.arm_state) > MAX_PRESS_FORCE {
                break;
            }
        }
        aim.update_calibration(&self.images);
        let at = self.arm;
        for posture in aim.plan_slide(press, &at).unwrap_or_default() {
            if !self.move_to(&posture, goes_on) || !self.hold_hand(aim.ball().settle, goes_on) {
                return false;
            }
        }
        approach.press_postures.first().is_none_or(|back| self.move_to(back, goes_on))
            && self.move_to(&approach.hover, goes_on)
    }

    /// Requests images a few times and waits for them up to a time limit.
    fn take_snapshot(&mut self, goes_on: &mut impl FnMut(&mut R) -> bool) -> bool {
        for _ in 0..IMAGES_PER_SNAPSHOT {
            let asked = self.time;
            if !self.tick_with(self.holding_goals(), true, goes_on) {
                return false;
            }
            let mut ticks = 1;
            while ticks < TICKS_BETWEEN_IMAGES
                || (self.images.newest_time() <= asked && self.time < asked + IMAGE_TIMEOUT)
            {
                if !self.tick(goes_on) {
                    return false;
                }
                ticks += 1;
            }
        }
        true
    }

    /// Moves the arm's set-points in a straight line in joint space at the script's speed.
    fn move_to(&mut self, target: &[f64], goes_on: &mut impl FnMut(&mut R) -> bool) -> bool {
        self.move_at_speed(target, self.script.arm_speed, goes_on)
    }

    /// Moves slowly, and stops if `met` holds for the state of the arm for a few ticks. Returns true if it stopped for
    /// that, and none if `goes_on` ended it.
    fn move_until(
        &mut self,
        target: &[f64],
        met: impl Fn(&ArmState) -> bool,
        goes_on: &mut impl FnMut(&mut R) -> bool,
    ) -> Option<bool> {
        let mut ticks = 0;
        while self.step_towards(target, GUARDED_SPEED) {
            if !self.tick(goes_on) {
                return None;
            }
            ticks = if met(&self.arm_state) { ticks + 1 } else { 0 };
            if ticks >= CONTACT_TICKS {
                return Some(true);
            }
        }
        Some(false)
    }

    /// Like [`Self::move_to`], with the fastest joint at `speed` (rad/s).
    fn move_at_speed(&mut self, target: &[f64], speed: f64, goes_on: &mut impl FnMut(&mut R) -> bool) -> bool {
        while self.step_towards(target, speed) {
            if !self.tick(goes_on) {
                return false;
            }
        }
        true
    }

    /// Moves the set-points by one tick, with the fastest joint at `speed` (rad/s). Returns false if they are at the
    /// target.
    fn step_towards(&mut self, target: &[f64], speed: f64) -> bool {
        let way: ArmVector = target.iter().zip(self.arm).map(|(target, at)| target - at).collect();
        let longest = way.iter().fold(0.0_f64, |longest, way| longest.max(way.abs()));
        if longest < REACH_TOLERANCE {
            return false;
        }
        let share = (speed * self.robot.tick_length() / longest).min(1.0);
        for (at, way) in self.arm.iter_mut().zip(way) {
            *at += share * way;
        }
        true
    }
}

/// Describes the script for the operator before any motion, one line per step.
pub fn describe(script: &ExcitationScript, hand: &Hand) -> Vec<String> {
    let line = |(n, step): (usize, ExcitationStep)| {
        let (what, how) = match &step {
            ExcitationStep::Motion(posture, motion) => (
                format!("{:26} {:32}", posture.name, motion.actuators.join(", ")),
                format!("up to {:3.0} mA in {:.1} s", 1e3 * motion.current, motion.time),
            ),
            ExcitationStep::Press(ball, press) => (
                format!("{:26} {:32}", "ball", hand.cameras[press.camera].name),
                format!("at {:+.2} {:+.2}, {:.1} mm deep", press.spot[0], press.spot[1], 1e3 * ball.depth),
            ),
            ExcitationStep::CalibratePayload(weight, PayloadStep::Empty(posture)) => (
                format!("{:26} {:32}", weight.posture[*posture].name, "calibration, hand empty"),
                format!("stands for {:.1} s", weight.hold),
            ),
            ExcitationStep::CalibratePayload(weight, PayloadStep::Lifted) => (
                format!("{:26} {:32}", weight.object, "picked up, held, put down"),
                format!("{:.0} g, in {} postures", 1e3 * weight.mass, weight.posture.len()),
            ),
        };
        format!("{:3}  {what} {how}, {:4.1} s in all", n + 1, script.step_duration(&step, hand))
    };
    script.steps(hand).into_iter().enumerate().map(line).collect()
}

#[cfg(test)]
mod tests;
