//! Options for the robot backend of trials.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use bench::recording::TimeOrigin;
use bench::trial::PolicyCapabilities;
use clap::{Args, ValueEnum};
use grasp_verification::simulated_world::SimulatedWorld;
use hand_model::RobotModel;
use hardware_bridge::config::BridgeConfig;
use hardware_bridge::supported_robot::check_supported;
use object_detector::measurement::MeasurementChecks;
use object_detector::{VisionSetup, VisionSource};
use registration::RegistrationFile;
use robot_backends::direct_emulation::DirectEmulationFactory;
use robot_backends::hardware::HardwareFactory;
use robot_backends::wire_emulation::{SimulationFactory, WireEmulationFactory};
use robot_backends::{BackendFactory, PoseSources, pose_numbers};
use scenarios::record::Condition;

/// Robot backend that runs the trials.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum BackendKind {
    /// The simulated robot.
    Sim,
    /// The real robot, with --config; the operator is asked for the verdict.
    Hardware,
    /// The hardware bridge on emulated devices whose plant is the simulated robot, in lock-step.
    Emulated,
    /// The simulated robot with the same processing of commands, measurements and images as `emulated`, but without its
    /// wires: to isolate effects of the devices.
    Direct,
}

impl BackendKind {
    /// Returns the name used in results and recordings.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sim => "sim",
            Self::Hardware => "hardware",
            Self::Emulated => "emulated",
            Self::Direct => "direct",
        }
    }

    /// Refuses a robot that this backend does not support.
    pub fn check_supported(self, robot: &RobotModel) -> Result<()> {
        match self {
            Self::Sim => Ok(()),
            Self::Hardware | Self::Emulated | Self::Direct => Ok(check_supported(robot)?),
        }
    }

    /// Returns the wall-clock origin of the backend's time 0.
    pub fn time_origin(self) -> TimeOrigin {
        match self {
            Self::Hardware => TimeOrigin::Now,
            Self::Sim | Self::Emulated | Self::Direct => TimeOrigin::Never,
        }
    }
}

/// Options for the poses of objects and arm base on an emulated or real robot.
#[derive(Debug, Clone, Default, Args)]
pub struct PoseSourceArgs {
    /// Vision system that measures object poses, HOST:PORT or unix:PATH, for --robot hardware or emulated: one JSON
    /// line per measurement with pose, covariance and time. With `emulated`, a camera of the emulated robot.
    #[arg(long, value_name = "ADDRESS")]
    pub detector: Option<VisionSource>,
    /// Registration of the arm's base, a file of `ftac bridge register`.
    #[arg(long, value_name = "FILE")]
    pub registration: Option<PathBuf>,
    /// Seed for a hidden pose of an emulated robot's base, away from the pose that the controller assumes.
    #[arg(long, value_name = "N")]
    pub mount: Option<u64>,
}

impl PoseSourceArgs {
    /// Checks the options and returns them in the form stored with a trial.
    pub fn pose_sources(&self, robot: BackendKind) -> Result<PoseSources> {
        let real = matches!(robot, BackendKind::Hardware | BackendKind::Emulated);
        if self.detector.is_some() && !real {
            bail!("--detector: found --robot {}, expected emulated or hardware", robot.name());
        }
        if self.registration.is_some() && !real {
            bail!("--registration: found --robot {}, expected emulated or hardware", robot.name());
        }
        if self.mount.is_some() && robot != BackendKind::Emulated {
            bail!("--mount: found --robot {}, expected emulated", robot.name());
        }
        if robot == BackendKind::Hardware && self.detector == Some(VisionSource::Emulated) {
            bail!("--detector emulated: found --robot hardware, expected the address of a vision system");
        }
        let file = self.registration.as_deref().map(RegistrationFile::read).transpose()?;
        let base = file.map(|file| pose_numbers(&file.world_from_base()));
        Ok(PoseSources { base, detector: self.detector.is_some(), mount: self.mount })
    }

    /// Returns the vision system, for the objects of this world.
    fn vision_setup(&self, world: &SimulatedWorld) -> Option<VisionSetup> {
        let known = world.scenario.object_names();
        let checks = MeasurementChecks::new(known.into_iter().collect(), world.cell.world_from_base);
        self.detector.clone().map(|source| VisionSetup { source, checks })
    }
}

/// Checks that backend and configuration match, and that they provide everything the conditions need.
pub fn check_backend(robot: BackendKind, config: Option<&Path>, conditions: &[Condition]) -> Result<()> {
    match (robot, config) {
        (BackendKind::Hardware, Some(path)) => {
            let sees = |condition: &&Condition| {
                PolicyCapabilities::for_condition(**condition).is_some_and(PolicyCapabilities::use_images)
            };
            let config = BridgeConfig::read(path)?;
            match conditions.iter().find(sees) {
                Some(condition) if config.cameras.is_none() && config.uvc.is_empty() => bail!(
                    "{}: found neither [cameras] nor [[uvc]], expected one of them for the condition {condition}; blind and reflex need none",
                    path.display()
                ),
                _ => Ok(()),
            }
        }
        (BackendKind::Hardware, None) => {
            bail!("--robot hardware: found no --config, expected the bridge's configuration")
        }
        (BackendKind::Sim | BackendKind::Emulated | BackendKind::Direct, Some(config)) => bail!(
            "--config {}: only the real robot has a configuration, and --robot is {}",
            config.display(),
            robot.name()
        ),
        (_, None) => Ok(()),
    }
}

/// Returns the source of robot backends for trials; `None` for simulated ones without a recorded session.
pub fn backend_factory(
    world: &SimulatedWorld,
    robot: BackendKind,
    (config, places): (Option<&Path>, &PoseSourceArgs),
    sessions: Option<PathBuf>,
) -> Result<Option<Box<dyn BackendFactory>>> {
    Ok(match (robot, sessions) {
        (BackendKind::Sim, None) => None,
        (BackendKind::Sim, Some(sessions)) => Some(Box::new(SimulationFactory { sessions })),
        (BackendKind::Emulated, sessions) => {
            let source = WireEmulationFactory::new(world.cell.robot.clone(), sessions);
            Some(Box::new(source.with_vision(places.vision_setup(world))))
        }
        (BackendKind::Direct, sessions) => {
            Some(Box::new(DirectEmulationFactory { robot: world.cell.robot.clone(), sessions }))
        }
        (BackendKind::Hardware, sessions) => {
            let config = config.context("--config")?;
            let sessions = sessions.unwrap_or_else(|| PathBuf::from("recordings/sessions"));
            let source = HardwareFactory::new(config, world.cell.robot.clone(), world.cell.ready_posture, sessions)?;
            Some(Box::new(source.with_vision(places.vision_setup(world))))
        }
    })
}
