use super::*;

const RULES: RefereeRules = RefereeRules { palm_distance: 0.15, slip: 0.05, knock_distance: 0.01 };
const TICK: f64 = 1.0 / 240.0;

/// The scene of a perfect trial in `phase`.
fn perfect(phase: Phase, time: f64) -> SceneTruth {
    let first_up = phase >= Phase::LiftFirst;
    let second_up = phase >= Phase::LiftSecond;
    let palm = Isometry3::translation(0.5, 0.0, if first_up { 0.3 } else { 0.1 });
    let in_palm = |up: bool, y: f64| {
        if up { palm * Isometry3::translation(0.0, y, -0.05) } else { Isometry3::translation(0.5, y, 0.02) }
    };
    SceneTruth {
        time,
        phase,
        first_touches_second: false,
        holding_digits_touch_second: false,
        free_digits_touch_second: phase >= Phase::GraspSecond,
        hand_contacts: [usize::from(phase >= Phase::GraspFirst) * 3, usize::from(phase >= Phase::GraspSecond) * 3],
        on_table: [!first_up, !second_up],
        world_from_object: [in_palm(first_up, 0.04), in_palm(second_up, -0.06)],
        world_from_palm: palm,
    }
}

/// How long each phase takes, s.
const PHASE_TIME: f64 = 4.0;

/// Runs a whole trial with the scene altered by `change`.
fn run(change: impl Fn(&mut SceneTruth)) -> Verdict {
    let mut referee = Referee::new(RULES, 3.0);
    let mut time = 0.0;
    for phase in Phase::ALL {
        for _ in 0..(PHASE_TIME / TICK).round() as usize {
            let mut truth = perfect(phase, time);
            change(&mut truth);
            referee.see(&truth);
            time += TICK;
        }
    }
    referee.verdict()
}

fn cause(change: impl Fn(&mut SceneTruth)) -> Option<FailureCause> {
    let verdict = run(change);
    assert_eq!(verdict.success, verdict.cause.is_none());
    verdict.cause
}

fn fall(truth: &mut SceneTruth, object: usize) {
    truth.hand_contacts[object] = 0;
    truth.on_table[object] = true;
    truth.world_from_object[object] = Isometry3::translation(0.5, 0.1, 0.02);
}

#[test]
fn a_perfect_trial_succeeds_without_collision() {
    let verdict = run(|_| ());
    assert_eq!(
        verdict,
        Verdict { collision: false, collision_time: None, collision_with: None, success: true, cause: None }
    );
}

#[test]
fn touch_by_the_held_object_is_a_collision_until_the_grasp_has_closed() {
    for phase in Phase::ALL {
        let verdict = run(|truth| truth.first_touches_second = truth.phase == phase);
        assert_eq!(verdict.collision, phase <= Phase::GraspSecond, "{phase}");
        assert!(verdict.success);
    }
    let verdict = run(|truth| truth.first_touches_second = truth.phase >= Phase::ApproachSecond);
    assert_eq!(verdict.collision_with, Some(CollisionWith::HeldObject));
    let before = Phase::ALL.iter().filter(|phase| **phase < Phase::ApproachSecond).count();
    assert!((verdict.collision_time.unwrap() - PHASE_TIME * before as f64).abs() < 1e-6);
}

#[test]
fn touch_by_a_holding_digit_is_a_collision_by_a_free_one_not() {
    let holding = run(|truth| truth.holding_digits_touch_second = truth.phase == Phase::GraspSecond);
    assert_eq!(holding.collision_with, Some(CollisionWith::HoldingDigits));
    assert!(!run(|truth| truth.free_digits_touch_second = truth.phase >= Phase::ApproachSecond).collision);
}

#[test]
fn a_blow_too_short_to_be_seen_is_a_collision() {
    let push = |truth: &mut SceneTruth, by: f64| {
        if (Phase::ApproachSecond..=Phase::GraspSecond).contains(&truth.phase) {
            truth.world_from_object[1].translation.x += by;
        }
    };
    assert_eq!(run(|truth| push(truth, 0.02)).collision_with, Some(CollisionWith::Knocked));
    assert!(!run(|truth| push(truth, 0.005)).collision);
    let by_free_digit = run(|truth| {
        push(truth, 0.02);
        truth.free_digits_touch_second = truth.phase >= Phase::ApproachSecond;
    });
    assert!(!by_free_digit.collision);
}

#[test]
fn failures_are_told_apart() {
    let drop = |object: usize, from: Phase| {
        cause(move |truth| {
            if truth.phase >= from {
                fall(truth, object);
            }
        })
    };
    assert_eq!(drop(0, Phase::GraspFirst), Some(FailureCause::FirstNotPicked));
    assert_eq!(drop(0, Phase::Carry), Some(FailureCause::FirstDropped));
    assert_eq!(drop(1, Phase::GraspSecond), Some(FailureCause::SecondNotPicked));
    assert_eq!(drop(1, Phase::Hold), Some(FailureCause::SecondDropped));
    let both = cause(|truth| {
        if truth.phase >= Phase::Carry {
            fall(truth, 0);
            fall(truth, 1);
        }
    });
    assert_eq!(both, Some(FailureCause::BothDropped));
}

#[test]
fn an_object_lost_while_it_is_lifted_was_not_picked() {
    let before = Phase::ALL.iter().filter(|phase| **phase < Phase::LiftSecond).count();
    let middle = PHASE_TIME * (before as f64 + 0.5);
    let late = cause(|truth| {
        if truth.phase > Phase::LiftSecond || (truth.phase == Phase::LiftSecond && truth.time > middle) {
            fall(truth, 1);
        }
    });
    assert_eq!(late, Some(FailureCause::SecondNotPicked));
}

#[test]
fn each_part_of_in_the_hand_counts() {
    let end = |change: fn(&mut SceneTruth)| {
        cause(move |truth| {
            if truth.phase >= Phase::Hold {
                change(truth)
            }
        })
    };
    assert_eq!(end(|truth| truth.hand_contacts[0] = 0), Some(FailureCause::FirstDropped));
    assert_eq!(end(|truth| truth.on_table[1] = true), Some(FailureCause::SecondDropped));
    assert_eq!(end(|truth| truth.world_from_object[1].translation.y -= 0.2), Some(FailureCause::SecondDropped));
    assert_eq!(end(|truth| truth.world_from_object[1].translation.y -= 0.06), Some(FailureCause::Slipped));
    assert_eq!(end(|truth| truth.world_from_object[1].translation.y -= 0.03), None);
}

#[test]
fn the_hold_must_be_whole_and_giving_up_has_its_cause() {
    let mut referee = Referee::new(RULES, 3.0);
    assert_eq!(referee.verdict().cause, Some(FailureCause::NotFinished));
    let mut time = 0.0;
    for phase in Phase::ALL {
        for _ in 0..240 {
            referee.see(&perfect(phase, time));
            time += TICK;
        }
    }
    assert_eq!(referee.verdict().cause, Some(FailureCause::NotFinished));
    let mut early = Referee::new(RULES, 3.0);
    early.see(&perfect(Phase::ApproachFirst, 0.0));
    early.give_up(FailureCause::Unreachable);
    early.give_up(FailureCause::RobotFault);
    assert_eq!(early.verdict().cause, Some(FailureCause::Unreachable));
}

#[test]
fn a_trial_that_carries_again_is_judged_by_its_last_carry() {
    let mut referee = Referee::new(RULES, 3.0);
    let mut time = 0.0;
    let first = Phase::ALL.into_iter().filter(|phase| *phase <= Phase::Carry).map(|phase| (phase, true));
    for (phase, slips) in first.chain(Phase::ALL.map(|phase| (phase, false))) {
        for step in 0..960 {
            let mut truth = perfect(phase, time);
            if slips && phase == Phase::Carry && step > 480 {
                truth.world_from_object[1].translation.y -= 0.06;
            }
            referee.see(&truth);
            time += TICK;
        }
        if slips && phase == Phase::Carry {
            assert!(!referee.verdict().success);
        }
    }
    assert_eq!(referee.verdict().cause, None);
}

#[test]
fn phases_are_in_order_and_have_names() {
    assert!(Phase::ALL.windows(2).all(|pair| pair[0] < pair[1]));
    assert_eq!(Phase::GraspSecond.to_string(), "grasp second");
}
