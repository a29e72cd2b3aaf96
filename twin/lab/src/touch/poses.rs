//! Errors of in-hand pose estimates of simulated grasps by class of object, compared with the prior and with contact
//! points only.

use std::borrow::Cow;
use std::time::Instant;

use anyhow::Result;
use bench::trial::{Bench, HeldGrasp};
use control::perception::KnownObject;
use nalgebra::{Isometry3, Matrix3, UnitQuaternion};
use schemars::JsonSchema;
use serde::Serialize;
use statistics::percentile;
use tactile_perception::{ExpectedObject, PoseEstimate, PoseOptions, TouchPipeline};
use world::objects::{ObjectModel, Symmetry};

use super::images::CameraUnit;

/// Source of a pose estimate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum PoseSource {
    /// Planned pose of the object (the prior).
    Prior,
    /// Servos and contact points, without normals and without absence of touch.
    Points,
    /// All evidence of touch, including absence of touch.
    Touch,
}

/// Evaluation of one perceived grasp.
pub struct PoseEvaluation {
    pub object: String,
    pub class: SymmetryClass,
    /// Errors of the prior, of contact points only, and of touch: mm and degrees.
    pub errors: [[f64; 2]; 3],
    /// Ratio of position error to stated standard deviation.
    pub ratio: f64,
    /// True if the true position lies in the stated 95 % ellipsoid.
    pub covered: bool,
    /// True if a pose found by descending from the truth has a lower cost than the estimate: the search is at fault.
    pub missed: bool,
    /// True if not `missed`, and the truth has a clearly higher cost than the estimate: the evidence is misleading.
    pub misled: bool,
    /// Latencies from raw images to touches, and from touches to the pose, ms.
    pub millis: [f64; 2],
}

/// Cost difference (log-likelihood) from which a pose is clearly worse.
const CLEAR_COST_DIFFERENCE: f64 = 3.0;
/// Cost difference (log-likelihood) from which a pose is better.
const BETTER_COST_DIFFERENCE: f64 = 0.3;
/// Gate on the squared normalized error of the position: 95 % quantile of chi-squared with three degrees of freedom.
const COVERAGE_GATE: f64 = 7.815;

/// Classes of objects by their rotational symmetry.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SymmetryClass {
    /// Full rotational symmetry.
    Ball,
    /// Rotational symmetry about an axis.
    Round,
    /// Discrete rotational symmetry.
    Box,
    /// No rotational symmetry.
    Irregular,
}

impl SymmetryClass {
    /// All classes, in the order of tables.
    pub const ALL: [Self; 4] = [Self::Ball, Self::Round, Self::Box, Self::Irregular];

    fn of(object: &ObjectModel) -> Self {
        match object.symmetry {
            Symmetry::Full => Self::Ball,
            Symmetry::Axis { .. } => Self::Round,
            Symmetry::Fold { .. } | Symmetry::Cube => Self::Box,
            Symmetry::None => Self::Irregular,
        }
    }

    /// Returns the name, which is also the key in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ball => "ball",
            Self::Round => "round",
            Self::Box => "box",
            Self::Irregular => "irregular",
        }
    }
}

/// Returns distance (mm) and angle (degrees, given the object's symmetry) between two poses.
pub fn pose_difference(object: &ObjectModel, pose: &Isometry3<f64>, truth: &Isometry3<f64>) -> [f64; 2] {
    [
        1e3 * (pose.translation.vector - truth.translation.vector).norm(),
        object.symmetry.angle(&truth.rotation, &pose.rotation).to_degrees(),
    ]
}

/// Returns, of all poses equivalent to the truth by the object's discrete symmetry, the one whose rotation is closest
/// to `estimate`. This matters because the prior contributes to a pose's cost.
fn nearest_symmetric_pose(object: &ObjectModel, truth: &Isometry3<f64>, estimate: &Isometry3<f64>) -> Isometry3<f64> {
    let turned = |turn: &UnitQuaternion<f64>| (truth.rotation * turn).angle_to(&estimate.rotation);
    let best = object.symmetry.rotations().into_iter().min_by(|a, b| turned(a).total_cmp(&turned(b)));
    best.map_or(*truth, |turn| truth * turn)
}

/// Returns the squared position error in units of the stated covariance (squared Mahalanobis distance).
fn squared_mahalanobis(estimate: &PoseEstimate, truth: &Isometry3<f64>) -> Option<f64> {
    let error = estimate.palm_from_object.translation.vector - truth.translation.vector;
    let covariance: Matrix3<f64> = estimate.region().fixed_view::<3, 3>(0, 0).into_owned();
    Some(error.dot(&covariance.cholesky()?.solve(&error)))
}

/// Perceives every grasp once, and evaluates the estimates.
pub fn evaluate_poses(
    bench: &Bench,
    detector: &CameraUnit,
    pipeline: &TouchPipeline,
    grasps: &[HeldGrasp],
    mut seen: impl FnMut(),
) -> Result<Vec<PoseEvaluation>> {
    grasps
        .iter()
        .enumerate()
        .map(|(n, grasp)| {
            let known: &KnownObject = &bench.known_objects[&grasp.object];
            // A trial does the same at its start.
            known.prepare();
            let object = &known.model;
            let seed = bench.seed ^ (n as u64) << 20;
            let frames = detector.render_images(grasp, &object.shape, seed);
            let pipeline = match detector.background_frames(grasp, seed) {
                Some(frames) => Cow::Owned(pipeline.with_backgrounds(frames)?),
                None => Cow::Borrowed(pipeline),
            };
            let mut points_only = pipeline.clone().into_owned();
            points_only.pose = PoseOptions { use_contact_free: false, sigma_normal: f64::INFINITY, ..pipeline.pose };
            let (prior, servos) = (grasp.prior, grasp.servos());
            let readings = grasp.readings(&servos);
            let begun = Instant::now();
            let mut touches = pipeline.perceive_frames(&frames, &[])?.touches;
            pipeline.mark_self_contacts(&mut touches, readings, &[ExpectedObject { shape: known, prior }])?;
            let perceived = begun.elapsed();
            let estimate = pipeline.estimate_pose(&touches, readings, &prior, known)?;
            let estimated = begun.elapsed() - perceived;
            let truth = nearest_symmetric_pose(object, &grasp.truth, &estimate.palm_from_object);
            let [there, below] = pipeline.costs_from_pose(&touches, readings, &prior, known, &truth)?;
            let points = points_only.estimate_pose(&touches, readings, &prior, known)?;
            seen();
            let poses = [prior.palm_from_object, points.palm_from_object, estimate.palm_from_object];
            let errors = poses.map(|pose| pose_difference(object, &pose, &grasp.truth));
            Ok(PoseEvaluation {
                object: object.name.clone(),
                class: SymmetryClass::of(object),
                errors,
                ratio: 1e-3 * errors[2][0] / (3f64.sqrt() * estimate.sigma().0),
                covered: squared_mahalanobis(&estimate, &grasp.truth).is_some_and(|squared| squared < COVERAGE_GATE),
                missed: below < estimate.cost - BETTER_COST_DIFFERENCE,
                misled: below >= estimate.cost - BETTER_COST_DIFFERENCE
                    && there > estimate.cost + CLEAR_COST_DIFFERENCE,
                millis: [perceived, estimated].map(|time| 1e3 * time.as_secs_f64()),
            })
        })
        .collect()
}

/// Median and 95th percentile of position (mm) and rotation (degrees).
#[derive(Debug, Clone, Copy, Serialize, JsonSchema)]
pub struct ErrorPercentiles {
    pub grasps: usize,
    /// Position error, mm.
    pub mm: MedianP95,
    /// Rotation error, degrees.
    pub deg: MedianP95,
}

/// Causes of large errors, as shares of the grasps.
#[derive(Debug, Clone, Copy, Serialize, JsonSchema)]
pub struct Causes {
    /// True positions within the stated 95 % ellipsoid.
    pub covered: f64,
    /// Errors above [`LARGE_ERROR`].
    pub far: f64,
    /// Large errors for which the truth has a clearly higher cost than the estimate: the evidence is misleading.
    pub misled: f64,
    /// Large errors for which a pose near the truth has a lower cost: the search missed it. The cause of the others is
    /// unknown.
    pub missed: f64,
}

/// Position error (mm) above which an error counts as large and its cause is determined.
pub const LARGE_ERROR: f64 = 2.0;

/// Computes the causes among the grasps selected by `pick`.
pub fn causes(felt: &[PoseEvaluation], pick: impl Fn(&PoseEvaluation) -> bool) -> Causes {
    let picked: Vec<&PoseEvaluation> = felt.iter().filter(|felt| pick(felt)).collect();
    let share = |of: &dyn Fn(&PoseEvaluation) -> bool| {
        picked.iter().filter(|felt| of(felt)).count() as f64 / picked.len().max(1) as f64
    };
    let far = |felt: &PoseEvaluation| felt.errors[PoseSource::Touch as usize][0] > LARGE_ERROR;
    Causes {
        covered: share(&|felt| felt.covered),
        far: share(&far),
        misled: share(&|felt| far(felt) && felt.misled),
        missed: share(&|felt| far(felt) && felt.missed),
    }
}

/// Median and 95th percentile.
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

/// Computes the percentiles of the errors of `source` among the grasps selected by `pick`.
pub fn error_percentiles(
    felt: &[PoseEvaluation],
    source: PoseSource,
    pick: impl Fn(&PoseEvaluation) -> bool,
) -> ErrorPercentiles {
    let picked: Vec<[f64; 2]> =
        felt.iter().filter(|felt| pick(felt)).map(|felt| felt.errors[source as usize]).collect();
    let part = |axis: usize| MedianP95::of(&picked.iter().map(|error| error[axis]).collect::<Vec<_>>());
    ErrorPercentiles { grasps: picked.len(), mm: part(0), deg: part(1) }
}
