//! Options for the body (robot backend) of trials.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use bench::recording::Began;
use bench::trial::Means;
use clap::{Args, ValueEnum};
use grasp_verification::simulated_world::World;
use hand_model::RobotModel;
use hardware_bridge::config::BridgeConfig;
use hardware_bridge::driven::expect_driven;
use object_detector::measurement::Checks;
use object_detector::{Vision, VisionSource};
use registration::RegistrationFile;
use robot_backends::emulated::{EmulatedSource, SimulatedSource};
use robot_backends::hardware::HardwareSource;
use robot_backends::rounded::RoundedSource;
use robot_backends::{BodySource, Places, numbers};
use scenarios::record::Condition;

/// Body (robot backend) that runs the trials.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Body {
    /// The simulated robot.
    Sim,
    /// The real robot, with --config; the operator is asked for the verdict.
    Hardware,
    /// The hardware bridge on emulated devices whose plant is the simulated robot, in lock-step.
    Emulated,
    /// The simulated robot with the same processing of commands, measurements and images as `emulated`, but without its
    /// wires: to isolate effects of the devices.
    Rounded,
}

impl Body {
    /// Returns the name used in results and recordings.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sim => "sim",
            Self::Hardware => "hardware",
            Self::Emulated => "emulated",
            Self::Rounded => "rounded",
        }
    }

    /// Refuses a robot that this backend does not support.
    pub fn expect(self, robot: &RobotModel) -> Result<()> {
        match self {
            Self::Sim => Ok(()),
            Self::Hardware | Self::Emulated | Self::Rounded => Ok(expect_driven(robot)?),
        }
    }

    /// Returns the wall-clock origin of the backend's time 0.
    pub fn began(self) -> Began {
        match self {
            Self::Hardware => Began::Now,
            Self::Sim | Self::Emulated | Self::Rounded => Began::Never,
        }
    }
}

/// Options for the poses of objects and arm base on an emulated or real robot.
#[derive(Debug, Clone, Default, Args)]
pub struct PlaceArgs {
    /// Vision system that measures object poses, HOST:PORT or unix:PATH, for --robot hardware or emulated: one JSON
    /// line per measurement with pose, covariance and time. With `emulated`, a camera of the emulated robot.
    #[arg(long, value_name = "ADDRESS")]
    pub eyes: Option<VisionSource>,
    /// Registration of the arm's base, a file of `ftac bridge register`.
    #[arg(long, value_name = "FILE")]
    pub registration: Option<PathBuf>,
    /// Seed that draws a hidden pose of an emulated robot's base, away from the pose that the controller assumes.
    #[arg(long, value_name = "N")]
    pub mount: Option<u64>,
}

impl PlaceArgs {
    /// Checks the options and returns them in the form stored with a trial.
    pub fn places(&self, robot: Body) -> Result<Places> {
        let real = matches!(robot, Body::Hardware | Body::Emulated);
        if self.eyes.is_some() && !real {
            bail!("--eyes: found --robot {}, expected emulated or hardware", robot.name());
        }
        if self.registration.is_some() && !real {
            bail!("--registration: found --robot {}, expected emulated or hardware", robot.name());
        }
        if self.mount.is_some() && robot != Body::Emulated {
            bail!("--mount: found --robot {}, expected emulated", robot.name());
        }
        if robot == Body::Hardware && self.eyes == Some(VisionSource::Emulated) {
            bail!("--eyes emulated: found --robot hardware, expected the address of a vision system");
        }
        let file = self.registration.as_deref().map(RegistrationFile::read).transpose()?;
        let base = file.map(|file| numbers(&file.world_from_base()));
        Ok(Places { base, eyes: self.eyes.is_some(), mount: self.mount })
    }

    /// Returns the vision system, for the objects of this world.
    fn vision(&self, world: &World) -> Option<Vision> {
        let known = world.scenario.objects();
        let checks = Checks::new(known.into_iter().collect(), world.cell.world_from_base);
        self.eyes.clone().map(|source| Vision { source, checks })
    }
}

/// Checks that backend and configuration match, and that they provide everything the conditions need.
pub fn check_body(robot: Body, config: Option<&Path>, conditions: &[Condition]) -> Result<()> {
    match (robot, config) {
        (Body::Hardware, Some(path)) => {
            let sees = |condition: &&Condition| Means::of(**condition).is_some_and(Means::see_images);
            let config = BridgeConfig::read(path)?;
            match conditions.iter().find(sees) {
                Some(condition) if config.cameras.is_none() && config.uvc.is_empty() => bail!(
                    "{}: found neither [cameras] nor [[uvc]], expected one of them for the condition {condition}; blind and reflex need none",
                    path.display()
                ),
                _ => Ok(()),
            }
        }
        (Body::Hardware, None) => bail!("--robot hardware: found no --config, expected the bridge's configuration"),
        (Body::Sim | Body::Emulated | Body::Rounded, Some(config)) => bail!(
            "--config {}: only the real robot has a configuration, and --robot is {}",
            config.display(),
            robot.name()
        ),
        (_, None) => Ok(()),
    }
}

/// Returns the source of robot backends for trials; `None` for simulated ones without a recorded session.
pub fn source(
    world: &World,
    robot: Body,
    (config, places): (Option<&Path>, &PlaceArgs),
    sessions: Option<PathBuf>,
) -> Result<Option<Box<dyn BodySource>>> {
    Ok(match (robot, sessions) {
        (Body::Sim, None) => None,
        (Body::Sim, Some(sessions)) => Some(Box::new(SimulatedSource { sessions })),
        (Body::Emulated, sessions) => {
            let source = EmulatedSource::new(world.cell.robot.clone(), sessions);
            Some(Box::new(source.with_eyes(places.vision(world))))
        }
        (Body::Rounded, sessions) => Some(Box::new(RoundedSource { robot: world.cell.robot.clone(), sessions })),
        (Body::Hardware, sessions) => {
            let config = config.context("--config")?;
            let sessions = sessions.unwrap_or_else(|| PathBuf::from("recordings/sessions"));
            let source = HardwareSource::new(config, world.cell.robot.clone(), world.cell.ready, sessions)?;
            Some(Box::new(source.with_eyes(places.vision(world))))
        }
    })
}
