//! Evaluation of the accuracy and latency of touch, from images to poses: on simulated grasps, on held-out shapes,
//! under changed optics, and on a real sensor. [`figures`] and [`table`] report the results.

pub mod figures;
pub mod table;

use crate::touch::networks::{METHOD_IN_USE, Networks, NormalMethod};
use anyhow::Result;
use bench::builtin::{HAND_UNIT, simulated_touch_pipeline};
use bench::trial::{Bench, HeldGrasp};
use schemars::JsonSchema;
use serde::Serialize;

use super::images::{CameraUnit, OpticsChange};
use super::normals::{NormalErrors, RealRow, RealSource, SampledPress, evaluate_normals, press_unseen_shapes};
use super::poses::{ErrorPercentiles, PoseEvaluation, PoseSource, SymmetryClass, error_percentiles, evaluate_poses};

/// Acceptance limits on the position error of objects without symmetry: median and 95th percentile, mm.
const ACCEPTANCE_LIMITS: [f64; 2] = [0.5, 2.0];

/// Results of `ftac touch eval`.
pub struct TouchEvaluation {
    /// Every grasp, as perceived by the pipeline used in trials.
    pub felt: Vec<PoseEvaluation>,
    /// Results as built, then under every change of the optics.
    pub changed: Vec<ChangedOptics>,
    /// Results on the real sensor, if its presses are available.
    pub real: Option<(RealSource, Vec<RealRow>)>,
}

/// Accuracy of normals and poses under one change of the optics.
#[derive(Serialize, JsonSchema)]
pub struct ChangedOptics {
    /// Name of the change.
    change: &'static str,
    /// Errors of normals on the held-out shapes, by method.
    normals: Vec<(NormalMethod, NormalErrors)>,
    /// Errors of poses by method; under a change only for the method used in trials.
    poses: Vec<(NormalMethod, ErrorPercentiles)>,
}

impl TouchEvaluation {
    /// Returns the reason why the poses fail, if they do.
    pub fn shortfall(&self) -> Option<String> {
        let found = error_percentiles(&self.felt, PoseSource::Touch, |felt| felt.class == SymmetryClass::Irregular).mm;
        let (median, p95) = (found.median?, found.p95?);
        (median > ACCEPTANCE_LIMITS[0] || p95 > ACCEPTANCE_LIMITS[1]).then(|| {
            format!(
                "objects without symmetry are {median:.2} mm off in the median and {p95:.2} mm in the 95th percentile, limits {} and {}",
                ACCEPTANCE_LIMITS[0], ACCEPTANCE_LIMITS[1]
            )
        })
    }

    fn as_built(&self) -> &[(NormalMethod, NormalErrors)] {
        self.changed.first().map_or(&[], |row| &row.normals)
    }
}

fn of_method(rows: &[(NormalMethod, NormalErrors)], method: NormalMethod) -> Option<NormalErrors> {
    rows.iter().find(|row| row.0 == method).map(|row| row.1)
}

/// Presses held-out shapes, and perceives `count` grasps, evenly spread over the list, as built and under every change.
/// The background images are taken under the change too, like those of a hand at power-on.
pub fn under_changes(
    bench: &Bench,
    networks: &Networks,
    grasps: &[HeldGrasp],
    count: usize,
) -> Result<Vec<ChangedOptics>> {
    let some: Vec<HeldGrasp> = match count {
        0 => Vec::new(),
        _ => grasps.iter().step_by(grasps.len().div_ceil(count).max(1)).cloned().collect(),
    };
    let changes = if count == 0 { &[][..] } else { &OpticsChange::ALL };
    std::iter::once(&OpticsChange::NONE)
        .chain(changes)
        .map(|change| {
            let hand = &bench.world.cell.robot.hand;
            let detector = [CameraUnit::new(hand, HAND_UNIT, change)?, CameraUnit::new(hand, HAND_UNIT + 1, change)?];
            let look_up = simulated_touch_pipeline(&bench.world.cell.robot, detector[0].backgrounds())?;
            let sampled: Vec<SampledPress> = press_unseen_shapes(&detector, bench.seed)?;
            let normals = NormalMethod::ALL
                .map(|method| {
                    Ok((method, evaluate_normals(&sampled, &detector, &networks.pipeline(&look_up, method))?))
                })
                .into_iter()
                .collect::<Result<_>>()?;
            let poses = NormalMethod::ALL
                .into_iter()
                .filter(|method| !some.is_empty() && (*method == METHOD_IN_USE || *change == OpticsChange::NONE))
                .map(|method| {
                    let felt = evaluate_poses(bench, &detector[0], &networks.pipeline(&look_up, method), &some, || {})?;
                    Ok((method, error_percentiles(&felt, PoseSource::Touch, |_| true)))
                })
                .collect::<Result<_>>()?;
            Ok(ChangedOptics { change: change.name, normals, poses })
        })
        .collect()
}

/// Returns the steps from images to a pose with their latencies for each [`PoseEvaluation`], ms.
fn step_latencies(felt: &[PoseEvaluation]) -> [(&'static str, Vec<f64>); 3] {
    let of = |pick: &dyn Fn(&PoseEvaluation) -> f64| felt.iter().map(pick).collect();
    [
        ("images", of(&|felt| felt.millis[0])),
        ("pose", of(&|felt| felt.millis[1])),
        ("chain", of(&|felt| felt.millis.iter().sum())),
    ]
}
