//! Built-in verified grasps and grasp pairs, which come with the program.

use std::path::Path;

use anyhow::Result;
use dexterous_grasping::Repertoire;
use hand_model::RobotModel;

use crate::grasp_pair::GraspPairTable;

/// Returns the benchmark's repertoire.
pub fn repertoire() -> Result<Repertoire> {
    Ok(Repertoire::parse(include_str!("../data/repertoire.json"), Path::new("data/repertoire.json"))?)
}

/// True if the built-in grasps and grasp pairs fit `robot`: it moves like the built-in robot, or is an instance of one
/// that does.
pub fn fits_robot(robot: &RobotModel) -> Result<bool> {
    Ok(robot.sources.is_none() || Repertoire::robot_identity(&robot.nominal()?).is_none())
}

/// Returns the benchmark's 60 combinations, planned without noise.
pub fn grasp_pairs() -> Result<GraspPairTable> {
    GraspPairTable::parse(include_str!("../data/grasp_pairs.json"), Path::new("data/grasp_pairs.json"))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use hand_model::{Digit, Hand};

    use super::*;

    /// Every grasp pair names a first grasp of its first object and second grasps of its second object. No ordered pair
    /// of objects occurs twice.
    #[test]
    fn plans_name_grasps_of_the_repertoire() {
        let (repertoire, plans) = (repertoire().unwrap(), grasp_pairs().unwrap());
        let sets = dexterous_grasping::digit_sets(&Hand::ftac(), 2);
        assert_eq!(plans.pairs.len(), 60);
        let mut pairs = BTreeSet::new();
        for plan in &plans.pairs {
            let pair = (&plan.first, &plan.second);
            assert!(pairs.insert(pair), "{pair:?} occurs twice");
            let has = |object: &str, place: usize, id: u32| {
                repertoire.for_digits(object, &sets[place]).any(|grasp| grasp.id == id)
            };
            assert!(has(&plan.first, 0, plan.first_grasp), "{pair:?}: first grasp {}", plan.first_grasp);
            assert!(!plan.second_grasps.is_empty(), "{pair:?}: no second grasp");
            let mut numbers = BTreeSet::new();
            for (id, score) in &plan.second_grasps {
                assert!(has(&plan.second, 1, *id), "{pair:?}: second grasp {id}");
                assert!(numbers.insert(id), "{pair:?}: second grasp {id} is named twice");
                assert!((0.0..=1.0).contains(score), "{pair:?}: second grasp {id}: score {score}");
            }
        }
        for plan in &plans.pairs {
            let candidates = plan.grasps(&Hand::ftac(), &repertoire).unwrap().second_candidates;
            let known = candidates.iter().filter(|candidate| !candidate.rollouts.is_empty()).count();
            assert!(
                known > 0
                    && known == plan.verification.as_ref().map_or(plan.outcomes.len(), |proof| proof.grasps.len()),
                "{}, {}: rollouts of {known} grasps",
                plan.first,
                plan.second
            );
            assert!(
                !candidates[0].rollouts.is_empty(),
                "{}, {}: no rollouts of the planned grasp",
                plan.first,
                plan.second
            );
        }
        for rejected in &plans.rejected {
            assert!(!pairs.contains(&(&rejected[0], &rejected[1])), "{rejected:?} is planned and rejected");
        }
    }

    /// A number identifies one grasp of an object and set of digits, so that a grasp pair that names it is unambiguous.
    #[test]
    fn numbers_of_grasps_are_unique() {
        let repertoire = repertoire().unwrap();
        for (object, grasps) in &repertoire.grasps {
            let numbers: BTreeSet<(&[Digit], u32)> = grasps.iter().map(|grasp| (&grasp.digits[..], grasp.id)).collect();
            assert_eq!(numbers.len(), grasps.len(), "{object}");
            assert!(grasps.iter().all(|grasp| grasp.object == *object), "{object}");
        }
    }
}
