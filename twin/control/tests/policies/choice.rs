//! The choice of the second grasp.

use std::ops::Range;
use std::sync::Arc;

use control::executor::Executor;
use control::look_ahead::{LookAheadSettings, RolloutError, RolloutModel, RolloutScene, SampledScene};
use control::outcome_model::{AimPosterior, Rollout, TryOutcome};
use control::score::GraspCandidate;
use control::strategy::{Assessment, Decision, DecisionContext, HeldObject, LookAhead, choose, object_solids};
use control::uncertainty::Uncertainty;
use nalgebra::{Isometry3, Vector3};
use world::objects::{ObjectModel, ObjectSet};

use crate::table::*;

/// Chooses with a held bar of 16 mm x 16 mm x 120 mm, along the palm's normal, at `x` (m, palm frame).
fn with_bar_at(x: f64) -> (bool, Assessment) {
    let table = Table::new();
    let mut executor = table.executor();
    run_until(&mut executor, DECIDE);
    let bar = bar();
    let [bar, target] = [&bar, &*table.objects[1]].map(object_solids);
    let held = HeldObject {
        name: "bar",
        solids: &bar,
        pose: Isometry3::translation(x, 0.09, -0.02),
        joints: vec![0.0; 15],
        digits: SIDE.to_vec(),
        sigma: 0.001,
    };
    let hand = &table.cell.robot.hand;
    let posterior = AimPosterior::new(&Uncertainty::standard());
    let situation = DecisionContext {
        executor: &executor,
        hand,
        held: &held,
        rollout_hold: None,
        target: &target,
        target_sigma: 0.002,
        all_rollouts: Arc::default(),
        aim_posterior: &posterior,
        detections: 1,
        probe: Vector3::zeros(),
        look_ahead: None,
    };
    let decision = choose(&situation, &table.second()).expect("geometry").expect("a plan");
    (decision.switched, decision.planned)
}

fn bar() -> ObjectModel {
    let cube = ObjectSet::standard().get(FIRST).expect("a cube").clone();
    let shape = world::ObjectShape::Cuboid { half: Vector3::new(0.008, 0.008, 0.06), radius: 0.0 };
    ObjectModel { name: "bar".into(), shape, ..(*cube).clone() }
}

/// If a held bar is at the place where the planned grasp closes on the next object, the grasp that closes below it is
/// chosen.
#[test]
fn a_bar_in_the_way_switches_the_grasp() {
    let (switched, plan) = with_bar_at(0.02);
    assert!(plan.clearance < 0.0 && plan.separation < 0.0, "{plan:?}");
    assert!(switched);
}

/// Digits in the way do not count as an overlap of the two objects.
#[test]
fn objects_are_no_nearer_than_what_holds_them() {
    for x in [-0.10, -0.05, 0.0, 0.02, 0.05] {
        let (_, plan) = with_bar_at(x);
        assert!(plan.separation > plan.clearance - 1e-4, "{x}: {plan:?}");
    }
}

/// The same bar beside the hand changes nothing.
#[test]
fn a_bar_out_of_the_way_keeps_the_plan() {
    let (switched, plan) = with_bar_at(-0.10);
    assert!(plan.clearance > 0.02, "{plan:?}");
    assert!(!switched);
}

/// Decision with given rollouts (plan, other grasp) and a held object that is out of the way.
fn with_rollouts(outcomes: [fn(&Vector3<f64>) -> TryOutcome; 2]) -> Decision {
    with_twin(outcomes, None)
}

/// A rollout model in which the grasp of this number makes contact and every other one holds.
struct OneContactModel(u32);

impl RolloutModel for OneContactModel {
    fn prepare(&self, _: &RolloutScene) -> Result<Box<dyn SampledScene>, RolloutError> {
        Ok(Box::new(Self(self.0)))
    }
}

impl SampledScene for OneContactModel {
    fn roll_out(&self, going: &Executor, draws: Range<usize>) -> Result<Vec<Option<TryOutcome>>, RolloutError> {
        let outcome = if going.target(1).grasp.id == self.0 { TryOutcome::Contact } else { TryOutcome::Held };
        Ok(vec![Some(outcome); draws.len()])
    }
}

/// Like [`with_rollouts`], with a rollout model in which the candidates are rolled out first.
fn with_twin(outcomes: [fn(&Vector3<f64>) -> TryOutcome; 2], twin: Option<&dyn RolloutModel>) -> Decision {
    let table = Table::new();
    let mut executor = table.executor();
    run_until(&mut executor, DECIDE);
    let bar = bar();
    let [bar, target] = [&bar, &*table.objects[1]].map(object_solids);
    let held = HeldObject {
        name: "bar",
        solids: &bar,
        pose: Isometry3::translation(-0.10, 0.09, -0.02),
        joints: vec![0.0; 15],
        digits: SIDE.to_vec(),
        sigma: 0.001,
    };
    let posterior = AimPosterior::new(&Uncertainty::standard());
    let covariance = nalgebra::Matrix6::zeros();
    let situation = DecisionContext {
        executor: &executor,
        hand: &table.cell.robot.hand,
        held: &held,
        rollout_hold: None,
        target: &target,
        target_sigma: 0.002,
        all_rollouts: Arc::default(),
        aim_posterior: &posterior,
        detections: 1,
        probe: Vector3::zeros(),
        look_ahead: twin.map(|twin| LookAhead {
            settings: LookAheadSettings::with_alternatives(twin),
            objects: &table.objects,
            covariance: &covariance,
        }),
    };
    let steps = || (-4..=4).map(|n| 0.004 * f64::from(n));
    let errors: Vec<_> = steps().flat_map(|x| steps().map(move |y| Vector3::new(x, y, 0.0))).collect();
    let rollouts = |outcome: fn(&Vector3<f64>) -> TryOutcome| {
        errors.iter().map(|error| Rollout::new(*error, outcome(error))).collect()
    };
    let candidates: Vec<_> = table
        .second()
        .into_iter()
        .zip(outcomes)
        .map(|(candidate, how)| GraspCandidate { rollouts: rollouts(how), ..candidate })
        .collect();
    choose(&situation, &candidates).expect("geometry").expect("a plan")
}

/// A plan that makes contact is given up for a grasp that only misses, because a miss can be tried again.
#[test]
fn a_miss_is_better_than_a_contact() {
    use TryOutcome::{Contact, Held, Missed};
    let decision = with_rollouts([
        |error| if error.x.abs() < 0.006 { Held } else { Contact },
        |error| if error.x.abs() < 0.006 { Held } else { Missed },
    ]);
    assert!(decision.switched && decision.chosen.risk < 0.1 && decision.planned.risk > 0.3, "{}", decision.reason);
}

/// A plan that makes contact on one side only is kept and aimed away from that side.
#[test]
fn the_aim_leaves_the_side_that_touches() {
    use TryOutcome::{Contact, Held};
    let decision = with_rollouts([|error| if error.x < 0.0 { Contact } else { Held }, |_| Contact]);
    assert!(!decision.switched && decision.aim.x > 0.0, "{}", decision.reason);
    assert!(decision.chosen.risk < decision.planned.risk - 0.1, "{}", decision.reason);
}

/// A plan that is good in its rollouts is given up when it makes contact in the look-ahead, and the reason states this.
#[test]
fn what_touches_in_the_twin_is_left() {
    let held: [fn(&Vector3<f64>) -> TryOutcome; 2] = [|_| TryOutcome::Held, |_| TryOutcome::Held];
    let [plan, other] = [0, 1].map(|n| Table::new().second()[n].grasp.id);
    assert!(!with_rollouts(held).switched);
    let decision = with_twin(held, Some(&OneContactModel(plan)));
    assert!(decision.switched && decision.planned.risk > 0.5 && decision.chosen.risk < 0.1, "{}", decision.reason);
    assert!(decision.reason.contains("of 8 rollouts 8 hold and 0 make contact"), "{}", decision.reason);
    let decision = with_twin(held, Some(&OneContactModel(other)));
    assert!(!decision.switched && decision.planned.risk < 0.1, "{}", decision.reason);
}
