//! Data that all trials of a benchmark share.

use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::{Result, ensure};
use control::perception::KnownObject;
use control::uncertainty::Uncertainty;
use dexterous_grasping::Repertoire;
use grasp_verification::plan::Plans;
use grasp_verification::plan::without::plan_without;
use grasp_verification::simulated_world::World;
use grasp_verification::twin::SceneTwin;
use hand_model::Digit;
use scenarios::record::Condition;
use sim::tactile::TactileBoard;
use tactile_perception::TouchPipeline;

use super::means::Means;
use super::profile::Profile;
use external_policy::{Level, Own};

/// Robot, objects, grasps and plans of a benchmark.
pub struct Bench {
    /// Robot, objects, scenario.
    pub world: World,
    /// Proven grasps.
    pub repertoire: Repertoire,
    /// Plans of the combinations.
    pub plans: Plans,
    /// Cameras of the hand unit.
    pub board: TactileBoard,
    /// Tactile perception.
    pub pipeline: TouchPipeline,
    /// The objects of all plans, ready for registration.
    pub known: BTreeMap<String, KnownObject>,
    /// Errors that the controller expects.
    pub uncertainty: Uncertainty,
    /// Seed of all random draws.
    pub seed: u64,
    /// Profile of the computing time.
    pub profile: Arc<Profile>,
    /// Twin of the scene in which `touch` and `reflex` simulate second grasps before they choose one, if enabled.
    pub twin: Option<SceneTwin>,
    /// True if a trial whose body stops counts as failed and others follow. If false, such a stop ends the benchmark.
    pub outlasts_faults: bool,
    /// Policy of the user's own, if one plays.
    pub own: Option<Own>,
    /// Deviations from the files of the scenario's own objects, and operations that are not possible with them.
    pub notes: Vec<String>,
    /// The scenario's own objects that are excluded, with the reasons.
    pub left_out: Vec<String>,
    /// Repertoire and plans made while all digits had power, if some have none. `ideal` and `blind` know nothing else.
    pub intact: Option<Intact>,
}

/// Repertoire and plans from before digits lost their power.
pub struct Intact {
    /// Proven grasps.
    pub repertoire: Repertoire,
    /// Plans of the combinations.
    pub plans: Plans,
    /// Combinations that are infeasible without those digits, with the reasons.
    pub impossible: BTreeMap<usize, String>,
}

impl Bench {
    /// True if a trial under a condition does not begin with the planned first grasp.
    pub fn begins_otherwise(&self, condition: Condition) -> bool {
        match condition {
            Condition::Own => self.own.as_ref().is_some_and(|own| own.guest.level == Level::Act),
            _ => Means::of(condition).is_some_and(Means::begin_otherwise),
        }
    }

    /// Sets whether policies that decide simulate second grasps in a twin of the scene before they choose one.
    pub fn foresee(&mut self, foresees: bool) {
        self.twin = foresees.then(|| SceneTwin::new(self.world.clone(), self.board.clone()));
    }

    /// From now on `touch` does without `digits`, as well as it can. The original plans stay those of `ideal` and
    /// `blind`.
    pub fn do_without(&mut self, digits: &[Digit]) -> Result<()> {
        ensure!(
            self.world.scenario.lists().len() == 2,
            "{}: disturbance.disabled_digits: found digits, expected none: only trials of two objects are planned without digits",
            self.world.scenario.name
        );
        let without = plan_without(&self.world, &self.repertoire, &self.plans, digits)?;
        self.intact = Some(Intact {
            repertoire: std::mem::replace(&mut self.repertoire, without.repertoire),
            plans: std::mem::replace(&mut self.plans, without.plans),
            impossible: without.impossible,
        });
        Ok(())
    }
}
