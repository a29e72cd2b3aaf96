//! Which body the command line asks for.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use bench::body::BodySource;
use bench::body::emulated::{EmulatedSource, SimulatedSource};
use bench::body::hardware::HardwareSource;
use bench::body::rounded::RoundedSource;
use bench::recording::Began;
use bench::trial::Means;
use clap::ValueEnum;
use hardware_bridge::config::BridgeConfig;
use proving::world::World;
use scenarios::record::Condition;

/// Which body runs the trials.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Body {
    /// The simulated robot.
    Sim,
    /// The real robot, under --config; the operator is asked for the verdict.
    Hardware,
    /// The hardware bridge on emulated devices whose plant is the simulated robot, in lock-step.
    Emulated,
    /// The simulated robot behind all that `emulated` does to commands, measurements and images, but without wires: to tell what is the devices' doing.
    Rounded,
}

impl Body {
    /// As results and recordings write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sim => "sim",
            Self::Hardware => "hardware",
            Self::Emulated => "emulated",
            Self::Rounded => "rounded",
        }
    }

    /// When its time 0 is.
    pub fn began(self) -> Began {
        match self {
            Self::Hardware => Began::Now,
            Self::Sim | Self::Emulated | Self::Rounded => Began::Never,
        }
    }
}

/// Whether body and configuration go together, and have what the conditions need.
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

/// Where bodies for trials come from; `None` for simulated ones without a recorded session.
pub fn source(
    world: &World,
    robot: Body,
    config: Option<&Path>,
    sessions: Option<PathBuf>,
) -> Result<Option<Box<dyn BodySource>>> {
    Ok(match (robot, sessions) {
        (Body::Sim, None) => None,
        (Body::Sim, Some(sessions)) => Some(Box::new(SimulatedSource { sessions })),
        (Body::Emulated, sessions) => {
            Some(Box::new(EmulatedSource::new(world.cell.hand.clone(), world.cell.arm.clone(), sessions)))
        }
        (Body::Rounded, sessions) => {
            Some(Box::new(RoundedSource { hand: world.cell.hand.clone(), arm: world.cell.arm.clone(), sessions }))
        }
        (Body::Hardware, sessions) => {
            let config = config.context("--config")?;
            let sessions = sessions.unwrap_or_else(|| PathBuf::from("recordings/sessions"));
            Some(Box::new(HardwareSource::new(config, world.cell.arm.clone(), world.cell.ready, sessions)?))
        }
    })
}
