//! Errors of in-hand poses of simulated grasps by kind of object, compared with the plan and with felt points alone.

use std::borrow::Cow;
use std::time::Instant;

use anyhow::Result;
use bench::trial::{Bench, HeldGrasp};
use control::perception::KnownObject;
use nalgebra::{Isometry3, Matrix3, UnitQuaternion};
use schemars::JsonSchema;
use serde::Serialize;
use statistics::percentile;
use touch::{InHand, PoseEstimate, PoseOptions, TouchPipeline};
use world::objects::{ObjectModel, Symmetry};

use super::images::Eyes;

/// What a pose is made from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum PoseSource {
    /// Where the plan has the object.
    Plan,
    /// Servos and felt points: no normals, no absence of touch.
    Points,
    /// All that is felt and not felt.
    Touch,
}

/// A grasp as it was felt.
pub struct FeltGrasp {
    pub object: String,
    pub class: Class,
    /// Error of the plan, of felt points alone, of touch: mm and degrees.
    pub errors: [[f64; 2]; 3],
    /// Error over the stated standard deviation, position.
    pub ratio: f64,
    /// Whether the position lies in the stated ellipsoid of 95 %.
    pub covered: bool,
    /// Whether a pose found by descending from the truth has a lower cost than the estimate: the search is at fault.
    pub missed: bool,
    /// Otherwise, whether the truth itself has a clearly higher cost: the evidence is misleading.
    pub misled: bool,
    /// Time from raw images to touches, and from touches to the pose, ms.
    pub millis: [f64; 2],
}

/// A pose is clearly worse from this difference of costs (log-likelihood) on.
const CLEARLY: f64 = 3.0;
/// A pose is better from this difference on.
const BETTER: f64 = 0.3;
/// 95 % of the squared, scaled errors of three numbers are below this (chi-squared, three degrees of freedom).
const COVERED: f64 = 7.815;

/// Kinds of objects by their symmetry.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Class {
    /// Every turn looks the same.
    Ball,
    /// Round about an axis.
    Round,
    /// Some turns look the same.
    Box,
    /// No turn looks the same.
    Irregular,
}

impl Class {
    /// All, in the order of tables.
    pub const ALL: [Self; 4] = [Self::Ball, Self::Round, Self::Box, Self::Irregular];

    fn of(object: &ObjectModel) -> Self {
        match object.symmetry {
            Symmetry::Full => Self::Ball,
            Symmetry::Axis { .. } => Self::Round,
            Symmetry::Fold { .. } | Symmetry::Cube => Self::Box,
            Symmetry::None => Self::Irregular,
        }
    }

    /// In words; the key in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ball => "ball",
            Self::Round => "round",
            Self::Box => "box",
            Self::Irregular => "irregular",
        }
    }
}

/// Distance (mm) and angle (degrees, given the object's symmetry) of two poses.
pub fn apart(object: &ObjectModel, pose: &Isometry3<f64>, truth: &Isometry3<f64>) -> [f64; 2] {
    [
        1e3 * (pose.translation.vector - truth.translation.vector).norm(),
        object.symmetry.angle(&truth.rotation, &pose.rotation).to_degrees(),
    ]
}

/// The true pose, turned as little from `estimate` as the object's discrete symmetry allows: the plan has a say in what a pose
/// costs.
fn looking_alike(object: &ObjectModel, truth: &Isometry3<f64>, estimate: &Isometry3<f64>) -> Isometry3<f64> {
    let turned = |turn: &UnitQuaternion<f64>| (truth.rotation * turn).angle_to(&estimate.rotation);
    let best = object.symmetry.turns().into_iter().min_by(|a, b| turned(a).total_cmp(&turned(b)));
    best.map_or(*truth, |turn| truth * turn)
}

/// Squared error of the position in stated standard deviations.
fn squared(estimate: &PoseEstimate, truth: &Isometry3<f64>) -> Option<f64> {
    let error = estimate.palm_from_object.translation.vector - truth.translation.vector;
    let covariance: Matrix3<f64> = estimate.region().fixed_view::<3, 3>(0, 0).into_owned();
    Some(error.dot(&covariance.cholesky()?.solve(&error)))
}

/// Feels every grasp once.
pub fn feel(
    bench: &Bench,
    eyes: &Eyes,
    pipeline: &TouchPipeline,
    grasps: &[HeldGrasp],
    mut seen: impl FnMut(),
) -> Result<Vec<FeltGrasp>> {
    grasps
        .iter()
        .enumerate()
        .map(|(n, grasp)| {
            let known: &KnownObject = &bench.known[&grasp.object];
            // As a trial does before it begins.
            known.prepare();
            let object = &known.model;
            let seed = bench.seed ^ (n as u64) << 20;
            let frames = eyes.look(grasp, &object.shape, seed);
            let pipeline = match eyes.background_frames(grasp, seed) {
                Some(frames) => Cow::Owned(pipeline.with_backgrounds(frames)?),
                None => Cow::Borrowed(pipeline),
            };
            let mut points_only = pipeline.clone().into_owned();
            points_only.pose = PoseOptions { use_clear: false, sigma_normal: f64::INFINITY, ..pipeline.pose };
            let (prior, servos) = (grasp.prior, grasp.servos());
            let readings = grasp.readings(&servos);
            let begun = Instant::now();
            let mut touches = pipeline.perceive_frames(&frames, &[])?.touches;
            pipeline.mark_own(&mut touches, readings, &[InHand { shape: known, prior }])?;
            let perceived = begun.elapsed();
            let estimate = pipeline.estimate_pose(&touches, readings, &prior, known)?;
            let estimated = begun.elapsed() - perceived;
            let truth = looking_alike(object, &grasp.truth, &estimate.palm_from_object);
            let [there, below] = pipeline.costs_from_pose(&touches, readings, &prior, known, &truth)?;
            let points = points_only.estimate_pose(&touches, readings, &prior, known)?;
            seen();
            let poses = [prior.palm_from_object, points.palm_from_object, estimate.palm_from_object];
            let errors = poses.map(|pose| apart(object, &pose, &grasp.truth));
            Ok(FeltGrasp {
                object: object.name.clone(),
                class: Class::of(object),
                errors,
                ratio: 1e-3 * errors[2][0] / (3f64.sqrt() * estimate.sigma().0),
                covered: squared(&estimate, &grasp.truth).is_some_and(|squared| squared < COVERED),
                missed: below < estimate.cost - BETTER,
                misled: below >= estimate.cost - BETTER && there > estimate.cost + CLEARLY,
                millis: [perceived, estimated].map(|time| 1e3 * time.as_secs_f64()),
            })
        })
        .collect()
}

/// Median and 95th percentile of position (mm) and rotation (degrees).
#[derive(Debug, Clone, Copy, Serialize, JsonSchema)]
pub struct Spread {
    pub grasps: usize,
    /// Position, mm.
    pub mm: MedianP95,
    /// Rotation, degrees.
    pub deg: MedianP95,
}

/// Where errors come from, as shares of the grasps.
#[derive(Debug, Clone, Copy, Serialize, JsonSchema)]
pub struct Causes {
    /// Positions in the stated ellipsoid of 95 %.
    pub covered: f64,
    /// More than [`FAR`] off.
    pub far: f64,
    /// Far off, and the truth has a clearly higher cost than the estimate: the evidence is misleading.
    pub misled: f64,
    /// Far off, and a pose near the truth has a lower cost: the search missed it. The cause of the rest is unknown.
    pub missed: f64,
}

/// Position error (mm) from which its cause is asked for.
pub const FAR: f64 = 2.0;

/// Causes among the grasps that `pick` takes.
pub fn causes(felt: &[FeltGrasp], pick: impl Fn(&FeltGrasp) -> bool) -> Causes {
    let picked: Vec<&FeltGrasp> = felt.iter().filter(|felt| pick(felt)).collect();
    let share = |of: &dyn Fn(&FeltGrasp) -> bool| {
        picked.iter().filter(|felt| of(felt)).count() as f64 / picked.len().max(1) as f64
    };
    let far = |felt: &FeltGrasp| felt.errors[PoseSource::Touch as usize][0] > FAR;
    Causes {
        covered: share(&|felt| felt.covered),
        far: share(&far),
        misled: share(&|felt| far(felt) && felt.misled),
        missed: share(&|felt| far(felt) && felt.missed),
    }
}

/// A median and a 95th percentile.
#[derive(Debug, Clone, Copy, Serialize, JsonSchema)]
#[allow(missing_docs)]
pub struct MedianP95 {
    pub median: Option<f64>,
    pub p95: Option<f64>,
}

impl MedianP95 {
    pub fn of(values: &[f64]) -> Self {
        Self { median: percentile(values, 50.0), p95: percentile(values, 95.0) }
    }
}

/// Spread of the errors of `source` among the grasps that `pick` takes.
pub fn spread(felt: &[FeltGrasp], source: PoseSource, pick: impl Fn(&FeltGrasp) -> bool) -> Spread {
    let picked: Vec<[f64; 2]> =
        felt.iter().filter(|felt| pick(felt)).map(|felt| felt.errors[source as usize]).collect();
    let part = |axis: usize| MedianP95::of(&picked.iter().map(|error| error[axis]).collect::<Vec<_>>());
    Spread { grasps: picked.len(), mm: part(0), deg: part(1) }
}
