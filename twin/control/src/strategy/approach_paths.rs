//! Collision-free approach paths: the first path that stays clear of given solids.

use hand_model::Hand;
use nalgebra::Isometry3;

use super::StrategyError;
use super::solids::{HeldObject, held_solids, transformed};
use crate::collision::{Solid, clearance_along};
use crate::detection::DetectedObject;
use crate::motion::MotionError;
use crate::palpation::PalpationPaths;
use crate::trajectory::PosePath;

/// Clearance that the held object keeps from other solids during a palpation, m.
pub const PALPATION_CLEARANCE: f64 = 0.012;

/// Smallest distance (m) of `moving` from `fixed` along `path` by way of `stops`. With two stops or more it is computed
/// from the second one on, because the hand may touch something at the first one and rises from there.
pub(super) fn clearance_after(
    stops: &[Isometry3<f64>],
    moving: &[Solid],
    fixed: &[Solid],
    path: impl Fn(&[Isometry3<f64>]) -> Result<PosePath, MotionError>,
) -> Result<f64, StrategyError> {
    let path = path(&stops[stops.len().min(2) - 1..])?;
    Ok(clearance_along(&path, moving, fixed, 2000)?.map_or(f64::INFINITY, |found| found.min_distance))
}

/// Returns the first of `options` whose clearance (m) exceeds `enough`, else the one with the largest, together with
/// its clearance.
pub(super) fn first_clear_option<T>(
    options: impl Iterator<Item = T>,
    enough: f64,
    clearance: impl Fn(&T) -> Result<f64, StrategyError>,
) -> Result<Option<(f64, T)>, StrategyError> {
    let mut best: Option<(f64, T)> = None;
    for option in options {
        let clearance = clearance(&option)?;
        if best.as_ref().is_none_or(|(least, _)| clearance > *least) {
            best = Some((clearance, option));
        }
        if clearance > enough {
            break;
        }
    }
    Ok(best)
}

/// Via poses of the first path that keeps the hand, `moving` with the palm, clear of `fixed`, else of the path with the
/// largest clearance. Returned with the smallest distance, m. `path` leads by way of stops to the approach pose.
pub fn clear_via_poses(
    moving: &[Solid],
    fixed: &[Solid],
    paths: impl Iterator<Item = Vec<Isometry3<f64>>>,
    path: impl Fn(&[Isometry3<f64>]) -> Result<PosePath, MotionError>,
) -> Result<(f64, Vec<Isometry3<f64>>), StrategyError> {
    let best = first_clear_option(paths, PALPATION_CLEARANCE, |stops| clearance_after(stops, moving, fixed, &path))?;
    Ok(best.unwrap_or((f64::NEG_INFINITY, Vec::new())))
}

/// First path that keeps the held object clear enough of the table and of `target` at `detected`, else the path with
/// the largest clearance. `None` if every path makes them collide.
pub fn clearest_palpation(
    hand: &Hand,
    held: &HeldObject,
    (target, detected): (&[Solid], &DetectedObject),
    paths: impl Iterator<Item = PalpationPaths>,
) -> Result<Option<PalpationPaths>, StrategyError> {
    let moving = held_solids(hand, held, (&held.pose, &held.joints));
    let mut fixed = transformed(target, &detected.pose());
    fixed.push(Solid::table(0.0));
    let best = first_clear_option(paths, PALPATION_CLEARANCE, |way: &PalpationPaths| {
        let mut clearance = f64::INFINITY;
        for path in [&way.approach, &way.guarded_motion] {
            let found = clearance_along(path, &moving, &fixed, 2000)?;
            clearance = clearance.min(found.map_or(f64::INFINITY, |found| found.min_distance));
        }
        Ok(clearance)
    })?;
    Ok(best.filter(|(clearance, _)| *clearance > 0.0).map(|(_, way)| way))
}
