//! Planning of a pick sequence: which objects to take, in which order and with which digits, so that the carried volume
//! is largest.
//!
//! Every [`PickSkill`] closes digits that are still free and keeps those that hold the object; the others open again.
//! The score of a plan is the sum over its picks of the object's volume times the probability that this pick and all
//! before it hold. The best plan is found by exhaustive search, which is quick because a hand has five digits. After
//! each pick, touch determines which digits hold something, and the rest is replanned.

use dexterous_grasping::Grasp;
use dexterous_grasping::digit_sets;
use hand_model::parameters::HoldLimits;
use hand_model::robot::ServoState;
use hand_model::{Digit, Hand};
use serde::{Deserialize, Serialize};
use tactile_perception::PadTouch;

use crate::perception::is_blocked;
use crate::score;

/// Conversion from m3 to cubic centimetres.
const CM3_PER_M3: f64 = 1e6;

/// A way to pick up a ball while other digits hold something.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PickSkill {
    /// Diameter of the ball with which it was verified, m.
    pub diameter: f64,
    /// Digits that held something when it was verified.
    pub beside: Vec<Digit>,
    /// Closing digits that hold the ball afterwards.
    pub keeps: Vec<Digit>,
    /// The grasp. Its object names the kind of object that it suits, and its score is the share of successful tries
    /// under errors.
    pub grasp: Grasp,
}

/// An object that is ready to be taken.
#[derive(Debug, Clone)]
pub struct ReachableObject {
    /// Number of the object among all objects.
    pub object: usize,
    /// Volume, m3.
    pub volume: f64,
    /// Indices of the suitable pickups within the arm's reach, each with its number of failures.
    pub skills: Vec<(usize, i32)>,
}

/// One pick of a plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pick {
    /// Index of the object.
    pub object: usize,
    /// Index of the pickup.
    pub skill: usize,
    /// Probability that this pick holds, given that those before it do.
    pub score: f64,
}

/// Picks in order.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PickPlan {
    pub picks: Vec<Pick>,
    /// Expected volume, m3.
    pub volume: f64,
}

/// Plan with the largest expected volume for a hand whose digits `holding` are occupied, with at most `most` picks.
pub fn plan_picks(pickups: &[PickSkill], ready: &[ReachableObject], holding: &[Digit], most: usize) -> PickPlan {
    if most == 0 {
        return PickPlan::default();
    }
    let mut best = PickPlan::default();
    for thing in ready {
        for pick in best_picks(pickups, thing, holding) {
            let digits = &pickups[pick.skill].keeps;
            let rest: Vec<ReachableObject> =
                ready.iter().filter(|other| other.object != thing.object).cloned().collect();
            let then = plan_picks(pickups, &rest, &[holding, digits].concat(), most - 1);
            let volume = pick.score * (thing.volume + then.volume);
            if volume > best.volume {
                best = PickPlan { picks: std::iter::once(pick).chain(then.picks).collect(), volume };
            }
        }
    }
    best
}

/// Best pickup for `thing` for each set of free digits that will hold it.
fn best_picks(pickups: &[PickSkill], thing: &ReachableObject, holding: &[Digit]) -> Vec<Pick> {
    let mut picks: Vec<Pick> = Vec::new();
    for &(number, failures) in &thing.skills {
        let pickup = &pickups[number];
        if pickup.grasp.digits.iter().any(|digit| holding.contains(digit)) {
            continue;
        }
        let verified =
            pickup.beside.len() == holding.len() && pickup.beside.iter().all(|digit| holding.contains(digit));
        let score = pickup.grasp.score
            * if verified { 1.0 } else { score::UNVERIFIED_PICK_FACTOR }
            * score::FAILURE_FACTOR.powi(failures);
        if score < score::MIN_PICK_SCORE {
            continue;
        }
        let pick = Pick { object: thing.object, skill: number, score };
        match picks.iter_mut().find(|other| pickups[other.skill].keeps == pickup.keeps) {
            Some(other) if other.score < score => *other = pick,
            Some(_) => {}
            None => picks.push(pick),
        }
    }
    picks
}

/// Describes the plan in words; `names` are those of all objects.
pub fn describe_plan(plan: &PickPlan, pickups: &[PickSkill], names: &[String]) -> String {
    let one = |pick: &Pick| {
        let digits = digit_sets::describe_digits(&pickups[pick.skill].keeps);
        format!("{} with {digits} (holds with {:.2})", names[pick.object], pick.score)
    };
    let picks: Vec<String> = plan.picks.iter().map(one).collect();
    format!("{}, {:.0} cm3 expected", picks.join(", then "), plan.volume * CM3_PER_M3)
}

/// Explains why `planned`, the remaining picks, are given up for `now`, given the digits that hold something. `None` if
/// they stay.
pub fn explain_replan(
    planned: &[Pick],
    now: &PickPlan,
    pickups: &[PickSkill],
    holding: &[Digit],
    names: &[String],
) -> Option<String> {
    let was = planned.first()?;
    if now.picks.first().is_some_and(|pick| pick.object == was.object) {
        return None;
    }
    let needs = &pickups[was.skill].grasp.digits;
    let taken: Vec<Digit> = needs.iter().copied().filter(|digit| holding.contains(digit)).collect();
    let because = match taken.as_slice() {
        [] => "has a lower score now".to_owned(),
        taken => format!(
            "needs {}, of which {} holds something already",
            digit_sets::describe_digits(needs),
            digit_sets::describe_digits(taken)
        ),
    };
    Some(format!("{} as planned {because}", names[was.object]))
}

/// Digits out of `pulled`, which close on one object, that hold it. A finger holds if its pads feel something, if a
/// blind pad may hide a contact, or if its cable shows that something blocks it: fingers often hold with their sides,
/// which bear no pads. The thumb closes against fingers, so only they can show that it holds something. Alone it holds
/// nothing.
pub fn holding_digits(
    (hand, limits): (&Hand, &HoldLimits),
    touches: &[PadTouch],
    servos: &[ServoState],
    pulled: &[Digit],
) -> Vec<Digit> {
    let felt = |digit: Digit| {
        let of = |touch: &&PadTouch| hand.digit_of(hand.pads[touch.pad].link) == Some(digit);
        touches.iter().filter(of).any(|touch| touch.is_touched() || touch.blind)
    };
    let holds = |digit: Digit| digit != Digit::Thumb && (felt(digit) || is_blocked(hand, limits, servos, digit));
    if !pulled.iter().any(|digit| holds(*digit)) {
        return Vec::new();
    }
    pulled.iter().copied().filter(|digit| *digit == Digit::Thumb || holds(*digit)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::perception::tests::servos;
    fn pickup(object: &str, digits: &[Digit], beside: &[Digit], score: f64) -> PickSkill {
        let mut close_tension = [0.0; 5];
        for digit in digits {
            close_tension[digit.index()] = 10.0;
        }
        let grasp = Grasp {
            id: 0,
            object: object.into(),
            digits: digits.to_vec(),
            yaw: 0.0,
            pitch: 0.0,
            roll: 0.0,
            center: [0.0; 3],
            pre_tension: [0.0; 5].into(),
            close_tension: close_tension.into(),
            opposition: 0.0,
            raise: 0.0,
            thumb_delay: 0.0,
            held: None,
            held_joints: None,
            held_sigmas: None,
            score,
        };
        PickSkill { diameter: 0.04, beside: beside.to_vec(), keeps: digits.to_vec(), grasp }
    }

    const REST: [Digit; 4] = [Digit::Thumb, Digit::Index, Digit::Middle, Digit::Ring];
    const THREE: [Digit; 3] = [Digit::Thumb, Digit::Index, Digit::Middle];

    /// The example of the paper: the golf ball with the little finger, the softball with the rest. With another finger
    /// on the golf ball, the softball's grasp is impossible, and a smaller ball is taken.
    fn paper_example() -> (Vec<PickSkill>, Vec<ReachableObject>, Vec<String>) {
        let pickups = vec![
            pickup("golf", &[Digit::Little], &[], 0.9),
            pickup("soft", &REST, &[Digit::Little], 0.8),
            pickup("yoga", &THREE, &[Digit::Ring], 0.9),
        ];
        let ready = |object: usize, volume: f64| ReachableObject { object, volume, skills: vec![(object, 0)] };
        let names = ["golf", "soft", "yoga"].map(str::to_owned).to_vec();
        (pickups, vec![ready(0, 40e-6), ready(1, 480e-6), ready(2, 180e-6)], names)
    }

    #[test]
    fn the_largest_load_is_planned() {
        let (pickups, ready, names) = paper_example();
        let best = plan_picks(&pickups, &ready, &[], 2);
        assert_eq!(best.picks.iter().map(|pick| pick.object).collect::<Vec<_>>(), [0, 1]);
        assert!((best.volume - 0.9 * (40e-6 + 0.8 * 480e-6)).abs() < 1e-12);
        assert!(
            describe_plan(&best, &pickups, &names).starts_with("golf with little finger (holds with 0.90), then soft")
        );
        assert_eq!(plan_picks(&pickups, &ready, &[], 0), PickPlan::default());
    }

    #[test]
    fn another_object_where_a_digit_is_taken() {
        let (pickups, ready, names) = paper_example();
        let planned = plan_picks(&pickups, &ready, &[], 2);
        let now = plan_picks(&pickups, &ready[1..], &[Digit::Ring], 2);
        assert_eq!(now.picks.iter().map(|pick| pick.object).collect::<Vec<_>>(), [2]);
        let why = explain_replan(&planned.picks[1..], &now, &pickups, &[Digit::Ring], &names).unwrap();
        assert_eq!(
            why,
            "soft as planned needs thumb, index, middle and ring finger, of which ring finger holds something already"
        );
        // With the little finger on it, the plan stays.
        let as_planned = plan_picks(&pickups, &ready[1..], &[Digit::Little], 2);
        assert!(explain_replan(&planned.picks[1..], &as_planned, &pickups, &[Digit::Little], &names).is_none());
    }

    /// Failed pickups and those never verified beside these digits count less, and improbable ones are not tried.
    #[test]
    fn doubts_count() {
        let (pickups, mut ready, _) = paper_example();
        ready[2].skills = vec![(2, 1)];
        assert!((plan_picks(&pickups, &ready[2..], &[Digit::Ring], 1).volume - 0.45 * 180e-6).abs() < 1e-12);
        ready[2].skills = vec![(2, 2)];
        assert!(plan_picks(&pickups, &ready[2..], &[Digit::Ring], 1).picks.is_empty());
    }

    /// A digit with a blind pad, or a blocked finger, holds. A thumb holds only with fingers, and a digit that does not
    /// close holds nothing.
    #[test]
    fn only_digits_that_close_and_are_stopped_hold() {
        let hand = Hand::ftac();
        let limits = hand.parameters.hold().expect("signs of a hold");
        let with = (&hand, &limits);
        let closed = servos(&hand, [1.0; 5]);
        let pad = hand.pads.iter().position(|pad| hand.digit_of(pad.link) == Some(Digit::Ring)).unwrap();
        let blind = [PadTouch { pad, blind: true, ..PadTouch::default() }];
        assert_eq!(holding_digits(with, &blind, &closed, &[Digit::Ring, Digit::Little]), [Digit::Ring]);
        assert!(holding_digits(with, &blind, &closed, &[Digit::Little]).is_empty());
        assert!(holding_digits(with, &[], &servos(&hand, [0.5, 1.0, 1.0, 1.0, 1.0]), &THREE).is_empty());
        let stopped = servos(&hand, [1.0, 0.5, 1.0, 1.0, 1.0]);
        assert_eq!(holding_digits(with, &[], &stopped, &THREE), [Digit::Thumb, Digit::Index]);
    }
}
