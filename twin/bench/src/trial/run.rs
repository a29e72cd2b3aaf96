//! A trial in progress: body, controller, referee and disturbances, which branch together.

use std::sync::Arc;

use anyhow::{Result, bail};
use control::executor::{Executor, Phase};
use control::outage::Outage;
use control::perception::{Felt, Grip};
use control::policy::{Choice, Injected};
use hand_model::Hand;
use hand_model::robot::{Command, Observation, RobotBackend, RobotError};
use proving::rehearsal::{PALM, Snapshot, digit_bits, in_hand};
use scenarios::FailureCause;
use scenarios::record::{Condition, TrialId, TrialRecord};
use scenarios::referee::{Referee, SceneTruth, Touch, Toucher};
use scenarios::stages::Stages;
use sim::robot::Truth;

use super::disturbance::Disturber;
use super::eyes::History;
use super::profile::{Activity, Profile};
use super::watcher::{Moment, Watcher};
use robot_backends::{Body, Stopped};

/// A trial in progress; a clone on a simulated body is a branch.
#[derive(Clone)]
pub struct Run {
    /// Body and controller.
    pub snapshot: Snapshot<Body>,
    /// Judges it.
    pub referee: Referee,
    /// What is done to it.
    pub disturber: Disturber,
    /// Where the objects were, for eyes that report late.
    pub history: History,
    /// Where the time goes.
    pub profile: Arc<Profile>,
    /// The object that the combination names second is taken first: the body's first object is that one.
    pub reversed: bool,
    /// Whether a trial whose body stops has failed, instead of being none.
    pub outlasts_faults: bool,
    /// Why the body stopped.
    pub fault: Option<String>,
    /// Failed calls of the body.
    pub outage: Outage,
}

impl Run {
    /// The verdict of the referee, or of whoever judges instead, on what was done so far. `names` are the two objects'.
    pub fn record(&mut self, names: [&str; 2], id: TrialId) -> Result<TrialRecord> {
        let verdict = match self.snapshot.robot.judge()? {
            Some(verdict) => verdict,
            None => self.referee.verdict(),
        };
        Ok(TrialRecord {
            combination: id.combination,
            trial: id.trial,
            condition: id.condition,
            first: names[0].to_owned(),
            second: names[1].to_owned(),
            contact: verdict.contact,
            contact_with: verdict.first_contact.map(|contact| contact.with),
            contact_s: verdict.first_contact.map(|contact| contact.time),
            contact_n: verdict.first_contact.map(|contact| contact.force),
            success: verdict.success,
            clean_success: verdict.success && !verdict.contact,
            cause: verdict.cause,
            switched: false,
            retries: 0,
            reason: String::new(),
            disturbance: self.disturber.log(),
            risk: None,
            pose_error_mm: None,
            pose_error_deg: None,
            prior_error_mm: None,
            sim_seconds: self.snapshot.robot.time(),
            decision_ms: None,
        })
    }

    /// Plays until the phase is one of `until`, while referee and watcher look on.
    pub fn play(
        &mut self,
        until: impl Fn(Phase) -> bool,
        felt: Option<&Felt>,
        condition: Option<Condition>,
        watcher: &mut dyn Watcher,
    ) -> Result<()> {
        self.play_while(|executor, _| !until(executor.phase()), felt, condition, watcher)?;
        // What comes next is to be decided first.
        self.snapshot.robot.pause();
        Ok(())
    }

    /// Lets `time` s pass while the executor waits for a decision.
    pub fn wait(
        &mut self,
        time: f64,
        felt: Option<&Felt>,
        condition: Option<Condition>,
        watcher: &mut dyn Watcher,
    ) -> Result<()> {
        // Half a tick of tolerance: times are sums of ticks.
        let end = self.snapshot.robot.time() + time - 0.5 * self.snapshot.executor.motion().tick_length();
        self.play_while(|_, now| now < end, felt, condition, watcher)
    }

    /// Plays as long as `on` says so of the executor and the time (s).
    fn play_while(
        &mut self,
        on: impl Fn(&Executor, f64) -> bool,
        felt: Option<&Felt>,
        condition: Option<Condition>,
        watcher: &mut dyn Watcher,
    ) -> Result<()> {
        while self.fault.is_none() && on(&self.snapshot.executor, self.snapshot.robot.time()) {
            match self.observe()? {
                Some(observation) => {
                    let executor = &mut self.snapshot.executor;
                    let command = self.profile.on(Activity::Control, || executor.tick(&observation))?;
                    self.carry_out(&command, None, (felt, condition), watcher)?;
                }
                None => self.pass(None, false, None, (felt, condition), watcher)?,
            }
        }
        Ok(())
    }

    /// The newest measurements; none while the body fails. One that fails for too long ends the trial.
    pub fn observe(&mut self) -> Result<Option<Observation>> {
        let seen = self.outage.observed(self.snapshot.robot.observe());
        self.unless_lost(seen)
    }

    /// One tick with `command`, while referee and watcher look on: what was sent, after limits, if anything was. The executor says what phase it
    /// is, or `stages` where it does not command.
    pub fn carry_out(
        &mut self,
        command: &Command,
        stages: Option<&mut Stages>,
        shown: (Option<&Felt>, Option<Condition>),
        watcher: &mut dyn Watcher,
    ) -> Result<Option<Command>> {
        let sent = self.outage.sent(self.snapshot.robot.send(command));
        let sent = self.unless_lost(sent)?;
        self.pass(sent.as_ref(), command.capture, stages, shown, watcher)?;
        Ok(sent)
    }

    /// Lets a tick pass in which this was `sent`, while referee and watcher look on.
    fn pass(
        &mut self,
        sent: Option<&Command>,
        captures: bool,
        stages: Option<&mut Stages>,
        (felt, condition): (Option<&Felt>, Option<Condition>),
        watcher: &mut dyn Watcher,
    ) -> Result<()> {
        let Self { snapshot: Snapshot { robot, executor }, referee, disturber, history, profile, .. } = self;
        let reversed = self.reversed;
        let note = match robot {
            Body::Simulated(robot) => disturber.act(robot, executor),
            Body::Single(_) => None,
        };
        let activity = if captures { Activity::Images } else { Activity::Physics };
        profile.on(activity, || robot.wait_for_tick());
        profile.on(Activity::Referee, || {
            let (truth, hand) = (robot.truth(), executor.motion().hand());
            if let Some(truth) = &truth {
                referee.see(&match stages {
                    Some(stages) => staged(hand, truth, stages),
                    None => {
                        let holding = digit_bits(hand, &executor.target(0).grasp.digits);
                        scene(hand, truth, executor.phase(), holding)
                    }
                });
                disturber.see(truth);
                history.see(truth);
            }
            let (time, note) = (robot.time(), note.as_deref());
            watcher.see(&Moment {
                time,
                truth: truth.as_ref(),
                executor,
                sent,
                felt,
                condition,
                note,
                choice: None,
                reversed,
            })
        })?;
        // The last tick of a recording may also be the last of a trial.
        if self.fault.is_none()
            && let Some(why) = robot.stopped().filter(|_| !executor.phase().is_done())
        {
            self.stop(&why)?;
        }
        Ok(())
    }

    /// The outcome of a call of the body; none, and the end of the trial, where it has failed for too long.
    fn unless_lost<T>(&mut self, called: Result<Option<T>, RobotError>) -> Result<Option<T>> {
        called.or_else(|error| {
            // Who stopped it knows better why.
            let why = self.snapshot.robot.stopped().unwrap_or_else(|| error.to_string());
            self.stop(&why)?;
            Ok(None)
        })
    }

    /// The trial ends here: as failed, or as none.
    fn stop(&mut self, why: &str) -> Result<()> {
        let Snapshot { robot, executor } = &self.snapshot;
        let why = format!("{why} (phase: {})", executor.phase().name());
        if !self.outlasts_faults || !robot.is_written() {
            bail!(Stopped(why));
        }
        self.referee.give_up(FailureCause::RobotFault);
        self.fault = Some(why);
        Ok(())
    }

    /// How often the reaction to slip pulled harder, in words.
    pub fn slips(&self) -> Option<String> {
        let [first, second] = self.snapshot.executor.slips();
        (first + second > 0).then(|| {
            format!(
                "while carrying, slip was felt {first} times in the first grip and {second} in the second: held harder"
            )
        })
    }

    /// Tells the watcher what is about to be done and why, or what was weighed for it.
    pub fn tell(
        &self,
        (note, choice): (Option<&str>, Option<&Choice>),
        felt: Option<&Felt>,
        condition: Condition,
        watcher: &mut dyn Watcher,
    ) -> Result<()> {
        let Snapshot { robot, executor } = &self.snapshot;
        if !watcher.active() {
            return Ok(());
        }
        let (time, truth) = (robot.time(), robot.truth());
        let condition = Some(condition);
        watcher.see(&Moment {
            time,
            truth: truth.as_ref(),
            executor,
            sent: None,
            felt,
            condition,
            note,
            choice,
            reversed: self.reversed,
        })
    }

    /// What is truly in the hand, as an estimate to inject.
    pub fn true_state(&self) -> Option<Injected> {
        let truth = self.snapshot.robot.truth()?;
        Some(Injected {
            palm_from_object: truth.palm.inverse() * truth.objects[0],
            grip: Grip { first: in_hand(&truth, 0), second: in_hand(&truth, 1) },
        })
    }
}

/// The referee's view of a scene whose phases are read from it. The digits that hold the first object are those that touch it.
fn staged(hand: &Hand, truth: &Truth, stages: &mut Stages) -> SceneTruth {
    let holding =
        hand.digits().iter().map(|digit| digit_bits(hand, &[*digit])).filter(|bits| truth.touched_by[0] & bits != 0);
    let holding = holding.fold(0, |all, bits| all | bits);
    let phase = stages.see(&scene(hand, truth, stages.phase(), holding));
    scene(hand, truth, phase, holding)
}

/// The referee's view of the scene.
fn scene(hand: &Hand, truth: &Truth, phase: Phase, holding: u32) -> SceneTruth {
    let holds = phase.lifts(0);
    let count = |object: usize| truth.touched_by[object].count_ones() as usize;
    SceneTruth {
        time: truth.time,
        phase,
        first_touches_second: !truth.object_pairs.is_empty(),
        holding_digits_touch_second: holds && truth.touched_by[1] & holding != 0,
        palm_touches_second: truth.touched_by[1] & PALM != 0,
        free_digits_on_second: digits_on(hand, truth.touched_by[1] & !holding),
        on_second: on_second(truth, holding),
        hand_contacts: [count(0), count(1)],
        on_table: [truth.on_table[0], truth.on_table[1]],
        world_from_object: [truth.objects[0], truth.objects[1]],
        world_from_palm: truth.palm,
    }
}

/// How many digits have a link among `links` (bits as in [`Truth::touched_by`]).
fn digits_on(hand: &Hand, links: u32) -> usize {
    hand.digits().iter().filter(|digit| links & digit_bits(hand, &[**digit]) != 0).count()
}

/// What presses on the second object at the end of the tick.
fn on_second(truth: &Truth, holding: u32) -> Vec<Touch> {
    let by_hand = truth.contacts.iter().filter(|contact| contact.object == 1).map(|contact| Touch {
        by: contact.link.map_or(Toucher::Palm, Toucher::Link),
        holding: contact.link.is_some_and(|link| holding >> link & 1 != 0),
        point: contact.point,
        force: contact.force.norm(),
    });
    let by_first = truth.object_contacts.iter().filter(|contact| contact.objects == (0, 1)).map(|contact| Touch {
        by: Toucher::FirstObject,
        holding: false,
        point: contact.point,
        force: contact.force,
    });
    by_hand.chain(by_first).collect()
}

#[cfg(test)]
mod tests {
    use control::executor::Skill;
    use nalgebra::Isometry3;

    use hand_model::Digit;

    use super::*;

    fn truth(touched_by: [u32; 2]) -> Truth {
        Truth {
            objects: vec![Isometry3::identity(); 2],
            touched_by: touched_by.to_vec(),
            on_table: vec![false, true],
            ..Truth::default()
        }
    }

    /// A digit that holds the first object counts against the trial when it touches the second one, but not before it holds;
    /// other links do not.
    #[test]
    fn the_referee_tells_holding_digits_from_free_ones() {
        let hand = Hand::ftac();
        let holding = digit_bits(&hand, &[Digit::Ring, Digit::Little]);
        let ring = 1 << Digit::Ring.ftac_joints()[2];
        let index = 1 << Digit::Index.ftac_joints()[2];
        let seen = |touched: u32, phase: Phase| scene(&hand, &truth([holding, touched]), phase, holding);
        assert!(seen(ring, Phase::run(Skill::Approach, 1)).holding_digits_touch_second);
        assert!(!seen(ring, Phase::run(Skill::Approach, 0)).holding_digits_touch_second);
        assert!(!seen(index, Phase::run(Skill::Grasp, 1)).holding_digits_touch_second);
        assert_eq!(seen(index, Phase::run(Skill::Grasp, 1)).free_digits_on_second, 1);
        assert_eq!(
            seen(index | 1 << Digit::Thumb.ftac_joints()[1], Phase::run(Skill::Grasp, 1)).free_digits_on_second,
            2
        );
        assert_eq!(seen(ring, Phase::run(Skill::Grasp, 1)).free_digits_on_second, 0);
        let palm = seen(PALM, Phase::run(Skill::Grasp, 1));
        assert!(palm.palm_touches_second && palm.free_digits_on_second == 0 && !palm.holding_digits_touch_second);
    }

    #[test]
    fn the_referee_counts_links_and_sees_who_lies_on_the_table() {
        let hand = Hand::ftac();
        let seen = scene(&hand, &truth([0b101, 0]), Phase::run(Skill::Lift, 0), 0);
        assert_eq!((seen.hand_contacts, seen.on_table), ([2, 0], [false, true]));
        assert!(!seen.first_touches_second);
        let pair = Truth { object_pairs: vec![(0, 1)], ..truth([0, 0]) };
        assert!(scene(&hand, &pair, Phase::run(Skill::Lift, 0), 0).first_touches_second);
    }
}
