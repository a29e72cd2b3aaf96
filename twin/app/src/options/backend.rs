//! Options for the robot backend of trials.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use bench::trial::PolicyCapabilities;
use clap::builder::{EnumValueParser, PossibleValue, TypedValueParser};
use clap::{Args, ValueEnum};
use grasp_verification::simulated_world::SimulatedWorld;
use hand_model::RobotModel;
use hardware_bridge::config::BridgeConfig;
use hardware_bridge::supported_robot::check_supported;
use object_detector::measurement::MeasurementChecks;
use object_detector::{VisionSetup, VisionSource};
use registration::RegistrationFile;
use robot_backends::direct_emulation::DirectEmulationFactory;
use robot_backends::driver::DrivenRobot;
use robot_backends::hardware::HardwareFactory;
use robot_backends::ros2::Ros2Robot;
use robot_backends::ros2::config::Ros2Config;
use robot_backends::wire_emulation::{SimulationFactory, WireEmulationFactory};
use robot_backends::{BackendFactory, DRIVER_BACKEND, PoseSources, ROS2_BACKEND, pose_numbers};
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
    /// A robot on ROS 2 topics, with --config; needs no ROS installation. The operator is asked for the verdict.
    Ros2,
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
            Self::Ros2 => ROS2_BACKEND,
            Self::Emulated => "emulated",
            Self::Direct => "direct",
        }
    }

    /// Refuses a robot that this backend does not support.
    pub fn check_supported(self, robot: &RobotModel) -> Result<()> {
        match self {
            Self::Sim | Self::Ros2 => Ok(()),
            Self::Hardware | Self::Emulated | Self::Direct => Ok(check_supported(robot)?),
        }
    }
}

/// Value of `--robot`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RobotOption {
    /// A backend of this program.
    Backend(BackendKind),
    /// A driver of the robot's owner, `FILE.py:CLASS`.
    Driver(String),
}

impl RobotOption {
    /// Returns the name used in results and recordings.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Backend(kind) => kind.name(),
            Self::Driver(_) => DRIVER_BACKEND,
        }
    }

    /// True for this backend of the program.
    pub fn is(&self, kind: BackendKind) -> bool {
        *self == Self::Backend(kind)
    }

    /// Refuses a robot that this backend does not support. A driver describes its robot itself.
    pub fn check_supported(&self, robot: &RobotModel) -> Result<()> {
        match self {
            Self::Backend(kind) => kind.check_supported(robot),
            Self::Driver(_) => Ok(()),
        }
    }
}

impl From<BackendKind> for RobotOption {
    fn from(kind: BackendKind) -> Self {
        Self::Backend(kind)
    }
}

impl std::fmt::Display for RobotOption {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Backend(kind) => f.write_str(kind.name()),
            Self::Driver(class) => f.write_str(class),
        }
    }
}

/// Parser of `--robot`: names of backends, and `FILE.py:CLASS`.
#[derive(Debug, Clone)]
pub struct RobotParser;

impl TypedValueParser for RobotParser {
    type Value = RobotOption;

    fn parse_ref(
        &self,
        command: &clap::Command,
        argument: Option<&clap::Arg>,
        value: &OsStr,
    ) -> Result<RobotOption, clap::Error> {
        match value.to_str() {
            Some(text) if text.contains(':') || text.ends_with(".py") => Ok(RobotOption::Driver(text.to_owned())),
            _ => EnumValueParser::<BackendKind>::new().parse_ref(command, argument, value).map(RobotOption::from),
        }
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new(BackendKind::value_variants().iter().filter_map(BackendKind::to_possible_value)))
    }
}

/// Options for the poses of objects and arm base on an emulated or real robot.
#[derive(Debug, Clone, Default, Args)]
pub struct PoseSourceArgs {
    /// Vision system that measures object poses, HOST:PORT or unix:PATH, for --robot hardware, emulated or
    /// FILE.py:CLASS: one JSON line per measurement with pose, covariance and time. With `emulated`, a camera of the emulated robot.
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
    pub fn pose_sources(&self, robot: &RobotOption) -> Result<PoseSources> {
        use BackendKind::{Emulated, Hardware, Ros2};
        let driven = matches!(robot, RobotOption::Driver(_));
        let real = robot.is(Hardware) || robot.is(Ros2) || robot.is(Emulated) || driven;
        if self.detector.is_some() && !real {
            bail!("--detector: found --robot {}, expected emulated, hardware, ros2 or FILE.py:CLASS", robot.name());
        }
        if self.registration.is_some() && !real {
            bail!("--registration: found --robot {}, expected emulated, hardware, ros2 or FILE.py:CLASS", robot.name());
        }
        if self.mount.is_some() && !robot.is(Emulated) {
            bail!("--mount: found --robot {}, expected emulated", robot.name());
        }
        if (robot.is(Hardware) || robot.is(Ros2) || driven) && self.detector == Some(VisionSource::Emulated) {
            bail!("--detector emulated: found --robot {robot}, expected the address of a vision system");
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

/// Checks that backend and configuration match, and that they provide everything the conditions need. The
/// configuration of a driver's robot has its limits alone, and is checked with the robot.
pub fn check_backend(robot: &RobotOption, config: Option<&Path>, conditions: &[Condition]) -> Result<()> {
    let sees = |condition: &&Condition| {
        PolicyCapabilities::for_condition(**condition).is_some_and(PolicyCapabilities::use_images)
    };
    match (robot, config) {
        (RobotOption::Backend(BackendKind::Hardware), Some(path)) => {
            let config = BridgeConfig::read(path)?;
            match conditions.iter().find(sees) {
                Some(condition) if config.cameras.is_none() && config.uvc.is_empty() => bail!(
                    "{}: found neither [cameras] nor [[uvc]], expected one of them for the condition {condition}; blind and reflex need none",
                    path.display()
                ),
                _ => Ok(()),
            }
        }
        (RobotOption::Backend(BackendKind::Ros2), Some(path)) => {
            let has_cameras = Ros2Config::read(path)?.cameras.is_some();
            match conditions.iter().find(sees) {
                Some(condition) if !has_cameras => bail!(
                    "{}: found no [cameras], expected it for the condition {condition}; blind and reflex need none",
                    path.display()
                ),
                _ => Ok(()),
            }
        }
        (RobotOption::Backend(BackendKind::Ros2), None) => {
            bail!("--robot ros2: found no --config, expected the file that names domain, topics and joints")
        }
        (RobotOption::Backend(BackendKind::Hardware), None) => {
            bail!("--robot hardware: found no --config, expected the bridge's configuration")
        }
        (RobotOption::Backend(BackendKind::Sim | BackendKind::Emulated | BackendKind::Direct), Some(config)) => {
            bail!("--config {}: only the real robot has a configuration, and --robot is {robot}", config.display())
        }
        (RobotOption::Driver(_), _) | (_, None) => Ok(()),
    }
}

/// Returns the source of robot backends for trials; `None` for simulated ones without a recorded session. `driven` is
/// the robot behind the driver that `robot` names, if it names one.
pub fn backend_factory(
    world: &SimulatedWorld,
    (robot, driven): (&RobotOption, Option<&DrivenRobot>),
    (config, places): (Option<&Path>, &PoseSourceArgs),
    sessions: Option<PathBuf>,
) -> Result<Option<Box<dyn BackendFactory>>> {
    let (model, ready) = (&world.cell.robot, world.cell.ready_posture);
    let always = || sessions.clone().unwrap_or_else(|| PathBuf::from("recordings/sessions"));
    let real = |source: HardwareFactory| Box::new(source.with_vision(places.vision_setup(world)));
    Ok(match robot {
        RobotOption::Driver(_) => {
            let driven = driven.context("--robot")?.clone();
            Some(real(HardwareFactory::with_driver(driven, model.clone(), ready, always())?))
        }
        RobotOption::Backend(BackendKind::Hardware) => {
            let config = config.context("--config")?;
            Some(real(HardwareFactory::new(config, model.clone(), ready, always())?))
        }
        RobotOption::Backend(BackendKind::Ros2) => {
            let robot = Ros2Robot::read(config.context("--config")?, model)?;
            Some(real(HardwareFactory::with_ros2(robot, model.clone(), ready, always())?))
        }
        RobotOption::Backend(BackendKind::Sim) => match sessions {
            Some(sessions) => Some(Box::new(SimulationFactory { sessions })),
            None => None,
        },
        RobotOption::Backend(BackendKind::Emulated) => {
            let source = WireEmulationFactory::new(model.clone(), sessions);
            Some(Box::new(source.with_vision(places.vision_setup(world))))
        }
        RobotOption::Backend(BackendKind::Direct) => {
            Some(Box::new(DirectEmulationFactory { robot: model.clone(), sessions }))
        }
    })
}
