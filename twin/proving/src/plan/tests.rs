use std::cell::Cell;

use super::*;

/// Grasps with these scores, numbered from 0.
fn grasps(scores: &[f64]) -> Vec<Grasp> {
    let repertoire = crate::builtin::repertoire().expect("the built-in repertoire");
    let any = repertoire.of("golf_ball", Role::Second).next().expect("a grasp").clone();
    scores.iter().enumerate().map(|(n, score)| Grasp { id: n as u32, score: *score, ..any.clone() }).collect()
}

/// Grasps that work come first, the most robust one in front; those that failed follow in their own order, at a discount.
#[test]
fn grasps_that_work_come_first() {
    let made = grasps(&[0.9, 0.5, 0.4, 1.0]);
    let all: Vec<&Grasp> = made.iter().collect();
    let works = |grasp: &Grasp| Ok(grasp.id == 1 || grasp.id == 2);
    let robustness = |grasp: &Grasp| Ok(if grasp.id == 2 { 0.8 } else { 0.2 });
    let found = ranked(&all, works, robustness).expect("ranked");
    assert_eq!(found, [(2, 0.8), (1, 0.2), (0, FAILED_WORTH * 0.9), (3, FAILED_WORTH)]);
}

/// A pair for which nothing works has no ranking, and nothing is tried under noise.
#[test]
fn nothing_works() {
    let made = grasps(&[1.0, 1.0]);
    let all: Vec<&Grasp> = made.iter().collect();
    let found = ranked(&all, |_| Ok(false), |_| panic!("tried under noise")).expect("ranked");
    assert!(found.is_empty());
}

/// Only the first few that work are tried under noise; the others count by their score. Of equals the earlier one stays ahead.
#[test]
fn only_the_first_few_are_tried_under_noise() {
    let made = grasps(&[1.0; PROVEN + 2]);
    let all: Vec<&Grasp> = made.iter().collect();
    let tried = Cell::new(0);
    let robustness = |_: &Grasp| {
        tried.set(tried.get() + 1);
        Ok(0.5)
    };
    let found = ranked(&all, |_| Ok(true), robustness).expect("ranked");
    assert_eq!(tried.get(), PROVEN);
    // Unproven ones are worth 0.6 here, more than the proven ones' 0.5.
    let order: Vec<u32> = found.iter().map(|(id, _)| *id).collect();
    let (proven, unproven): (Vec<u32>, Vec<u32>) = (0..all.len() as u32).partition(|id| (*id as usize) < PROVEN);
    assert_eq!(order, [unproven, proven].concat());
}

/// A plan that names a grasp of another role or number is refused with both names.
#[test]
fn missing_grasps_are_named() {
    let repertoire = crate::builtin::repertoire().expect("the built-in repertoire");
    let mut plan = crate::builtin::plans().expect("the built-in plans").plans.swap_remove(0);
    assert!(plan.grasps(&repertoire).is_ok());
    plan.second_grasps.push((987_654, 1.0));
    let error = plan.grasps(&repertoire).expect_err("no such grasp").to_string();
    assert!(error.contains("987654") && error.contains(&plan.second), "{error}");
}
