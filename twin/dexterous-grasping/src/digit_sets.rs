//! Sets of digits: those that take the objects of a trial in turn, and proposals for any set.
//!
//! [`crate::sampler`] covers the two ways in which the benchmark's pairs are picked up. To carry more than two objects,
//! each must be held with fewer digits: a ball by one or more fingers against the palm, or between thumb and fingers.
//! The distributions of [`propose_ball_grasp`] are wide, and physics decides which proposals hold.

use hand_model::{Digit, Hand};
use rand::{Rng, RngExt};

use crate::grasp::Grasp;

/// Returns the set of digits that takes each of `objects` objects in turn, as given by the hand's file. A set is empty
/// if no digit is left for it. Without such data, thumb, index and middle finger take the last object and the other
/// digits those before it. A single object is taken by these other digits, if there are any. If there are more objects
/// than sets, each object but the last gets one digit, the outermost first.
///
/// ```
/// use dexterous_grasping::digit_sets;
/// use hand_model::{Digit, Hand};
///
/// let sets = digit_sets(&Hand::ftac(), 2);
/// assert_eq!(sets[0], [Digit::Ring, Digit::Little]);
/// assert_eq!(sets[1], [Digit::Thumb, Digit::Index, Digit::Middle]);
/// ```
pub fn digit_sets(hand: &Hand, objects: usize) -> Vec<Vec<Digit>> {
    let own = hand.parameters.grasps.as_ref().map_or(&[][..], |grasps| &grasps.set);
    let has = |set: &[Digit]| set.iter().all(|digit| hand.digits().contains(digit));
    let mut sets: Vec<Vec<Digit>> = own.iter().map(|set| set.digits.clone()).filter(|set| has(set)).collect();
    if sets.is_empty() {
        let (last, others) = hand.digits().iter().partition::<Vec<Digit>, _>(|digit| **digit <= Digit::Middle);
        sets = vec![others, last];
        sets.sort_by_key(Vec::is_empty);
    }
    if objects > sets.len().max(2) {
        let (last, others) = (sets.pop().unwrap_or_default(), sets.concat());
        let single: Vec<Vec<Digit>> = others.iter().rev().map(|digit| vec![*digit]).collect();
        if single.len() + 1 < objects {
            return vec![Vec::new(); objects];
        }
        return single.into_iter().take(objects - 1).chain([last]).collect();
    }
    sets.resize(objects, Vec::new());
    sets
}

/// Formats digits as text: "thumb, index and middle finger".
pub fn describe_digits(digits: &[Digit]) -> String {
    let names: Vec<&str> = digits.iter().map(|digit| digit.name()).collect();
    match names.split_last() {
        Some((last, [])) => format!("{last} finger"),
        Some((last, others)) => format!("{} and {last} finger", others.join(", ")),
        None => "no digit".to_owned(),
    }
}

/// Proposes a random grasp of a ball of `radius` (m) called `object` with `digits`.
pub fn propose_ball_grasp(
    hand: &Hand,
    digits: &[Digit],
    object: &str,
    radius: f64,
    id: u32,
    rng: &mut impl Rng,
) -> Grasp {
    let mut uniform = |low: f64, high: f64| rng.random_range(low..high);
    let deg = std::f64::consts::PI / 180.0;
    let fingers: Vec<Digit> = digits.iter().copied().filter(|digit| *digit != Digit::Thumb).collect();
    let column = |digit: &Digit| hand.tree.joints[hand.links(*digit)[0]].origin.translation.x;
    let middle = fingers.iter().map(column).sum::<f64>() / fingers.len().max(1) as f64;
    let opposed = fingers.len() < digits.len();
    let (mut pre, mut close) = (hand.slack_tensions(), hand.slack_tensions());
    for digit in digits {
        pre[digit.index()] = uniform(1.0, 4.0);
        close[digit.index()] = uniform(10.0, 36.0);
    }
    let [roll, pitch, along, gap] = if opposed {
        [uniform(-15.0, 35.0), uniform(5.0, 45.0), uniform(0.086, 0.134), uniform(0.002, 0.03)]
    } else {
        [uniform(-85.0, 10.0), uniform(-20.0, 25.0), uniform(0.045, 0.115), uniform(0.001, 0.016)]
    };
    let of = hand.parameters.grasps();
    Grasp {
        id,
        object: object.to_owned(),
        digits: Digit::ALL.into_iter().filter(|digit| digits.contains(digit)).collect(),
        yaw: 0.0,
        pitch: deg * pitch,
        roll: deg * roll,
        center: [middle + uniform(-0.02, 0.02), along - of.wrist, of.palm_face - gap - radius],
        pre_tension: pre,
        close_tension: close,
        opposition: deg * if opposed { uniform(40.0, 90.0) } else { uniform(0.0, 20.0) },
        raise: uniform(0.0, if opposed { 0.02 } else { 0.008 }),
        thumb_delay: if opposed { uniform(-0.25, 0.18) } else { 0.0 },
        held: None,
        held_joints: None,
        held_sigmas: None,
        score: 0.0,
    }
}
