//! What all trials of a benchmark share.

use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::{Result, ensure};
use control::perception::KnownObject;
use control::uncertainty::Uncertainty;
use grasping::Repertoire;
use hand_model::Digit;
use proving::plan::Plans;
use proving::plan::without::plan_without;
use proving::simulated_world::World;
use proving::twin::SceneTwin;
use scenarios::record::Condition;
use sim::tactile::TactileBoard;
use touch::TouchPipeline;

use super::means::Means;
use super::profile::Profile;
use external_policy::{Level, Own};

/// Robot, objects, grasps and plans of a benchmark.
pub struct Bench {
    /// Robot, objects, scenario.
    pub world: World,
    /// Proven grasps.
    pub repertoire: Repertoire,
    /// Combinations.
    pub plans: Plans,
    /// The hand unit's cameras.
    pub board: TactileBoard,
    /// Perception.
    pub pipeline: TouchPipeline,
    /// The objects of all plans, ready to be registered.
    pub known: BTreeMap<String, KnownObject>,
    /// What the controller expects to go wrong.
    pub uncertainty: Uncertainty,
    /// Seed of everything random.
    pub seed: u64,
    /// Where the time went.
    pub profile: Arc<Profile>,
    /// A twin of the scene in which `touch` and `reflex` play second grasps before they choose one, where they may.
    pub twin: Option<SceneTwin>,
    /// Whether a trial whose body stops has failed and others follow, instead of nothing being played any more.
    pub outlasts_faults: bool,
    /// A policy of the user's own, where one plays.
    pub own: Option<Own>,
    /// What is not as the files of the scenario's own objects have it, and what cannot be done with them.
    pub notes: Vec<String>,
    /// The scenario's own objects that are not played at all, and why.
    pub left_out: Vec<String>,
    /// What was planned while all digits had power, where some have none: `ideal` and `blind` know nothing else.
    pub intact: Option<Intact>,
}

/// What was planned before digits lost their power.
pub struct Intact {
    /// Grasps.
    pub repertoire: Repertoire,
    /// Combinations.
    pub plans: Plans,
    /// Combinations that cannot be done without those digits, and why.
    pub impossible: BTreeMap<usize, String>,
}

impl Bench {
    /// Whether a trial under a condition begins with anything but the planned first grasp.
    pub fn begins_otherwise(&self, condition: Condition) -> bool {
        match condition {
            Condition::Own => self.own.as_ref().is_some_and(|own| own.guest.level == Level::Act),
            _ => Means::of(condition).is_some_and(Means::begin_otherwise),
        }
    }

    /// Whether policies that decide play second grasps in a twin of the scene before they choose one.
    pub fn foresee(&mut self, foresees: bool) {
        self.twin = foresees.then(|| SceneTwin::new(self.world.clone(), self.board.clone()));
    }

    /// From now on `touch` does without `digits`, as well as it can; what was planned stays what `ideal` and `blind` know.
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
