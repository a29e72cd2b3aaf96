//! Repeated verification: the grasps of a file are closed once more from their open hands and checked once more, with
//! negative controls.
//!
//! A file claims that its grasps were verified. This repeats the verification on this machine and with this version of
//! the physics.

use std::time::Instant;

use anyhow::Result;
use dexterous_grasping::synthesis::collection::ObjectGrasps;
use dexterous_grasping::synthesis::held::{HeldGrasp, pose_from_array};
use rayon::prelude::*;

use super::checks::{self, LEAST_MARGIN, MOST_PENETRATION};
use super::closing;
use super::evaluation::{self, Evaluation, Row};
use super::grasp_file::GraspFile;
use super::grasping_hand::GraspingHand;
use super::subject::{Subject, verified_for};

/// Metrics of the evaluation that are known for a grasp that is closed again.
const METRICS: [&str; 2] = ["margin", "contacts"];

/// Returns an evaluation for each object of `file`, or for `object` alone.
pub fn evaluate(file: &GraspFile, object: Option<&str>) -> Result<Vec<Evaluation>> {
    let wanted = |entry: &&ObjectGrasps| object.is_none_or(|name| name == entry.summary.object);
    file.collection.objects.iter().filter(wanted).map(|entry| of_object(file, entry)).collect()
}

/// Closes every grasp of an object with the mass and friction for which it was verified.
fn of_object(file: &GraspFile, entry: &ObjectGrasps) -> Result<Evaluation> {
    let (name, grasps) = (&entry.summary.object, &entry.grasps);
    let start = Instant::now();
    let mut subjects: Vec<((f64, f64), Subject)> = Vec::new();
    for load in grasps.iter().map(verified_for) {
        if !subjects.iter().any(|(known, _)| *known == load) {
            subjects.push((load, file.subject(name, load.0, load.1)?));
        }
    }
    let rows = grasps
        .par_iter()
        .filter_map(|grasp| {
            let (_, subject) = subjects.iter().find(|(known, _)| *known == verified_for(grasp))?;
            Some(row(&file.hand, subject, grasp))
        })
        .collect::<Result<Vec<_>>>()?;
    Ok(Evaluation { wall_s: start.elapsed().as_secs_f64(), ..evaluation::summarize(name, &rows, &METRICS) })
}

/// Closes a grasp once more. Returns `None` if it does not close.
fn row(hand: &GraspingHand, subject: &Subject, grasp: &HeldGrasp) -> Result<Option<Row>> {
    let (open, tensions) = (hand.reopened(grasp), grasp.tensions.to_vec());
    // A grasp that needs more effort than the hand's joints bear counts as not held.
    let bearable = hand.bearable(&tensions) == tensions;
    let Ok(closed) = closing::pull(hand, subject, pose_from_array(&grasp.start), open, tensions) else {
        return Ok(None);
    };
    let (margin, penetration) = (checks::margin(hand, subject, &closed)?, checks::penetration(hand, subject, &closed));
    let mass = subject.model.mass;
    let held = bearable && checks::hold(&closed, mass).held;
    let controls = held.then(|| evaluation::controls(&closed, mass));
    let verdicts = [margin >= LEAST_MARGIN, penetration <= MOST_PENETRATION, held];
    Ok(Some(Row { verdicts, metrics: vec![margin, closed.touches.len() as f64], controls }))
}
