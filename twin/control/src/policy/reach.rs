//! Grasps that the arm can carry out at an object's percept, turned about the vertical where the object allows it.

use dexterous_grasping::Grasp;
use hand_model::Digit;
use world::objects::ObjectModel;

use super::Knowledge;
use super::tracked::Tracked;
use crate::percept::Percept;
use crate::stand_in::stand_ins;
use crate::worth::Candidate;

/// Yaws that are tried if an object is out of reach of the planned grasp, rad.
pub const TURNS: [f64; 15] = [0.0, 0.2, -0.2, 0.4, -0.4, 0.6, -0.6, 0.8, -0.8, 1.0, -1.0, 1.2, -1.2, 1.4, -1.4];

/// Variants of `grasp` from all sides from which the object looks the same, as far as the arm can reach them; the
/// unturned one first.
pub fn turned<'a>(
    knowledge: &'a Knowledge,
    grasp: &'a Grasp,
    seen: &'a Percept,
    object: &ObjectModel,
) -> impl Iterator<Item = Grasp> + use<'a> {
    let turns = if object.round_about_vertical(&seen.rotation) {
        TURNS.to_vec()
    } else {
        let others = object.standing_yaws(&seen.rotation).into_iter().map(|yaw| yaw - seen.yaw);
        std::iter::once(0.0).chain(others.filter(|turn| turn.abs() > 1e-6)).collect()
    };
    turns
        .into_iter()
        .map(|turn| Grasp { yaw: grasp.yaw + turn, ..grasp.clone() })
        .filter(|grasp| knowledge.cell.reaches(&grasp.palm_pose(&seen.position, seen.yaw)))
}

/// Inputs of a search for grasps.
pub struct Wanted<'a> {
    pub object: &'a ObjectModel,
    /// Digits that take the object.
    pub digits: &'a [Digit],
    /// Grasps of the object in the pose that the plan expects.
    pub candidates: &'a [Candidate],
    /// Record of the failures in this trial.
    pub tracked: &'a Tracked,
}

/// Candidates whose grasp the arm can reach. For an object that fell over, grasps of objects that lie like it.
pub fn within_reach(knowledge: &Knowledge, wanted: &Wanted, seen: &Percept) -> Vec<Candidate> {
    let turn_into_reach = |candidate: &Candidate| {
        let grasp = turned(knowledge, &candidate.grasp, seen, wanted.object).next()?;
        let trust = wanted.tracked.trust(grasp.id);
        Some(Candidate { grasp, worth: candidate.worth * trust, trust, rehearsed: candidate.rehearsed.clone() })
    };
    let own: Vec<Candidate> = match wanted.object.standing_yaw(&seen.rotation) {
        Some(_) => wanted.candidates.iter().filter_map(turn_into_reach).collect(),
        None => Vec::new(),
    };
    if !own.is_empty() {
        return own;
    }
    let (library, repertoire) = (knowledge.library, knowledge.repertoire);
    let others = stand_ins((library, repertoire), (wanted.object, seen), wanted.digits, &knowledge.fallen);
    others.iter().filter_map(turn_into_reach).collect()
}
