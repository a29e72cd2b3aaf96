//! The simulated robot under the commands that the bridge would send: limited by its supervisor, rounded to whole milliamperes, encoder counts and the
//! arm's single-precision degrees, without any wire.
//!
//! It stands between `sim` and `emulated`: what differs from `sim` here is the devices' resolution; what `emulated` differs by from here is
//! the doing of wires, devices and coded images.

use std::path::PathBuf;

use anyhow::{Result, anyhow};
use hand_model::robot::{Command, Observation, Robot, ServoGoal, Tick};
use hand_model::{Arm, Hand};
use hardware_bridge::config::LimitConfig;
use hardware_bridge::kortex::degrees::{nearest_turn, to_radians, to_wire_angle};
use hardware_bridge::safety::checks::{ArmReading, Measured, ServoReading};
use hardware_bridge::safety::supervisor::{Asked, Step, Supervisor};
use hardware_bridge::session_log::Session;
use hardware_bridge::xc330;
use nalgebra::Isometry3;
use scenarios::noise::ObjectNoise;
use sim::SimulatedRobot;
use sim::robot::Truth;

use super::emulated::{session_file, travel};
use super::{Setting, Stage, Task, Venue};

/// Supply of the servos that are not there, V.
const SUPPLY: f64 = 11.1;

/// The robot and its supervisor.
pub struct Rounded {
    robot: SimulatedRobot,
    supervisor: Supervisor,
    newest: Observation,
}

impl Rounded {
    fn new(mut robot: SimulatedRobot, hand: &Hand, arm: &Arm) -> Result<Self> {
        let mut supervisor = Supervisor::new(LimitConfig::default().limits(&travel(hand), arm));
        let newest = robot.observe();
        let measured = measured(&newest);
        supervisor.connect()?;
        supervisor.check(&measured, newest.time).map_err(|error| anyhow!("{error}"))?;
        supervisor.arm(&measured, newest.time).map_err(|error| anyhow!("{error}"))?;
        Ok(Self { robot, supervisor, newest })
    }
}

fn measured(seen: &Observation) -> Measured {
    let servo = |n: usize| Some(ServoReading { at: seen.time, state: seen.servos[n], voltage: SUPPLY, alert: false });
    let arm = ArmReading { at: seen.time, state: seen.arm, fault: false };
    Measured { servos: std::array::from_fn(servo), arm: Some(arm), cameras: true }
}

/// A number as the register holds it.
fn rounded(value: f64, per_count: f64) -> f64 {
    (value / per_count).round() * per_count
}

impl Robot for Rounded {
    fn observe(&mut self) -> Observation {
        self.newest = self.robot.observe();
        self.newest.clone()
    }

    fn send(&mut self, command: &Command) -> Command {
        let now = self.newest.time;
        let step = self.supervisor.step(now, Some(Asked { command, at: now }), &measured(&self.newest));
        let Step::Send(safe) = step else { return *command };
        let servos = safe.servos.map(|goal| ServoGoal::Position {
            angle: rounded(goal.angle, xc330::GOAL_POSITION.unit.per_count()),
            current_limit: rounded(goal.current, xc330::GOAL_CURRENT.unit.per_count()),
        });
        let arm = safe.arm.map(|angle| nearest_turn(to_radians(to_wire_angle(angle)), angle));
        self.robot.send(&Command { arm, servos, capture: command.capture })
    }

    fn wait_for_tick(&mut self) -> Tick {
        self.robot.wait_for_tick()
    }

    fn tick_length(&self) -> f64 {
        self.robot.tick_length()
    }
}

impl Stage for Rounded {
    fn truth(&self) -> Option<Truth> {
        Some(self.robot.truth())
    }

    fn look(&mut self, object: usize, noise: &ObjectNoise) -> Result<Isometry3<f64>> {
        Stage::look(&mut self.robot, object, noise)
    }

    fn stopped(&self) -> Option<String> {
        use hardware_bridge::safety::state::State;
        match self.supervisor.state() {
            State::Running | State::Armed => None,
            state => Some(state.to_string()),
        }
    }
}

/// Where such robots come from.
pub struct RoundedVenue {
    /// The hand.
    pub hand: std::sync::Arc<Hand>,
    /// The arm.
    pub arm: std::sync::Arc<Arm>,
    /// Folder of the sessions' files, if they are recorded.
    pub sessions: Option<PathBuf>,
}

impl Venue for RoundedVenue {
    fn enter(&mut self, _: &Setting, scene: SimulatedRobot) -> Result<Box<dyn Stage>> {
        Ok(Box::new(Rounded::new(scene, &self.hand, &self.arm)?))
    }

    fn session(&self, task: &Task) -> Result<Option<(PathBuf, Session)>> {
        Ok(session_file(self.sessions.as_deref(), task)?.map(|path| (path, Session::default())))
    }
}
