//! Grasp pairs without some digits: the grasps of the repertoire with those digits slack, as far as they still hold in
//! physics.
//!
//! A grasp has to pass the same test as in the repertoire: it is closed in physics and has to hold. The remaining
//! digits do more work, so each grasp that loses a digit is tried with the same tension and with more.

use anyhow::Result;
use dexterous_grasping::{Grasp, Repertoire, digit_sets};
use hand_model::Digit;
use rayon::prelude::*;
use sim::tactile::TactileBoard;

use super::{GraspPair, GraspPairTable, plan_pair};
use crate::rollout::{FirstGraspRollout, roll_out_first};
use crate::simulated_world::SimulatedWorld;

/// Factors on the tension of the remaining digits.
const TENSION_FACTORS: [f64; 2] = [1.0, 1.8];
/// Offset of the numbers of grasps that pull harder, per entry of [`TENSION_FACTORS`].
const NUMBER_OFFSET: u32 = 100_000;
/// Largest tension to which the tension of a cable is raised, N.
const MAX_TENSION: f64 = 60.0;
/// Number of first grasps after which second grasps are tried, the best ones.
const FIRST_GRASPS_TESTED: usize = 2;
/// Number of second grasps that are tried, the best ones.
const SECOND_GRASPS_TESTED: usize = 16;
/// Factor on the score of a grasp that has lost a digit, before it is verified.
const UNVERIFIED_SCORE_FACTOR: f64 = 0.7;

/// Grasps and grasp pairs without some digits.
pub struct ReducedGrasps {
    /// Remaining grasps.
    pub repertoire: Repertoire,
    /// One grasp pair per combination. A combination that cannot be done keeps its old one.
    pub pairs: GraspPairTable,
    /// Combinations that cannot be done, by number, with the reason.
    pub impossible: std::collections::BTreeMap<usize, String>,
}

/// Plans the combinations of `plans` again without `digits`.
pub fn plan_without_digits(
    world: &SimulatedWorld,
    repertoire: &Repertoire,
    plans: &GraspPairTable,
    digits: &[Digit],
) -> Result<ReducedGrasps> {
    let slack = without_digits(repertoire, digits);
    let sets = digit_sets(&world.cell.robot.hand, 2);
    let board = TactileBoard::unit(&world.cell.robot.hand, 0);
    let made: Vec<Result<PlannedPair>> =
        plans.pairs.par_iter().map(|plan| plan_reduced_pair(world, &slack, plan, digits, &board)).collect();
    let mut without = ReducedGrasps { repertoire: slack.clone(), pairs: plans.clone(), impossible: Default::default() };
    for list in without.repertoire.grasps.values_mut() {
        list.retain(|grasp| grasp.digits == sets[1]);
    }
    for (n, made) in made.into_iter().enumerate() {
        let (verified, plan) = made?;
        for grasp in verified {
            let known = without.repertoire.for_digits(&grasp.object, &sets[0]).any(|other| other.id == grasp.id);
            if !known {
                without.repertoire.insert(grasp);
            }
        }
        match plan {
            Ok(plan) => without.pairs.pairs[n] = plan,
            Err(why) => {
                without.impossible.insert(n, why);
            }
        }
    }
    Ok(without)
}

/// Verified first grasps of a combination with its grasp pair, or the reason why there is none.
type PlannedPair = (Vec<Grasp>, Result<GraspPair, String>);

fn plan_reduced_pair(
    world: &SimulatedWorld,
    slack: &Repertoire,
    plan: &GraspPair,
    digits: &[Digit],
    board: &TactileBoard,
) -> Result<PlannedPair> {
    let names = digits.iter().map(|digit| digit.name()).collect::<Vec<_>>().join(" and ");
    let sets = digit_sets(&world.cell.robot.hand, 2);
    let firsts: Vec<&Grasp> = slack.for_digits(&plan.first, &sets[0]).collect();
    let seconds = slack.for_digits(&plan.second, &sets[1]).count().min(SECOND_GRASPS_TESTED);
    let none = |why: String| Ok((Vec::new(), Err(why)));
    if firsts.is_empty() {
        return none(format!("no grasp holds {} first without {names}", plan.first));
    }
    if seconds == 0 {
        return none(format!("no grasp takes {} second without {names}", plan.second));
    }
    let verified = verify_firsts(world, &firsts, slack.for_digits(&plan.second, &sets[1]).next(), board)?;
    if verified.is_empty() {
        return none(format!(
            "{} grasps of {} without {names} were tried in physics and none holds it",
            firsts.len(),
            plan.first
        ));
    }
    let mut own = Repertoire::default();
    for grasp in verified
        .iter()
        .take(FIRST_GRASPS_TESTED)
        .chain(slack.for_digits(&plan.second, &sets[1]).take(SECOND_GRASPS_TESTED))
    {
        own.insert(grasp.clone());
    }
    let planned = plan_pair(world, &own, board, [&plan.first, &plan.second])?.ok_or_else(|| {
        format!(
            "{seconds} grasps of {} without {names} were tried in physics after {} of {} and none holds both",
            plan.second,
            verified.len().min(FIRST_GRASPS_TESTED),
            plan.first
        )
    });
    Ok((verified, planned))
}

/// Returns those of `firsts` that hold beside the object of `bystander`, with the object's pose in the hand.
fn verify_firsts(
    world: &SimulatedWorld,
    firsts: &[&Grasp],
    bystander: Option<&Grasp>,
    board: &TactileBoard,
) -> Result<Vec<Grasp>> {
    let Some(bystander) = bystander else { return Ok(Vec::new()) };
    let mut verified = Vec::new();
    for first in firsts {
        let grasps = [*first, bystander];
        let rollout = FirstGraspRollout::ideal(world, &grasps);
        if let Some((_, held)) = roll_out_first(world, &rollout, board)? {
            let (place, joints) = (Some(held.palm_from_object), Some(held.joints));
            verified.push(Grasp { held: place, held_joints: joints, ..(*first).clone() });
        }
    }
    Ok(verified)
}

/// Returns the grasps that have a digit left, with `digits` slack. Grasps that lose a digit are also added with more
/// tension.
fn without_digits(repertoire: &Repertoire, digits: &[Digit]) -> Repertoire {
    let mut masked = Repertoire { grasps: Default::default(), ..repertoire.clone() };
    for grasp in repertoire.grasps.values().flatten() {
        let left = grasp.digits.iter().filter(|digit| !digits.contains(digit)).count();
        let lost = grasp.digits.len() - left;
        // A single digit besides a thumb has nothing to close against. If no thumb closes, the palm is the opponent.
        let enough = if grasp.digits.contains(&Digit::Thumb) { 2 } else { 1 };
        if left < enough {
            continue;
        }
        let pulls = if lost > 0 { &TENSION_FACTORS[..] } else { &TENSION_FACTORS[..1] };
        for (n, pull) in pulls.iter().enumerate() {
            masked.insert(slackened(grasp, digits, *pull, NUMBER_OFFSET * n as u32));
        }
    }
    masked
}

fn slackened(grasp: &Grasp, digits: &[Digit], pull: f64, number: u32) -> Grasp {
    let lost = grasp.digits.iter().any(|digit| digits.contains(digit));
    let mut other = Grasp { id: grasp.id + number, ..grasp.clone() };
    for digit in Digit::ALL.into_iter().take(grasp.close_tension.len()) {
        let n = digit.index();
        if digits.contains(&digit) {
            (other.pre_tension[n], other.close_tension[n]) = (0.0, 0.0);
        } else {
            other.close_tension[n] = (pull * grasp.close_tension[n]).min(MAX_TENSION.max(grasp.close_tension[n]));
        }
    }
    if digits.contains(&Digit::Thumb) {
        other.opposition = 0.0;
    }
    if lost {
        other.score *= UNVERIFIED_SCORE_FACTOR;
    }
    other
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: &[Digit] = &[Digit::Ring, Digit::Little];
    const PINCH: &[Digit] = &[Digit::Thumb, Digit::Index, Digit::Middle];

    fn repertoire() -> Repertoire {
        crate::builtin::repertoire().unwrap()
    }

    /// No grasp pulls a digit that has no power. Grasps that did not use it are unchanged.
    #[test]
    fn what_has_no_power_is_not_pulled() {
        let (whole, index) = (repertoire(), Digit::Index);
        let slack = without_digits(&whole, &[index]);
        let of = |digits| slack.for_digits("golf_ball", digits).collect::<Vec<_>>();
        assert_eq!(of(SIDE), whole.for_digits("golf_ball", SIDE).collect::<Vec<_>>());
        assert_eq!(of(PINCH).len(), TENSION_FACTORS.len() * whole.for_digits("golf_ball", PINCH).count());
        for grasp in of(PINCH) {
            assert_eq!((grasp.pre_tension[1], grasp.close_tension[1]), (0.0, 0.0));
            assert!(grasp.close_tension[2] > 0.0 && grasp.close_tension.iter().all(|pull| *pull <= MAX_TENSION));
        }
        let mut numbers: Vec<u32> = of(PINCH).iter().map(|grasp| grasp.id).collect();
        numbers.sort_unstable();
        numbers.dedup();
        assert_eq!(numbers.len(), of(PINCH).len());
    }

    #[test]
    fn some_sets_leave_nothing() {
        let whole = repertoire();
        assert_eq!(without_digits(&whole, &[Digit::Ring, Digit::Little]).for_digits("golf_ball", SIDE).count(), 0);
        assert_eq!(without_digits(&whole, &[Digit::Thumb, Digit::Index]).for_digits("golf_ball", PINCH).count(), 0);
        assert!(
            without_digits(&whole, &[Digit::Thumb]).for_digits("golf_ball", PINCH).all(|grasp| grasp.opposition == 0.0)
        );
    }
}
