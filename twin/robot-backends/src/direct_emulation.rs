//! The simulated robot behind the bridge's devices without any wire: function calls ([`DirectRobot`]) apply everything
//! that the lock-step emulated robot applies to a command, a measurement or an image.
//!
//! It lies between `sim` and [`crate::wire_emulation`]. Differences from `sim` are due to limits, registers,
//! single-precision degrees and coded images. There must be no differences from `wire_emulation`, because only wires
//! remain between them.

use std::path::PathBuf;

use anyhow::{Result, anyhow};
use control::detection::PoseDetection;
use hand_model::RobotModel;
use hand_model::robot::RobotBackend;
use hardware_bridge::emulator::direct::DirectRobot;
use hardware_bridge::safety::state::SupervisorState;
use hardware_bridge::supported_robot::check_supported;
use robot_session_log::SessionHeader;
use sim::SimulatedRobot;
use sim::robot::GroundTruth;

use super::wire_emulation::{SharedPlant, lockstep_settings, session_file};
use super::{BackendFactory, Detection, TrialBackend, TrialSetup, TrialTask};

/// The robot, and the simulated one that it moves.
pub struct DirectEmulation {
    robot: DirectRobot,
    plant: SharedPlant,
}

impl TrialBackend for DirectEmulation {
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
        TrialBackend::detect(&mut *self.plant.lock(), glance)
    }

    fn stop_reason(&self) -> Option<String> {
        match self.robot.state() {
            SupervisorState::Running | SupervisorState::Armed => None,
            state => Some(state.to_string()),
        }
    }
}

/// Source of such robots.
pub struct DirectEmulationFactory {
    pub robot: RobotModel,
    /// Folder of the session files, if sessions are recorded.
    pub sessions: Option<PathBuf>,
}

impl BackendFactory for DirectEmulationFactory {
    fn open(&mut self, setup: &TrialSetup, scene: SimulatedRobot) -> Result<Box<dyn TrialBackend>> {
        check_supported(&self.robot)?;
        let plant = SharedPlant::new(scene);
        let settings = lockstep_settings(&self.robot.hand, setup.task.seed);
        let robot =
            DirectRobot::start(Box::new(plant.clone()), settings, &self.robot).map_err(|error| anyhow!("{error}"))?;
        Ok(Box::new(DirectEmulation { robot, plant }))
    }

    fn session(&self, task: &TrialTask) -> Result<Option<(PathBuf, SessionHeader)>> {
        Ok(session_file(self.sessions.as_deref(), task)?.map(|path| (path, SessionHeader::default())))
    }
}
