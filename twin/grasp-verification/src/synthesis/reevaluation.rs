//! Repeated verification: the grasps of a file are closed once more from their open hands and checked once more, with
//! negative controls.
//!
//! A file states that its grasps were verified. This repeats the verification on this machine and with this version of
//! the physics.

use std::time::Instant;

use anyhow::Result;
use dexterous_grasping::synthesis::collection::ObjectGrasps;
use dexterous_grasping::synthesis::held::{HeldGrasp, pose_from_array};
use rayon::prelude::*;

use super::checks::{self, MAX_PENETRATION, MIN_MARGIN};
use super::closing;
use super::evaluation::{self, Evaluation, EvaluationRow};
use super::grasp_file::GraspFile;
use super::grasping_hand::GraspingHand;
use super::subject::{PreparedObject, verified_for};

/// Metrics of the evaluation that are known for a grasp that is closed again.
const METRIC_NAMES: [&str; 2] = ["margin", "contacts"];

/// Returns an evaluation for each object of `file`, or for `object` alone.
pub fn evaluate(file: &GraspFile, object: Option<&str>) -> Result<Vec<Evaluation>> {
    let wanted = |entry: &&ObjectGrasps| object.is_none_or(|name| name == entry.summary.object);
    file.collection.objects.iter().filter(wanted).map(|entry| evaluate_object(file, entry)).collect()
}

/// Closes every grasp of an object with the mass and friction for which it was verified.
fn evaluate_object(file: &GraspFile, entry: &ObjectGrasps) -> Result<Evaluation> {
    let (name, grasps) = (&entry.summary.object, &entry.grasps);
    let start = Instant::now();
    let mut subjects: Vec<((f64, f64), PreparedObject)> = Vec::new();
    for load in grasps.iter().map(verified_for) {
        if !subjects.iter().any(|(known, _)| *known == load) {
            subjects.push((load, file.subject(name, load.0, load.1)?));
        }
    }
    let rows = grasps
        .par_iter()
        .filter_map(|grasp| {
            let (_, subject) = subjects.iter().find(|(known, _)| *known == verified_for(grasp))?;
            Some(close_again(&file.hand, subject, grasp))
        })
        .collect::<Result<Vec<_>>>()?;
    Ok(Evaluation { wall_s: start.elapsed().as_secs_f64(), ..evaluation::summarize(name, &rows, &METRIC_NAMES) })
}

/// Closes a grasp once more. Returns `None` if it does not close.
fn close_again(hand: &GraspingHand, subject: &PreparedObject, grasp: &HeldGrasp) -> Result<Option<EvaluationRow>> {
    let (open, tensions) = (hand.open_posture(grasp), grasp.tensions.to_vec());
    // A grasp that needs more effort than the hand's joints bear counts as not held.
    let bearable = hand.limited_to_efforts(&tensions) == tensions;
    let Ok(closed) = closing::close_open_hand(hand, subject, pose_from_array(&grasp.start), open, tensions) else {
        return Ok(None);
    };
    let (margin, penetration) = (checks::margin(hand, subject, &closed)?, checks::penetration(hand, subject, &closed));
    let mass = subject.model.mass;
    let held = bearable && checks::run_hold_test(&closed, mass).held;
    let controls = held.then(|| evaluation::controls(&closed, mass));
    let verdicts = [margin >= MIN_MARGIN, penetration <= MAX_PENETRATION, held];
    Ok(Some(EvaluationRow { verdicts, metrics: vec![margin, closed.touches.len() as f64], controls }))
}
