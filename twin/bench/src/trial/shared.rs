//! Data that all trials of a benchmark share.

use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::{Result, ensure};
use control::perception::KnownObject;
use control::uncertainty::Uncertainty;
use dexterous_grasping::Repertoire;
use grasp_verification::grasp_pair::GraspPairTable;
use grasp_verification::grasp_pair::reduced_digits::plan_without_digits;
use grasp_verification::scene_model::SceneModel;
use grasp_verification::simulated_world::SimulatedWorld;
use hand_model::Digit;
use scenarios::Scenario;
use scenarios::record::Condition;
use sim::tactile::TactileBoard;
use tactile_perception::TouchPipeline;

use super::capabilities::PolicyCapabilities;
use super::profile::Profile;
use external_policy::{DecisionLevel, ExternalPolicy};

/// Robot, objects, grasps and grasp pairs of a benchmark.
pub struct Bench {
    /// Robot, objects, scenario.
    pub world: SimulatedWorld,
    /// Verified grasps.
    pub repertoire: Repertoire,
    /// Grasp pairs of the combinations.
    pub grasp_pairs: GraspPairTable,
    /// Cameras of the hand unit.
    pub cameras: TactileBoard,
    /// Tactile perception.
    pub pipeline: TouchPipeline,
    /// The objects of all grasp pairs, ready for registration.
    pub known_objects: BTreeMap<String, KnownObject>,
    /// Errors that the controller expects.
    pub uncertainty: Uncertainty,
    /// Seed of all random draws.
    pub seed: u64,
    /// Profile of the computing time.
    pub profile: Arc<Profile>,
    /// Scene model in which `touch` and `reflex` simulate second grasps before they choose one, if enabled.
    pub rollout_model: Option<SceneModel>,
    /// True if a trial whose backend stops counts as failed and others follow. If false, such a stop ends the
    /// benchmark.
    pub continues_after_faults: bool,
    /// External policy, if any.
    pub external_policy: Option<ExternalPolicy>,
    /// Deviations from the files of the scenario's own objects, and operations that are impossible with them.
    pub notes: Vec<String>,
    /// The scenario's own objects that are excluded, with the reasons.
    pub left_out: Vec<String>,
    /// Repertoire and grasp pairs made while all digits had power, if some have none. `ideal` and `blind` use no
    /// others.
    pub intact_grasps: Option<IntactGrasps>,
}

/// Repertoire and grasp pairs from before digits lost their power.
pub struct IntactGrasps {
    /// Verified grasps.
    pub repertoire: Repertoire,
    /// Grasp pairs of the combinations.
    pub plans: GraspPairTable,
    /// Combinations that are infeasible without those digits, with the reasons.
    pub impossible: BTreeMap<usize, String>,
}

impl Bench {
    /// True if a trial under a condition does not begin with the planned first grasp.
    pub fn skips_planned_grasp(&self, condition: Condition) -> bool {
        match condition {
            Condition::External => {
                self.external_policy.as_ref().is_some_and(|own| own.introduction.level == DecisionLevel::Act)
            }
            _ => PolicyCapabilities::for_condition(condition).is_some_and(PolicyCapabilities::may_skip_planned_grasp),
        }
    }

    /// Sets whether deciding policies simulate second grasps in rollouts before they choose one.
    pub fn set_look_ahead(&mut self, foresees: bool) {
        self.rollout_model = foresees.then(|| SceneModel::new(self.world.clone(), self.cameras.clone()));
    }

    /// Returns a bench with the same robot, objects and grasps under another scenario, and without an external policy.
    /// `scenario` may differ from the bench's in noise, effects and layout only: the objects stay those of the bench.
    #[must_use]
    pub fn with_scenario(&self, scenario: Scenario) -> Self {
        Self {
            world: SimulatedWorld { scenario, ..self.world.clone() },
            repertoire: self.repertoire.clone(),
            grasp_pairs: self.grasp_pairs.clone(),
            cameras: self.cameras.clone(),
            pipeline: self.pipeline.clone(),
            known_objects: self.known_objects.clone(),
            uncertainty: self.uncertainty,
            seed: self.seed,
            profile: Arc::default(),
            rollout_model: None,
            continues_after_faults: self.continues_after_faults,
            external_policy: None,
            notes: self.notes.clone(),
            left_out: self.left_out.clone(),
            intact_grasps: None,
        }
    }

    /// Makes `touch` do without `digits` from now on. `ideal` and `blind` keep the original grasp pairs.
    pub fn disable_digits(&mut self, digits: &[Digit]) -> Result<()> {
        ensure!(
            self.world.scenario.object_lists().len() == 2,
            "{}: disturbance.disabled_digits: found digits, expected none: only trials of two objects are planned without digits",
            self.world.scenario.name
        );
        let without = plan_without_digits(&self.world, &self.repertoire, &self.grasp_pairs, digits)?;
        self.intact_grasps = Some(IntactGrasps {
            repertoire: std::mem::replace(&mut self.repertoire, without.repertoire),
            plans: std::mem::replace(&mut self.grasp_pairs, without.pairs),
            impossible: without.impossible,
        });
        Ok(())
    }
}
