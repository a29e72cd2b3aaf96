//! The outcome of a trial's first grasp, with the data needed to perceive it again with other cameras or optics.

use anyhow::Result;
use control::perception::{ExpectedHolds, default_prior};
use grasp_verification::rollout::in_hand;
use hand_model::ActuatorVector;
use hand_model::robot::ServoState;
use nalgebra::{Isometry3, UnitQuaternion};
use serde::{Deserialize, Serialize};
use tactile_perception::{PosePrior, Readings};

use super::setup::InitialConditions;
use super::shared::Bench;
use super::watcher::NoWatcher;

/// A first object in the hand at the moment of decision. Frame: palm.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct HeldGrasp {
    /// Number of the combination.
    pub combination: usize,
    /// Number of the trial.
    pub trial: usize,
    pub object: String,
    /// Position (rad) and current (A) of each servo.
    servos: ActuatorVector<[f64; 2]>,
    /// Rotation of the palm in the world, from the arm's encoders.
    turned: UnitQuaternion<f64>,
    /// Planned pose of the object, with its uncertainty.
    pub prior: PosePrior,
    /// True pose of the object.
    pub truth: Isometry3<f64>,
    /// True poses of the pads.
    pub pads: Vec<Isometry3<f64>>,
    /// True finger angles, rad.
    pub joints: Vec<f64>,
    /// Normal force on each pad, N.
    pub forces: Vec<f64>,
}

impl HeldGrasp {
    /// Returns the servos' readings.
    pub fn servos(&self) -> ActuatorVector<ServoState> {
        let state = |&[position, current]: &[f64; 2]| ServoState { position, current, ..ServoState::default() };
        self.servos.iter().map(state).collect()
    }

    /// Returns the readings that determine the hand's posture, given [`Self::servos`].
    pub fn readings<'a>(&self, servos: &'a [ServoState]) -> Readings<'a> {
        Readings::new(servos, &self.turned)
    }
}

impl Bench {
    /// Runs a noisy trial up to the decision. `None` if the first object is not in the hand then.
    pub fn held_grasp(&self, combination: usize, trial: usize) -> Result<Option<HeldGrasp>> {
        let start =
            InitialConditions::noisy(self, combination, trial)?.0.run_first_grasp(self, None, &mut NoWatcher)?;
        let snapshot = &start.run.snapshot;
        let Some(truth) = snapshot.robot.truth().filter(|truth| in_hand(truth, 0)) else { return Ok(None) };
        let first = snapshot.executor.target(0);
        let second = snapshot.executor.targets().get(1).map(|second| &second.grasp);
        let palm = truth.palm.inverse();
        let links: Vec<Isometry3<f64>> = truth.hand_links.iter().map(|link| palm * link).collect();
        Ok(Some(HeldGrasp {
            combination,
            trial,
            object: start.objects[0].name.clone(),
            servos: snapshot.executor.motion().servos().iter().map(|servo| [servo.position, servo.current]).collect(),
            turned: snapshot.executor.motion().palm().rotation,
            // Nothing was touched before this grasp: the variance from verifications after a touch is too small for it.
            prior: default_prior(ExpectedHolds::from_grasps(&first.grasp, &first.detected, second).palm_from_object),
            truth: palm * truth.objects[0],
            pads: self.world.cell.robot.hand.pad_poses(&links),
            joints: truth.hand,
            forces: truth.pad_forces,
        }))
    }
}
