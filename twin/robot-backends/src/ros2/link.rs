//! The topics of a robot as the devices of the servo cycle.

use hand_model::Hand;
use hardware_bridge::clock::Clock;
use hardware_bridge::config::LimitConfig;
use hardware_bridge::robot_link::RobotLink;
use hardware_bridge::safety::checks::Measurements;
use hardware_bridge::safety::limits::WatchdogTimeouts;
use hardware_bridge::safety::supervisor::SafeCommand;
use hardware_bridge::servo_cycle::CycleReport;
use robot_ros2::messages::{Float64Array, JointState};
use robot_ros2::{Publisher, Ros2Error, Ros2Node, Subscription};

use super::cameras::Ros2Cameras;
use super::config::Ros2Config;
use super::joints::JointTable;
use super::stamps::StampClock;

/// Current below which a servo counts as without torque, A.
const NO_CURRENT: f64 = 0.05;

/// Topics of the commands.
pub struct CommandTopics {
    /// Set-points of the arm, rad.
    pub arm: Publisher<Float64Array>,
    /// Goals of the servos, rad.
    pub servo_positions: Publisher<Float64Array>,
    /// Torque limits of the servos, N m.
    pub servo_efforts: Publisher<Float64Array>,
}

/// A robot on ROS 2 topics.
pub struct Ros2Link {
    /// Owner of all topics.
    _node: Ros2Node,
    commands: CommandTopics,
    states: Subscription<JointState>,
    stamps: StampClock,
    joints: JointTable,
    /// Names of the servos.
    servos: Vec<String>,
    torque_constants: Vec<f64>,
    cameras: Option<Ros2Cameras>,
    senses_torque: bool,
    domain: u16,
    /// Arrival of the newest joint state, s on the bridge's clock; none before the first one of the servo cycle.
    arrived_at: Option<f64>,
    /// Longest silence of the joint states, s.
    longest_silence: f64,
    failure: Option<String>,
}

impl Ros2Link {
    /// Joins the topics of a robot with this configuration, these limits and this hand. `joints` has heard every joint.
    pub fn new(
        node: Ros2Node,
        commands: CommandTopics,
        states: Subscription<JointState>,
        joints: JointTable,
        cameras: Option<Ros2Cameras>,
        (config, limits, hand): (&Ros2Config, &LimitConfig, &Hand),
    ) -> Self {
        let names = || hand.parameters.actuator.iter().map(|actuator| actuator.name.clone()).collect();
        Self {
            _node: node,
            commands,
            states,
            stamps: StampClock::default(),
            joints,
            servos: config.hand.joints.clone().unwrap_or_else(names),
            torque_constants: hand.servos.iter().map(|servo| servo.torque_constant).collect(),
            cameras,
            senses_torque: config.arm.senses_torque,
            domain: config.domain,
            arrived_at: None,
            longest_silence: limits.staleness,
            failure: None,
        }
    }

    /// Takes all joint states that have arrived.
    fn take_states(&mut self, now: f64) -> Result<(), String> {
        while let Some(message) = self.states.take().map_err(|error| error.to_string())? {
            let time = self.stamps.host_time(message.header.stamp.as_secs_f64(), now);
            let fault = |error| format!("{} on domain {}: {error}", self.states.topic(), self.domain);
            self.joints.update(&message, time).map_err(fault)?;
            self.arrived_at = Some(now);
        }
        Ok(())
    }

    /// Publishes a command: the torque limits first, so that no goal is approached with an older, larger one.
    fn publish(&self, command: &SafeCommand) -> Result<(), Ros2Error> {
        let efforts = command.servos.iter().zip(&self.torque_constants).map(|(goal, constant)| goal.current * constant);
        self.commands.servo_efforts.send(&Float64Array { data: efforts.collect() })?;
        self.commands
            .servo_positions
            .send(&Float64Array { data: command.servos.iter().map(|goal| goal.angle).collect() })?;
        self.commands.arm.send(&Float64Array { data: command.arm.to_vec() })
    }

    fn note(&mut self, result: Result<(), Ros2Error>) {
        if let Err(error) = result {
            self.failure.get_or_insert(error.to_string());
        }
    }
}

impl RobotLink for Ros2Link {
    fn measure(&mut self, clock: &Clock, measured: &mut Measurements, report: &mut CycleReport) {
        if let Some(cameras) = &mut self.cameras {
            cameras.start(clock);
        }
        let now = clock.now();
        if let Err(error) = self.take_states(now) {
            self.failure.get_or_insert(error);
        }
        if let Some(error) = self.cameras.as_ref().and_then(Ros2Cameras::failure) {
            self.failure.get_or_insert(error);
        }
        let silence = now - *self.arrived_at.get_or_insert(now);
        let silent = || {
            let (topic, domain) = (self.states.topic(), self.domain);
            format!("{topic} on domain {domain}: no message for {silence:.3} s")
        };
        let trouble = self.failure.clone().or_else(|| (silence > self.longest_silence).then(silent));
        measured.driver = trouble.is_none();
        report.driver_error = trouble.or(report.driver_error.take());
        self.joints.write(measured);
    }

    fn send(&mut self, command: &SafeCommand, _: &mut CycleReport) -> SafeCommand {
        let sent = self.publish(command);
        self.note(sent);
        *command
    }

    /// Sends the measured posture with no torque. The controllers have been activated by the robot's own tools.
    fn engage(&mut self, first: &SafeCommand, _: f64) -> Result<(), String> {
        let topics = [&self.commands.arm, &self.commands.servo_positions, &self.commands.servo_efforts];
        if let Some(topic) = topics.into_iter().find(|topic| topic.subscribers() == 0) {
            return Err(format!(
                "{} on domain {}: found no subscriber, expected an active controller (`ros2 control list_controllers`)",
                topic.topic(),
                self.domain
            ));
        }
        self.publish(first).map_err(|error| error.to_string())
    }

    /// Sends torque limits of 0. The torque itself is switched by the robot's driver; a servo counts as without torque if
    /// its measured current says so.
    fn torque_off(&mut self, _: &mut CycleReport) -> Vec<String> {
        let none = Float64Array { data: vec![0.0; self.servos.len()] };
        let sent = self.commands.servo_efforts.send(&none);
        self.note(sent);
        let flowing =
            self.servos.iter().zip(self.joints.servo_currents()).filter(|(_, current)| current.abs() > NO_CURRENT);
        flowing.map(|(name, current)| format!("{name}: found {current:.2} A, expected none")).collect()
    }

    /// Sends nothing more: a forward command controller keeps its last command.
    fn park(&mut self, _: &mut CycleReport) {}

    fn step(&mut self, _: &mut CycleReport) {}

    fn standstill_limit(&self, watchdogs: &WatchdogTimeouts) -> f64 {
        // Nothing but this program notices that its commands have stopped.
        watchdogs.host
    }

    fn senses_torque(&self) -> bool {
        self.senses_torque
    }
}
