//! The supervisor: in each cycle it turns the requested command and the measurements into the command that may be sent.

use crate::driven::SERVOS;
use hand_model::robot::{Command, ServoGoal};
use hand_model::{ArmVector, RobotModel};

use super::checks::{self, Measured};
use super::limits::{Limits, SafeGoal};
use super::pressing::{PressWatch, Pressed};
use super::set_points::SetPoints;
use super::space::{Room, SpaceWatch};
use super::state::{Cause, Refused, State};

/// Longest time step that counts for the motion of a goal, s: after a pause nothing may jump.
const LONGEST_STEP: f64 = 0.02;
/// Silence of the controller after which the arm's set-points count as being at rest, s.
const STANDS_AFTER: f64 = 0.05;

/// Command that may be sent, after all limits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SafeCommand {
    /// Goals of the servos, in actuator order.
    pub servos: [SafeGoal; SERVOS],
    /// Arm set-points, rad.
    pub arm: ArmVector,
}

impl SafeCommand {
    /// Converts to a command of the robot interface.
    pub fn as_command(&self, capture: bool) -> Command {
        let servos = self.servos.map(|goal| ServoGoal::Position { angle: goal.angle, current_limit: goal.current });
        Command { arm: self.arm, servos: servos.into(), capture }
    }
}

/// Decision of one cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Step {
    /// Send nothing.
    Silent,
    Send(SafeCommand),
    /// Switch the torque off.
    TorqueOff,
}

/// Newest command of the controller, with its time and number.
#[derive(Debug, Clone, Copy)]
pub struct Asked<'a> {
    pub command: &'a Command,
    /// Time at which the controller gave it, s.
    pub at: f64,
    /// Number of the command: the same number means the same command.
    pub number: u64,
}

/// Extremes that arm and hand have reached relative to their limits.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Margins {
    pub pressed: Option<Pressed>,
    pub room: Option<Room>,
}

#[derive(Debug, Clone)]
pub struct Supervisor {
    limits: Limits,
    state: State,
    sent: SafeCommand,
    /// Speeds that remain of the arm's set-points since it was stopped, rad/s.
    braking: Option<ArmVector>,
    /// Measured posture of an arm that pressed, to which it is sent to give way, rad.
    giving_way: Option<ArmVector>,
    set_points: SetPoints,
    /// Number and time (s) of the command that the set-points follow.
    followed: Option<(u64, f64)>,
    press: Option<PressWatch>,
    space: Option<SpaceWatch>,
    stepped: f64,
}

impl Supervisor {
    /// Creates the supervisor of a robot that is not connected.
    pub fn new(limits: Limits) -> Self {
        let sent = SafeCommand { servos: [SafeGoal::default(); SERVOS], arm: limits.arm.still() };
        Self {
            limits,
            state: State::Disconnected,
            sent,
            braking: None,
            giving_way: None,
            set_points: SetPoints::at(&sent.arm),
            followed: None,
            press: None,
            space: None,
            stepped: 0.0,
        }
    }

    /// Adds monitoring of pressing and of the workspace for a robot of this model, as far as there are limits for them.
    #[must_use]
    pub fn watching(self, robot: &RobotModel) -> Self {
        let press = self.limits.press.map(|limits| PressWatch::new(robot, limits));
        let space = self.limits.space.map(|limits| SpaceWatch::new(robot, limits));
        Self { press, space, ..self }
    }

    /// Returns the extremes that arm and hand have reached relative to their limits.
    pub fn margins(&self) -> Margins {
        let (press, space) = (self.press.as_ref(), self.space.as_ref());
        Margins { pressed: press.map(PressWatch::pressed), room: space.map(SpaceWatch::room) }
    }

    pub fn state(&self) -> State {
        self.state
    }

    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// Notes that the devices answer.
    pub fn connect(&mut self) -> Result<(), Refused> {
        self.go(State::Connected, "connect", |state| matches!(state, State::Disconnected))
    }

    /// Notes that the devices are gone or given up.
    pub fn disconnect(&mut self) {
        self.state = State::Disconnected;
    }

    /// Notes that the device checks passed. Fails if `measured` raises an alarm.
    pub fn check(&mut self, measured: &Measured, now: f64) -> Result<(), CheckFailed> {
        if let Some(cause) = checks::alarm(measured, &self.limits, now) {
            return Err(CheckFailed::Alarm(cause));
        }
        self.go(State::Checked, "be checked", |state| matches!(state, State::Connected | State::Checked))?;
        Ok(())
    }

    /// Arms the robot. Goals start at the measured positions, with zero current.
    pub fn arm(&mut self, measured: &Measured, now: f64) -> Result<SafeCommand, CheckFailed> {
        if let Some(cause) = checks::alarm(measured, &self.limits, now) {
            return Err(CheckFailed::Alarm(cause));
        }
        self.go(State::Armed, "arm", |state| matches!(state, State::Checked))?;
        for (n, (goal, servo)) in self.sent.servos.iter_mut().zip(&measured.servos).enumerate() {
            let (low, high) = self.limits.servos[n].angle;
            // The check above has verified that all measurements exist.
            *goal = SafeGoal { angle: servo.map_or(0.0, |servo| servo.state.position).clamp(low, high), current: 0.0 };
        }
        for (joint, goal) in self.sent.arm.iter_mut().enumerate() {
            let (low, high) = self.limits.arm.angle[joint];
            *goal = measured.arm.map_or(0.0, |arm| arm.state.position[joint]).clamp(low, high);
        }
        self.stepped = now;
        (self.set_points, self.followed) = (SetPoints::at(&self.sent.arm), None);
        (self.braking, self.giving_way) = (None, None);
        Ok(self.sent)
    }

    /// Stops and holds. A robot that has been checked but not armed must then be checked again.
    pub fn hold(&mut self, cause: Cause) {
        if self.state == State::Checked {
            self.state = State::Connected;
        }
        if matches!(self.state, State::Armed | State::Running) {
            self.state = if cause.is_fault() { State::Fault(cause) } else { State::Hold(cause) };
        } else if matches!(self.state, State::Hold(_)) && cause.is_fault() {
            self.state = State::Fault(cause);
        }
    }

    /// Begins a release: the hand opens. Possible whenever torque is on.
    pub fn release(&mut self, now: f64) -> Result<(), Refused> {
        self.go(State::Release { since: now }, "release", |state| {
            matches!(state, State::Armed | State::Running | State::Hold(_) | State::Fault(_))
        })
    }

    /// Runs one cycle: decides which command may be sent at `now` (s).
    pub fn step(&mut self, now: f64, asked: Option<Asked>, measured: &Measured) -> Step {
        let dt = (now - self.stepped).clamp(0.0, LONGEST_STEP);
        self.stepped = now;
        let on = matches!(self.state, State::Armed | State::Running | State::Hold(_));
        if let Some(cause) = checks::alarm(measured, &self.limits, now).filter(|_| on) {
            self.hold(cause);
        }
        self.feel(measured, now);
        if matches!(self.state, State::Armed | State::Running) {
            self.listen(asked, now);
        }
        if let (State::Running, Some(asked)) = (self.state, asked) {
            self.lead(&asked, measured);
        }
        match self.state {
            State::Disconnected | State::Connected | State::Checked => Step::Silent,
            State::Running => {
                self.braking = None;
                if let Some(asked) = asked {
                    self.follow(asked.command, measured, dt);
                }
                Step::Send(self.sent)
            }
            State::Armed => Step::Send(self.sent),
            State::Hold(_) | State::Fault(_) => {
                self.brake(measured, dt);
                for (goal, limits) in self.sent.servos.iter_mut().zip(&self.limits.servos) {
                    *goal = limits.hold(*goal);
                }
                Step::Send(self.sent)
            }
            State::Release { since } => {
                self.brake(measured, dt);
                self.fade(now - since, dt)
            }
        }
    }

    /// Monitors the arm's torques. An arm that presses too hard is stopped, if it is not already, and gives way.
    fn feel(&mut self, measured: &Measured, now: f64) {
        let on = !matches!(self.state, State::Disconnected | State::Connected | State::Checked);
        let fresh = measured.arm.filter(|arm| now - arm.at <= self.limits.watchdogs.arm);
        let (Some(press), Some(arm), true) = (&mut self.press, fresh, on) else { return };
        // A braking arm lags behind its set-points for a moment, as if it were pushed.
        if self.braking.is_some_and(|left| left.iter().any(|speed| *speed != 0.0)) {
            return press.forget();
        }
        let Some(cause) = press.see(&arm.state, arm.at) else { return };
        press.forget();
        self.hold(cause);
        self.giving_way = Some(arm.state.position);
    }

    /// Advances the set-points as a new command requests, unless arm and hand would come to rest outside the workspace
    /// limits; then it holds.
    fn lead(&mut self, asked: &Asked, measured: &Measured) {
        if self.followed.is_some_and(|(number, _)| number == asked.number) {
            return;
        }
        let stood = self.followed.is_some_and(|(_, at)| asked.at - at > STANDS_AFTER);
        self.followed = Some((asked.number, asked.at));
        let from = if stood { self.set_points.rested() } else { self.set_points };
        let arm = &self.limits.arm;
        let wanted = &asked.command.arm;
        let next = arm.motion.as_ref().map_or_else(|| SetPoints::at(wanted), |motion| from.follow(wanted, motion));
        let (standing, now) = (arm.stand(&next.angles(), &next.speeds()), arm.stand(&from.angles(), &from.speeds()));
        let servos = measured.servos.map(|servo| servo.map_or(0.0, |servo| servo.state.position));
        match self.space.as_mut().and_then(|space| space.see(&standing, &now, &servos)) {
            Some(cause) => self.hold(cause),
            None => self.set_points = next,
        }
    }

    /// Brakes the arm from the speed at which it moves. An arm that gives way returns to its measured posture instead.
    fn brake(&mut self, measured: &Measured, dt: f64) {
        if let Some(place) = &self.giving_way {
            self.sent.arm = self.limits.arm.limit(place, &self.sent.arm, dt);
            return;
        }
        let moving = || measured.arm.map_or_else(|| self.limits.arm.still(), |arm| arm.state.velocity);
        let speed = self.braking.unwrap_or_else(moving);
        let (arm, slower) = self.limits.arm.brake(&self.sent.arm, &speed, dt);
        self.sent.arm = arm;
        self.braking = Some(slower);
    }

    /// Checks that the controller is not silent and that its command is sound.
    fn listen(&mut self, asked: Option<Asked>, now: f64) {
        let Some(asked) = asked else { return };
        let silent = now - asked.at;
        if !checks::is_sound(asked.command) {
            self.hold(Cause::BadCommand);
        } else if silent > self.limits.watchdogs.host {
            if self.state == State::Running {
                self.hold(Cause::HostSilent(silent));
            }
        } else {
            self.state = State::Running;
        }
    }

    fn follow(&mut self, command: &Command, measured: &Measured, dt: f64) {
        for n in 0..SERVOS {
            let Some(servo) = measured.servos[n] else { continue };
            let limits = &self.limits.servos[n];
            self.sent.servos[n] = limits.limit(&command.servos[n], servo.state.position, self.sent.servos[n], dt);
        }
        self.sent.arm = self.limits.arm.limit(&self.set_points.angles(), &self.sent.arm, dt);
    }

    /// Lowers the current limit linearly to 0 within the release time, independent of the current before.
    fn fade(&mut self, elapsed: f64, dt: f64) -> Step {
        for (goal, limits) in self.sent.servos.iter_mut().zip(&self.limits.servos) {
            let fall = limits.current * dt / self.limits.release_time;
            goal.current = (goal.current.min(limits.current) - fall).max(0.0);
        }
        if elapsed >= self.limits.release_time {
            self.state = State::Connected;
            return Step::TorqueOff;
        }
        Step::Send(self.sent)
    }

    fn go(&mut self, to: State, wish: &'static str, from: impl Fn(&State) -> bool) -> Result<(), Refused> {
        if !from(&self.state) {
            return Err(Refused { wish, state: self.state.to_string() });
        }
        self.state = to;
        Ok(())
    }
}

/// Reason why the robot is not ready.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CheckFailed {
    /// A measurement raises an alarm.
    #[error("{0}")]
    Alarm(Cause),
    /// The present state does not allow the step.
    #[error(transparent)]
    Refused(#[from] Refused),
}

#[cfg(test)]
#[path = "supervisor_tests.rs"]
mod tests;
