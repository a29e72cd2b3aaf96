//! The grasps of a file closed once more from their open hands and checked once more, with negative controls.
//!
//! A file says that its grasps were verified; this shows it, on this machine and with this version of the physics.

use std::sync::Arc;
use std::time::Instant;

use anyhow::Result;
use grasping::synthesis::held::{AnyHeld, HeldGrasp, pose_from_array, values};
use grasping::synthesis::posture::project;
use grasping::synthesis::surface::HandSurface;
use hand_model::Hand;
use rayon::prelude::*;

use super::any::closing::{self as any_closing, AnyClosed, AnyOpen};
use super::any::describe::Described;
use super::checks::{self, LEAST_MARGIN, MOST_PENETRATION};
use super::closing;
use super::evaluation::{self, Evaluation, Row, SLIPPERY};
use super::grasp_file::{GraspFile, Grasps};
use super::subject::{Subject, verified_for};
use super::synthesizer::SURFACE_POINTS;

/// What is known of a grasp that is closed again: metrics of the evaluation.
const METRICS: [&str; 2] = ["margin", "contacts"];

/// An evaluation for each object of `file`, or for `object` alone; `own` is the hand of grasps that are not another URDF's.
pub fn evaluate(own: &Arc<Hand>, file: &GraspFile, object: Option<&str>) -> Result<Vec<Evaluation>> {
    let wanted = |name: &str| object.is_none_or(|object| object == name);
    match &file.grasps {
        Grasps::Ours(collection) => {
            let surface = HandSurface::new(own, SURFACE_POINTS);
            let entries = collection.objects.iter().filter(|entry| wanted(&entry.summary.object));
            entries
                .map(|entry| {
                    let loads: Vec<(f64, f64)> = entry.grasps.iter().map(verified_for).collect();
                    of_object(file, &entry.summary.object, &entry.grasps, &loads, |subject, grasp| {
                        ours(own, &surface, subject, grasp)
                    })
                })
                .collect()
        }
        Grasps::Other(other) => {
            let by_object = other.by_object();
            let entries = by_object.iter().filter(|(name, _)| wanted(name));
            entries
                .map(|(name, grasps)| {
                    let loads: Vec<(f64, f64)> =
                        grasps.iter().map(|grasp| (grasp.proof.mass, grasp.proof.friction)).collect();
                    of_object(file, name, grasps, &loads, |subject, grasp| another(&other.hand, subject, grasp))
                })
                .collect()
        }
    }
}

/// Closes every grasp of an object with the mass and friction that it was verified for.
fn of_object<G: Sync>(
    file: &GraspFile,
    name: &str,
    grasps: &[G],
    loads: &[(f64, f64)],
    close: impl Fn(&Subject, &G) -> Result<Option<Row>> + Sync,
) -> Result<Evaluation> {
    let start = Instant::now();
    let mut subjects: Vec<((f64, f64), Subject)> = Vec::new();
    for load in loads {
        if !subjects.iter().any(|(known, _)| known == load) {
            subjects.push((*load, file.subject(name, load.0, load.1)?));
        }
    }
    let rows = grasps
        .par_iter()
        .zip(loads)
        .filter_map(|(grasp, load)| {
            let (_, subject) = subjects.iter().find(|(known, _)| known == load)?;
            Some(close(subject, grasp))
        })
        .collect::<Result<Vec<_>>>()?;
    Ok(Evaluation { wall_s: start.elapsed().as_secs_f64(), ..evaluation::summarize(name, &rows, &METRICS) })
}

fn ours(hand: &Arc<Hand>, surface: &HandSurface, subject: &Subject, grasp: &HeldGrasp) -> Result<Option<Row>> {
    let open = project(hand, &grasp.open_joints);
    let Ok(closed) = closing::pull(hand, subject, &pose_from_array(&grasp.start), open, &grasp.tensions) else {
        return Ok(None);
    };
    let margin = checks::margin(subject, &closed)?;
    let penetration = checks::penetration(hand, surface, subject, &closed);
    let held = checks::hold(&closed, subject.model.mass).held;
    let controls = held.then(|| evaluation::controls(&closed, subject.model.mass));
    Ok(Some(row(margin, penetration, held, closed.touches.len(), controls)))
}

fn another(hand: &Described, subject: &Subject, grasp: &AnyHeld) -> Result<Option<Row>> {
    let open = AnyOpen {
        start: pose_from_array(&grasp.start),
        joints: values(&grasp.open_joints),
        tensions: values(&grasp.open_tensions),
    };
    let Ok(closed) = any_closing::pull(hand, subject, open, &values(&grasp.tensions)) else { return Ok(None) };
    let margin = any_closing::margin(subject, &closed)?;
    let mass = subject.model.mass;
    // A grasp that asks for more than the hand's joints bear is none.
    let bearable = hand.hand.within_efforts(&closed.tensions).1.is_empty();
    let held = bearable && checks::hold(&closed, mass).held;
    let controls = held.then(|| {
        let slack = AnyClosed { tensions: vec![0.0; closed.tensions.len()], ..closed.clone() };
        let mut slippery = closed.clone();
        slippery.stand.set_friction(SLIPPERY);
        [checks::hold(&slack, mass).held, checks::hold(&slippery, mass).held]
    });
    Ok(Some(row(margin, closed.stand.penetration(), held, closed.touches.len(), controls)))
}

fn row(margin: f64, penetration: f64, held: bool, contacts: usize, controls: Option<[bool; 2]>) -> Row {
    let verdicts = [margin >= LEAST_MARGIN, penetration <= MOST_PENETRATION, held];
    Row { verdicts, metrics: vec![margin, contacts as f64], controls }
}
