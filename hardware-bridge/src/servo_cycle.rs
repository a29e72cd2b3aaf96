//! The servo cycle: the thread that owns bus, arm and supervisor and runs at about 200 Hz.
//!
//! Each cycle reads all servos, reads the arm, lets the supervisor decide, and sends. It keeps its pace while the
//! controller computes, which feeds the servos' watchdogs; the supervisor watches for a silent controller. If the
//! process stops, this thread stops too, and the servos' watchdogs stop the hand.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Sender};
use std::sync::{Arc, Condvar, Mutex};
use std::time::{Duration, Instant};

use dynamixel_bus::servo_bus::statistics::BusStatistics;
use dynamixel_bus::servo_bus::{BusSettings, ServoBus};
use hand_model::robot::RobotCommand;
use robot_session_log::LinkTap;

use crate::arm_link::ArmLink;
use crate::clock::Clock;
use crate::hand_bus::{HandBus, servo_tap};
use crate::lock::lock;
use crate::remote::RemoteCommand;
use crate::safety::checks::Measurements;
use crate::safety::state::{StopCause, SupervisorState};
use crate::safety::supervisor::{ControllerCommand, SafeCommand, SafetyMargins, Supervisor, SupervisorStep};
use crate::supported_robot::SERVOS;

/// Longest wait for the answer to an order.
const ORDER_TIMEOUT: Duration = Duration::from_secs(3);
/// Interval between attempts to reopen a lost port.
const REOPEN_INTERVAL: Duration = Duration::from_millis(500);
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
}

pub(crate) struct CycleShared {
    /// Tap for the bus's bytes, if they are to be recorded.
    pub tap: Mutex<Option<LinkTap>>,
    pub state: Mutex<SharedState>,
    pub cycle_done: Condvar,
    pub stop: AtomicBool,
}

/// Passes an order to the servo cycle and waits for the answer.
pub(crate) fn send_order(shared: &CycleShared, order: CycleOrder) -> Result<String, String> {
    let (answer, answered) = mpsc::channel();
    lock(&shared.state).orders.push_back((order, answer));
    answered.recv_timeout(ORDER_TIMEOUT).unwrap_or_else(|_| Err("the servo cycle does not answer".into()))
}

/// Receiver of the lines of a dry run.
pub type DryLines = Box<dyn FnMut(String) + Send>;

pub(crate) struct ServoCycle {
    pub shared: Arc<CycleShared>,
    pub hand: Option<HandBus>,
    pub port: PathBuf,
    pub bus: BusSettings,
    pub ids: [u8; SERVOS],
    pub fast: bool,
    pub arm: Box<dyn ArmLink>,
    pub supervisor: Supervisor,
    pub period: Duration,
    pub clock: Clock,
    /// Servo cycles between two audits, each of one servo.
    pub audit_interval: u64,
    /// Dry run, if `Some`: nothing is written to any device, and goals are reported here.
    pub dry: Option<DryLines>,
    pub measured: Measurements,
    pub report: CycleReport,
    pub lost_at: Instant,
    pub last_dry_line: f64,
}

impl ServoCycle {
    pub fn run(mut self) {
        let mut next = Instant::now();
        let mut begun = next;
        // After a longer gap the devices' own watchdogs have stopped them: this program is the cause, not the devices.
        let watchdogs = self.supervisor.limits().watchdogs;
        let longest = watchdogs.servo_bus.min(watchdogs.arm);
        while !self.shared.stop.load(Ordering::Relaxed) {
            let gap = begun.elapsed().as_secs_f64();
            begun = Instant::now();
            self.report.longest_gap = self.report.longest_gap.max(gap);
            if gap > longest {
                self.report.last_standstill = Some((begun, gap));
                self.supervisor.hold(StopCause::HostFrozen(gap));
            }
            self.cycle();
            next += self.period;
            let now = Instant::now();
            if now > next + self.period {
                self.report.late += 1;
                next = now;
            }
            std::thread::sleep(next.saturating_duration_since(now));
        }
        self.shut_down();
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
        let step = self.supervisor.step(now, asked, &self.measured);
        match step {
            SupervisorStep::Silent => {}
            SupervisorStep::Send(command) => self.send(&command),
            SupervisorStep::TorqueOff => self.finish_release(),
        }
        self.audit();
        self.report.cycles += 1;
        self.report.margins = self.supervisor.margins();
        let mut board = lock(&self.shared.state);
        if let SupervisorStep::Send(command) = step {
            board.sent = command;
        }
        board.used_number = number;
        board.state = self.supervisor.state();
        board.report = self.report.clone();
        drop(board);
        self.shared.cycle_done.notify_all();
    }

    /// Runs the first half of a cycle: new measurements.
    pub fn measure(&mut self) {
        let now = self.now();
        self.reopen();
        if let (Some(hand), Some(tap)) = (&mut self.hand, lock(&self.shared.tap).take()) {
            hand.bus.tap(servo_tap(tap));
        }
        if let Some(hand) = &mut self.hand {
            match hand.read(now) {
                Ok(readings) => {
                    for (newest, reading) in self.measured.servos.iter_mut().zip(readings) {
                        *newest = reading.or(*newest);
                    }
                    // The statistics hold thousands of numbers, so they are copied only once in a while.
                    if self.report.cycles.is_multiple_of(50) {
                        self.report.bus = hand.bus.statistics().clone();
                    }
                }
                Err(error) => self.close_lost_port(error.to_string()),
            }
        }
        match self.arm.read(now) {
            Ok(reading) => self.measured.arm = Some(reading),
            Err(error) => self.report.arm_error = Some(error.to_string()),
        }
        let mut board = lock(&self.shared.state);
        self.measured.cameras = board.cameras;
        board.measured = self.measured;
    }

    /// Asks one servo after the other, while torque should be on, whether it is.
    fn audit(&mut self) {
        let on = matches!(
            self.supervisor.state(),
            SupervisorState::Armed | SupervisorState::Running | SupervisorState::Hold(_)
        );
        if self.dry.is_some() || !on || !self.report.cycles.is_multiple_of(self.audit_interval) {
            return;
        }
        let n = (self.report.cycles / self.audit_interval) as usize % SERVOS;
        // A servo that does not answer now is noticed by the age of its readings.
        if let Some(Ok(Some(cause))) = self.hand.as_mut().map(|hand| hand.audit(n)) {
            self.supervisor.hold(cause);
        }
    }

    fn send(&mut self, command: &SafeCommand) {
        let now = self.now();
        if let Some(tell) = &mut self.dry {
            if now - self.last_dry_line >= DRY_LINE_INTERVAL {
                self.last_dry_line = now;
                let goals = command.servos.map(|goal| format!("{:.2} rad {:.0} mA", goal.angle, 1e3 * goal.current));
                tell(format!("{now:8.3} s, not sent: servos {}; arm {:.3?} rad", goals.join(", "), command.arm));
            }
            return;
        }
        if let Some(Err(error)) = self.hand.as_mut().map(|hand| hand.send(&command.servos)) {
            self.close_lost_port(error.to_string());
        }
        if let Err(error) = self.arm.command(&command.arm) {
            self.report.arm_error = Some(error.to_string());
        }
    }

    /// Ends a release: switches the torque off and disengages the arm.
    fn finish_release(&mut self) {
        if self.dry.is_some() {
            self.report.torque_still_on =
                self.ids.iter().map(|id| format!("servo {id}: dry run, nothing was written")).collect();
            return;
        }
        self.report.torque_still_on = match &mut self.hand {
            Some(hand) => hand.torque_off(),
            None => self.ids.iter().map(|id| format!("servo {id}: its port is gone")).collect(),
        };
        if let Err(error) = self.arm.disengage() {
            self.report.arm_error = Some(error.to_string());
        }
        // Commands given before a release no longer apply.
        lock(&self.shared.state).requested = None;
    }

    /// Ends the program in an orderly way: the hand keeps holding, with its bus watchdogs off.
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
        if let Some(Err(error)) = self.hand.as_mut().map(|hand| hand.set_watchdog(0.0)) {
            self.close_lost_port(error.to_string());
        }
        if let Err(error) = self.arm.disengage() {
            self.report.arm_error = Some(error.to_string());
        }
    }

    fn close_lost_port(&mut self, error: String) {
        self.report.port_error = Some(error);
        self.hand = None;
        self.lost_at = Instant::now();
    }

    fn reopen(&mut self) {
        if self.hand.is_some() || self.lost_at.elapsed() < REOPEN_INTERVAL {
            return;
        }
        self.lost_at = Instant::now();
        match ServoBus::open(&self.port, self.bus) {
            Ok(bus) => {
                self.hand = Some(HandBus::new(bus, self.ids, self.fast));
                self.report.port_error = None;
            }
            Err(error) => self.report.port_error = Some(error.to_string()),
        }
    }

    fn take_orders(&mut self) {
        let orders = std::mem::take(&mut lock(&self.shared.state).orders);
        for (order, answer) in orders {
            let result = self.execute_order(order).map(|()| self.supervisor.state().to_string());
            // A caller that reads the board after the answer must find the state that was answered.
            lock(&self.shared.state).state = self.supervisor.state();
            // The sender of the order may be gone.
            let _ = answer.send(result);
        }
    }

    fn execute_order(&mut self, order: CycleOrder) -> Result<(), String> {
        let now = self.now();
        match order {
            CycleOrder::Check => self.supervisor.check(&self.measured, now).map_err(|error| error.to_string()),
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

    /// Switches the torque on at the present positions, with zero force.
    pub fn arm_torque(&mut self, now: f64) -> Result<(), String> {
        let first = self.supervisor.arm(&self.measured, now).map_err(|error| error.to_string())?;
        lock(&self.shared.state).requested = None;
        if self.dry.is_some() {
            return Ok(());
        }
        let watchdog = self.supervisor.limits().watchdogs.servo_bus;
        // The arm comes first: it takes its time, and the servos' watchdog does not wait.
        let result = self.arm.engage().map_err(|error| error.to_string()).and_then(|()| match &mut self.hand {
            Some(hand) => hand.torque_on(&first.servos, watchdog).map_err(|error| error.to_string()),
            None => Err("the servo port is gone".into()),
        });
        if result.is_err() {
            // Torque on only a part of the hand is not an acceptable state.
            self.finish_release();
            self.supervisor.disconnect();
            self.supervisor.connect().map_err(|error| error.to_string())?;
        }
        result
    }
}
