//! The simulated robot behind the bridge's devices without any wire: function calls ([`DirectRobot`]) apply everything
//! that the lock-step emulated robot applies to a command, a measurement or an image.
//!
//! It stands between `sim` and `emulated`. Differences from `sim` are due to limits, registers, single-precision
//! degrees and coded images. There must be no differences from `emulated`, since only wires remain between them.

use std::path::PathBuf;

use anyhow::{Result, anyhow};
use control::percept::Sighted;
use hand_model::RobotModel;
use hand_model::robot::RobotBackend;
use hardware_bridge::driven::expect_driven;
use hardware_bridge::emulator::direct::DirectRobot;
use hardware_bridge::safety::state::State;
use robot_session_log::Session;
use sim::SimulatedRobot;
use sim::robot::Truth;

use super::emulated::{SharedPlant, session_file, settings};
use super::{BodySource, Glance, Task, TrialBody, TrialSetup};

/// The robot, and the simulated one that it moves.
pub struct Rounded {
    robot: DirectRobot,
    plant: SharedPlant,
}

impl TrialBody for Rounded {
    fn robot(&self) -> &dyn RobotBackend {
        &self.robot
    }

    fn robot_mut(&mut self) -> &mut dyn RobotBackend {
        &mut self.robot
    }

    fn truth(&self) -> Option<Truth> {
        Some(self.plant.lock().truth())
    }

    fn look(&mut self, glance: &Glance) -> Result<Option<Sighted>> {
        TrialBody::look(&mut *self.plant.lock(), glance)
    }

    fn stopped(&self) -> Option<String> {
        match self.robot.state() {
            State::Running | State::Armed => None,
            state => Some(state.to_string()),
        }
    }
}

/// Source of such robots.
pub struct RoundedSource {
    pub robot: RobotModel,
    /// Folder of the session files, if sessions are recorded.
    pub sessions: Option<PathBuf>,
}

impl BodySource for RoundedSource {
    fn open(&mut self, setup: &TrialSetup, scene: SimulatedRobot) -> Result<Box<dyn TrialBody>> {
        expect_driven(&self.robot)?;
        let plant = SharedPlant::new(scene);
        let settings = settings(&self.robot.hand, setup.task.seed);
        let robot =
            DirectRobot::start(Box::new(plant.clone()), settings, &self.robot).map_err(|error| anyhow!("{error}"))?;
        Ok(Box::new(Rounded { robot, plant }))
    }

    fn session(&self, task: &Task) -> Result<Option<(PathBuf, Session)>> {
        Ok(session_file(self.sessions.as_deref(), task)?.map(|path| (path, Session::default())))
    }
}
