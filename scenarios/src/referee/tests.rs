use super::*;

const RULES: RefereeRules = RefereeRules { palm_distance: 0.15, slip: 0.05, knock_distance: 0.01 };
const LIMITS: Limits = Limits { hold: 3.0, trial: 120.0 };
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
        palm_touches_second: false,
        free_digits_on_second: 2 * usize::from(phase >= Phase::GraspSecond),
        on_second: Vec::new(),
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
    let mut referee = Referee::new(RULES, LIMITS);
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
fn a_perfect_trial_succeeds_without_contact() {
    assert_eq!(run(|_| ()), Verdict { contact: false, first_contact: None, success: true, cause: None });
}

#[test]
fn touch_by_the_held_object_is_a_contact_until_the_grasp_has_closed() {
    for phase in Phase::ALL {
        let verdict = run(|truth| truth.first_touches_second = truth.phase == phase);
        assert_eq!(verdict.contact, (Phase::LiftFirst..=Phase::GraspSecond).contains(&phase), "{phase}");
        assert!(verdict.success);
    }
    let verdict = run(|truth| truth.first_touches_second = truth.phase >= Phase::ApproachSecond);
    assert_eq!(verdict.first_contact.map(|contact| contact.with), Some(ContactWith::HeldObject));
    let before = Phase::ALL.iter().filter(|phase| **phase < Phase::ApproachSecond).count();
    assert!((verdict.first_contact.unwrap().time - PHASE_TIME * before as f64).abs() < 1e-6);
}

#[test]
fn touch_by_a_holding_digit_is_a_contact_by_a_free_one_not() {
    let holding = run(|truth| truth.holding_digits_touch_second = truth.phase == Phase::GraspSecond);
    assert_eq!(holding.first_contact.map(|contact| contact.with), Some(ContactWith::HoldingDigits));
    assert!(!run(|truth| truth.free_digits_on_second = usize::from(truth.phase >= Phase::ApproachSecond)).contact);
}

/// The palm may not push the object, but two digits may draw it against the palm.
#[test]
fn the_palm_counts_until_two_digits_have_the_object() {
    let pushed = run(|truth| truth.palm_touches_second = truth.phase == Phase::ApproachSecond);
    assert_eq!(pushed.first_contact.map(|contact| contact.with), Some(ContactWith::Palm));
    assert!(!run(|truth| truth.palm_touches_second = truth.phase == Phase::GraspSecond).contact);
    let one_digit = run(|truth| {
        truth.palm_touches_second = truth.phase == Phase::GraspSecond;
        truth.free_digits_on_second = 1;
    });
    assert!(one_digit.contact);
}

/// What lies on the table beside the second object, or hangs in the hand with it, may touch it.
#[test]
fn loose_objects_and_objects_in_the_hand_may_touch_each_other() {
    let touching = |truth: &mut SceneTruth| truth.first_touches_second = truth.phase == Phase::ApproachSecond;
    assert!(run(touching).contact);
    let dropped = |truth: &mut SceneTruth| {
        touching(truth);
        truth.on_table[0] = true;
    };
    assert!(!run(dropped).contact);
    let both_held = |truth: &mut SceneTruth| {
        touching(truth);
        (truth.on_table[1], truth.hand_contacts[1]) = (false, 3);
    };
    assert!(!run(both_held).contact);
}

/// A hold that ends after the time limit is no success.
#[test]
fn the_time_limit_is_judged() {
    let late = |limit: f64| {
        let mut referee = Referee::new(RULES, Limits { trial: limit, ..LIMITS });
        let mut time = 0.0;
        for phase in Phase::ALL {
            for _ in 0..(PHASE_TIME / TICK).round() as usize {
                referee.see(&perfect(phase, time));
                time += TICK;
            }
        }
        referee.verdict().cause
    };
    assert_eq!((late(86.0), late(96.0)), (Some(FailureCause::TooLate), None));
}

/// Two approaches are two tries, each with its own contact, and the greatest force counts.
#[test]
fn tries_are_told_apart() {
    let mut referee = Referee::new(RULES, LIMITS);
    let mut time = 0.0;
    let again = [Phase::ApproachSecond, Phase::GraspSecond, Phase::LiftSecond];
    for (n, phase) in Phase::ALL.into_iter().filter(|phase| *phase <= Phase::Confirm).chain(again).enumerate() {
        for step in 0..240 {
            let mut truth = perfect(phase, time);
            if n > 20 && phase == Phase::ApproachSecond {
                truth.holding_digits_touch_second = true;
                let force = f64::from(step);
                truth.on_second = vec![Touch { by: Toucher::Link(13), holding: true, point: Point3::origin(), force }];
            }
            referee.see(&truth);
            time += TICK;
        }
    }
    let tries = referee.tries();
    assert_eq!(
        tries.iter().map(|one| (one.object, one.picked)).collect::<Vec<_>>(),
        [0, 1, 1].map(|n| (n, Some(true)))
    );
    assert!(tries[0].contact.is_none() && tries[1].contact.is_none() && tries[0].ended < tries[1].begun);
    let contact = tries[2].contact.unwrap();
    assert_eq!((contact.by, contact.force, contact.phase), (Some(Toucher::Link(13)), 239.0, Phase::ApproachSecond));
}

#[test]
fn a_blow_too_short_to_be_seen_is_a_contact() {
    let push = |truth: &mut SceneTruth, by: f64| {
        if (Phase::ApproachSecond..=Phase::GraspSecond).contains(&truth.phase) {
            truth.world_from_object[1].translation.x += by;
        }
    };
    assert_eq!(run(|truth| push(truth, 0.02)).first_contact.map(|contact| contact.with), Some(ContactWith::Knocked));
    assert!(!run(|truth| push(truth, 0.005)).contact);
    let by_free_digit = run(|truth| {
        push(truth, 0.02);
        truth.free_digits_on_second = usize::from(truth.phase >= Phase::ApproachSecond);
    });
    assert!(!by_free_digit.contact);
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
    let mut referee = Referee::new(RULES, LIMITS);
    assert_eq!(referee.verdict().cause, Some(FailureCause::NotFinished));
    let mut time = 0.0;
    for phase in Phase::ALL {
        for _ in 0..240 {
            referee.see(&perfect(phase, time));
            time += TICK;
        }
    }
    assert_eq!(referee.verdict().cause, Some(FailureCause::NotFinished));
    let mut early = Referee::new(RULES, LIMITS);
    early.see(&perfect(Phase::ApproachFirst, 0.0));
    early.give_up(FailureCause::Unreachable);
    early.give_up(FailureCause::RobotFault);
    assert_eq!(early.verdict().cause, Some(FailureCause::Unreachable));
}

#[test]
fn a_trial_that_carries_again_is_judged_by_its_last_carry() {
    let mut referee = Referee::new(RULES, LIMITS);
    let mut time = 0.0;
    // Without the exploratory motions, to end in time.
    let explores = |phase: &Phase| {
        (Phase::Begin..=Phase::LocateFirst).contains(phase)
            || (Phase::ReachSecond..=Phase::LocateSecond).contains(phase)
    };
    let phases = || Phase::ALL.into_iter().filter(|phase| !explores(phase));
    let first = phases().filter(|phase| *phase <= Phase::Carry).map(|phase| (phase, true));
    for (phase, slips) in first.chain(phases().map(|phase| (phase, false))) {
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
