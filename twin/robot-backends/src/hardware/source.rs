//! Source of real robots: the robot is connected and checked, then the operator lays out the objects, then the torque
//! is switched on.

use std::path::PathBuf;
use std::sync::mpsc::Sender;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use control::outage::Outage;
use hand_model::robot::{RobotBackend, RobotCommand, ServoGoal};
use hand_model::{ArmVector, RobotModel};
use hardware_bridge::config::BridgeConfig;
use hardware_bridge::config::secrets::without_secrets;
use hardware_bridge::hardware_robot::HardwareRobot;
use hardware_bridge::real_time::PERMIT_COMMANDS;
use hardware_bridge::reference_pictures::ReferencePictures;
use nalgebra::Isometry3;
use robot_session_log::{LinkPacket, LinkTap, SessionHeader};
use sim::SimulatedRobot;

use super::{CHECK_TIMEOUT, HardwareBackend};
use crate::arm_link::connect_arm_link;
use crate::disk::ensure_session_space;
use crate::driver::scene::{DriverScene, SceneObject};
use crate::driver::{DrivenRobot, SharedProcess};
use crate::operator::{Operator, ask_until};
use crate::ros2::Ros2Robot;
use crate::wire_emulation::session_file;
use crate::{BackendFactory, TrialBackend, TrialSetup, TrialStopped, TrialTask};
use object_detector::{VisionLink, VisionSetup, VisionSource, format_position};
use progress::interrupt::Interrupt;

/// Speed of the arm's joints on the way to the posture in which trials begin, rad/s.
const APPROACH_SPEED: f64 = 0.3;
/// Time for which the servo cycle is observed before the torque goes on.
const CYCLE_TEST_DURATION: Duration = Duration::from_secs(1);
/// Tolerance of the ready posture, rad.
const READY_TOLERANCE: f64 = 0.01;

/// Devices of a real robot.
enum Devices {
    /// Those of the hardware bridge.
    Bridge(Box<BridgeConfig>),
    /// Those behind a driver of the robot's owner.
    Driver(Box<DrivenRobot>),
    /// Those on ROS 2 topics.
    Ros2(Box<Ros2Robot>),
}

/// Source of the real robot.
pub struct HardwareFactory {
    devices: Devices,
    header: SessionHeader,
    model: RobotModel,
    /// Posture in which trials begin, rad.
    ready: ArmVector,
    sessions: PathBuf,
    vision: Option<VisionSetup>,
    packets: Option<std::sync::mpsc::Receiver<LinkPacket>>,
}

impl HardwareFactory {
    /// Reads the configuration at `path`. Sessions are always recorded, into `sessions`.
    pub fn new(path: &std::path::Path, model: RobotModel, ready: ArmVector, sessions: PathBuf) -> Result<Self> {
        let config = BridgeConfig::read(path)?;
        let bytes = |path: &std::path::Path| std::fs::read(path).with_context(|| path.display().to_string());
        let configuration = without_secrets(&String::from_utf8_lossy(&bytes(path)?)).into_bytes();
        let about =
            SessionHeader { configuration, calibration: bytes(&config.calibration)?, ..SessionHeader::default() };
        let devices = Devices::Bridge(Box::new(config));
        Ok(Self { devices, header: about, model, ready, sessions, vision: None, packets: None })
    }

    /// Source of a robot behind a driver of its owner. Sessions are always recorded, into `sessions`.
    pub fn with_driver(robot: DrivenRobot, model: RobotModel, ready: ArmVector, sessions: PathBuf) -> Result<Self> {
        let header = SessionHeader {
            configuration: toml::to_string(&robot.limits)?.into_bytes(),
            calibration: serde_json::to_vec(&robot.description)?,
            ..SessionHeader::default()
        };
        let devices = Devices::Driver(Box::new(robot));
        Ok(Self { devices, header, model, ready, sessions, vision: None, packets: None })
    }

    /// Source of a robot on ROS 2 topics. Sessions are always recorded, into `sessions`.
    pub fn with_ros2(robot: Ros2Robot, model: RobotModel, ready: ArmVector, sessions: PathBuf) -> Result<Self> {
        let header = SessionHeader {
            configuration: toml::to_string(&robot.config)?.into_bytes(),
            calibration: toml::to_string(&robot.limits)?.into_bytes(),
            ..SessionHeader::default()
        };
        let devices = Devices::Ros2(Box::new(robot));
        Ok(Self { devices, header, model, ready, sessions, vision: None, packets: None })
    }

    /// Adds a vision system that reports object poses.
    #[must_use]
    pub fn with_vision(self, detector: Option<VisionSetup>) -> Self {
        Self { vision: detector, ..self }
    }

    /// Connects the vision system.
    fn connect_vision(&self) -> Result<Option<VisionLink>> {
        let connect = |detector: &VisionSetup| match &detector.source {
            VisionSource::System(address) => Ok(VisionLink::connect(address, detector.checks.clone())?),
            VisionSource::Emulated => {
                bail!("--detector emulated: found --robot hardware, expected the address of a vision system")
            }
        };
        self.vision.as_ref().map(connect).transpose()
    }

    /// True if the robot has tactile cameras.
    pub fn has_cameras(&self) -> bool {
        match &self.devices {
            Devices::Bridge(config) => config.cameras.is_some() || !config.uvc.is_empty(),
            Devices::Driver(robot) => !robot.description.cameras.is_empty(),
            Devices::Ros2(robot) => robot.config.cameras.is_some(),
        }
    }

    /// Connects and checks the robot with its torque as it was. This finds every fault that can be found before objects
    /// are laid out or anything moves.
    pub fn check(&mut self) -> Result<CheckedRobot> {
        match &self.devices {
            Devices::Bridge(config) => {
                let (packets, receiver) = std::sync::mpsc::channel();
                self.packets = Some(receiver);
                check_bridge(config, &self.model, self.ready, packets)
            }
            Devices::Driver(robot) => self.check_driver(robot, robot.start_process()?, None),
            Devices::Ros2(robot) => {
                let connected = robot.connect()?;
                wait_for_checks(&connected)?;
                Ok(CheckedRobot::new(connected, self.ready, robot.limits.pause, None))
            }
        }
    }

    /// Connects and checks the robot behind a driver's process, which has laid out `scene`.
    fn check_driver(
        &self,
        robot: &DrivenRobot,
        process: SharedProcess,
        scene: Option<DriverScene>,
    ) -> Result<CheckedRobot> {
        let connected = robot.connect(process)?;
        wait_for_checks(&connected)?;
        Ok(CheckedRobot::new(connected, self.ready, robot.limits.pause, scene))
    }

    /// Starts a driver for a trial, lets it lay out the objects if it can, and checks its robot. `simulated` is the
    /// trial's scene.
    fn open_driver(&self, robot: &DrivenRobot, setup: &TrialSetup, simulated: &SimulatedRobot) -> Result<CheckedRobot> {
        let process = robot.start_process()?;
        let scene = robot.scene(&process);
        if let Some(scene) = &scene {
            let placed = setup.objects.iter().zip(simulated.models());
            let objects = placed.map(|((name, pose), model)| {
                let yaw = (pose.rotation * model.rest.inverse()).euler_angles().2;
                SceneObject { name, pose: *pose, yaw }
            });
            scene.lay_out(setup.task, &objects.collect::<Vec<_>>())?;
        }
        self.check_driver(robot, process, scene)
    }

    /// Asks the operator to lay out the objects of a trial, and for consent to move.
    fn ask_operator(&self, setup: &TrialSetup, checked: &mut CheckedRobot) -> Result<()> {
        let TrialTask { combination, trial, condition, .. } = setup.task;
        eprintln!("combination {combination}, trial {trial}, {condition}:");
        for (name, place) in &setup.objects {
            eprintln!("  put {name} at {}", format_position(place));
        }
        let question = "The arm will move to its ready posture, then the trial begins. Empty hand, clear way? Enter begins, `q` ends here.";
        if ask_until(question, || checked.recheck().map(|()| false))?.is_none_or(|answer| answer == "q") {
            bail!(TrialStopped("the operator ended the list here".into()));
        }
        Ok(())
    }
}

/// Connects and checks the robot of the hardware bridge; the bytes on its wires go to `packets` once it is armed.
fn check_bridge(
    config: &BridgeConfig,
    model: &RobotModel,
    ready: ArmVector,
    packets: Sender<LinkPacket>,
) -> Result<CheckedRobot> {
    let link = connect_arm_link(config, model, ready)?;
    let robot = HardwareRobot::connect(config, link, model, None)?;
    wait_for_checks(&robot)?;
    check_reference_pictures(config, model, &robot)?;
    if let Some(why) = robot.report().priority_error {
        eprintln!(
            "warning: the servo cycle has no real-time priority ({why}). On a busy computer devices may stop in mid-trial. To permit it:"
        );
        PERMIT_COMMANDS.iter().for_each(|command| eprintln!("  {command}"));
        eprintln!("then log in again.");
    }
    std::thread::sleep(CYCLE_TEST_DURATION);
    let (gap, limits) = (robot.report().longest_gap, &config.limits);
    let most = 0.5 * limits.servo_watchdog.min(limits.arm_watchdog);
    if gap > most {
        bail!(
            "this computer is too busy to begin: found {:.0} ms between two servo cycles, expected at most {:.0} (half of the shortest watchdog)",
            1e3 * gap,
            1e3 * most
        );
    }
    Ok(CheckedRobot { packets: Some(packets), ..CheckedRobot::new(robot, ready, config.limits.pause, None) })
}

/// Checks that no camera is plugged in at another's place, as far as reference pictures exist.
fn check_reference_pictures(config: &BridgeConfig, model: &RobotModel, robot: &HardwareRobot) -> Result<()> {
    let kept = ReferencePictures::read(&ReferencePictures::beside(&config.calibration), model.hand.cameras.len())?;
    let (Some(kept), Some(cameras)) = (kept, robot.cameras()) else { return Ok(()) };
    let now = ReferencePictures::capture(cameras, CHECK_TIMEOUT).map_err(anyhow::Error::msg)?;
    let mistaken: Vec<String> = kept.exchanged_cameras(&now).iter().map(ToString::to_string).collect();
    if !mistaken.is_empty() {
        bail!(
            "found {}, expected every camera where it was (`ftac bridge doctor --store-references` stores the present images)",
            mistaken.join(", ")
        );
    }
    Ok(())
}

/// A robot that passed the checks. Its links are kept while its operator lays out objects; nothing moves.
pub struct CheckedRobot {
    robot: HardwareRobot,
    /// Destination of the links' bytes from the beginning of the trial on, if there are any.
    packets: Option<Sender<LinkPacket>>,
    /// Scene of a driver that needs no operator.
    scene: Option<DriverScene>,
    /// Posture in which trials begin, rad.
    ready: ArmVector,
    /// Longest pause while the controller computes, s.
    pause: f64,
    /// Time since which the checks have failed, if they do.
    failing_since: Option<Instant>,
}

impl CheckedRobot {
    fn new(robot: HardwareRobot, ready: ArmVector, pause: f64, scene: Option<DriverScene>) -> Self {
        Self { robot, packets: None, scene, ready, pause, failing_since: None }
    }

    /// Repeats the checks during a question to the operator. A robot that fails them for [`CHECK_TIMEOUT`] ends the
    /// question.
    pub fn recheck(&mut self) -> Result<()> {
        let Err(error) = self.robot.check() else {
            self.failing_since = None;
            return Ok(());
        };
        if self.failing_since.get_or_insert_with(Instant::now).elapsed() > CHECK_TIMEOUT {
            bail!("the checks no longer pass: {error}");
        }
        Ok(())
    }

    /// Switches the torque on and moves to the ready posture. `objects` are given with their nominal poses,
    /// `world_from_object`.
    pub fn arm_and_home(self, objects: &[(&str, Isometry3<f64>)]) -> Result<HardwareBackend> {
        let Self { robot, packets, scene, ready, pause, .. } = self;
        wait_for_checks(&robot)?;
        if let Some(packets) = packets {
            robot.tap(&packets);
            if let Some(tactile) = robot.tactile() {
                tactile.tap(LinkTap::new("cameras", packets));
            }
        }
        // A robot without an operator ends with the program that runs it.
        let interrupt = scene.is_none().then(Interrupt::catch).transpose()?;
        let operator = Operator::from_stdin()?;
        robot.arm()?;
        let (names, places) = objects.iter().map(|(name, place)| ((*name).to_owned(), *place)).unzip();
        let mut hardware = HardwareBackend {
            robot,
            nominal_poses: places,
            names,
            max_pause: pause,
            interrupt,
            vision: None,
            scene,
            operator,
        };
        if let Err(error) = move_arm(&mut hardware, &ready) {
            hardware.end_trial(Some(&format!("{error:#}")))?;
            return Err(error);
        }
        Ok(hardware)
    }
}

/// Waits until the newest measurements pass the checks.
fn wait_for_checks(robot: &HardwareRobot) -> Result<()> {
    let begun = Instant::now();
    while let Err(error) = robot.check() {
        if begun.elapsed() > CHECK_TIMEOUT || robot.report().driver_error.is_some() {
            bail!("the checks do not pass: {error}");
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    Ok(())
}

impl BackendFactory for HardwareFactory {
    fn open(&mut self, setup: &TrialSetup, simulated: SimulatedRobot) -> Result<Box<dyn TrialBackend>> {
        ensure_session_space(&self.sessions)?;
        // Faults of robot or detector are found before the objects are laid out.
        let mut detector = self.connect_vision()?;
        let mut checked = match &self.devices {
            Devices::Bridge(_) | Devices::Ros2(_) => self.check()?,
            Devices::Driver(robot) => self.open_driver(robot, setup, &simulated)?,
        };
        if checked.scene.is_none() {
            self.ask_operator(setup, &mut checked)?;
        }
        for (name, _) in &setup.objects {
            let Some(detector) = &mut detector else { break };
            // A hidden object is found before anything moves.
            let seen = detector.detect(name, || false)?;
            let seen =
                seen.with_context(|| format!("{name} is hidden, expected it in sight before the trial begins"))?;
            eprintln!("  {name} is detected at {}", format_position(&seen.pose));
        }
        Ok(Box::new(HardwareBackend { vision: detector, ..checked.arm_and_home(&setup.objects)? }))
    }

    fn session(&self, task: &TrialTask) -> Result<Option<(PathBuf, SessionHeader)>> {
        Ok(session_file(Some(&self.sessions), task)?.map(|path| (path, self.header.clone())))
    }

    fn packets(&mut self) -> Option<std::sync::mpsc::Receiver<LinkPacket>> {
        self.packets.take()
    }

    fn is_real(&self) -> bool {
        true
    }
}

/// Moves the arm to `posture` (rad), all joints at [`APPROACH_SPEED`] at most, with the hand open.
fn move_arm(hardware: &mut HardwareBackend, posture: &[f64]) -> Result<()> {
    let step = APPROACH_SPEED * hardware.robot.tick_length();
    let mut goal = hardware.robot.observe()?.into_observation()?.arm.position;
    let longest = goal.iter().zip(posture).map(|(from, to)| (to - from).abs()).fold(0.0, f64::max);
    let mut left = (longest / step) as u64 + 600;
    let mut outage = Outage::default();
    loop {
        let Some(observation) = outage.record_observation(hardware.robot.observe())? else {
            hardware.robot.wait_for_tick();
            continue;
        };
        let far = observation.arm.position.iter().zip(posture).any(|(is, to)| (is - to).abs() > READY_TOLERANCE);
        let arrived = goal[..] == *posture && !far;
        for (goal, to) in goal.iter_mut().zip(posture) {
            *goal += (to - *goal).clamp(-step, step);
        }
        let servos = observation.servos.iter().map(|_| ServoGoal::Current(0.0)).collect();
        let command = RobotCommand { arm: goal, servos, capture: false };
        let sent = outage.record_send(hardware.robot.send(&command));
        hardware.robot.wait_for_tick();
        if let Some(why) = hardware.stop_reason() {
            bail!(TrialStopped(format!("{why} on the way to the ready posture")));
        }
        sent?;
        left = left.saturating_sub(1);
        if arrived {
            return Ok(());
        }
        if left == 0 {
            bail!(
                "the arm does not reach its ready posture: found {:.3?} rad, expected {posture:.3?}",
                observation.arm.position
            );
        }
    }
}
