//! Evaluation of the accuracy and latency of touch, from images to poses: on simulated grasps, on unseen shapes, under
//! changed optics, and on a real sensor. [`figures`] and [`table`] report the results.

pub mod figures;
pub mod table;

use crate::touch::networks::{IN_USE, Method, Networks};
use anyhow::Result;
use bench::builtin::{HAND_UNIT, simulated_touch};
use bench::trial::{Bench, HeldGrasp};
use schemars::JsonSchema;
use serde::Serialize;

use super::images::{Change, Eyes};
use super::normals::{Measured, RealRow, RealSource, Sampled, measure, unseen};
use super::poses::{Class, FeltGrasp, PoseSource, Spread, feel, spread};

/// Acceptance limits on the position error of objects without symmetry: median and 95th percentile, mm.
const GOOD: [f64; 2] = [0.5, 2.0];

/// Results of `ftac touch eval`.
pub struct TouchEvaluation {
    /// Every grasp, as perceived by the pipeline that trials use.
    pub felt: Vec<FeltGrasp>,
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
    /// Errors of normals on the unseen shapes, by method.
    normals: Vec<(Method, Measured)>,
    /// Errors of poses by method; under a change only for the method that trials use.
    poses: Vec<(Method, Spread)>,
}

impl TouchEvaluation {
    /// Returns the reason why the poses fall short, if they do.
    pub fn shortfall(&self) -> Option<String> {
        let found = spread(&self.felt, PoseSource::Touch, |felt| felt.class == Class::Irregular).mm;
        let (median, p95) = (found.median?, found.p95?);
        (median > GOOD[0] || p95 > GOOD[1]).then(|| {
            format!(
                "objects without symmetry are {median:.2} mm off in the median and {p95:.2} mm in the 95th percentile, aim {} and {}",
                GOOD[0], GOOD[1]
            )
        })
    }

    fn as_built(&self) -> &[(Method, Measured)] {
        self.changed.first().map_or(&[], |row| &row.normals)
    }
}

fn of_method(rows: &[(Method, Measured)], method: Method) -> Option<Measured> {
    rows.iter().find(|row| row.0 == method).map(|row| row.1)
}

/// Presses unseen shapes, and perceives `count` grasps, evenly spread over the list, as built and under every change.
/// The background images are taken under the change too, as a hand takes them when it is switched on.
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
    let changes = if count == 0 { &[][..] } else { &Change::ALL };
    std::iter::once(&Change::NONE)
        .chain(changes)
        .map(|change| {
            let hand = &bench.world.cell.robot.hand;
            let eyes = [Eyes::new(hand, HAND_UNIT, change)?, Eyes::new(hand, HAND_UNIT + 1, change)?];
            let look_up = simulated_touch(&bench.world.cell.robot, eyes[0].backgrounds())?;
            let sampled: Vec<Sampled> = unseen(&eyes, bench.seed)?;
            let normals = Method::ALL
                .map(|method| Ok((method, measure(&sampled, &eyes, &networks.pipeline(&look_up, method))?)))
                .into_iter()
                .collect::<Result<_>>()?;
            let poses = Method::ALL
                .into_iter()
                .filter(|method| !some.is_empty() && (*method == IN_USE || *change == Change::NONE))
                .map(|method| {
                    let felt = feel(bench, &eyes[0], &networks.pipeline(&look_up, method), &some, || {})?;
                    Ok((method, spread(&felt, PoseSource::Touch, |_| true)))
                })
                .collect::<Result<_>>()?;
            Ok(ChangedOptics { change: change.name, normals, poses })
        })
        .collect()
}

/// Returns the steps from images to a pose with their latencies for each [`FeltGrasp`], ms.
fn steps(felt: &[FeltGrasp]) -> [(&'static str, Vec<f64>); 3] {
    let of = |pick: &dyn Fn(&FeltGrasp) -> f64| felt.iter().map(pick).collect();
    [
        ("images", of(&|felt| felt.millis[0])),
        ("pose", of(&|felt| felt.millis[1])),
        ("chain", of(&|felt| felt.millis.iter().sum())),
    ]
}
