//! Behaviour of the policy `touch` if every grasp of the second object is likelier to make contact than to hold.

use std::sync::Arc;

use control::executor::Phase;
use control::outcome_model::{Rollout, TryOutcome};
use control::policy::touch::TouchPolicy;
use control::policy::{Knowledge, PolicyStep, Recovery, TrialPolicy};
use control::score::{GraspCandidate, GraspSequence};
use control::sensing::TouchPerception;
use nalgebra::Vector3;
use world::Sensing;

use crate::table::*;

/// Second grasps with the given outcome in all rollouts, whatever the error of the aim.
fn with_outcome(table: &Table, outcome: TryOutcome) -> Vec<GraspCandidate> {
    let steps = || (-4..=4).map(|n| 0.004 * f64::from(n));
    let errors = steps().flat_map(|x| steps().map(move |y| Vector3::new(x, y, 0.0)));
    let with_outcome: Arc<[Rollout]> = errors.map(|error| Rollout::new(error, outcome)).collect();
    table.second().into_iter().map(|candidate| GraspCandidate { rollouts: with_outcome.clone(), ..candidate }).collect()
}

/// Decision with the first object in the hand, second grasps that make contact after the planned first grasp, and
/// rollouts after the other first grasp as given by `others`.
fn with_contacts_after_the_plan(
    others: Option<TryOutcome>,
    recovery: Recovery,
    time: f64,
) -> (PolicyStep, Phase, String) {
    let table = Table::new();
    let mut executor = table.executor();
    let mut detector = CountingDetector::new(&table);
    let mut grasps = table.repertoire.for_digits(FIRST, SIDE);
    let [planned, other] = [(); 2].map(|()| grasps.next().expect("two first grasps"));
    let others =
        others.map(|outcome| GraspSequence { first: other.clone(), second_candidates: with_outcome(&table, outcome) });
    let knowledge = Knowledge {
        second_candidates: with_outcome(&table, TryOutcome::Contact),
        alternative_firsts: others.into_iter().collect(),
        recovery,
        ..table.knowledge()
    };
    let senses = TouchPerception::new(&table.pipeline, Sensing::TruePose).expect("made");
    let mut touch = TouchPolicy::new(knowledge, senses, planned);
    run_until(&mut executor, DECIDE);
    touch.perceive(&executor, in_hand(true, false)).expect("perceived");
    let step = touch.decide(&mut executor, &mut detector, time).expect("decided");
    let told = touch.trace().take_announcements().join("; ");
    if executor.phase() == PUT_DOWN {
        while executor.phase() == PUT_DOWN {
            executor.tick(&still()).expect("a command");
        }
        touch.perceive(&executor, in_hand(false, false)).expect("perceived");
        touch.decide(&mut executor, &mut detector, time).expect("decided");
        assert_eq!(executor.target(0).grasp.id, other.id, "it is taken with the other grasp");
    }
    (step, executor.phase(), told)
}

/// If another first grasp has rollouts and the second object can be taken after it, the first one is put down and taken
/// that way.
#[test]
fn the_first_object_is_put_down_and_taken_otherwise() {
    let (step, phase, told) = with_contacts_after_the_plan(Some(TryOutcome::Held), Recovery::FULL, 0.0);
    assert_eq!((step, phase), (PolicyStep::Continue, APPROACH_FIRST), "{told}");
    assert!(told.contains("put down"), "{told}");
}

/// The second object is left alone if no other first grasp is known, if the known one is no better, if no time is left,
/// or if retries are not permitted.
#[test]
fn a_likely_contact_is_declined() {
    let once = Recovery { retry: false, ..Recovery::FULL };
    for (others, recovery, time) in [
        (None, Recovery::FULL, 0.0),
        (Some(TryOutcome::Contact), Recovery::FULL, 0.0),
        (Some(TryOutcome::Held), Recovery::FULL, TIME_LIMIT - 1.0),
        (Some(TryOutcome::Held), once, 0.0),
    ] {
        let (step, phase, told) = with_contacts_after_the_plan(others, recovery, time);
        assert_eq!((step, phase), (PolicyStep::Decline, DECIDE), "{others:?}: {told}");
        assert!(told.contains("declined"), "{told}");
    }
}
