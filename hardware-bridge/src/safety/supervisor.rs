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

/// Longest time between two steps that still counts for how far a goal may move, s: after a pause nothing may jump.
const LONGEST_STEP: f64 = 0.02;
/// A controller that was silent for longer has let the arm stand, s.
const STANDS_AFTER: f64 = 0.05;

/// What may be sent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SafeCommand {
    /// The servos, in actuator order.
    pub servos: [SafeGoal; SERVOS],
    /// Arm set-points, rad.
    pub arm: ArmVector,
}

impl SafeCommand {
    /// As a command of the robot interface.
    pub fn as_command(&self, capture: bool) -> Command {
        let servos = self.servos.map(|goal| ServoGoal::Position { angle: goal.angle, current_limit: goal.current });
        Command { arm: self.arm, servos: servos.into(), capture }
    }
}

/// What one step decides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Step {
    /// Send nothing.
    Silent,
    Send(SafeCommand),
    /// Take the torque away.
    TorqueOff,
}

/// A command and when the controller gave it, s.
#[derive(Debug, Clone, Copy)]
pub struct Asked<'a> {
    pub command: &'a Command,
    /// s.
    pub at: f64,
    /// Which one it is: the same number is the same command.
    pub number: u64,
}

/// How near to their limits arm and hand have come.
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
    /// Speeds that are left of the arm's set-points since it was stopped, rad/s.
    braking: Option<ArmVector>,
    /// Where an arm that pressed was measured to be: it is sent there, rad.
    giving_way: Option<ArmVector>,
    set_points: SetPoints,
    /// Number and time (s) of the command that they follow.
    followed: Option<(u64, f64)>,
    press: Option<PressWatch>,
    space: Option<SpaceWatch>,
    stepped: f64,
}

impl Supervisor {
    /// A supervisor of a robot that is not connected.
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

    /// The same for a robot of this model, which is watched for what it presses and where it goes, as far as there are limits for that.
    #[must_use]
    pub fn watching(self, robot: &RobotModel) -> Self {
        let press = self.limits.press.map(|limits| PressWatch::new(robot, limits));
        let space = self.limits.space.map(|limits| SpaceWatch::new(robot, limits));
        Self { press, space, ..self }
    }

    /// How near to their limits arm and hand have come.
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

    /// The devices answer.
    pub fn connect(&mut self) -> Result<(), Refused> {
        self.go(State::Connected, "connect", |state| matches!(state, State::Disconnected))
    }

    /// The devices are gone or given up.
    pub fn disconnect(&mut self) {
        self.state = State::Disconnected;
    }

    /// The checks found nothing wrong; `measured` must agree.
    pub fn check(&mut self, measured: &Measured, now: f64) -> Result<(), CheckFailed> {
        if let Some(cause) = checks::alarm(measured, &self.limits, now) {
            return Err(CheckFailed::Alarm(cause));
        }
        self.go(State::Checked, "be checked", |state| matches!(state, State::Connected | State::Checked))?;
        Ok(())
    }

    /// Arms the robot. Goals start at the measured positions, without current.
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

    /// Stops and holds. A robot that is not armed yet has to be checked again before it is.
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

    /// Lets go: the hand opens. Possible whenever torque is on.
    pub fn release(&mut self, now: f64) -> Result<(), Refused> {
        self.go(State::Release { since: now }, "release", |state| {
            matches!(state, State::Armed | State::Running | State::Hold(_) | State::Fault(_))
        })
    }

    /// One cycle: what may be sent at `now`.
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

    /// Takes note of what the arm feels; one that presses too hard is stopped, if it is not already, and gives way.
    fn feel(&mut self, measured: &Measured, now: f64) {
        let on = !matches!(self.state, State::Disconnected | State::Connected | State::Checked);
        let fresh = measured.arm.filter(|arm| now - arm.at <= self.limits.watchdogs.arm);
        let (Some(press), Some(arm), true) = (&mut self.press, fresh, on) else { return };
        // An arm that is being stopped lags behind its set-points for a moment, as if it were pushed.
        if self.braking.is_some_and(|left| left.iter().any(|speed| *speed != 0.0)) {
            return press.forget();
        }
        let Some(cause) = press.see(&arm.state, arm.at) else { return };
        press.forget();
        self.hold(cause);
        self.giving_way = Some(arm.state.position);
    }

    /// Leads the set-points on where a new command wants them, unless arm and hand may not be where they would come to a stand.
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

    /// Lets the arm come to a stand, beginning with the speed at which it moves; one that gives way goes back to where it was measured to be.
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

    /// Takes note of whether the controller speaks, and speaks sense.
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

    /// The current limit falls linearly to 0 within the release time, independent of the current before.
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

/// Why the robot is not ready.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CheckFailed {
    /// A measurement is not as it should be.
    #[error("{0}")]
    Alarm(Cause),
    /// Not the time for it.
    #[error(transparent)]
    Refused(#[from] Refused),
}

#[cfg(test)]
#[path = "supervisor_tests.rs"]
mod tests;
