//! Behaviour of the policy `touch` as objects are held, lost, detected and hidden.

use control::detection::DetectedObject;
use control::executor::{Executor, Phase, Skill};
use control::policy::touch::TouchPolicy;
use control::policy::{InjectedHold, Knowledge, PolicyStep, TrialPolicy};
use control::sensing::TouchPerception;
use nalgebra::Isometry3;
use world::Sensing;

use crate::table::*;

/// With the first object felt in the hand, the second is detected again and approached. With both, they are carried,
/// and the trial ends.
#[test]
fn touch_goes_on_while_everything_is_in_the_hand() {
    let table = Table::new();
    let mut executor = table.executor();
    let mut detector = CountingDetector::new(&table);
    let mut touch = table.touch();
    for (phase, grip, then) in [
        (DECIDE, in_hand(true, false), PolicyStep::Continue),
        (CONFIRM, in_hand(true, true), PolicyStep::Continue),
        (DONE, in_hand(true, true), PolicyStep::Finish),
    ] {
        run_until(&mut executor, phase);
        touch.perceive(&executor, grip).expect("perceived");
        assert_eq!(touch.decide(&mut executor, &mut detector, 0.0).expect("decided"), then);
    }
    assert_eq!((detector.detections, touch.trace().retries, touch.trace().decisions), ([0, 1], 0, 1));
    let felt = touch.felt()[0].estimate.palm_from_object;
    assert_eq!(felt, in_hand(true, false).expect("injected").palm_from_object);
}

/// If permitted, it palpates the second object before it takes it. An object that it does not feel is taken at its
/// detected position.
#[test]
fn touch_feels_for_the_second_object_first() {
    let table = Table::new();
    let mut executor = table.executor();
    let mut detector = CountingDetector::new(&table);
    let first = table.repertoire.for_digits(FIRST, SIDE).next().expect("a first grasp");
    let touch_with = |sensing: Sensing| {
        let senses = TouchPerception::new(&table.pipeline, sensing).expect("made");
        TouchPolicy::new(Knowledge { palpates: true, ..table.knowledge() }, senses, first)
    };
    run_until(&mut executor, DECIDE);
    // The held cube is out of the way of the fingers.
    let palm_from_object = Isometry3::translation(-0.03, -0.04, -0.03);
    let behind = in_hand(true, false).map(|injected| InjectedHold { palm_from_object, ..injected });
    for (sensing, then) in [
        (Sensing::ServosOnly, (PolicyStep::Continue, APPROACH_SECOND)),
        (Sensing::TruePose, (PolicyStep::Continue, REACH_SECOND)),
    ] {
        let (mut touch, mut executor) = (touch_with(sensing), executor.clone());
        touch.perceive(&executor, behind).expect("perceived");
        let step = touch.decide(&mut executor, &mut detector, 0.0).expect("decided");
        assert_eq!((step, executor.phase()), then, "{sensing:?}");
        if executor.phase() == REACH_SECOND {
            let seen = executor.target(1).detected;
            run_until(&mut executor, LOCATE_SECOND);
            touch.perceive(&executor, None).expect("perceived");
            let step = touch.decide(&mut executor, &mut detector, 0.0).expect("decided");
            assert_eq!((step, executor.phase()), (PolicyStep::Continue, APPROACH_SECOND));
            assert_eq!(executor.target(1).detected, seen);
            assert!(touch.trace().reasons.iter().any(|reason| reason.contains("nothing was felt")));
        }
    }
}

/// A trial that waits for its start begins with a palpation of the first object, or without images with the planned
/// grasp. The digits that touched keep still until the hand has risen.
#[test]
fn touch_feels_for_the_first_object_too() {
    let table = Table::new();
    let mut detector = CountingDetector::new(&table);
    let first = table.repertoire.for_digits(FIRST, SIDE).next().expect("a first grasp");
    for (sensing, then) in [
        (Sensing::ServosOnly, (PolicyStep::Continue, APPROACH_FIRST)),
        (Sensing::Full, (PolicyStep::Continue, REACH_FIRST)),
    ] {
        let senses = TouchPerception::new(&table.pipeline, sensing).expect("made");
        let mut touch = TouchPolicy::new(Knowledge { palpates: true, ..table.knowledge() }, senses, first);
        let mut executor = table.waiting();
        touch.perceive(&executor, None).expect("perceived");
        let step = touch.decide(&mut executor, &mut detector, 0.0).expect("decided");
        assert_eq!((step, executor.phase()), then, "{sensing:?}");
        assert_eq!(executor.target(0).grasp.id, first.id);
        if executor.phase() == REACH_FIRST {
            run_until(&mut executor, LOCATE_FIRST);
            let (height, still) = (executor.motion().end().translation.z, executor.required_tensions());
            touch.perceive(&executor, None).expect("perceived");
            let step = touch.decide(&mut executor, &mut detector, 0.0).expect("decided");
            assert_eq!((step, executor.phase()), (PolicyStep::Continue, APPROACH_FIRST));
            assert_eq!(executor.required_tensions(), still);
            run_until(&mut executor, GRASP_FIRST);
            assert!(executor.required_tensions() != still && executor.motion().end().translation.z < height + 0.1);
        }
    }
}

/// With an empty hand, it detects both objects again and tries the first one again. A grasp that failed gives way to
/// the other.
#[test]
fn touch_tries_again_what_is_missing() {
    let table = Table::new();
    let mut executor = table.executor();
    let mut detector = CountingDetector::new(&table);
    let mut touch = table.touch();
    run_until(&mut executor, DECIDE);
    touch.perceive(&executor, in_hand(false, false)).expect("perceived");
    assert_eq!(touch.decide(&mut executor, &mut detector, 0.0).expect("decided"), PolicyStep::Continue);
    assert_eq!((executor.phase(), detector.detections), (APPROACH_FIRST, [1, 1]));
    // 1.0 halved by its failure is less than 0.9 x 0.9 of the unplanned grasp.
    assert_eq!((executor.target(0).grasp.id, touch.trace().retries), (1, 1));
    assert!(!touch.trace().is_as_planned() && touch.trace().take_announcements().len() == 1);
}

/// If only the second object is in the hand, it is put down. The first one comes next, without another snapshot of the
/// hand.
#[test]
fn touch_puts_down_the_second_object_when_the_first_is_lost() {
    let table = Table::new();
    let mut executor = table.executor();
    let mut detector = CountingDetector::new(&table);
    let mut touch = table.touch();
    run_until(&mut executor, DECIDE);
    touch.perceive(&executor, in_hand(true, false)).expect("perceived");
    touch.decide(&mut executor, &mut detector, 0.0).expect("decided");
    run_until(&mut executor, CONFIRM);
    touch.perceive(&executor, in_hand(false, true)).expect("perceived");
    assert_eq!(touch.decide(&mut executor, &mut detector, 0.0).expect("decided"), PolicyStep::Continue);
    assert_eq!((executor.phase(), detector.detections), (PUT_DOWN, [1, 1]));
    while executor.phase() == PUT_DOWN {
        executor.tick(&still()).expect("a command");
    }
    touch.perceive(&executor, in_hand(true, true)).expect("perceived");
    assert_eq!(touch.decide(&mut executor, &mut detector, 0.0).expect("decided"), PolicyStep::Continue);
    assert_eq!((executor.phase(), detector.detections), (APPROACH_FIRST, [2, 2]));
}

/// A second object that the pads do not feel is kept if it is detected well above the table, and taken again if it is
/// on the table or hardly above it.
#[test]
fn touch_keeps_what_is_seen_in_the_hand() {
    for (raised, kept) in [(0.0, false), (0.02, false), (0.12, true)] {
        let table = Table::new();
        let mut executor = table.executor();
        let mut detector = CountingDetector { raised: [0.0, raised], ..CountingDetector::new(&table) };
        let mut touch = table.touch();
        run_until(&mut executor, DECIDE);
        touch.perceive(&executor, in_hand(true, false)).expect("perceived");
        touch.decide(&mut executor, &mut CountingDetector::new(&table), 0.0).expect("decided");
        run_until(&mut executor, CONFIRM);
        touch.perceive(&executor, in_hand(true, false)).expect("perceived");
        assert_eq!(touch.decide(&mut executor, &mut detector, 0.0).expect("decided"), PolicyStep::Continue);
        assert_eq!((executor.phase() != APPROACH_SECOND, touch.trace().retries == 0), (kept, kept), "{raised} m");
    }
}

/// Runs the motion aside up to the decision after it.
fn aside(executor: &mut Executor) {
    assert_eq!(executor.phase(), STEP_ASIDE);
    while executor.phase() == STEP_ASIDE {
        executor.tick(&still()).expect("a command");
    }
    assert_eq!(executor.phase(), Phase::decide(Skill::StepAside, 0));
}

/// The hand steps aside so that a required object that is hidden can be detected. A later object is detected when its
/// turn comes.
#[test]
fn touch_steps_aside_to_see_what_it_needs() {
    let table = Table::new();
    let mut executor = table.executor();
    let mut detector = CountingDetector { hidden: [1, 3], ..CountingDetector::new(&table) };
    let mut touch = table.touch();
    run_until(&mut executor, DECIDE);
    touch.perceive(&executor, in_hand(false, false)).expect("perceived");
    let mut decide = |executor: &mut Executor, touch: &mut TouchPolicy, grip: Option<InjectedHold>| {
        touch.perceive(executor, grip).expect("perceived");
        touch.decide(executor, &mut detector, 0.0).expect("decided")
    };
    assert_eq!(decide(&mut executor, &mut touch, in_hand(false, false)), PolicyStep::Continue);
    let last = executor.target(1).detected;
    aside(&mut executor);
    // The previous grip stays valid: nothing is felt on the way aside.
    assert_eq!(decide(&mut executor, &mut touch, None), PolicyStep::Continue);
    assert_eq!((executor.phase(), executor.target(1).detected), (APPROACH_FIRST, last));
    run_until(&mut executor, DECIDE);
    assert_eq!(decide(&mut executor, &mut touch, in_hand(true, false)), PolicyStep::Continue);
    aside(&mut executor);
    assert_eq!(decide(&mut executor, &mut touch, None), PolicyStep::Continue);
    assert_eq!((executor.phase(), touch.trace().retries), (APPROACH_SECOND, 1));
    assert_eq!((detector.detections, detector.hidden), ([2, 4], [0, 0]));
}

/// If an object stays hidden after the hand has stepped aside, the trial is given up, and the reason names it.
#[test]
fn touch_gives_up_what_is_nowhere_to_be_seen() {
    for (phase, grip, missing) in [(DECIDE, in_hand(false, false), FIRST), (CONFIRM, in_hand(true, false), SECOND)] {
        let table = Table::new();
        let mut executor = table.executor();
        let mut detector = CountingDetector { hidden: [9, 9], ..CountingDetector::new(&table) };
        let mut touch = table.touch();
        run_until(&mut executor, DECIDE);
        if phase == CONFIRM {
            touch.perceive(&executor, in_hand(true, false)).expect("perceived");
            touch.decide(&mut executor, &mut detector, 0.0).expect("decided");
            run_until(&mut executor, CONFIRM);
        }
        touch.perceive(&executor, grip).expect("perceived");
        assert_eq!(touch.decide(&mut executor, &mut detector, 0.0).expect("decided"), PolicyStep::Continue);
        aside(&mut executor);
        touch.perceive(&executor, None).expect("perceived");
        assert_eq!(touch.decide(&mut executor, &mut detector, 0.0).expect("decided"), PolicyStep::NotDetected);
        let reason = touch.trace().reasons.last().expect("a reason").clone();
        assert_eq!(reason, format!("{missing} is not detected"));
    }
}

/// Near the time limit no new try begins, even if an object is missing.
#[test]
fn touch_begins_no_try_that_cannot_end_in_time() {
    let table = Table::new();
    let mut executor = table.executor();
    let mut detector = CountingDetector::new(&table);
    let mut touch = table.touch();
    run_until(&mut executor, DECIDE);
    touch.perceive(&executor, in_hand(false, false)).expect("perceived");
    let step = touch.decide(&mut executor, &mut detector, TIME_LIMIT - 1.0).expect("decided");
    assert_eq!((step, touch.trace().retries), (PolicyStep::Continue, 0));
}

/// A target that no rotation brings within reach ends the trial, and the reason gives its position.
#[test]
fn touch_gives_up_what_is_out_of_reach() {
    let table = Table::new();
    let mut executor = table.executor();
    let far = DetectedObject { position: [3.0, 0.0, 0.02].into(), ..table.percept(1) };
    executor.update_detection(1, far);
    // The next detection does not find it either.
    let mut detector = CountingDetector { hidden: [0, 1], ..CountingDetector::new(&table) };
    let mut touch = table.touch();
    run_until(&mut executor, DECIDE);
    touch.perceive(&executor, in_hand(true, false)).expect("perceived");
    assert_eq!(touch.decide(&mut executor, &mut detector, 0.0).expect("decided"), PolicyStep::GiveUp);
    let reason = touch.trace().reasons.last().expect("a reason").clone();
    assert!(reason.contains(SECOND) && reason.contains("3.00"), "{reason}");
}
