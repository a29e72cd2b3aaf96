//! Options for publishing a robot on ROS 2 topics, and the backend that does so.

use std::net::IpAddr;
use std::path::PathBuf;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use anyhow::Result;
use clap::Args;
use control::detection::PoseDetection;
use control::workcell::Workcell;
use hand_model::robot::{Readings, RobotBackend, RobotCommand, RobotError, ServoState, Tick};
use hand_model::{Hand, HandVector};
use robot_backends::{BackendFactory, Detection, TrialBackend, TrialSetup, TrialTask};
use robot_ros2::{RobotPublisher, Ros2Error, Ros2Node};
use robot_session_log::{LinkPacket, SessionHeader};
use scenarios::referee::Verdict;
use sim::SimulatedRobot;
use sim::robot::GroundTruth;
use tactile_perception::posture::free_posture;

/// Options for publishing a trial.
#[derive(Debug, Clone, Default, Args)]
pub struct Ros2Args {
    /// Publish the robot's measurements and commands on the topics of this ROS 2 domain (ROS_DOMAIN_ID), as RViz shows
    /// them.
    #[arg(long, value_name = "DOMAIN")]
    pub ros2: Option<u16>,
    /// Address of this computer whose network alone is used for ROS 2; default: all networks.
    #[arg(long, value_name = "ADDRESS", requires = "ros2")]
    pub ros2_interface: Option<IpAddr>,
}

impl Ros2Args {
    /// Returns a source whose robots are published, if requested. Without a source, the robots are the simulated ones.
    pub fn publish(
        &self,
        source: Option<Box<dyn BackendFactory>>,
        cell: &Workcell,
    ) -> Result<Option<Box<dyn BackendFactory>>, Ros2Error> {
        let Some(domain) = self.ros2 else { return Ok(source) };
        let node = Ros2Node::new(domain, self.ros2_interface)?;
        Ok(Some(Box::new(PublishingFactory { source, node, cell: cell.clone() })))
    }
}

/// Source of robots that are published.
struct PublishingFactory {
    source: Option<Box<dyn BackendFactory>>,
    node: Ros2Node,
    cell: Workcell,
}

impl BackendFactory for PublishingFactory {
    fn open(&mut self, setup: &TrialSetup, scene: SimulatedRobot) -> Result<Box<dyn TrialBackend>> {
        let (robot, base) = (&self.cell.robot, &self.cell.world_from_base);
        let publisher = RobotPublisher::new(&self.node, robot, base, wall_time())?;
        let backend: Box<dyn TrialBackend> = match &mut self.source {
            Some(source) => source.open(setup, scene)?,
            None => Box::new(scene),
        };
        Ok(Box::new(PublishingBackend { backend, publisher, hand: robot.hand.clone(), failed: false }))
    }

    fn session(&self, task: &TrialTask) -> Result<Option<(PathBuf, SessionHeader)>> {
        self.source.as_ref().map_or(Ok(None), |source| source.session(task))
    }

    fn packets(&mut self) -> Option<std::sync::mpsc::Receiver<LinkPacket>> {
        self.source.as_mut().and_then(|source| source.packets())
    }

    fn is_real(&self) -> bool {
        self.source.as_ref().is_some_and(|source| source.is_real())
    }
}

/// A robot whose observations and commands are published.
struct PublishingBackend {
    backend: Box<dyn TrialBackend>,
    publisher: RobotPublisher,
    hand: std::sync::Arc<Hand>,
    /// True once publishing has failed, which does not end a trial.
    failed: bool,
}

impl PublishingBackend {
    fn note(&mut self, result: Result<(), Ros2Error>) {
        if let Err(error) = result
            && !std::mem::replace(&mut self.failed, true)
        {
            eprintln!("warning: no longer published: {error}");
        }
    }
}

impl RobotBackend for PublishingBackend {
    fn observe(&mut self) -> Result<Readings, RobotError> {
        let readings = self.backend.robot_mut().observe()?;
        if !self.failed {
            let fingers = hand_angles(&self.hand, &readings);
            let sent = self.publisher.send_readings(wall_time(), &readings, fingers.as_deref());
            self.note(sent);
        }
        Ok(readings)
    }

    fn send(&mut self, command: &RobotCommand) -> Result<RobotCommand, RobotError> {
        let command = self.backend.robot_mut().send(command)?;
        if !self.failed {
            let sent = self.publisher.send_command(wall_time(), &command);
            self.note(sent);
        }
        Ok(command)
    }

    fn wait_for_tick(&mut self) -> Tick {
        self.backend.robot_mut().wait_for_tick()
    }

    fn tick_length(&self) -> f64 {
        self.backend.robot().tick_length()
    }
}

impl TrialBackend for PublishingBackend {
    fn robot(&self) -> &dyn RobotBackend {
        self
    }

    fn robot_mut(&mut self) -> &mut dyn RobotBackend {
        self
    }

    fn truth(&self) -> Option<GroundTruth> {
        self.backend.truth()
    }

    fn detect(&mut self, glance: &Detection) -> Result<Option<PoseDetection>> {
        self.backend.detect(glance)
    }

    fn stop_reason(&self) -> Option<String> {
        self.backend.stop_reason()
    }

    fn hold(&mut self) {
        self.backend.hold();
    }

    fn pause(&mut self) {
        self.backend.pause();
    }

    fn end_trial(&mut self, why: Option<&str>) -> Result<()> {
        self.backend.end_trial(why)
    }

    fn statistics(&self) -> Option<serde_json::Value> {
        self.backend.statistics()
    }

    fn judge(&mut self) -> Result<Option<Verdict>> {
        self.backend.judge()
    }
}

/// Returns the joint angles of a hand that touches nothing, rad, as its servos tell them; none if a servo was not read.
pub fn hand_angles(hand: &Hand, readings: &Readings) -> Option<HandVector> {
    let servos: Option<Vec<ServoState>> = readings.servos.iter().map(|servo| servo.map(|servo| servo.value)).collect();
    Some(free_posture(hand, &servos?).q)
}

/// Returns the time since 1970.
pub fn wall_time() -> Duration {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default()
}
