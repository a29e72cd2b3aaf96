//! The policy that delegates to a chooser.

use control::executor::Phase;
use control::policy::chooser::{AimOffset, Chooser, ChooserDecision, ChooserError, ChooserPolicy, ChooserSituation};
use control::policy::{PolicyStep, TrialPolicy};
use control::sensing::TouchPerception;
use world::Sensing;

use crate::table::*;

/// Gives its answers one after the other and records the situations.
struct ScriptedChooser {
    answers: Vec<Result<ChooserDecision, &'static str>>,
    tries: Vec<(Phase, u32, bool, bool)>,
}

impl ScriptedChooser {
    fn new(answers: impl IntoIterator<Item = Result<ChooserDecision, &'static str>>) -> Self {
        Self { answers: answers.into_iter().collect(), tries: Vec::new() }
    }
}

impl Chooser for ScriptedChooser {
    fn choose(&mut self, situation: &ChooserSituation) -> Result<ChooserDecision, ChooserError> {
        assert_eq!((&situation.objects[..], situation.candidates.len()), (&[FIRST, SECOND][..], 2));
        let ChooserSituation { phase, tries, second_is_visible: sees_second, hold_state: grip, .. } = *situation;
        self.tries.push((phase, tries, sees_second, grip.holds(1)));
        self.answers.remove(0).map_err(Into::into)
    }
}

fn take(candidate: usize) -> Result<ChooserDecision, &'static str> {
    Ok(ChooserDecision::Take { candidate, aim: AimOffset::default() })
}

/// Runs a trial whose decisions come at `time` until it ends; returns the tries and the decision trace too.
fn finished(told: &mut ScriptedChooser, time: f64) -> (PolicyStep, Vec<u32>, Vec<String>) {
    let table = Table::new();
    let (mut executor, mut detector) = (table.executor(), CountingDetector::new(&table));
    let senses = TouchPerception::new(&table.pipeline, Sensing::TruePose).expect("made");
    let mut chosen = ChooserPolicy::new(table.knowledge(), senses, told);
    run_until(&mut executor, DECIDE);
    loop {
        let second = executor.phase().has_lifted(1);
        chosen.perceive(&executor, in_hand(true, second)).expect("perceived");
        match chosen.decide(&mut executor, &mut detector, time).expect("decided") {
            PolicyStep::Continue => run_on(&mut executor),
            end => {
                let story = chosen.trace();
                return (end, story.attempts.iter().map(|attempt| attempt.grasp).collect(), story.reasons.clone());
            }
        }
    }
}

#[test]
fn what_is_chosen_is_tried_until_it_is_kept() {
    let mut told = ScriptedChooser::new([take(1), take(0), Ok(ChooserDecision::Keep)]);
    let (end, tried, _) = finished(&mut told, 0.0);
    assert_eq!((end, tried), (PolicyStep::Finish, vec![1, 0]));
    assert_eq!(told.tries, [(DECIDE, 0, true, false), (CONFIRM, 1, true, true), (CONFIRM, 2, true, true)]);
}

#[test]
fn the_second_object_may_be_left_alone_and_no_try_begins_too_late() {
    let (end, tried, _) = finished(&mut ScriptedChooser::new([Ok(ChooserDecision::Keep)]), 0.0);
    assert_eq!((end, tried), (PolicyStep::Decline, vec![]));
    let mut told = ScriptedChooser::new([]);
    assert_eq!(finished(&mut told, TIME_LIMIT - 5.0).0, PolicyStep::Decline);
    assert!(told.tries.is_empty());
}

#[test]
fn a_chooser_that_fails_or_answers_what_cannot_be_ends_its_trial_with_the_reason() {
    let aim = |x: f64, yaw: f64| Ok(ChooserDecision::Take { candidate: 0, aim: AimOffset { x, y: 0.0, yaw } });
    for (answer, words) in [
        (Err("no idea"), "the chooser failed: no idea"),
        (take(2), "candidate: found 2, expected less than 2"),
        (aim(f64::NAN, 0.0), "aim: found"),
        (aim(0.2, 0.0), "expected up to 0.1 m"),
        (aim(0.0, f64::INFINITY), "aim: found"),
    ] {
        let (end, tried, reasons) = finished(&mut ScriptedChooser::new([answer]), 0.0);
        assert_eq!((end, tried), (PolicyStep::Failed, vec![]));
        assert!(reasons.iter().any(|reason| reason.contains(words)), "{reasons:?}");
    }
}
