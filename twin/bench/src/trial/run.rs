//! A trial in progress: body, controller, referee and disturbances, which branch together.

use std::sync::Arc;

use anyhow::{Result, bail};
use control::executive::Phase;
use control::perception::{Felt, Grip};
use control::policy::Injected;
use hand_model::robot::Robot;
use proving::rehearsal::{Snapshot, digit_bits, in_hand};
use scenarios::record::{Condition, TrialId, TrialRecord};
use scenarios::referee::{Referee, SceneTruth};
use sim::robot::Truth;

use super::disturbance::Disturber;
use super::eyes::History;
use super::profile::{Activity, Profile};
use super::watcher::{Moment, Watcher};
use crate::body::{Body, Stopped};

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
            collision: verdict.collision,
            success: verdict.success,
            cause: verdict.cause,
            switched: false,
            retries: 0,
            reason: String::new(),
            disturbance: self.disturber.log(),
            pose_error_mm: None,
            pose_error_deg: None,
            prior_error_mm: None,
            sim_seconds: self.snapshot.robot.time(),
            decision_ms: None,
        })
    }

    /// Plays until `until`, while referee and watcher look on.
    pub fn play(
        &mut self,
        until: Phase,
        felt: Option<&Felt>,
        condition: Option<Condition>,
        watcher: &mut dyn Watcher,
    ) -> Result<()> {
        let Self { snapshot, referee, disturber, history, profile } = self;
        let holding = digit_bits(snapshot.executive.first().0.role.digits());
        let Snapshot { robot, executive } = snapshot;
        while executive.phase() < until {
            let observation = robot.observe();
            let command = profile.on(Activity::Control, || executive.tick(&observation))?;
            robot.send(&command);
            let note = match robot {
                Body::Simulated(robot) => disturber.act(robot, executive),
                Body::Single(_) => None,
            };
            let activity = if command.capture { Activity::Images } else { Activity::Physics };
            profile.on(activity, || robot.wait_for_tick());
            profile.on(Activity::Referee, || {
                let Some(truth) = robot.truth() else { return Ok(()) };
                referee.see(&scene(&truth, executive.phase(), holding));
                disturber.see(&truth);
                history.see(&truth);
                watcher.see(&Moment { truth: &truth, executive, felt, condition, note: note.as_deref() })
            })?;
            // The last tick of a recording may also be the last of a trial.
            if let Some(why) = robot.stopped().filter(|_| executive.phase() < Phase::Done) {
                bail!(Stopped(format!("{} while {}", why, executive.phase().name())));
            }
        }
        // What comes next is to be decided first.
        robot.pause();
        Ok(())
    }

    /// How often the reaction to slip pulled harder, in words.
    pub fn slips(&self) -> Option<String> {
        let [first, second] = self.snapshot.executive.slips();
        (first + second > 0).then(|| {
            format!(
                "while carrying, slip was felt {first} times in the first grip and {second} in the second: held harder"
            )
        })
    }

    /// Tells the watcher what is about to be done, and why.
    pub fn tell(&self, note: &str, felt: Option<&Felt>, condition: Condition, watcher: &mut dyn Watcher) -> Result<()> {
        let Snapshot { robot, executive } = &self.snapshot;
        if !watcher.active() {
            return Ok(());
        }
        let Some(truth) = robot.truth() else { return Ok(()) };
        watcher.see(&Moment { truth: &truth, executive, felt, condition: Some(condition), note: Some(note) })
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

/// The referee's view of the scene.
fn scene(truth: &Truth, phase: Phase, holding: u32) -> SceneTruth {
    let count = |object: usize| truth.touched_by[object].count_ones() as usize;
    SceneTruth {
        time: truth.time,
        phase,
        first_touches_second: !truth.object_pairs.is_empty(),
        holding_digits_touch_second: phase >= Phase::LiftFirst && truth.touched_by[1] & holding != 0,
        free_digits_touch_second: truth.touched_by[1] & !holding != 0,
        hand_contacts: [count(0), count(1)],
        on_table: [truth.on_table[0], truth.on_table[1]],
        world_from_object: [truth.objects[0], truth.objects[1]],
        world_from_palm: truth.palm,
    }
}

#[cfg(test)]
mod tests {
    use hand_model::Digit;
    use nalgebra::Isometry3;

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
        let holding = digit_bits(&[Digit::Ring, Digit::Little]);
        let ring = 1 << Digit::Ring.joints()[2];
        let index = 1 << Digit::Index.joints()[2];
        let seen = |touched: u32, phase: Phase| scene(&truth([holding, touched]), phase, holding);
        assert!(seen(ring, Phase::ApproachSecond).holding_digits_touch_second);
        assert!(!seen(ring, Phase::ApproachFirst).holding_digits_touch_second);
        assert!(!seen(index, Phase::GraspSecond).holding_digits_touch_second);
        assert!(seen(index, Phase::GraspSecond).free_digits_touch_second);
        assert!(!seen(ring, Phase::GraspSecond).free_digits_touch_second);
    }

    #[test]
    fn the_referee_counts_links_and_sees_who_lies_on_the_table() {
        let seen = scene(&truth([0b101, 0]), Phase::LiftFirst, 0);
        assert_eq!((seen.hand_contacts, seen.on_table), ([2, 0], [false, true]));
        assert!(!seen.first_touches_second);
        let pair = Truth { object_pairs: vec![(0, 1)], ..truth([0, 0]) };
        assert!(scene(&pair, Phase::LiftFirst, 0).first_touches_second);
    }
}
