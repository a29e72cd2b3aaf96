//! A trial in progress: backend, controller, referee and disturbances, which branch together.

use std::sync::Arc;

use anyhow::{Result, bail};
use control::executor::{Executor, Phase};
use control::outage::Outage;
use control::perception::ObjectEstimate;
use control::policy::{DecisionRecord, InjectedHold};
use grasp_verification::rollout::{PALM, RolloutSnapshot, digit_bits, in_hand};
use hand_model::Hand;
use hand_model::robot::{Observation, RobotBackend, RobotCommand, RobotError};
use scenarios::FailureCause;
use scenarios::phase_tracker::PhaseTracker;
use scenarios::record::{Condition, PoseErrors, TrialId, TrialRecord};
use scenarios::referee::{ContactingBody, ObjectTruth, Referee, SceneTruth, TouchEvent};
use sim::robot::GroundTruth;
use world::objects::ObjectModel;
use world::phase::ordinal;

use super::disturbance::Disturber;
use super::profile::{Activity, Profile};
use super::simulated_detector::PoseHistory;
use super::watcher::{TickView, Watcher};
use robot_backends::{Backend, TrialStopped};

/// A trial in progress; a clone on a simulated backend is a branch.
#[derive(Clone)]
pub struct Run {
    /// Backend and controller.
    pub snapshot: RolloutSnapshot<Backend>,
    /// Referee that judges the trial.
    pub referee: Referee,
    /// Disturbances of the trial.
    pub disturber: Disturber,
    /// Past object poses, for detectors with latency.
    pub history: PoseHistory,
    /// Profile of the computing time.
    pub profile: Arc<Profile>,
    /// True if the object that the combination names second is grasped first: it is then the backend's first object.
    pub reversed: bool,
    /// True if a trial whose backend stops counts as failed. If false, it does not count at all.
    pub continues_after_faults: bool,
    /// Reason for the stop of the backend.
    pub fault: Option<String>,
    /// Failed calls of the backend.
    pub outage: Outage,
}

impl Run {
    /// Returns the record of the trial so far with these `objects`, with the verdict of the referee or of the backend's
    /// own referee.
    pub fn record(&mut self, objects: &[Arc<ObjectModel>], id: TrialId) -> Result<TrialRecord> {
        let verdict = match self.snapshot.robot.judge()? {
            Some(verdict) => verdict,
            None => self.referee.verdict(),
        };
        let name = |index: usize| objects.get(index).map(|object| object.name.clone()).unwrap_or_default();
        Ok(TrialRecord {
            combination: id.combination,
            trial: id.trial,
            condition: id.condition,
            first: name(0),
            second: name(1),
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
            disturbance: self.disturber.description(),
            risk: None,
            plan_separation_mm: None,
            chosen_separation_mm: None,
            pose_error_mm: None,
            pose_error_deg: None,
            prior_error_mm: None,
            sim_seconds: self.snapshot.robot.time(),
            decision_ms: None,
            third: name(2),
            later_pose_errors: PoseErrors(if objects.len() > 2 { vec![None; objects.len() - 1] } else { Vec::new() }),
        })
    }

    /// Runs until the phase is one of `until`. Referee and watcher observe every tick.
    pub fn run_until(
        &mut self,
        until: impl Fn(Phase) -> bool,
        felt: &[ObjectEstimate],
        condition: Option<Condition>,
        watcher: &mut dyn Watcher,
    ) -> Result<()> {
        self.run_while(|executor, _| !until(executor.phase()), felt, condition, watcher)?;
        // The next step needs a decision first.
        self.snapshot.robot.pause();
        Ok(())
    }

    /// Lets `time` s pass while the executor waits for a decision.
    pub fn wait(
        &mut self,
        time: f64,
        felt: &[ObjectEstimate],
        condition: Option<Condition>,
        watcher: &mut dyn Watcher,
    ) -> Result<()> {
        // Half a tick of tolerance: times are sums of ticks.
        let end = self.snapshot.robot.time() + time - 0.5 * self.snapshot.executor.motion().tick_length();
        self.run_while(|_, now| now < end, felt, condition, watcher)
    }

    /// Runs as long as `on` returns true for the executor and the time (s).
    fn run_while(
        &mut self,
        on: impl Fn(&Executor, f64) -> bool,
        felt: &[ObjectEstimate],
        condition: Option<Condition>,
        watcher: &mut dyn Watcher,
    ) -> Result<()> {
        while self.fault.is_none() && on(&self.snapshot.executor, self.snapshot.robot.time()) {
            match self.observe()? {
                Some(observation) => {
                    let executor = &mut self.snapshot.executor;
                    let command = self.profile.measure(Activity::Control, || executor.tick(&observation))?;
                    self.carry_out(&command, None, (felt, condition), watcher)?;
                }
                None => self.finish_tick(None, false, None, (felt, condition), watcher)?,
            }
        }
        Ok(())
    }

    /// Returns the newest measurements, or none while the backend fails. A backend that fails for too long ends the
    /// trial.
    pub fn observe(&mut self) -> Result<Option<Observation>> {
        let seen = self.outage.record_observation(self.snapshot.robot.observe());
        self.check_outage(seen)
    }

    /// Runs one tick with `command`, observed by referee and watcher. Returns the command after limits, if one was
    /// sent. The phase comes from the executor, or from `stages` if the executor does not command.
    pub fn carry_out(
        &mut self,
        command: &RobotCommand,
        stages: Option<&mut PhaseTracker>,
        shown: (&[ObjectEstimate], Option<Condition>),
        watcher: &mut dyn Watcher,
    ) -> Result<Option<RobotCommand>> {
        let sent = self.outage.record_send(self.snapshot.robot.send(command));
        let sent = self.check_outage(sent)?;
        self.finish_tick(sent.as_ref(), command.capture, stages, shown, watcher)?;
        Ok(sent)
    }

    /// Finishes a tick in which `sent` was sent, observed by referee and watcher.
    fn finish_tick(
        &mut self,
        sent: Option<&RobotCommand>,
        captures: bool,
        stages: Option<&mut PhaseTracker>,
        (felt, condition): (&[ObjectEstimate], Option<Condition>),
        watcher: &mut dyn Watcher,
    ) -> Result<()> {
        let Self { snapshot: RolloutSnapshot { robot, executor }, referee, disturber, history, profile, .. } = self;
        let reversed = self.reversed;
        let note = match robot {
            Backend::Simulated(robot) => disturber.apply(robot, executor),
            Backend::Single(_) => None,
        };
        let activity = if captures { Activity::Images } else { Activity::Physics };
        profile.measure(activity, || robot.wait_for_tick());
        profile.measure(Activity::Referee, || {
            let (truth, hand) = (robot.truth(), executor.motion().hand());
            if let Some(truth) = &truth {
                referee.observe(&match stages {
                    Some(stages) => staged_scene_truth(hand, truth, stages),
                    None => {
                        let digits = executor.targets().iter().map(|target| digit_bits(hand, &target.grasp.digits));
                        let mut seen = scene_truth(hand, truth, executor.phase(), &digits.collect::<Vec<_>>());
                        for (object, target) in seen.objects.iter_mut().zip(executor.targets()).skip(1) {
                            object.palm_grasp = target.grasp.digits.len() == 1;
                        }
                        seen
                    }
                });
                disturber.note_touched(truth);
                history.record(truth);
            }
            let (time, note) = (robot.time(), note.as_deref());
            watcher.on_tick(&TickView {
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
            && let Some(why) = robot.stop_reason().filter(|_| !executor.phase().is_done())
        {
            self.end_trial(&why)?;
        }
        Ok(())
    }

    /// Returns the outcome of a call of the backend. If the backend has failed for too long, returns none and ends the
    /// trial.
    fn check_outage<T>(&mut self, called: Result<Option<T>, RobotError>) -> Result<Option<T>> {
        called.or_else(|error| {
            // The party that stopped the backend has the more precise reason.
            let why = self.snapshot.robot.stop_reason().unwrap_or_else(|| error.to_string());
            self.end_trial(&why)?;
            Ok(None)
        })
    }

    /// Ends the trial here, as failed or as not counting.
    fn end_trial(&mut self, why: &str) -> Result<()> {
        let RolloutSnapshot { robot, executor } = &self.snapshot;
        let why = format!("{why} (phase: {})", executor.phase().name());
        if !self.continues_after_faults || !robot.is_session_writable() {
            bail!(TrialStopped(why));
        }
        self.referee.give_up(FailureCause::RobotFault);
        self.fault = Some(why);
        Ok(())
    }

    /// Describes how often the slip reflex increased the grip force.
    pub fn describe_slips(&self) -> Option<String> {
        let slips = self.snapshot.executor.slip_counts();
        (slips.iter().sum::<u32>() > 0).then(|| {
            let grips = slips.iter().enumerate().map(|(n, count)| match n {
                0 => format!("{count} times in the {} grip", ordinal(n)),
                _ => format!("{count} in the {}", ordinal(n)),
            });
            let grips: Vec<String> = grips.collect();
            format!("while carrying, slip was detected {}: grip force increased", grips.join(" and "))
        })
    }

    /// Shows the watcher a note about the coming action, or the options scored for it.
    pub fn notify_watcher(
        &self,
        (note, choice): (Option<&str>, Option<&DecisionRecord>),
        felt: &[ObjectEstimate],
        condition: Condition,
        watcher: &mut dyn Watcher,
    ) -> Result<()> {
        let RolloutSnapshot { robot, executor } = &self.snapshot;
        if !watcher.is_active() {
            return Ok(());
        }
        let (time, truth) = (robot.time(), robot.truth());
        let condition = Some(condition);
        watcher.on_tick(&TickView {
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

    /// Returns the true state of the objects in the hand, as an estimate to inject.
    pub fn true_state(&self) -> Option<InjectedHold> {
        let truth = self.snapshot.robot.truth()?;
        Some(InjectedHold {
            palm_from_object: truth.palm.inverse() * truth.objects[0],
            hold_state: (0..truth.objects.len()).map(|object| in_hand(&truth, object)).collect(),
        })
    }
}

/// Returns the referee's view of a scene whose phases are read from it. The digits that hold an object are those that
/// touch it.
fn staged_scene_truth(hand: &Hand, truth: &GroundTruth, stages: &mut PhaseTracker) -> SceneTruth {
    let on = |touched: &u32| {
        let digits = hand.digits().iter().map(|digit| digit_bits(hand, &[*digit]));
        digits.filter(|bits| touched & bits != 0).fold(0, |all, bits| all | bits)
    };
    let holding: Vec<u32> = truth.touched_by.iter().map(on).collect();
    let phase = stages.observe(&scene_truth(hand, truth, stages.phase(), &holding));
    scene_truth(hand, truth, phase, &holding)
}

/// Returns the referee's view of the scene; `holding` are the links of the digits assigned to each object (bits as in
/// [`GroundTruth::touched_by`]).
fn scene_truth(hand: &Hand, truth: &GroundTruth, phase: Phase, holding: &[u32]) -> SceneTruth {
    let object = |n: usize| {
        let touched = truth.touched_by[n];
        let of = |wanted: &dyn Fn(usize) -> bool| {
            holding[..n].iter().enumerate().filter(|(other, _)| wanted(*other)).fold(0, |all, (_, bits)| all | bits)
        };
        let before = of(&|_| true);
        ObjectTruth {
            touching_objects: truth
                .object_pairs
                .iter()
                .filter_map(|&(a, b)| (a.max(b) == n).then_some(a.min(b)))
                .collect(),
            holding_digits_touch: touched & of(&|other| phase.has_begun_lift(other)) != 0,
            palm_touches: touched & PALM != 0,
            free_digits: digits_on(hand, touched & !before),
            palm_grasp: false,
            pressed_by: if n == 0 { Vec::new() } else { pressing_contacts(truth, n, before) },
            hand_contacts: touched.count_ones() as usize,
            on_table: truth.on_table[n],
            world_from_object: truth.objects[n],
        }
    };
    SceneTruth {
        time: truth.time,
        phase,
        objects: (0..truth.objects.len()).map(object).collect(),
        world_from_palm: truth.palm,
    }
}

/// Returns the number of digits with a link among `links` (bits as in [`GroundTruth::touched_by`]).
fn digits_on(hand: &Hand, links: u32) -> usize {
    hand.digits().iter().filter(|digit| links & digit_bits(hand, &[**digit]) != 0).count()
}

/// Returns the contacts that press on an object after the first at the end of the tick; `holding` are the links of the
/// digits assigned to the objects before it.
fn pressing_contacts(truth: &GroundTruth, object: usize, holding: u32) -> Vec<TouchEvent> {
    let by_hand = truth.contacts.iter().filter(|contact| contact.object == object).map(|contact| TouchEvent {
        by: contact.link.map_or(ContactingBody::Palm, ContactingBody::Link),
        holding: contact.link.is_some_and(|link| holding >> link & 1 != 0),
        point: contact.point,
        force: contact.force.norm(),
    });
    let by_objects = truth.object_contacts.iter().filter_map(|contact| {
        let (a, b) = contact.objects;
        let by = match a.min(b) {
            0 => ContactingBody::FirstObject,
            _ => ContactingBody::SecondObject,
        };
        (a.max(b) == object).then_some(TouchEvent { by, holding: false, point: contact.point, force: contact.force })
    });
    by_hand.chain(by_objects).collect()
}

#[cfg(test)]
mod tests {
    use control::executor::Skill;
    use nalgebra::Isometry3;

    use hand_model::Digit;

    use super::*;

    fn truth(touched_by: [u32; 2]) -> GroundTruth {
        GroundTruth {
            objects: vec![Isometry3::identity(); 2],
            touched_by: touched_by.to_vec(),
            on_table: vec![false, true],
            ..GroundTruth::default()
        }
    }

    /// A digit that holds the first object counts against the trial when it touches the second one, but not before it
    /// holds. Other links do not count.
    #[test]
    fn the_referee_tells_holding_digits_from_free_ones() {
        let hand = Hand::ftac();
        let holding = digit_bits(&hand, &[Digit::Ring, Digit::Little]);
        let ring = 1 << Digit::Ring.ftac_joints()[2];
        let index = 1 << Digit::Index.ftac_joints()[2];
        let seen = |touched: u32, phase: Phase| {
            scene_truth(&hand, &truth([holding, touched]), phase, &[holding, 0]).objects[1].clone()
        };
        assert!(seen(ring, Phase::run(Skill::Approach, 1)).holding_digits_touch);
        assert!(!seen(ring, Phase::run(Skill::Approach, 0)).holding_digits_touch);
        assert!(!seen(index, Phase::run(Skill::Grasp, 1)).holding_digits_touch);
        assert_eq!(seen(index, Phase::run(Skill::Grasp, 1)).free_digits, 1);
        assert_eq!(seen(index | 1 << Digit::Thumb.ftac_joints()[1], Phase::run(Skill::Grasp, 1)).free_digits, 2);
        assert_eq!(seen(ring, Phase::run(Skill::Grasp, 1)).free_digits, 0);
        let palm = seen(PALM, Phase::run(Skill::Grasp, 1));
        assert!(palm.palm_touches && palm.free_digits == 0 && !palm.holding_digits_touch);
    }

    #[test]
    fn the_referee_counts_links_and_sees_who_lies_on_the_table() {
        let hand = Hand::ftac();
        let seen = scene_truth(&hand, &truth([0b101, 0]), Phase::run(Skill::Lift, 0), &[0; 2]).objects;
        assert_eq!([0, 1].map(|n| (seen[n].hand_contacts, seen[n].on_table)), [(2, false), (0, true)]);
        assert!(seen[1].touching_objects.is_empty());
        let pair = GroundTruth { object_pairs: vec![(0, 1)], ..truth([0, 0]) };
        assert_eq!(scene_truth(&hand, &pair, Phase::run(Skill::Lift, 0), &[0; 2]).objects[1].touching_objects, [0]);
    }
}
