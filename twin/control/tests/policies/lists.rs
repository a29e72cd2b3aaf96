//! One, two and three objects are lists for the same executor.

use control::executor::{Executor, GraspTarget, Phase, Skill};
use hand_model::{Digit, DigitVector};

use crate::table::*;

pub const DIGIT_SETS: [&[Digit]; 3] = [&[Digit::Little], &[Digit::Ring], &[Digit::Thumb, Digit::Index, Digit::Middle]];

/// Target of a grasp with `digits`, which pull with 10 N, and with 2 N before they close.
pub fn target(table: &Table, digits: &[Digit]) -> GraspTarget {
    let mut grasp = grasp(0, SECOND, PINCH, [0.02, 0.09, -0.05], 1.0);
    grasp.digits = digits.to_vec();
    (grasp.pre_tension, grasp.close_tension) = (pull(digits, 2.0), pull(digits, 10.0));
    GraspTarget { grasp, detected: table.percept(1) }
}

fn pull(digits: &[Digit], tension: f64) -> DigitVector {
    Digit::ALL.map(|digit| if digits.contains(&digit) { tension } else { 0.0 }).into()
}

/// A list of any length is worked off object by object, and digits keep their hold while others close.
#[test]
fn a_list_of_any_length_is_carried_out() {
    let table = Table::new();
    for count in 1..=DIGIT_SETS.len() {
        let mut executor = table.with_list(DIGIT_SETS[..count].iter().map(|digits| target(&table, digits)).collect());
        let mut phases = vec![executor.phase()];
        while !executor.phase().is_done() {
            executor.continue_as_planned().expect("a path");
            let phase = executor.phase();
            let wanted = executor.required_tensions();
            let kept: Vec<Digit> = DIGIT_SETS[..count]
                .iter()
                .enumerate()
                .filter(|(n, _)| phase.has_begun_lift(*n))
                .flat_map(|(_, set)| set.iter().copied())
                .collect();
            assert_eq!(
                executor.holding_digits(),
                Digit::ALL.into_iter().filter(|digit| kept.contains(digit)).collect::<Vec<_>>(),
                "{phase}"
            );
            if phase.skill == Skill::Approach {
                let before = pull(DIGIT_SETS[phase.object], 2.0);
                let expected: DigitVector = (0..5).map(|n| pull(&kept, 10.0)[n].max(before[n])).collect();
                assert_eq!(wanted, expected, "{phase}");
            }
            if phases.last() != Some(&phase) {
                phases.push(phase);
            }
            step(&mut executor);
            if phases.last() != Some(&executor.phase()) {
                phases.push(executor.phase());
            }
        }
        let expected = Phase::trial_phases(count).into_iter().filter(|phase| phase.skill != Skill::Palpate);
        assert_eq!(phases, expected.collect::<Vec<_>>());
    }
}

/// Delivered objects are released over the goal, and the list begins anew. Digits that hold nothing open on command.
#[test]
fn a_delivery_empties_the_hand() {
    let table = Table::new();
    let mut executor = table.with_list(Vec::new());
    for digits in &DIGIT_SETS[..2] {
        let object = executor.targets().len();
        executor.take(object, target(&table, digits)).expect("a path");
        run_on(&mut executor);
    }
    assert_eq!(executor.holding_digits(), [Digit::Ring, Digit::Little]);
    executor.keep_only(&[Digit::Ring]);
    assert_eq!(
        (executor.holding_digits(), executor.required_tensions()),
        (vec![Digit::Ring], pull(&[Digit::Ring], 10.0))
    );
    executor.deliver([0.6, 0.05]).expect("a path");
    run_until(&mut executor, Phase::run(Skill::Hold, 0));
    let over = executor.motion().palm().translation.vector;
    assert!((over.xy() - nalgebra::Vector2::new(0.6, 0.05)).norm() < 1e-9, "{over}");
    assert_eq!(executor.holding_digits(), [Digit::Ring]);
    run_on(&mut executor);
    assert_eq!(executor.phase(), Phase::decide(Skill::PutDown, 0));
    assert!(executor.holding_digits().is_empty());
    executor.take(0, target(&table, DIGIT_SETS[2])).expect("a path");
    run_on(&mut executor);
    assert_eq!(executor.holding_digits(), DIGIT_SETS[2]);
}

fn step(executor: &mut Executor) {
    executor.tick(&still()).expect("a command");
}
