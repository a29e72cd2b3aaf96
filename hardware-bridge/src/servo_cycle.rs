//! The servo cycle: the thread that owns a robot's devices and its supervisor.
//!
//! Each cycle reads all devices, lets the supervisor decide, and sends. It keeps its pace while the controller computes,
//! which feeds the servos' watchdogs; the supervisor watches for a silent controller. If the process stops, this thread
//! stops too, and the servos' watchdogs stop the hand. A robot in lock-step has cycles on request instead.

mod pacing;

use std::collections::VecDeque;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::{self, Sender};
use std::sync::{Arc, Condvar, Mutex};
use std::time::{Duration, Instant};

use dynamixel_bus::servo_bus::statistics::BusStatistics;
use hand_model::RobotModel;
use hand_model::robot::RobotCommand;
use robot_session_log::LinkTap;

use crate::clock::Clock;
use crate::lock::lock;
use crate::remote::RemoteCommand;
use crate::robot_link::RobotLink;
use crate::safety::SafetyLimits;
use crate::safety::checks::Measurements;
use crate::safety::limits::SafeGoal;
use crate::safety::state::{StopCause, SupervisorState};
use crate::safety::supervisor::{
    CheckFailed, ControllerCommand, SafeCommand, SafetyMargins, Supervisor, SupervisorStep,
};

pub(crate) use self::pacing::Pace;

/// Servo cycles between two audits, each of one device.
const AUDIT_INTERVAL: u64 = 5;
/// Interval between lines of a dry run, s.
const DRY_LINE_INTERVAL: f64 = 0.5;

/// Orders to the thread, besides commands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum CycleOrder {
    Check,
    Arm,
    Remote(RemoteCommand),
}

/// Statistics of the cycles.
#[derive(Debug, Clone, Default)]
pub struct CycleReport {
    /// Cycles so far.
    pub cycles: u64,
    /// Cycles that began more than a period late.
    pub late: u64,
    /// Longest time from the beginning of one cycle to that of the next, s.
    pub longest_gap: f64,
    /// Longest silence of the controller that was not announced, s.
    pub longest_silence: f64,
    pub bus: BusStatistics,
    /// The error that closed the servo port, if any.
    pub port_error: Option<String>,
    /// The last error of the arm's client.
    pub arm_error: Option<String>,
    /// Failure of the robot's driver, in its own words, if it has failed.
    pub driver_error: Option<String>,
    /// Reason why this thread does not have real-time priority, if it does not.
    pub priority_error: Option<String>,
    /// End and duration (s) of this thread's last standstill for longer than a device's watchdog.
    pub last_standstill: Option<(Instant, f64)>,
    /// Servos whose torque was not read back as off at the end of a release, and why.
    pub torque_still_on: Vec<String>,
    /// Extremes that arm and hand have reached relative to their limits.
    pub margins: SafetyMargins,
}

type OrderReply = Sender<Result<String, String>>;

/// State shared between the thread and the robot.
pub(crate) struct SharedState {
    pub requested: Option<(RobotCommand, f64)>,
    /// Number of the newest command; `used_number` is that of the newest one that a cycle has used.
    pub requested_number: u64,
    pub used_number: u64,
    /// End of the silence that the controller has announced, s on the bridge's clock.
    pub quiet_until: f64,
    pub sent: SafeCommand,
    pub measured: Measurements,
    pub state: SupervisorState,
    pub orders: VecDeque<(CycleOrder, OrderReply)>,
    pub report: CycleReport,
    pub cameras: bool,
    /// Control ticks requested of a robot in lock-step; `ticks` is the number of those that have passed.
    pub requested_ticks: u64,
    pub ticks: u64,
}

pub(crate) struct CycleShared {
    /// Tap for the bus's bytes, if they are to be recorded.
    pub tap: Mutex<Option<LinkTap>>,
    pub state: Mutex<SharedState>,
    pub cycle_done: Condvar,
    /// Signals a request to a robot in lock-step.
    pub requested: Condvar,
    pub stop: AtomicBool,
    /// Longest wait for the answer to an order.
    pub order_timeout: Duration,
}

/// Passes an order to the servo cycle and waits for the answer.
pub(crate) fn send_order(shared: &CycleShared, order: CycleOrder) -> Result<String, String> {
    let (answer, answered) = mpsc::channel();
    lock(&shared.state).orders.push_back((order, answer));
    shared.requested.notify_all();
    answered.recv_timeout(shared.order_timeout).unwrap_or_else(|_| Err("the servo cycle does not answer".into()))
}

/// Receiver of the lines of a dry run.
pub type DryLines = Box<dyn FnMut(String) + Send>;

pub(crate) struct ServoCycle<L> {
    pub shared: Arc<CycleShared>,
    pub link: L,
    pub supervisor: Supervisor,
    pub clock: Clock,
    /// Servo cycles between two audits, each of one device.
    pub audit_interval: u64,
    /// Dry run, if `Some`: nothing is written to any device, and goals are reported here.
    pub dry: Option<DryLines>,
    pub measured: Measurements,
    pub report: CycleReport,
    pub last_dry_line: f64,
}

impl<L: RobotLink> ServoCycle<L> {
    /// Creates the cycle of the devices behind `link` of a robot of this model: connected, torque unchanged.
    pub fn new(link: L, robot: &RobotModel, limits: SafetyLimits, clock: Clock, order_timeout: Duration) -> Self {
        let torque = limits.torque.filter(|_| link.senses_torque());
        let mut supervisor = Supervisor::new(SafetyLimits { torque, ..limits }).with_monitors(robot);
        // A new supervisor is disconnected, so this cannot be refused.
        let _ = supervisor.connect();
        let measured = Measurements::none(limits.servos.len());
        let shared = Arc::new(CycleShared {
            tap: Mutex::new(None),
            state: Mutex::new(SharedState {
                requested: None,
                requested_number: 0,
                used_number: 0,
                quiet_until: 0.0,
                sent: SafeCommand::at_rest(&limits),
                measured,
                state: supervisor.state(),
                orders: VecDeque::new(),
                report: CycleReport::default(),
                cameras: true,
                requested_ticks: 0,
                ticks: 0,
            }),
            cycle_done: Condvar::new(),
            requested: Condvar::new(),
            stop: AtomicBool::new(false),
            order_timeout,
        });
        Self {
            shared,
            link,
            supervisor,
            clock,
            audit_interval: AUDIT_INTERVAL,
            dry: None,
            measured,
            report: CycleReport::default(),
            last_dry_line: 0.0,
        }
    }

    fn now(&self) -> f64 {
        self.clock.now()
    }

    pub fn cycle(&mut self) {
        self.measure();
        self.decide();
    }

    /// Runs the second half of a cycle: orders, the supervisor's decision, and sending.
    pub fn decide(&mut self) {
        self.take_orders();
        let (asked, number, quiet_until) = {
            let board = lock(&self.shared.state);
            (board.requested, board.requested_number, board.quiet_until)
        };
        let now = self.now();
        // Silence counts from the end of a pause that was announced.
        let asked = asked.as_ref().map(|(command, at)| ControllerCommand {
            command,
            received_at: at.max(quiet_until.min(now)),
            number,
        });
        if let (SupervisorState::Running, Some(asked)) = (self.supervisor.state(), asked) {
            self.report.longest_silence = self.report.longest_silence.max(now - asked.received_at);
        }
        let sent = match self.supervisor.step(now, asked, &self.measured) {
            SupervisorStep::Silent => None,
            SupervisorStep::Send(command) => Some(self.send(&command)),
            SupervisorStep::TorqueOff => {
                self.finish_release();
                None
            }
        };
        self.audit();
        self.report.cycles += 1;
        self.report.margins = self.supervisor.margins();
        let mut board = lock(&self.shared.state);
        board.sent = sent.unwrap_or(board.sent);
        board.used_number = number;
        board.state = self.supervisor.state();
        board.report = self.report.clone();
        drop(board);
        self.shared.cycle_done.notify_all();
    }

    /// Runs the first half of a cycle: new measurements.
    pub fn measure(&mut self) {
        if let Some(tap) = lock(&self.shared.tap).take() {
            self.link.tap(tap);
        }
        self.link.measure(&self.clock, &mut self.measured, &mut self.report);
        let mut board = lock(&self.shared.state);
        self.measured.cameras = board.cameras;
        board.measured = self.measured;
    }

    /// Audits one device after the other while torque should be on.
    fn audit(&mut self) {
        let on = matches!(
            self.supervisor.state(),
            SupervisorState::Armed | SupervisorState::Running | SupervisorState::Hold(_)
        );
        if self.dry.is_some() || !on || !self.report.cycles.is_multiple_of(self.audit_interval) {
            return;
        }
        if let Some(cause) = self.link.audit(self.report.cycles / self.audit_interval) {
            self.supervisor.hold(cause);
        }
    }

    /// Sends a command. Returns the one that was really sent.
    fn send(&mut self, command: &SafeCommand) -> SafeCommand {
        let now = self.now();
        let Some(tell) = &mut self.dry else { return self.link.send(command, &mut self.report) };
        if now - self.last_dry_line >= DRY_LINE_INTERVAL {
            self.last_dry_line = now;
            let goal = |goal: &SafeGoal| format!("{:.2} rad {:.0} mA", goal.angle, 1e3 * goal.current);
            let goals: Vec<String> = command.servos.iter().map(goal).collect();
            tell(format!("{now:8.3} s, not sent: servos {}; arm {:.3?} rad", goals.join(", "), command.arm));
        }
        *command
    }

    /// Ends a release: switches the torque off and stops the arm.
    fn finish_release(&mut self) {
        if self.dry.is_some() {
            let unwritten = |n| format!("servo {n}: dry run, nothing was written");
            self.report.torque_still_on = (1..=self.measured.servos.len()).map(unwritten).collect();
            return;
        }
        self.report.torque_still_on = self.link.torque_off(&mut self.report);
        // Commands given before a release no longer apply.
        lock(&self.shared.state).requested = None;
    }

    /// Ends the program in an orderly way: the hand keeps holding.
    pub fn shut_down(&mut self) {
        let on = matches!(
            self.supervisor.state(),
            SupervisorState::Armed | SupervisorState::Running | SupervisorState::Hold(_) | SupervisorState::Fault(_)
        );
        if !on || self.dry.is_some() {
            return;
        }
        self.supervisor.hold(StopCause::Operator);
        if let SupervisorStep::Send(command) = self.supervisor.step(self.now(), None, &self.measured) {
            self.send(&command);
        }
        self.link.park(&mut self.report);
    }

    fn take_orders(&mut self) {
        let orders = std::mem::take(&mut lock(&self.shared.state).orders);
        for (order, answer) in orders {
            let result = self.execute_order(order).map(|()| self.supervisor.state().to_string());
            // A caller that reads the board after the answer must find the state that was answered.
            let mut board = lock(&self.shared.state);
            board.state = self.supervisor.state();
            board.report.driver_error.clone_from(&self.report.driver_error);
            drop(board);
            // The sender of the order may be gone.
            let _ = answer.send(result);
        }
    }

    fn execute_order(&mut self, order: CycleOrder) -> Result<(), String> {
        let now = self.now();
        match order {
            CycleOrder::Check => {
                self.supervisor.check(&self.measured, now).map_err(|error| self.describe_failure(&error))
            }
            CycleOrder::Arm => self.arm_torque(now),
            CycleOrder::Remote(RemoteCommand::State) => Ok(()),
            CycleOrder::Remote(RemoteCommand::Hold) => {
                self.supervisor.hold(StopCause::Operator);
                match self.supervisor.state() {
                    SupervisorState::Hold(_) | SupervisorState::Fault(_) | SupervisorState::Connected => Ok(()),
                    state => Err(format!("cannot hold while {state}")),
                }
            }
            CycleOrder::Remote(RemoteCommand::Release) => {
                self.supervisor.release(now).map_err(|error| error.to_string())
            }
        }
    }

    /// Describes a failed check, with the words of a driver that has failed.
    fn describe_failure(&self, error: &CheckFailed) -> String {
        match &self.report.driver_error {
            Some(words) => format!("{error} ({words})"),
            None => error.to_string(),
        }
    }

    /// Switches the torque on at the present positions, with zero force.
    pub fn arm_torque(&mut self, now: f64) -> Result<(), String> {
        let first = self.supervisor.arm(&self.measured, now).map_err(|error| self.describe_failure(&error))?;
        lock(&self.shared.state).requested = None;
        if self.dry.is_some() {
            return Ok(());
        }
        let watchdog = self.supervisor.limits().watchdogs.servo_bus;
        let result = self.link.engage(&first, watchdog);
        if result.is_err() {
            // Torque on only a part of the hand is not an acceptable state.
            self.finish_release();
            self.supervisor.disconnect();
            self.supervisor.connect().map_err(|error| error.to_string())?;
        }
        result
    }
}
