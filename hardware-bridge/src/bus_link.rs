//! This project's devices as a [`RobotLink`]: the servos on their bus, and an arm behind its own interface.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use dynamixel_bus::servo_bus::{BusSettings, ServoBus};
use hand_model::RobotModel;
use robot_session_log::LinkTap;

use crate::arm_link::ArmLink;
use crate::calibration::HandCalibration;
use crate::clock::Clock;
use crate::config::BridgeConfig;
use crate::hand_bus::{HandBus, servo_tap};
use crate::hardware_robot::ConnectError;
use crate::robot_link::RobotLink;
use crate::safety::checks::Measurements;
use crate::safety::limits::WatchdogTimeouts;
use crate::safety::state::StopCause;
use crate::safety::supervisor::SafeCommand;
use crate::servo_cycle::CycleReport;
use crate::setup;
use crate::supported_robot::SERVOS;

/// Interval between attempts to reopen a lost port.
const REOPEN_INTERVAL: Duration = Duration::from_millis(500);
/// Cycles between two copies of the bus's statistics, which hold thousands of numbers.
const STATISTICS_INTERVAL: u64 = 50;

/// Servo bus and arm. A lost port is reopened.
pub(crate) struct BusLink {
    pub hand: Option<HandBus>,
    pub bus: BusSettings,
    port: PathBuf,
    ids: [u8; SERVOS],
    fast: bool,
    arm: Box<dyn ArmLink>,
    lost_at: Instant,
    /// Tap that waits for an open port.
    tap: Option<LinkTap>,
}

impl BusLink {
    /// Joins the open `hand` of this configuration and `arm`.
    pub fn new(config: &BridgeConfig, hand: HandBus, arm: Box<dyn ArmLink>) -> Self {
        Self {
            hand: Some(hand),
            bus: config.bus(),
            port: config.servos.port.clone(),
            ids: config.servos.ids,
            fast: config.servos.fast_sync_read,
            arm,
            lost_at: Instant::now(),
            tap: None,
        }
    }

    fn close_lost_port(&mut self, error: String, report: &mut CycleReport) {
        report.port_error = Some(error);
        self.hand = None;
        self.lost_at = Instant::now();
    }

    fn reopen(&mut self, report: &mut CycleReport) {
        if self.hand.is_some() || self.lost_at.elapsed() < REOPEN_INTERVAL {
            return;
        }
        self.lost_at = Instant::now();
        match ServoBus::open(&self.port, self.bus) {
            Ok(bus) => {
                self.hand = Some(HandBus::new(bus, self.ids, self.fast));
                report.port_error = None;
            }
            Err(error) => report.port_error = Some(error.to_string()),
        }
    }

    fn disengage(&mut self, report: &mut CycleReport) {
        if let Err(error) = self.arm.disengage() {
            report.arm_error = Some(error.to_string());
        }
    }
}

impl RobotLink for BusLink {
    fn measure(&mut self, clock: &Clock, measured: &mut Measurements, report: &mut CycleReport) {
        let now = clock.now();
        self.reopen(report);
        if let Some(hand) = &mut self.hand {
            if let Some(tap) = self.tap.take() {
                hand.bus.tap(servo_tap(tap));
            }
            match hand.read(now) {
                Ok(readings) => {
                    for (newest, reading) in measured.servos.iter_mut().zip(readings) {
                        *newest = reading.or(*newest);
                    }
                    if report.cycles.is_multiple_of(STATISTICS_INTERVAL) {
                        report.bus = hand.bus.statistics().clone();
                    }
                }
                Err(error) => self.close_lost_port(error.to_string(), report),
            }
        }
        match self.arm.read(now) {
            Ok(reading) => measured.arm = Some(reading),
            Err(error) => report.arm_error = Some(error.to_string()),
        }
    }

    fn send(&mut self, command: &SafeCommand, report: &mut CycleReport) -> SafeCommand {
        if let Some(Err(error)) = self.hand.as_mut().map(|hand| hand.send(&command.servos)) {
            self.close_lost_port(error.to_string(), report);
        }
        if let Err(error) = self.arm.command(&command.arm) {
            report.arm_error = Some(error.to_string());
        }
        *command
    }

    fn engage(&mut self, first: &SafeCommand, watchdog: f64) -> Result<(), String> {
        // The arm comes first: it takes its time, and the servos' watchdog does not wait.
        self.arm.engage().map_err(|error| error.to_string())?;
        match &mut self.hand {
            Some(hand) => hand.torque_on(&first.servos, watchdog).map_err(|error| error.to_string()),
            None => Err("the servo port is gone".into()),
        }
    }

    fn torque_off(&mut self, report: &mut CycleReport) -> Vec<String> {
        let unsure = match &mut self.hand {
            Some(hand) => hand.torque_off(),
            None => self.ids.iter().map(|id| format!("servo {id}: its port is gone")).collect(),
        };
        self.disengage(report);
        unsure
    }

    /// The hand keeps holding, with its bus watchdogs off.
    fn park(&mut self, report: &mut CycleReport) {
        if let Some(Err(error)) = self.hand.as_mut().map(|hand| hand.set_watchdog(0.0)) {
            self.close_lost_port(error.to_string(), report);
        }
        self.disengage(report);
    }

    /// The emulated devices are stepped beside this link.
    fn step(&mut self, _: &mut CycleReport) {}

    fn audit(&mut self, number: u64) -> Option<StopCause> {
        // A servo that does not answer now is noticed by the age of its readings.
        self.hand.as_mut()?.audit(number as usize % SERVOS).ok()?
    }

    fn tap(&mut self, tap: LinkTap) {
        self.tap = Some(tap);
    }

    /// After a longer gap the devices' own watchdogs have stopped them.
    fn standstill_limit(&self, watchdogs: &WatchdogTimeouts) -> f64 {
        watchdogs.servo_bus.min(watchdogs.arm)
    }

    fn senses_torque(&self) -> bool {
        self.arm.senses_torque()
    }
}

/// Opens the servo bus and verifies that the servos are the calibrated ones.
pub(crate) fn open_hand(
    config: &BridgeConfig,
    calibration: &HandCalibration,
    robot: &RobotModel,
) -> Result<HandBus, ConnectError> {
    let mut bus = ServoBus::open(&config.servos.port, config.bus())?;
    let names: Vec<&str> = robot.hand.parameters.actuator.iter().map(|actuator| actuator.name.as_str()).collect();
    for (id, name) in config.servos.ids.iter().zip(&names) {
        let findings = setup::check(&mut bus, config, *id, name)?;
        if let Some(bad) = findings.into_iter().find(|finding| !finding.passed) {
            return Err(ConnectError::Setup { what: bad.item, found: bad.found, expected: bad.expected });
        }
    }
    let mut hand = HandBus::new(bus, config.servos.ids, config.servos.fast_sync_read);
    if let Some((actuator, found, expected)) = hand.compare_homing_offsets(calibration)? {
        let owner = calibration.servos.iter().zip(&names).find(|(servo, _)| i64::from(servo.homing_offset) == found);
        let why = match owner {
            Some((_, owner)) => format!("it is that of {owner}; were their ids exchanged?"),
            None => "the servo was replaced or remounted; calibrate".to_owned(),
        };
        return Err(ConnectError::Mismatch { actuator, name: names[actuator].to_owned(), why, found, expected });
    }
    Ok(hand)
}
