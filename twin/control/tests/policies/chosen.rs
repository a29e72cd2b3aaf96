//! The policy that delegates to a chooser.

use control::executor::Phase;
use control::policy::chosen::{Aim, Answer, Chooser, ChooserError, Chosen, Situation};
use control::policy::{Policy, Step};
use control::sensing::Senses;
use world::Sensing;

use crate::table::*;

/// Gives its answers one after the other and records the situations.
struct Told {
    answers: Vec<Result<Answer, &'static str>>,
    tries: Vec<(Phase, u32, bool, bool)>,
}

impl Told {
    fn new(answers: impl IntoIterator<Item = Result<Answer, &'static str>>) -> Self {
        Self { answers: answers.into_iter().collect(), tries: Vec::new() }
    }
}

impl Chooser for Told {
    fn choose(&mut self, situation: &Situation) -> Result<Answer, ChooserError> {
        assert_eq!((&situation.objects[..], situation.candidates.len()), (&[FIRST, SECOND][..], 2));
        let Situation { phase, tries, sees_second, grip, .. } = *situation;
        self.tries.push((phase, tries, sees_second, grip.holds(1)));
        self.answers.remove(0).map_err(Into::into)
    }
}

fn take(candidate: usize) -> Result<Answer, &'static str> {
    Ok(Answer::Take { candidate, aim: Aim::default() })
}

/// Plays a trial whose decisions come at `time` until it ends; returns the tries and the story too.
fn played(told: &mut Told, time: f64) -> (Step, Vec<u32>, Vec<String>) {
    let table = Table::new();
    let (mut executor, mut eyes) = (table.executor(), Watchful::new(&table));
    let senses = Senses::new(&table.pipeline, Sensing::TruePose).expect("made");
    let mut chosen = Chosen::new(table.knowledge(), senses, told);
    run_until(&mut executor, DECIDE);
    loop {
        let second = executor.phase().has_lifted(1);
        chosen.perceive(&executor, in_hand(true, second)).expect("perceived");
        match chosen.decide(&mut executor, &mut eyes, time).expect("decided") {
            Step::Play => run_on(&mut executor),
            end => {
                let story = chosen.story();
                return (end, story.attempts.iter().map(|attempt| attempt.grasp).collect(), story.reasons.clone());
            }
        }
    }
}

#[test]
fn what_is_chosen_is_tried_until_it_is_kept() {
    let mut told = Told::new([take(1), take(0), Ok(Answer::Keep)]);
    let (end, tried, _) = played(&mut told, 0.0);
    assert_eq!((end, tried), (Step::Finish, vec![1, 0]));
    assert_eq!(told.tries, [(DECIDE, 0, true, false), (CONFIRM, 1, true, true), (CONFIRM, 2, true, true)]);
}

#[test]
fn the_second_object_may_be_left_alone_and_no_try_begins_too_late() {
    let (end, tried, _) = played(&mut Told::new([Ok(Answer::Keep)]), 0.0);
    assert_eq!((end, tried), (Step::Decline, vec![]));
    let mut told = Told::new([]);
    assert_eq!(played(&mut told, TIME_LIMIT - 5.0).0, Step::Decline);
    assert!(told.tries.is_empty());
}

#[test]
fn a_chooser_that_fails_or_answers_what_cannot_be_ends_its_trial_with_the_reason() {
    let aim = |x: f64, yaw: f64| Ok(Answer::Take { candidate: 0, aim: Aim { x, y: 0.0, yaw } });
    for (answer, words) in [
        (Err("no idea"), "the chooser failed: no idea"),
        (take(2), "candidate: found 2, expected less than 2"),
        (aim(f64::NAN, 0.0), "aim: found"),
        (aim(0.2, 0.0), "expected up to 0.1 m"),
        (aim(0.0, f64::INFINITY), "aim: found"),
    ] {
        let (end, tried, reasons) = played(&mut Told::new([answer]), 0.0);
        assert_eq!((end, tried), (Step::Failed, vec![]));
        assert!(reasons.iter().any(|reason| reason.contains(words)), "{reasons:?}");
    }
}
