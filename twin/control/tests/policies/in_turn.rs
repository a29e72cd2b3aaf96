//! Three objects in turn: an object missing from the hand is taken again, and an object lost earlier begins the list
//! anew.

use control::detection::{DetectionError, ObjectDetector, PoseDetection};
use control::executor::{Executor, Phase, Skill};
use control::policy::sequential::SequentialPolicy;
use control::policy::{Knowledge, PolicyStep, TrialPolicy};
use control::sensing::TouchPerception;
use world::Sensing;

use crate::lists::{DIGIT_SETS, target};
use crate::table::*;

/// Detects every object at the pose of the table's second object.
struct FixedDetector<'a>(&'a Table);

impl ObjectDetector for FixedDetector<'_> {
    fn detect(&mut self, _: usize) -> Result<Option<PoseDetection>, DetectionError> {
        Ok(Some(self.0.place(1).into()))
    }
}

/// Runs a trial in which the first two objects are felt as `felt` returns for each phase, the third never is, and
/// decisions come at `time` (s). Returns the attempted objects, the number of retries, and the phases of the decisions.
fn run_policy(time: f64, felt: impl Fn(Phase) -> [bool; 2]) -> (Vec<usize>, u32, Vec<Phase>) {
    let table = Table::new();
    let mut executor: Executor = table.with_list(DIGIT_SETS.iter().map(|digits| target(&table, digits)).collect());
    let planned: Vec<_> = executor.targets().iter().map(|target| target.grasp.clone()).collect();
    let object = table.objects[1].clone();
    let knowledge = Knowledge {
        objects: vec![object; 3],
        known_objects: vec![&table.known; 3],
        second_candidates: Vec::new(),
        ..table.knowledge()
    };
    let senses = TouchPerception::new(&table.pipeline, Sensing::TruePose).expect("made");
    let mut policy = SequentialPolicy::new(knowledge, senses, &planned.iter().collect::<Vec<_>>());
    let (mut detector, mut phases) = (FixedDetector(&table), Vec::new());
    for _ in 0..6 {
        let phase = executor.phase();
        phases.push(phase);
        let [first, second] = felt(phase);
        policy.perceive(&executor, in_hand(first, second)).expect("perceived");
        if policy.decide(&mut executor, &mut detector, time).expect("decided") != PolicyStep::Continue {
            break;
        }
        run_on(&mut executor);
    }
    let attempts = policy.trace().attempts.iter().map(|attempt| attempt.object).collect();
    (attempts, policy.trace().retries, phases)
}

/// Phase of the snapshot after an object has been taken.
fn after(object: usize) -> Phase {
    Phase::decide(Skill::Snapshot, object)
}

#[test]
fn what_is_not_felt_is_taken_again() {
    let (attempts, retries, _) = run_policy(0.0, |_| [true, false]);
    assert_eq!((&attempts[..3], retries > 1), (&[0, 1, 1][..], true));
}

#[test]
fn what_was_lost_earlier_begins_the_list_anew() {
    let (attempts, _, phases) = run_policy(0.0, |phase| [phase != after(1), true]);
    assert_eq!((&attempts[..], phases[3]), (&[0, 1, 0, 1][..], Phase::decide(Skill::PutDown, 0)));
}

/// If no try can end in time any more, the list is completed whatever is felt.
#[test]
fn late_nothing_is_taken_again() {
    let (attempts, retries, phases) = run_policy(TIME_LIMIT, |_| [false, false]);
    assert_eq!((attempts, retries), (vec![0, 1, 2], 0));
    assert!(phases.last().is_some_and(|phase| phase.is_done()));
}
