use super::*;

const RULES: RefereeRules = RefereeRules { palm_distance: 0.15, slip: 0.05, knock_distance: 0.01 };
const LIMITS: RefereeLimits = RefereeLimits { hold: 3.0, trial: 120.0 };
const TICK: f64 = 1.0 / 240.0;

/// Returns the scene of a perfect trial of `objects` objects in `phase`.
fn perfect(objects: usize, phase: Phase, time: f64) -> SceneTruth {
    let palm = Isometry3::translation(0.5, 0.0, if phase.has_begun_lift(0) { 0.3 } else { 0.1 });
    let in_palm = |up: bool, y: f64| {
        if up { palm * Isometry3::translation(0.0, y, -0.05) } else { Isometry3::translation(0.5, y, 0.02) }
    };
    SceneTruth {
        time,
        phase,
        objects: (0..objects)
            .map(|object| {
                let up = phase.has_begun_lift(object);
                ObjectTruth {
                    free_digits: 2 * usize::from(object > 0 && phase.has_begun_grasp(object)),
                    hand_contacts: 3 * usize::from(phase.has_begun_grasp(object)),
                    on_table: !up,
                    ..ObjectTruth::resting_on_table(in_palm(up, [0.04, -0.06, 0.09][object]))
                }
            })
            .collect(),
        world_from_palm: palm,
    }
}

/// Returns the phases of a trial that begins with putting an object down and stepping aside for a detection.
fn phases() -> Vec<Phase> {
    let aside = [Skill::PutDown, Skill::StepAside].map(|skill| Phase::run(skill, 0));
    aside.into_iter().chain(Phase::trial_phases(2)).collect()
}

/// Duration of each phase, s.
const PHASE_TIME: f64 = 4.0;

/// Runs a whole trial with the scene altered by `change`.
fn run(change: impl Fn(&mut SceneTruth)) -> Verdict {
    let mut referee = Referee::new(RULES, LIMITS);
    let mut time = 0.0;
    for phase in phases() {
        for _ in 0..(PHASE_TIME / TICK).round() as usize {
            let mut truth = perfect(2, phase, time);
            change(&mut truth);
            referee.observe(&truth);
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
    truth.phase.has_begun(1) && truth.phase.skill != Skill::Palpate
}

/// Sets whether the first object touches the second.
fn press(truth: &mut SceneTruth, touches: bool) {
    truth.objects[1].touching_objects = (0..usize::from(touches)).collect();
}

fn fall(truth: &mut SceneTruth, object: usize) {
    truth.objects[object].hand_contacts = 0;
    truth.objects[object].on_table = true;
    truth.objects[object].world_from_object = Isometry3::translation(0.5, 0.1, 0.02);
}

#[test]
fn a_perfect_trial_succeeds_without_contact() {
    assert_eq!(run(|_| ()), Verdict { contact: false, first_contact: None, success: true, cause: None });
}

#[test]
fn touch_by_the_held_object_is_a_contact_until_the_grasp_has_closed() {
    for phase in phases() {
        let verdict = run(|truth| press(truth, truth.phase == phase));
        assert_eq!(verdict.contact, phase.has_begun_lift(0) && !phase.has_begun_lift(1), "{phase}");
        assert!(verdict.success);
    }
    let verdict = run(|truth| press(truth, approached(truth)));
    assert_eq!(verdict.first_contact.map(|contact| contact.with), Some(ContactWith::HeldObject));
    let before = phases().iter().position(|phase| *phase == Phase::run(Skill::Approach, 1)).expect("an approach");
    assert!((verdict.first_contact.unwrap().time - PHASE_TIME * before as f64).abs() < 1e-6);
}

#[test]
fn touch_by_a_holding_digit_is_a_contact_by_a_free_one_not() {
    let holding = run(|truth| truth.objects[1].holding_digits_touch = truth.phase == Phase::run(Skill::Grasp, 1));
    assert_eq!(holding.first_contact.map(|contact| contact.with), Some(ContactWith::HoldingDigits));
    assert!(!run(|truth| truth.objects[1].free_digits = usize::from(approached(truth))).contact);
}

/// The palm may not push the object, but two digits may draw it against the palm.
#[test]
fn the_palm_counts_until_two_digits_have_the_object() {
    let pushed = run(|truth| truth.objects[1].palm_touches = truth.phase == Phase::run(Skill::Approach, 1));
    assert_eq!(pushed.first_contact.map(|contact| contact.with), Some(ContactWith::Palm));
    assert!(!run(|truth| truth.objects[1].palm_touches = truth.phase == Phase::run(Skill::Grasp, 1)).contact);
    let one_digit = run(|truth| {
        truth.objects[1].palm_touches = truth.phase == Phase::run(Skill::Grasp, 1);
        truth.objects[1].free_digits = 1;
    });
    assert!(one_digit.contact);
}

/// Objects that lie on the table next to each other, or hang in the hand together, may touch.
#[test]
fn loose_objects_and_objects_in_the_hand_may_touch_each_other() {
    let touching = |truth: &mut SceneTruth| press(truth, truth.phase == Phase::run(Skill::Approach, 1));
    assert!(run(touching).contact);
    let dropped = |truth: &mut SceneTruth| {
        touching(truth);
        truth.objects[0].on_table = true;
    };
    assert!(!run(dropped).contact);
    let both_held = |truth: &mut SceneTruth| {
        touching(truth);
        (truth.objects[1].on_table, truth.objects[1].hand_contacts) = (false, 3);
    };
    assert!(!run(both_held).contact);
}

/// A hold that ends after the time limit is no success.
#[test]
fn the_time_limit_is_judged() {
    let late = |limit: f64| {
        let mut referee = Referee::new(RULES, RefereeLimits { trial: limit, ..LIMITS });
        let mut time = 0.0;
        for phase in phases() {
            for _ in 0..(PHASE_TIME / TICK).round() as usize {
                referee.observe(&perfect(2, phase, time));
                time += TICK;
            }
        }
        referee.verdict().cause
    };
    assert_eq!((late(86.0), late(96.0)), (Some(FailureCause::TooLate), None));
}

/// Two approaches are two tries, each with its own contact and its own greatest force.
#[test]
fn tries_are_told_apart() {
    let mut referee = Referee::new(RULES, LIMITS);
    let mut time = 0.0;
    let again = [Phase::run(Skill::Approach, 1), Phase::run(Skill::Grasp, 1), Phase::run(Skill::Lift, 1)];
    for (n, phase) in phases().into_iter().filter(|phase| !phase.has_begun_carry()).chain(again).enumerate() {
        for step in 0..240 {
            let mut truth = perfect(2, phase, time);
            if n > 20 && phase == Phase::run(Skill::Approach, 1) {
                truth.objects[1].holding_digits_touch = true;
                let force = f64::from(step);
                truth.objects[1].pressed_by =
                    vec![TouchEvent { by: ContactingBody::Link(13), holding: true, point: Point3::origin(), force }];
            }
            referee.observe(&truth);
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
        (Some(ContactingBody::Link(13)), 239.0, Phase::run(Skill::Approach, 1))
    );
}

#[test]
fn a_blow_too_short_to_be_seen_is_a_contact() {
    let push = |truth: &mut SceneTruth, by: f64| {
        if approached(truth) && !truth.phase.has_begun_lift(1) {
            truth.objects[1].world_from_object.translation.x += by;
        }
    };
    assert_eq!(run(|truth| push(truth, 0.02)).first_contact.map(|contact| contact.with), Some(ContactWith::Knocked));
    assert!(!run(|truth| push(truth, 0.005)).contact);
    let by_free_digit = run(|truth| {
        push(truth, 0.02);
        truth.objects[1].free_digits = usize::from(approached(truth));
    });
    assert!(!by_free_digit.contact);
}

/// True from the hold on.
fn holds(phase: Phase) -> bool {
    phase.has_begun_carry() && phase.skill != Skill::Carry
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
    assert_eq!(drop(0, |phase| phase.has_begun_grasp(0)), Some(FailureCause::FirstNotPicked));
    assert_eq!(drop(0, Phase::has_begun_carry), Some(FailureCause::FirstDropped));
    assert_eq!(drop(1, |phase| phase.has_begun_grasp(1)), Some(FailureCause::SecondNotPicked));
    assert_eq!(drop(1, holds), Some(FailureCause::SecondDropped));
    let both = cause(|truth| {
        if truth.phase.has_begun_carry() {
            fall(truth, 0);
            fall(truth, 1);
        }
    });
    assert_eq!(both, Some(FailureCause::BothDropped));
}

#[test]
fn an_object_lost_while_it_is_lifted_was_not_picked() {
    let before = phases().iter().position(|phase| phase.has_begun_lift(1)).expect("a lift");
    let middle = PHASE_TIME * (before as f64 + 0.5);
    let late = cause(|truth| {
        if truth.phase.has_lifted(1) || (truth.phase.has_begun_lift(1) && truth.time > middle) {
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
    assert_eq!(end(|truth| truth.objects[0].hand_contacts = 0), Some(FailureCause::FirstDropped));
    assert_eq!(end(|truth| truth.objects[1].on_table = true), Some(FailureCause::SecondDropped));
    assert_eq!(end(|truth| truth.objects[1].world_from_object.translation.y -= 0.2), Some(FailureCause::SecondDropped));
    assert_eq!(end(|truth| truth.objects[1].world_from_object.translation.y -= 0.06), Some(FailureCause::Slipped));
    assert_eq!(end(|truth| truth.objects[1].world_from_object.translation.y -= 0.03), None);
}

#[test]
fn the_hold_must_be_whole_and_giving_up_has_its_cause() {
    let mut referee = Referee::new(RULES, LIMITS);
    assert_eq!(referee.verdict().cause, Some(FailureCause::NotFinished));
    let mut time = 0.0;
    for phase in phases() {
        for _ in 0..240 {
            referee.observe(&perfect(2, phase, time));
            time += TICK;
        }
    }
    assert_eq!(referee.verdict().cause, Some(FailureCause::NotFinished));
    let mut early = Referee::new(RULES, LIMITS);
    early.observe(&perfect(2, Phase::run(Skill::Approach, 0), 0.0));
    early.give_up(FailureCause::Unreachable);
    early.give_up(FailureCause::RobotFault);
    assert_eq!(early.verdict().cause, Some(FailureCause::Unreachable));
}

#[test]
fn a_trial_that_carries_again_is_judged_by_its_last_carry() {
    let mut referee = Referee::new(RULES, LIMITS);
    let mut time = 0.0;
    // The exploratory motions are left out to finish in time.
    let explores = |phase: &Phase| matches!(phase.skill, Skill::Begin | Skill::Palpate);
    let phases = || phases().into_iter().filter(|phase| !explores(phase));
    let first = phases().filter(|phase| !holds(*phase)).map(|phase| (phase, true));
    for (phase, slips) in first.chain(phases().map(|phase| (phase, false))) {
        for step in 0..960 {
            let mut truth = perfect(2, phase, time);
            if slips && phase == Phase::run(Skill::Carry, 0) && step > 480 {
                truth.objects[1].world_from_object.translation.y -= 0.06;
            }
            referee.observe(&truth);
            time += TICK;
        }
        if slips && phase == Phase::run(Skill::Carry, 0) {
            assert!(!referee.verdict().success);
        }
    }
    assert_eq!(referee.verdict().cause, None);
}

/// Runs a trial of `objects` objects, all phases in turn, with the scene altered by `change`.
fn run_list(objects: usize, change: impl Fn(&mut SceneTruth)) -> (Verdict, usize) {
    let mut referee = Referee::new(RULES, LIMITS);
    let mut time = 0.0;
    for phase in Phase::trial_phases(objects) {
        for _ in 0..(3.1 / TICK).round() as usize {
            let mut truth = perfect(objects, phase, time);
            change(&mut truth);
            referee.observe(&truth);
            time += TICK;
        }
    }
    (referee.verdict(), referee.tries().len())
}

/// In trials of one and of three objects, each object is judged: it must be picked up and stay in the hand.
#[test]
fn a_list_of_one_or_three_is_judged_object_by_object() {
    for objects in [1, 3] {
        let (verdict, tries) = run_list(objects, |_| ());
        assert!(verdict.success && !verdict.contact && tries == objects, "{objects}: {verdict:?}");
        for (object, causes) in CAUSES_BY_OBJECT.iter().enumerate().take(objects) {
            let dropped = run_list(objects, |truth| {
                if truth.phase.has_begun_carry() {
                    fall(truth, object);
                }
            });
            let never = run_list(objects, |truth| {
                if truth.phase.has_begun_grasp(object) {
                    fall(truth, object);
                }
            });
            assert_eq!([dropped.0.cause, never.0.cause], causes.map(Some));
        }
    }
    let (lost, _) = run_list(3, |truth| {
        if truth.phase.has_begun_carry() {
            fall(truth, 0);
            fall(truth, 2);
        }
    });
    assert_eq!(lost.cause, Some(FailureCause::SeveralDropped));
}

/// A touch between any held object and the third before its grasp is an unwanted contact, and so is a touch by a digit
/// that holds one.
#[test]
fn each_held_object_must_keep_off_the_next() {
    for held in 0..2 {
        let (verdict, _) = run_list(3, |truth| {
            if truth.phase == Phase::run(Skill::Approach, 2) {
                truth.objects[2].touching_objects = vec![held];
            }
        });
        assert_eq!(verdict.first_contact.map(|contact| contact.with), Some(ContactWith::HeldObject), "{held}");
    }
    let (digit, _) =
        run_list(3, |truth| truth.objects[2].holding_digits_touch = truth.phase == Phase::run(Skill::Approach, 2));
    assert_eq!(digit.first_contact.map(|contact| contact.with), Some(ContactWith::HoldingDigits));
    // The second object lies on the table until its turn and may touch the third there.
    let (lying, _) = run_list(3, |truth| {
        if !truth.phase.has_begun_lift(1) {
            truth.objects[2].touching_objects = vec![1];
        }
    });
    assert!(!lying.contact);
}
