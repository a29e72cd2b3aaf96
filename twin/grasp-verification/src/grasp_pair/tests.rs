use super::*;

/// Returns grasps with these scores, numbered from 0.
fn grasps(scores: &[f64]) -> Vec<Grasp> {
    let repertoire = crate::builtin::repertoire().expect("the built-in repertoire");
    let any = repertoire.for_digits("golf_ball", &digit_sets(&Hand::ftac(), 2)[1]).next().expect("a grasp").clone();
    scores.iter().enumerate().map(|(n, score)| Grasp { id: n as u32, score: *score, ..any.clone() }).collect()
}

/// Grasps that work come first, in the repertoire's order. Those that failed follow in theirs, at a discount.
#[test]
fn grasps_that_work_come_first() {
    let made = grasps(&[0.9, 0.5, 0.4, 1.0]);
    let all: Vec<&Grasp> = made.iter().collect();
    let found = ranked(&all, |grasp| Ok(grasp.id == 1 || grasp.id == 2)).expect("ranked");
    assert_eq!(found, [(1, 0.5), (2, 0.4), (0, FAILED_SCORE_FACTOR * 0.9), (3, FAILED_SCORE_FACTOR)]);
}

/// A pair for which nothing works has no ranking.
#[test]
fn nothing_works() {
    let made = grasps(&[1.0, 1.0]);
    let all: Vec<&Grasp> = made.iter().collect();
    assert!(ranked(&all, |_| Ok(false)).expect("ranked").is_empty());
}

/// A grasp pair that names a grasp of other digits or another number is refused with both names.
#[test]
fn missing_grasps_are_named() {
    let repertoire = crate::builtin::repertoire().expect("the built-in repertoire");
    let mut plan = crate::builtin::grasp_pairs().expect("the built-in plans").pairs.swap_remove(0);
    assert!(plan.grasps(&Hand::ftac(), &repertoire).is_ok());
    plan.second_grasps.push((987_654, 1.0));
    let error = plan.grasps(&Hand::ftac(), &repertoire).expect_err("no such grasp").to_string();
    assert!(error.contains("987654") && error.contains(&plan.second), "{error}");
}
