use super::*;

const RULES: RefereeRules = RefereeRules { palm_distance: 0.15, slip: 0.05, knock_distance: 0.01 };
const LIMITS: Limits = Limits { hold: 3.0, trial: 120.0 };
const TICK: f64 = 1.0 / 240.0;

/// The scene of a perfect trial in `phase`.
fn perfect(phase: Phase, time: f64) -> SceneTruth {
    let [first_up, second_up] = [0, 1].map(|object| phase.lifts(object));
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
        free_digits_on_second: 2 * usize::from(phase.closes(1)),
        on_second: Vec::new(),
        hand_contacts: [0, 1].map(|object| usize::from(phase.closes(object)) * 3),
        on_table: [!first_up, !second_up],
        world_from_object: [in_palm(first_up, 0.04), in_palm(second_up, -0.06)],
        world_from_palm: palm,
    }
}

/// The phases of a trial in which something has to be laid down and looked for at the beginning.
fn phases() -> Vec<Phase> {
    let aside = [Skill::PutDown, Skill::StepAside].map(|skill| Phase::run(skill, 0));
    aside.into_iter().chain(Phase::of_trial(2)).collect()
}

/// How long each phase takes, s.
const PHASE_TIME: f64 = 4.0;

/// Runs a whole trial with the scene altered by `change`.
fn run(change: impl Fn(&mut SceneTruth)) -> Verdict {
    let mut referee = Referee::new(RULES, LIMITS);
    let mut time = 0.0;
    for phase in phases() {
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

/// True from the approach to the second object on.
fn approached(truth: &SceneTruth) -> bool {
    truth.phase.begins(1) && truth.phase.skill != Skill::Palpate
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
    for phase in phases() {
        let verdict = run(|truth| truth.first_touches_second = truth.phase == phase);
        assert_eq!(verdict.contact, phase.lifts(0) && !phase.lifts(1), "{phase}");
        assert!(verdict.success);
    }
    let verdict = run(|truth| truth.first_touches_second = approached(truth));
    assert_eq!(verdict.first_contact.map(|contact| contact.with), Some(ContactWith::HeldObject));
    let before = phases().iter().position(|phase| *phase == Phase::run(Skill::Approach, 1)).expect("an approach");
    assert!((verdict.first_contact.unwrap().time - PHASE_TIME * before as f64).abs() < 1e-6);
}

#[test]
fn touch_by_a_holding_digit_is_a_contact_by_a_free_one_not() {
    let holding = run(|truth| truth.holding_digits_touch_second = truth.phase == Phase::run(Skill::Grasp, 1));
    assert_eq!(holding.first_contact.map(|contact| contact.with), Some(ContactWith::HoldingDigits));
    assert!(!run(|truth| truth.free_digits_on_second = usize::from(approached(truth))).contact);
}

/// The palm may not push the object, but two digits may draw it against the palm.
#[test]
fn the_palm_counts_until_two_digits_have_the_object() {
    let pushed = run(|truth| truth.palm_touches_second = truth.phase == Phase::run(Skill::Approach, 1));
    assert_eq!(pushed.first_contact.map(|contact| contact.with), Some(ContactWith::Palm));
    assert!(!run(|truth| truth.palm_touches_second = truth.phase == Phase::run(Skill::Grasp, 1)).contact);
    let one_digit = run(|truth| {
        truth.palm_touches_second = truth.phase == Phase::run(Skill::Grasp, 1);
        truth.free_digits_on_second = 1;
    });
    assert!(one_digit.contact);
}

/// What lies on the table beside the second object, or hangs in the hand with it, may touch it.
#[test]
fn loose_objects_and_objects_in_the_hand_may_touch_each_other() {
    let touching = |truth: &mut SceneTruth| truth.first_touches_second = truth.phase == Phase::run(Skill::Approach, 1);
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
        for phase in phases() {
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
    let again = [Phase::run(Skill::Approach, 1), Phase::run(Skill::Grasp, 1), Phase::run(Skill::Lift, 1)];
    for (n, phase) in phases().into_iter().filter(|phase| !phase.carries()).chain(again).enumerate() {
        for step in 0..240 {
            let mut truth = perfect(phase, time);
            if n > 20 && phase == Phase::run(Skill::Approach, 1) {
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
    assert_eq!(
        (contact.by, contact.force, contact.phase),
        (Some(Toucher::Link(13)), 239.0, Phase::run(Skill::Approach, 1))
    );
}

#[test]
fn a_blow_too_short_to_be_seen_is_a_contact() {
    let push = |truth: &mut SceneTruth, by: f64| {
        if approached(truth) && !truth.phase.lifts(1) {
            truth.world_from_object[1].translation.x += by;
        }
    };
    assert_eq!(run(|truth| push(truth, 0.02)).first_contact.map(|contact| contact.with), Some(ContactWith::Knocked));
    assert!(!run(|truth| push(truth, 0.005)).contact);
    let by_free_digit = run(|truth| {
        push(truth, 0.02);
        truth.free_digits_on_second = usize::from(approached(truth));
    });
    assert!(!by_free_digit.contact);
}

/// True from the hold on.
fn holds(phase: Phase) -> bool {
    phase.carries() && phase.skill != Skill::Carry
}

#[test]
fn failures_are_told_apart() {
    let drop = |object: usize, from: fn(Phase) -> bool| {
        cause(move |truth| {
            if from(truth.phase) {
                fall(truth, object);
            }
        })
    };
    assert_eq!(drop(0, |phase| phase.closes(0)), Some(FailureCause::FirstNotPicked));
    assert_eq!(drop(0, Phase::carries), Some(FailureCause::FirstDropped));
    assert_eq!(drop(1, |phase| phase.closes(1)), Some(FailureCause::SecondNotPicked));
    assert_eq!(drop(1, holds), Some(FailureCause::SecondDropped));
    let both = cause(|truth| {
        if truth.phase.carries() {
            fall(truth, 0);
            fall(truth, 1);
        }
    });
    assert_eq!(both, Some(FailureCause::BothDropped));
}

#[test]
fn an_object_lost_while_it_is_lifted_was_not_picked() {
    let before = phases().iter().position(|phase| phase.lifts(1)).expect("a lift");
    let middle = PHASE_TIME * (before as f64 + 0.5);
    let late = cause(|truth| {
        if truth.phase.has_lifted(1) || (truth.phase.lifts(1) && truth.time > middle) {
            fall(truth, 1);
        }
    });
    assert_eq!(late, Some(FailureCause::SecondNotPicked));
}

#[test]
fn each_part_of_in_the_hand_counts() {
    let end = |change: fn(&mut SceneTruth)| {
        cause(move |truth| {
            if holds(truth.phase) {
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
    for phase in phases() {
        for _ in 0..240 {
            referee.see(&perfect(phase, time));
            time += TICK;
        }
    }
    assert_eq!(referee.verdict().cause, Some(FailureCause::NotFinished));
    let mut early = Referee::new(RULES, LIMITS);
    early.see(&perfect(Phase::run(Skill::Approach, 0), 0.0));
    early.give_up(FailureCause::Unreachable);
    early.give_up(FailureCause::RobotFault);
    assert_eq!(early.verdict().cause, Some(FailureCause::Unreachable));
}

#[test]
fn a_trial_that_carries_again_is_judged_by_its_last_carry() {
    let mut referee = Referee::new(RULES, LIMITS);
    let mut time = 0.0;
    // Without the exploratory motions, to end in time.
    let explores = |phase: &Phase| matches!(phase.skill, Skill::Begin | Skill::Palpate);
    let phases = || phases().into_iter().filter(|phase| !explores(phase));
    let first = phases().filter(|phase| !holds(*phase)).map(|phase| (phase, true));
    for (phase, slips) in first.chain(phases().map(|phase| (phase, false))) {
        for step in 0..960 {
            let mut truth = perfect(phase, time);
            if slips && phase == Phase::run(Skill::Carry, 0) && step > 480 {
                truth.world_from_object[1].translation.y -= 0.06;
            }
            referee.see(&truth);
            time += TICK;
        }
        if slips && phase == Phase::run(Skill::Carry, 0) {
            assert!(!referee.verdict().success);
        }
    }
    assert_eq!(referee.verdict().cause, None);
}
