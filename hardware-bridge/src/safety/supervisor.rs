//! The supervisor: in each cycle it turns the requested command and the measurements into the command that may be sent.

use hand_model::robot::{RobotCommand, ServoGoal};
use hand_model::{ActuatorVector, ArmVector, RobotModel};

use super::arm_course::{ArmCourse, nearest_turn};
use super::checks::{self, Measurements, ServoReading};
use super::limits::{SafeGoal, SafetyLimits};
use super::set_points::SetPoints;
use super::state::{StopCause, SupervisorState, TransitionRefused};
use super::torque_monitor::{TorqueExtremes, TorqueMonitor};
use super::workspace::{WorkspaceMargins, WorkspaceMonitor};

/// Longest time step that counts for the motion of a goal, s: after a pause nothing may jump.
const MAX_TIME_STEP: f64 = 0.02;
/// Silence of the controller after which the arm's set-points count as being at rest, s.
const REST_TIMEOUT: f64 = 0.05;

/// Distance by which a joint of the arm may be outside its range when torque is switched on, rad: it is sent back to the
/// edge in one cycle.
const MAX_START_OVERTRAVEL: f64 = 0.01;

/// Command that may be sent, after all limits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SafeCommand {
    /// Goals of the servos, in actuator order.
    pub servos: ActuatorVector<SafeGoal>,
    /// Arm set-points, rad.
    pub arm: ArmVector,
}

impl SafeCommand {
    /// Returns the command before any other: all goals zero, without current.
    pub fn at_rest(limits: &SafetyLimits) -> Self {
        let servos = limits.servos.iter().map(|_| SafeGoal::default()).collect();
        Self { servos, arm: limits.arm.zero_speed() }
    }

    /// Converts to a command of the robot interface.
    pub fn as_command(&self, capture: bool) -> RobotCommand {
        let goal = |goal: &SafeGoal| ServoGoal::Position { angle: goal.angle, current_limit: goal.current };
        RobotCommand { arm: self.arm, servos: self.servos.iter().map(goal).collect(), capture }
    }
}

/// Decision of one cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SupervisorStep {
    /// Send nothing.
    Silent,
    Send(SafeCommand),
    /// Switch the torque off.
    TorqueOff,
}

/// Newest command of the controller, with its time and number.
#[derive(Debug, Clone, Copy)]
pub struct ControllerCommand<'a> {
    pub command: &'a RobotCommand,
    /// Time at which the controller gave it, s.
    pub received_at: f64,
    /// Number of the command: the same number means the same command.
    pub number: u64,
}

/// Extremes that arm and hand have reached relative to their limits.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SafetyMargins {
    pub torque: Option<TorqueExtremes>,
    pub workspace: Option<WorkspaceMargins>,
}

#[derive(Debug, Clone)]
pub struct Supervisor {
    limits: SafetyLimits,
    state: SupervisorState,
    sent: SafeCommand,
    /// Speeds that remain of the arm's set-points since it was stopped, rad/s.
    braking: Option<ArmVector>,
    /// Measured posture of an arm that pressed, to which it is sent to yield, rad.
    giving_way: Option<ArmVector>,
    set_points: SetPoints,
    /// Number and time (s) of the command that the set-points follow.
    followed_command: Option<(u64, f64)>,
    course: ArmCourse,
    torque_monitor: Option<TorqueMonitor>,
    workspace_monitor: Option<WorkspaceMonitor>,
    last_step: f64,
}

impl Supervisor {
    /// Creates the supervisor of a robot that is not connected.
    pub fn new(limits: SafetyLimits) -> Self {
        let sent = SafeCommand::at_rest(&limits);
        Self {
            limits,
            state: SupervisorState::Disconnected,
            sent,
            braking: None,
            giving_way: None,
            set_points: SetPoints::at(&sent.arm),
            followed_command: None,
            course: ArmCourse::default(),
            torque_monitor: None,
            workspace_monitor: None,
            last_step: 0.0,
        }
    }

    /// Adds monitoring of pressing and of the workspace for a robot of this model, as far as there are limits for them.
    #[must_use]
    pub fn with_monitors(self, robot: &RobotModel) -> Self {
        let press = self.limits.torque.map(|limits| TorqueMonitor::new(robot, limits));
        let space = self.limits.workspace.map(|limits| WorkspaceMonitor::new(robot, limits));
        Self { torque_monitor: press, workspace_monitor: space, ..self }
    }

    /// Returns the extremes that arm and hand have reached relative to their limits.
    pub fn margins(&self) -> SafetyMargins {
        let (press, space) = (self.torque_monitor.as_ref(), self.workspace_monitor.as_ref());
        SafetyMargins { torque: press.map(TorqueMonitor::extremes), workspace: space.map(WorkspaceMonitor::margins) }
    }

    pub fn state(&self) -> SupervisorState {
        self.state
    }

    pub fn limits(&self) -> &SafetyLimits {
        &self.limits
    }

    /// Notes that the devices answer.
    pub fn connect(&mut self) -> Result<(), TransitionRefused> {
        self.transition(SupervisorState::Connected, "connect", |state| matches!(state, SupervisorState::Disconnected))
    }

    /// Notes that the devices are gone or abandoned.
    pub fn disconnect(&mut self) {
        self.state = SupervisorState::Disconnected;
    }

    /// Notes that the device checks passed. Fails if `measured` raises an alarm.
    pub fn check(&mut self, measured: &Measurements, now: f64) -> Result<(), CheckFailed> {
        self.check_start(measured, now)?;
        self.transition(SupervisorState::Checked, "be checked", |state| {
            matches!(state, SupervisorState::Connected | SupervisorState::Checked)
        })?;
        Ok(())
    }

    /// Arms the robot. Goals start at the measured positions, with zero current. An arm that stands outside its range is
    /// refused: its first command would be a jump.
    pub fn arm(&mut self, measured: &Measurements, now: f64) -> Result<SafeCommand, CheckFailed> {
        self.check_start(measured, now)?;
        let posture = measured.arm.map_or_else(|| self.limits.arm.zero_speed(), |arm| arm.state.position);
        self.transition(SupervisorState::Armed, "arm", |state| matches!(state, SupervisorState::Checked))?;
        for (n, (goal, servo)) in self.sent.servos.iter_mut().zip(&measured.servos).enumerate() {
            let (low, high) = self.limits.servos[n].angle;
            // The check above has verified that all measurements exist.
            *goal = SafeGoal { angle: servo.map_or(0.0, |servo| servo.state.position).clamp(low, high), current: 0.0 };
        }
        for (joint, goal) in self.sent.arm.iter_mut().enumerate() {
            let (low, high) = self.limits.arm.angle[joint];
            *goal = posture[joint].clamp(low, high);
        }
        self.course = ArmCourse::default();
        self.last_step = now;
        (self.set_points, self.followed_command) = (SetPoints::at(&self.sent.arm), None);
        (self.braking, self.giving_way) = (None, None);
        Ok(self.sent)
    }

    /// Checks that nothing in the measurements speaks against switching the torque on.
    fn check_start(&self, measured: &Measurements, now: f64) -> Result<(), CheckFailed> {
        let alarm = checks::alarm(measured, &self.limits, now).or_else(|| self.start_alarm(measured));
        alarm.map_or(Ok(()), |cause| Err(CheckFailed::Alarm(cause)))
    }

    /// Returns the joint of the arm that is too far outside its range for torque to be switched on, as an alarm.
    fn start_alarm(&self, measured: &Measurements) -> Option<StopCause> {
        let posture = measured.arm?.state.position;
        (0..posture.len()).find_map(|joint| {
            let (angle, (low, high)) = (posture[joint], self.limits.arm.angle[joint]);
            let outside = (low - angle).max(angle - high) > MAX_START_OVERTRAVEL;
            outside.then_some(StopCause::ArmAngle(joint, angle, (low, high)))
        })
    }

    /// Stops and holds. A robot that has been checked but not armed must then be checked again.
    pub fn hold(&mut self, cause: StopCause) {
        if self.state == SupervisorState::Checked {
            self.state = SupervisorState::Connected;
        }
        if matches!(self.state, SupervisorState::Armed | SupervisorState::Running) {
            self.state = if cause.is_fault() { SupervisorState::Fault(cause) } else { SupervisorState::Hold(cause) };
        } else if matches!(self.state, SupervisorState::Hold(_)) && cause.is_fault() {
            self.state = SupervisorState::Fault(cause);
        }
    }

    /// Begins a release: the hand opens. Possible whenever torque is on.
    pub fn release(&mut self, now: f64) -> Result<(), TransitionRefused> {
        self.transition(SupervisorState::Release { since: now }, "release", |state| {
            matches!(
                state,
                SupervisorState::Armed
                    | SupervisorState::Running
                    | SupervisorState::Hold(_)
                    | SupervisorState::Fault(_)
            )
        })
    }

    /// Runs one cycle: decides which command may be sent at `now` (s).
    pub fn step(&mut self, now: f64, asked: Option<ControllerCommand>, measured: &Measurements) -> SupervisorStep {
        let dt = (now - self.last_step).clamp(0.0, MAX_TIME_STEP);
        self.last_step = now;
        let on = matches!(self.state, SupervisorState::Armed | SupervisorState::Running | SupervisorState::Hold(_));
        if let Some(cause) = checks::alarm(measured, &self.limits, now).filter(|_| on) {
            self.hold(cause);
        }
        self.monitor_torque(measured, now);
        if let (SupervisorState::Running, Some(arm)) = (self.state, measured.arm)
            && let Some((joint, distance)) =
                self.course.departure(&arm.state.position, arm.received_at, &self.limits.arm)
        {
            self.hold(StopCause::ArmOffCourse(joint, distance));
            // It may be pushed or blocked: it is sent to where it is, within the turn of its set-points.
            let near = |joint: usize| nearest_turn(arm.state.position[joint], self.sent.arm[joint]);
            self.giving_way = Some((0..arm.state.position.len()).map(near).collect());
        }
        if matches!(self.state, SupervisorState::Armed | SupervisorState::Running) {
            self.check_command(asked, now);
        }
        if let (SupervisorState::Running, Some(asked)) = (self.state, asked) {
            self.advance_set_points(&asked, measured);
        }
        match self.state {
            SupervisorState::Disconnected | SupervisorState::Connected | SupervisorState::Checked => {
                SupervisorStep::Silent
            }
            SupervisorState::Running => {
                self.braking = None;
                if let Some(asked) = asked {
                    self.follow(asked.command, measured, dt);
                }
                self.course.note(now, &self.sent.arm);
                SupervisorStep::Send(self.sent)
            }
            SupervisorState::Armed => SupervisorStep::Send(self.sent),
            SupervisorState::Hold(_) | SupervisorState::Fault(_) => {
                self.brake(measured, dt);
                for (goal, limits) in self.sent.servos.iter_mut().zip(&self.limits.servos) {
                    *goal = limits.hold(*goal);
                }
                SupervisorStep::Send(self.sent)
            }
            SupervisorState::Release { since } => {
                self.brake(measured, dt);
                self.fade(now - since, dt)
            }
        }
    }

    /// Monitors the arm's torques. An arm that presses too hard is stopped, if it is not already, and yields.
    fn monitor_torque(&mut self, measured: &Measurements, now: f64) {
        let on = !matches!(
            self.state,
            SupervisorState::Disconnected | SupervisorState::Connected | SupervisorState::Checked
        );
        let fresh = measured.arm.filter(|arm| now - arm.received_at <= self.limits.watchdogs.arm);
        let (Some(press), Some(arm), true) = (&mut self.torque_monitor, fresh, on) else { return };
        // A braking arm lags behind its set-points for a moment, as if it were pushed.
        if self.braking.is_some_and(|left| left.iter().any(|speed| *speed != 0.0)) {
            return press.reset();
        }
        let Some(cause) = press.update(&arm.state, arm.received_at) else { return };
        press.reset();
        self.hold(cause);
        self.giving_way = Some(arm.state.position);
    }

    /// Advances the set-points as a new command requests, unless arm and hand would come to rest outside the workspace
    /// limits; then it holds.
    fn advance_set_points(&mut self, asked: &ControllerCommand, measured: &Measurements) {
        if self.followed_command.is_some_and(|(number, _)| number == asked.number) {
            return;
        }
        let stood = self.followed_command.is_some_and(|(_, at)| asked.received_at - at > REST_TIMEOUT);
        self.followed_command = Some((asked.number, asked.received_at));
        let from = if stood { self.set_points.at_rest() } else { self.set_points };
        let arm = &self.limits.arm;
        let wanted = &asked.command.arm;
        let next = arm.motion.as_ref().map_or_else(|| SetPoints::at(wanted), |motion| from.follow(wanted, motion));
        let (standing, now) = (
            arm.stopping_position(&next.angles(), &next.speeds()),
            arm.stopping_position(&from.angles(), &from.speeds()),
        );
        let position = |servo: &Option<ServoReading>| servo.map_or(0.0, |servo| servo.state.position);
        let servos: ActuatorVector = measured.servos.iter().map(position).collect();
        match self.workspace_monitor.as_mut().and_then(|space| space.check(&standing, &now, &servos)) {
            Some(cause) => self.hold(cause),
            None => self.set_points = next,
        }
    }

    /// Brakes the arm from the speed at which it moves. An arm that yields returns to its measured posture instead.
    fn brake(&mut self, measured: &Measurements, dt: f64) {
        if let Some(place) = &self.giving_way {
            self.sent.arm = self.limits.arm.limit(place, &self.sent.arm, dt);
            return;
        }
        let moving = || measured.arm.map_or_else(|| self.limits.arm.zero_speed(), |arm| arm.state.velocity);
        let speed = self.braking.unwrap_or_else(moving);
        let (arm, slower) = self.limits.arm.brake(&self.sent.arm, &speed, dt);
        self.sent.arm = arm;
        self.braking = Some(slower);
    }

    /// Checks that the controller is not silent and that its command is sound.
    fn check_command(&mut self, asked: Option<ControllerCommand>, now: f64) {
        let Some(asked) = asked else { return };
        let silent = now - asked.received_at;
        if !checks::is_valid(asked.command) {
            self.hold(StopCause::BadCommand);
        } else if silent > self.limits.watchdogs.host {
            if self.state == SupervisorState::Running {
                self.hold(StopCause::HostSilent(silent));
            }
        } else {
            self.state = SupervisorState::Running;
        }
    }

    fn follow(&mut self, command: &RobotCommand, measured: &Measurements, dt: f64) {
        for (n, servo) in measured.servos.iter().enumerate() {
            let Some(servo) = servo else { continue };
            let limits = &self.limits.servos[n];
            self.sent.servos[n] = limits.limit(&command.servos[n], servo.state.position, self.sent.servos[n], dt);
        }
        self.sent.arm = self.limits.arm.limit(&self.set_points.angles(), &self.sent.arm, dt);
    }

    /// Lowers the current limit linearly to 0 within the release time, independent of the current before.
    fn fade(&mut self, elapsed: f64, dt: f64) -> SupervisorStep {
        for (goal, limits) in self.sent.servos.iter_mut().zip(&self.limits.servos) {
            let fall = limits.current * dt / self.limits.release_time;
            goal.current = (goal.current.min(limits.current) - fall).max(0.0);
        }
        if elapsed >= self.limits.release_time {
            self.state = SupervisorState::Connected;
            return SupervisorStep::TorqueOff;
        }
        SupervisorStep::Send(self.sent)
    }

    fn transition(
        &mut self,
        to: SupervisorState,
        transition: &'static str,
        from: impl Fn(&SupervisorState) -> bool,
    ) -> Result<(), TransitionRefused> {
        if !from(&self.state) {
            return Err(TransitionRefused { transition, state: self.state.to_string() });
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
    Alarm(StopCause),
    /// The present state does not allow the step.
    #[error(transparent)]
    TransitionRefused(#[from] TransitionRefused),
}

#[cfg(test)]
#[path = "supervisor_tests.rs"]
mod tests;
