//! Grasps that the arm can carry out at an object's detected pose, turned about the vertical where the object allows
//! it.

use dexterous_grasping::Grasp;
use hand_model::Digit;
use world::objects::ObjectModel;

use super::Knowledge;
use super::tracked::TrackedObject;
use crate::detection::DetectedObject;
use crate::fallback_grasp::fallback_grasps;
use crate::score::GraspCandidate;

/// Yaws that are tried if an object is out of reach of the planned grasp, rad.
pub const YAW_CANDIDATES: [f64; 15] =
    [0.0, 0.2, -0.2, 0.4, -0.4, 0.6, -0.6, 0.8, -0.8, 1.0, -1.0, 1.2, -1.2, 1.4, -1.4];

/// Variants of `grasp` from all sides from which the object looks the same, as far as the arm can reach them; the
/// unturned one first.
pub fn yaw_variants<'a>(
    knowledge: &'a Knowledge,
    grasp: &'a Grasp,
    seen: &'a DetectedObject,
    object: &ObjectModel,
) -> impl Iterator<Item = Grasp> + use<'a> {
    let turns = if object.round_about_vertical(&seen.rotation) {
        YAW_CANDIDATES.to_vec()
    } else {
        let others = object.resting_yaws(&seen.rotation).into_iter().map(|yaw| yaw - seen.yaw);
        std::iter::once(0.0).chain(others.filter(|turn| turn.abs() > 1e-6)).collect()
    };
    turns
        .into_iter()
        .map(|turn| Grasp { yaw: grasp.yaw + turn, ..grasp.clone() })
        .filter(|grasp| knowledge.cell.reaches(&grasp.palm_pose(&seen.position, seen.yaw)))
}

/// Inputs of a search for grasps.
pub struct ReachQuery<'a> {
    pub object: &'a ObjectModel,
    /// Digits that take the object.
    pub digits: &'a [Digit],
    /// Grasps of the object in the pose that the plan expects.
    pub candidates: &'a [GraspCandidate],
    /// Record of the failures in this trial.
    pub tracked: &'a TrackedObject,
}

/// Candidates whose grasp the arm can reach. For an object that fell over, grasps of objects that lie like it.
pub fn reachable_candidates(knowledge: &Knowledge, wanted: &ReachQuery, seen: &DetectedObject) -> Vec<GraspCandidate> {
    let turn_into_reach = |candidate: &GraspCandidate| {
        let grasp = yaw_variants(knowledge, &candidate.grasp, seen, wanted.object).next()?;
        let trust = wanted.tracked.failure_factor(grasp.id);
        Some(GraspCandidate {
            grasp,
            score: candidate.score * trust,
            failure_factor: trust,
            rollouts: candidate.rollouts.clone(),
        })
    };
    let own: Vec<GraspCandidate> = match wanted.object.resting_yaw(&seen.rotation) {
        Some(_) => wanted.candidates.iter().filter_map(turn_into_reach).collect(),
        None => Vec::new(),
    };
    if !own.is_empty() {
        return own;
    }
    let (library, repertoire) = (knowledge.library, knowledge.repertoire);
    let others =
        fallback_grasps((library, repertoire), (wanted.object, seen), wanted.digits, &knowledge.fallen_candidates);
    others.iter().filter_map(turn_into_reach).collect()
}
