//! The hardware bridge on emulated devices whose plant is the simulated robot, in lock-step. Also the simulated robot
//! with its session recorded.

use std::path::PathBuf;
use std::sync::mpsc::{self, Receiver};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use anyhow::{Context as _, Result};
use control::detection::PoseDetection;
use hand_model::parameters::Servo;
use hand_model::robot::{Observation, Plant, RobotBackend, RobotCommand, Tick};
use hand_model::{ActuatorVector, Hand, RobotModel};
use hardware_bridge::config::LimitConfig;
use hardware_bridge::emulator::EmulatorSettings;
use hardware_bridge::emulator::camera_board::BoardSettings;
use hardware_bridge::emulator::lockstep::{LockstepRobot, LockstepSettings};
use hardware_bridge::safety::state::SupervisorState;
use hardware_bridge::supported_robot::SERVOS;
use robot_session_log::{LinkPacket, SessionHeader};
use sim::SimulatedRobot;
use sim::robot::GroundTruth;

use object_detector::camera::{EmulatedDetector, EmulatedDetectorSettings, VisibleObjects};
use object_detector::{Address, VisionLink, VisionSetup, VisionSource};

use super::{BackendFactory, Detection, TrialBackend, TrialSetup, TrialTask};

/// Additional travel of the spool beyond the geometric closing, because the cable stretches under the strongest pull,
/// rad.
const CABLE_STRETCH: f64 = 0.35;
/// JPEG quality of the emulated board: that of a firmware with spare bandwidth on its USB line.
const JPEG_QUALITY: u8 = 95;
/// Time limit for an answer of the servos, s of real time.
const REPLY_SLACK: f64 = 20.0;

/// The simulated robot as a plant that others can observe too.
#[derive(Clone)]
pub struct SharedPlant(Arc<Mutex<SimulatedRobot>>);

impl SharedPlant {
    /// Wraps a robot in its scene.
    pub fn new(robot: SimulatedRobot) -> Self {
        Self(Arc::new(Mutex::new(robot)))
    }

    pub fn lock(&self) -> MutexGuard<'_, SimulatedRobot> {
        // A panic of another holder has been reported already.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Plant for SharedPlant {
    fn observe(&mut self) -> Observation {
        self.lock().observe()
    }

    fn send(&mut self, command: &RobotCommand) -> RobotCommand {
        self.lock().send(command)
    }

    fn wait_for_tick(&mut self) -> Tick {
        self.lock().wait_for_tick()
    }

    fn tick_length(&self) -> f64 {
        self.lock().tick_length()
    }
}

/// Returns the travel of every servo of a hand, rad: the closing of all joints, and the cable's stretch.
pub fn servo_travel(hand: &Hand) -> ActuatorVector {
    let travel = |(n, servo): (usize, &Servo)| match hand.transmission.cables.get(n) {
        Some(cable) => cable.full_excursion() / hand.cables[n].spool_radius + CABLE_STRETCH,
        None => std::f64::consts::FRAC_PI_2 * servo.gear_ratio_opposition + CABLE_STRETCH,
    };
    hand.servos.iter().enumerate().map(travel).collect()
}

/// Returns the travel of every shaft of a hand that the bridge drives, rad.
pub fn shaft_travel(hand: &Hand) -> [f64; SERVOS] {
    let travel = servo_travel(hand);
    std::array::from_fn(|n| travel[n])
}

/// Returns the usual settings of the lock-step robot.
pub fn lockstep_settings(hand: &Hand, seed: u64) -> LockstepSettings {
    let board = BoardSettings { quality: JPEG_QUALITY, ..BoardSettings::default() };
    LockstepSettings {
        devices: EmulatorSettings { board, seed, ..EmulatorSettings::default() },
        travel: shaft_travel(hand),
        limits: LimitConfig::default(),
        slack: REPLY_SLACK,
    }
}

/// The emulated robot, and the simulated one that its devices move.
pub struct WireEmulation {
    robot: LockstepRobot,
    plant: SharedPlant,
    /// Vision system that replaces simulated perception, with the objects' names.
    detector: Option<(VisionLink, Vec<String>)>,
    /// Camera behind the vision system, if it comes with the robot.
    _emulated_detector: Option<EmulatedDetector>,
}

impl TrialBackend for WireEmulation {
    fn robot(&self) -> &dyn RobotBackend {
        &self.robot
    }

    fn robot_mut(&mut self) -> &mut dyn RobotBackend {
        &mut self.robot
    }

    fn truth(&self) -> Option<GroundTruth> {
        Some(self.plant.lock().truth())
    }

    fn detect(&mut self, glance: &Detection) -> Result<Option<PoseDetection>> {
        match &mut self.detector {
            Some((link, names)) => Ok(link.detect(&names[glance.object], || false)?),
            None => TrialBackend::detect(&mut *self.plant.lock(), glance),
        }
    }

    fn stop_reason(&self) -> Option<String> {
        match self.robot.state() {
            SupervisorState::Running | SupervisorState::Armed => None,
            state => Some(state.to_string()),
        }
    }
}

/// Source of emulated robots.
pub struct WireEmulationFactory {
    robot: RobotModel,
    /// Folder of the session files, if sessions are recorded.
    sessions: Option<PathBuf>,
    vision: Option<VisionSetup>,
    packets: Option<Receiver<LinkPacket>>,
    header: Option<SessionHeader>,
}

impl WireEmulationFactory {
    /// Creates the source of this robot.
    pub fn new(robot: RobotModel, sessions: Option<PathBuf>) -> Self {
        Self { robot, sessions, vision: None, packets: None, header: None }
    }

    /// Adds a vision system that reports object poses.
    #[must_use]
    pub fn with_vision(self, detector: Option<VisionSetup>) -> Self {
        Self { vision: detector, ..self }
    }
}

/// Standard errors of the camera that comes with an emulated robot: position, m, and rotation about the vertical, rad.
/// Pose estimators of known objects on a table reach them.
pub const DETECTOR_SIGMA: (f64, f64) = (0.003, 0.02);

/// Returns the function by which a camera detects the plant's objects.
pub fn visible_objects(plant: &SharedPlant, names: Vec<String>) -> VisibleObjects {
    let plant = plant.clone();
    Box::new(move || names.iter().cloned().zip(plant.lock().truth().objects).collect())
}

impl BackendFactory for WireEmulationFactory {
    fn open(&mut self, setup: &TrialSetup, scene: SimulatedRobot) -> Result<Box<dyn TrialBackend>> {
        let plant = SharedPlant::new(scene);
        let (sender, receiver) = mpsc::channel();
        let tapped = self.sessions.is_some().then_some(&sender);
        let settings = lockstep_settings(&self.robot.hand, setup.task.seed);
        let robot = LockstepRobot::start(Box::new(plant.clone()), settings, &self.robot, tapped)?;
        self.packets = self.sessions.is_some().then_some(receiver);
        self.header = Some(SessionHeader {
            configuration: robot.config().to_toml().into_bytes(),
            calibration: serde_json::to_vec(robot.calibration())?,
            ..SessionHeader::default()
        });
        let names: Vec<String> = setup.objects.iter().map(|(name, _)| (*name).to_owned()).collect();
        let mut camera = None;
        let eyes = self.vision.as_ref().map(|eyes| {
            let address = match &eyes.source {
                VisionSource::System(address) => address.clone(),
                VisionSource::Emulated => {
                    let settings =
                        EmulatedDetectorSettings { sigma: DETECTOR_SIGMA, seed: setup.task.unit_seed(), period: None };
                    let local = Address::Tcp("127.0.0.1:0".to_owned());
                    let own = EmulatedDetector::start(&local, settings, visible_objects(&plant, names.clone()))
                        .context("the camera")?;
                    let address = own.address().clone();
                    camera = Some(own);
                    address
                }
            };
            anyhow::Ok((VisionLink::connect(&address, eyes.checks.clone())?, names))
        });
        Ok(Box::new(WireEmulation { robot, plant, detector: eyes.transpose()?, _emulated_detector: camera }))
    }

    fn session(&self, task: &TrialTask) -> Result<Option<(PathBuf, SessionHeader)>> {
        Ok(session_file(self.sessions.as_deref(), task)?.zip(self.header.clone()))
    }

    fn packets(&mut self) -> Option<Receiver<LinkPacket>> {
        self.packets.take()
    }
}

/// Source of simulated robots whose sessions are recorded.
pub struct SimulationFactory {
    /// Folder of the session files.
    pub sessions: PathBuf,
}

impl BackendFactory for SimulationFactory {
    fn open(&mut self, _: &TrialSetup, scene: SimulatedRobot) -> Result<Box<dyn TrialBackend>> {
        Ok(Box::new(scene))
    }

    fn session(&self, task: &TrialTask) -> Result<Option<(PathBuf, SessionHeader)>> {
        Ok(session_file(Some(&self.sessions), task)?.map(|path| (path, SessionHeader::default())))
    }
}

/// Returns the file of a trial's session in `folder`. An existing file of an earlier run is renamed.
pub fn session_file(folder: Option<&std::path::Path>, task: &TrialTask) -> Result<Option<PathBuf>> {
    let Some(folder) = folder else { return Ok(None) };
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let TrialTask { robot, combination, trial, condition, .. } = task;
    let name = format!("combination_{combination:02}_trial_{trial}_{condition}_{robot}");
    let path = folder.join(format!("{name}.mcap"));
    if path.exists() {
        let earlier = (1..).map(|n| folder.join(format!("{name}.{n}.mcap"))).find(|path| !path.exists());
        if let Some(earlier) = earlier {
            std::fs::rename(&path, &earlier).with_context(|| path.display().to_string())?;
        }
    }
    Ok(Some(path))
}
