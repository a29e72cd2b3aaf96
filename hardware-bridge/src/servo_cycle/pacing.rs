//! Pacing of the servo cycles: by the wall clock, or on request.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use crate::lock::lock;
use crate::robot_link::RobotLink;
use crate::safety::state::{StopCause, SupervisorState};

use super::ServoCycle;

/// Pace of the cycles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Pace {
    /// A cycle in each period of the wall clock.
    Wall(Duration),
    /// A cycle for each control tick of this length (s), when the controller requests it: no time passes between them.
    Lockstep(f64),
}

/// Request to a robot in lock-step.
enum Request {
    /// An order.
    Order,
    /// A new command.
    Command,
    /// A control tick.
    Tick,
    Stop,
}

impl<L: RobotLink> ServoCycle<L> {
    /// Runs cycles until the robot is dropped.
    pub fn run(mut self, pace: Pace) {
        match pace {
            Pace::Wall(period) => self.run_on_wall_clock(period),
            Pace::Lockstep(tick) => self.run_on_request(tick),
        }
        self.shut_down();
    }

    fn run_on_wall_clock(&mut self, period: Duration) {
        let mut next = Instant::now();
        let mut begun = next;
        let longest = self.link.standstill_limit(&self.supervisor.limits().watchdogs);
        while !self.shared.stop.load(Ordering::Relaxed) {
            let gap = begun.elapsed().as_secs_f64();
            begun = Instant::now();
            self.report.longest_gap = self.report.longest_gap.max(gap);
            if gap > longest {
                self.report.last_standstill = Some((begun, gap));
                self.supervisor.hold(StopCause::HostFrozen(gap));
            }
            self.cycle();
            next += period;
            let now = Instant::now();
            if now > next + period {
                self.report.late += 1;
                next = now;
            }
            std::thread::sleep(next.saturating_duration_since(now));
        }
    }

    fn run_on_request(&mut self, tick: f64) {
        self.measure();
        // True if something was sent for the coming tick.
        let mut decided = false;
        loop {
            match self.wait_for_request() {
                Request::Order => self.take_orders(),
                Request::Command => {
                    self.decide();
                    decided = true;
                }
                Request::Tick => {
                    if !std::mem::take(&mut decided) {
                        self.decide();
                    }
                    self.pass_tick(tick);
                    lock(&self.shared.state).ticks += 1;
                    self.shared.cycle_done.notify_all();
                }
                Request::Stop => return,
            }
            // Nobody requests the ticks in which a release fades.
            while matches!(self.supervisor.state(), SupervisorState::Release { .. }) {
                self.pass_tick(tick);
                self.decide();
            }
        }
    }

    fn pass_tick(&mut self, tick: f64) {
        self.link.step(&mut self.report);
        self.clock.advance(tick);
        self.measure();
    }

    fn wait_for_request(&self) -> Request {
        let mut board = lock(&self.shared.state);
        loop {
            if self.shared.stop.load(Ordering::Relaxed) {
                return Request::Stop;
            }
            if !board.orders.is_empty() {
                return Request::Order;
            }
            if board.requested_number > board.used_number {
                return Request::Command;
            }
            if board.requested_ticks > board.ticks {
                return Request::Tick;
            }
            board = self.shared.requested.wait(board).unwrap_or_else(std::sync::PoisonError::into_inner);
        }
    }
}
