//! Phases of a controller that reports none, inferred from the scene, so that a referee can judge the trial.
//!
//! The objects are to be picked in their order. Once an object is in the hand and lifted, the next one is approached.
//! Once all are lifted, they are held. An object that is lost meanwhile is to be picked again.

use crate::referee::{SceneTruth, distance_in_palm};
use world::holding::{HoldingRule, SupportState};
use world::phase::{Phase, Skill};

/// Infers the phases of one trial.
#[derive(Debug, Clone)]
pub struct PhaseTracker {
    /// Distance from the palm up to which an object counts as in the hand, m.
    reach: f64,
    /// Height by which an object must have risen, m.
    lift: f64,
    /// Required duration of the hold, s.
    hold: f64,
    phase: Phase,
    /// Heights of the objects at the first sample, m.
    rest: Option<Vec<f64>>,
    held_since: Option<f64>,
}

impl PhaseTracker {
    /// Creates the tracker of one trial. Objects count as lifted when they have risen by `lift` (m), and all must be
    /// held within `reach` (m) of the palm for `hold` (s).
    pub fn new(reach: f64, lift: f64, hold: f64) -> Self {
        Self { reach, lift, hold, phase: Phase::run(Skill::Approach, 0), rest: None, held_since: None }
    }

    /// Returns the present phase: an approach to an object, or the hold.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Takes the scene after one tick, in order of time, and returns its phase. The phase stored in the scene is
    /// ignored.
    pub fn observe(&mut self, truth: &SceneTruth) -> Phase {
        let heights: Vec<f64> = truth.objects.iter().map(|object| object.world_from_object.translation.z).collect();
        let rest = self.rest.get_or_insert_with(|| heights.clone());
        let in_hand = |object: usize, lifted: f64| {
            HoldingRule { max_distance: self.reach, min_height: lifted }.holds(&SupportState {
                held: truth.objects[object].hand_contacts > 0,
                on_table: truth.objects[object].on_table,
                distance: distance_in_palm(truth, object),
                height: heights[object],
            })
        };
        let count = heights.len();
        let held = |object: &usize| in_hand(*object, f64::NEG_INFINITY);
        let lifted = |object: &usize| in_hand(*object, rest[*object] + self.lift);
        let holds = self.phase.skill == Skill::Hold;
        // Objects picked before need only be in the hand: they hang low while the hand goes down to the next one.
        let taken = if holds { count } else { self.phase.object };
        self.phase = match (0..taken).find(|object| !held(object)) {
            None if holds || (0..count).all(|object| lifted(&object)) => Phase::run(Skill::Hold, 0),
            Some(lost) => Phase::run(Skill::Approach, lost),
            None if lifted(&taken) => {
                let next = (taken..count).find(|object| !lifted(object));
                Phase::run(Skill::Approach, next.unwrap_or(taken))
            }
            None => Phase::run(Skill::Approach, taken),
        };
        self.held_since = (self.phase.skill == Skill::Hold).then(|| self.held_since.unwrap_or(truth.time));
        self.phase
    }

    /// True if all objects have been held for long enough at `time` (s).
    pub fn is_done(&self, time: f64) -> bool {
        // Tolerance, because times are sums of ticks.
        self.held_since.is_some_and(|since| time - since > self.hold - 1e-3)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Vector3};

    use super::*;
    use crate::referee::{FailureCause, ObjectTruth, Referee, RefereeLimits, RefereeRules};

    /// Returns a scene with objects at these heights over the table, touched by the hand or not.
    fn scene<const N: usize>(time: f64, heights: [f64; N], touched: [bool; N]) -> SceneTruth {
        SceneTruth {
            time,
            phase: Phase::decide(Skill::Begin, 0),
            objects: heights
                .iter()
                .zip(touched)
                .map(|(height, touched)| ObjectTruth {
                    hand_contacts: usize::from(touched),
                    on_table: *height < 0.031,
                    ..ObjectTruth::resting_on_table(Isometry3::translation(0.0, 0.0, *height))
                })
                .collect(),
            world_from_palm: Isometry3::translation(0.0, 0.0, heights.into_iter().fold(0.0, f64::max)),
        }
    }

    #[test]
    fn phases_follow_what_is_lifted_held_and_lost() {
        let mut stages = PhaseTracker::new(0.16, 0.05, 1.0);
        let mut see = |time, heights, touched| (stages.observe(&scene(time, heights, touched)), stages.is_done(time));
        assert_eq!(see(0.0, [0.03, 0.03], [false; 2]), (Phase::run(Skill::Approach, 0), false));
        // Touched, raised slightly, and raised.
        assert_eq!(see(1.0, [0.03, 0.03], [true, false]).0, Phase::run(Skill::Approach, 0));
        assert_eq!(see(2.0, [0.05, 0.03], [true, false]).0, Phase::run(Skill::Approach, 0));
        assert_eq!(see(3.0, [0.09, 0.03], [true, false]).0, Phase::run(Skill::Approach, 1));
        // The second grasp goes down again with the held object.
        assert_eq!(see(4.0, [0.05, 0.03], [true, true]).0, Phase::run(Skill::Approach, 1));
        assert_eq!(see(5.0, [0.09, 0.09], [true, true]), (Phase::run(Skill::Hold, 0), false));
        assert_eq!(see(5.5, [0.07, 0.07], [true, true]), (Phase::run(Skill::Hold, 0), false));
        // The second object is lost, regained, and held for a whole second.
        assert_eq!(see(5.7, [0.09, 0.06], [true, false]).0, Phase::run(Skill::Approach, 1));
        assert_eq!(see(6.0, [0.09, 0.09], [true, true]), (Phase::run(Skill::Hold, 0), false));
        assert_eq!(see(6.9, [0.09, 0.09], [true, true]), (Phase::run(Skill::Hold, 0), false));
        assert_eq!(see(7.0, [0.09, 0.09], [true, true]), (Phase::run(Skill::Hold, 0), true));
        assert_eq!(see(8.0, [0.03, 0.09], [true, true]), (Phase::run(Skill::Approach, 0), false));
    }

    /// A referee that judges by these phases finds a trial successful if both objects are picked and held, and failed
    /// if the hold is broken off.
    #[test]
    fn a_referee_can_judge_by_them() {
        let rules = RefereeRules { palm_distance: 0.16, slip: 0.02, knock_distance: 0.01 };
        let judged = |until: f64| {
            let mut referee = Referee::new(rules, RefereeLimits { hold: 1.0, trial: 60.0 });
            let mut stages = PhaseTracker::new(0.16, 0.05, 1.0);
            let mut time = 0.0;
            while time < until && !stages.is_done(time) {
                time += 0.01;
                let (heights, touched) = match time {
                    _ if time < 1.0 => ([0.03, 0.03], [false, false]),
                    _ if time < 3.0 => ([0.1, 0.03], [true, false]),
                    _ => ([0.1, 0.1], [true, true]),
                };
                let mut truth = scene(time, heights, touched);
                truth.objects[1].free_digits = 2 * usize::from(touched[1]);
                truth.phase = stages.observe(&truth);
                referee.observe(&truth);
            }
            (referee.verdict(), referee.tries().len())
        };
        let (won, tries) = judged(10.0);
        assert!(won.success && !won.contact && tries == 2, "{won:?}");
        let (lost, _) = judged(3.5);
        assert_eq!((lost.success, lost.cause), (false, Some(FailureCause::NotFinished)));
    }

    /// One object is held as soon as it is lifted. Of three, each is approached in turn, and again if it is lost.
    #[test]
    fn a_list_of_one_or_three() {
        let mut one = PhaseTracker::new(0.16, 0.05, 1.0);
        assert_eq!(one.observe(&scene(0.0, [0.03], [false])), Phase::run(Skill::Approach, 0));
        assert_eq!(one.observe(&scene(1.0, [0.1], [true])), Phase::run(Skill::Hold, 0));
        assert!(one.is_done(2.0));
        let mut three = PhaseTracker::new(0.16, 0.05, 1.0);
        let mut see = |heights, touched| three.observe(&scene(0.0, heights, touched));
        assert_eq!(see([0.03; 3], [false; 3]), Phase::run(Skill::Approach, 0));
        assert_eq!(see([0.1, 0.03, 0.03], [true, false, false]), Phase::run(Skill::Approach, 1));
        assert_eq!(see([0.05, 0.03, 0.03], [true, true, false]), Phase::run(Skill::Approach, 1));
        assert_eq!(see([0.1, 0.1, 0.03], [true, true, false]), Phase::run(Skill::Approach, 2));
        assert_eq!(see([0.05, 0.05, 0.03], [true, true, true]), Phase::run(Skill::Approach, 2));
        assert_eq!(see([0.1; 3], [true; 3]), Phase::run(Skill::Hold, 0));
        assert_eq!(see([0.1, 0.03, 0.1], [true, false, true]), Phase::run(Skill::Approach, 1));
    }

    #[test]
    fn an_object_far_from_the_palm_is_not_in_the_hand() {
        let mut stages = PhaseTracker::new(0.16, 0.05, 1.0);
        stages.observe(&scene(0.0, [0.03, 0.03], [false; 2]));
        let mut far = scene(1.0, [0.2, 0.03], [true, false]);
        far.world_from_palm.translation.vector += Vector3::new(0.2, 0.0, 0.0);
        assert_eq!(stages.observe(&far), Phase::run(Skill::Approach, 0));
    }
}
